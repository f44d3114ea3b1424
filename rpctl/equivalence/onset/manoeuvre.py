"""Manoeuvres: families of steady motions by one number, a speed or a force, that end in an onset.

Each is as a test driver would do it: a circle ever faster, more and more drive, the brakes, a push.
The arm keeps its posture, wheels that steer are where the circle needs them, casters trail.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.drive import BASE_SPEEDS
from rpctl.drive.steering import heading_radius, steer, trailing_positions
from rpctl.dynamics.ground_reaction import Contacts
from rpctl.dynamics.push import Push, push_at, pushed_efforts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot

CIRCLE_SPANS = 1.5  # radius of the circle, of the distance between the outermost contacts
STEERING_MARGIN = 1.5  # of the tightest bend that the steering allows
SLIPS, TIPS = "slips", "tips"
AHEAD = np.array([1.0, 0.0, 0.0])
REST = np.zeros(3)


@dataclass(frozen=True)
class Manoeuvre:
    """A family of motions, and what ends it.

    Attributes:
        name: What the robot does, in words.
        ending: ``"slips"`` or ``"tips"``.
        unit: Of the number that grows: ``"m/s"`` or ``"N"``.
        twist: Of P per m/s of speed (3,); zeros where it is no speed.
        acceleration: Of P forward, per N of force, 1/kg.
        before: Speed at which it begins, times the acceleration, s: brakes need some.
        height: Of the push above P, m; 0 where there is none. Brakes hold the wheels then.
        push: Direction of the push (2,): forward and left, unit length.
    """

    name: str
    ending: str
    unit: str
    twist: tuple[float, float, float] = (0.0, 0.0, 0.0)
    acceleration: float = 0.0
    before: float = 0.0
    height: float = 0.0
    push: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Instant:
    """A motion at one of its instants, in the reduced model.

    Attributes:
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        force: Of the push on the root link (3,), world axes, N.
        moment: Of the push about that link's origin (3,), world axes, N·m.
        pushed: What the robot's coordinates feel of it.
        tau: Actuator efforts (n_act,), N·m or N.
        unforced: Those of the same motion without acceleration or push (n_act,).
    """

    q: Array
    nu: Array
    force: Array
    moment: Array
    pushed: Push
    tau: Array
    unforced: Array


def manoeuvres(
    dynamics: ReducedDynamics, contacts: Contacts, braking_time: float, ending: str
) -> Iterator[Manoeuvre]:
    """Yield the manoeuvres that make sense for a robot, each to the same ending.

    Args:
        dynamics: The robot's dynamics.
        contacts: How it stands.
        braking_time: How long brakes are on, s.
        ending: ``"slips"`` or ``"tips"``.
    """
    robot = dynamics.robot
    if (
        robot.drive.type != "skid-steer"
    ):  # it turns by scrubbing, which the reduced model leaves out
        radius = circle_radius(robot, contacts)
        turn = (1.0, 0.0, 1.0 / radius)
        yield Manoeuvre(f"circle of {radius:.2g} m", ending, "m/s", twist=turn)
    rate = 1.0 / robot.mass
    yield Manoeuvre("drives off", ending, "N", acceleration=rate)
    yield Manoeuvre("brakes", ending, "N", acceleration=-rate, before=braking_time)
    height = pushed_height(dynamics)
    for words, push in (("to its left", (0.0, 1.0)), ("ahead", (1.0, 0.0))):
        name = f"pushed {words} at {height:.2g} m"
        yield Manoeuvre(name, ending, "N", height=height, push=push)


def circle_radius(robot: Robot, contacts: Contacts) -> float:
    """Return the radius of the circle that a robot is to drive, m."""
    points = contacts.points
    span = float(np.hypot(*(points[:, None] - points[None]).T).max())
    tightest = heading_radius(robot.drive, robot.description.joint)
    return max(CIRCLE_SPANS * span, STEERING_MARGIN * tightest)


def pushed_height(dynamics: ReducedDynamics) -> float:
    """Return the height of the highest link above the ground with the arm at home, m."""
    model, data = dynamics.robot.model, dynamics.placements(configuration(dynamics.robot, AHEAD))
    pin.updateFramePlacements(model, data)
    bodies = [k for k, f in enumerate(model.frames) if f.type == pin.FrameType.BODY]
    highest = max(float(data.oMf[k].translation[2]) for k in bodies)
    return highest - dynamics.robot.drive.ground


def instant(dynamics: ReducedDynamics, manoeuvre: Manoeuvre, value: float) -> Instant:
    """Return a manoeuvre's motion at a speed (m/s) or force (N).

    Args:
        dynamics: The reduced dynamics.
        manoeuvre: The manoeuvre.
        value: The number that it is a family of.

    Raises:
        ActuationError: Nothing drives one of the quasi-velocities.
        SingularBasisError: The steered wheels fix no one motion.
    """
    robot = dynamics.robot
    acceleration = manoeuvre.acceleration * value
    twist = value * np.array(manoeuvre.twist)
    twist = twist - AHEAD * manoeuvre.before * acceleration
    q = configuration(robot, np.array(manoeuvre.twist) if any(manoeuvre.twist) else AHEAD)
    to_speeds = _speeds_of_twist(dynamics, q)
    nu, nu_dot, rest = to_speeds @ twist, to_speeds @ (acceleration * AHEAD), np.zeros(robot.dof)
    heading = robot.drive.heading
    (along, left), root = value * np.array(manoeuvre.push), robot.description.root
    cos, sin = math.cos(heading), math.sin(heading)
    force = np.array([cos * along - sin * left, sin * along + cos * left, 0.0])
    moment = np.cross([*robot.drive.point, robot.drive.ground + manoeuvre.height], force)
    pushed, none = push_at(dynamics, q, root, force, moment), push_at(dynamics, q, root, REST, REST)
    return Instant(
        q=q,
        nu=nu,
        force=force,
        moment=moment,
        pushed=pushed,
        tau=pushed_efforts(dynamics, q, nu, nu_dot, pushed),
        unforced=pushed_efforts(dynamics, q, nu, rest, none),
    )


def configuration(robot: Robot, twist: Array) -> Array:
    """Return q (nq,) at the origin: the arm at home, wheels steered and casters trailing.

    Args:
        robot: The robot.
        twist: Twist of P (3,) that its wheels are to allow, of any length.
    """
    drive, root = robot.drive, robot.root_velocity @ twist
    joints = dict(zip(robot.joint_names, robot.home, strict=True))
    if drive.steered:
        steering = steer(drive, np.vstack([root, np.zeros((2, 3))]))[0]
        joints |= zip((swivel.joint for swivel in drive.steered), steering.tolist(), strict=True)
    casters = [swivel for swivel in drive.swivels if swivel.role == "caster"]
    trailing = trailing_positions(drive, root, casters)
    joints |= zip((swivel.joint for swivel in casters), trailing.tolist(), strict=True)
    return robot.configuration(joints=joints)


def _speeds_of_twist(dynamics: ReducedDynamics, q: Array) -> Array:
    """Return the map (dof, 3) from twists of P to ν, all but the base's own speeds 0."""
    robot = dynamics.robot
    count = len(BASE_SPEEDS[robot.drive.type])
    found = np.zeros((robot.dof, 3))
    found[:count] = np.linalg.pinv(robot.point_velocity @ dynamics.basis(q)[:3, :count])
    return found
