"""Manoeuvres, and where the reduced model predicts that they end: a number, or an interval.

A manoeuvre is a family of steady motions by one number, a speed or a force: a circle ever faster,
more and more drive, the brakes, a push. The arm keeps its posture, wheels that steer are where the
circle needs them, casters trail.

Tipping is a matter of the zero-moment point and the support polygon alone, and so one number for
any number of contacts. So is slipping of a robot on three contacts. With more, the split of the
load decides: from the first number the robot slips for one split at least (it could), from the
second for all of them (it would).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.drive import BASE_SPEEDS
from rpctl.drive.steering import heading_radius
from rpctl.dynamics.grip import WheelForces, missing_grip, wheel_forces
from rpctl.dynamics.ground_reaction import Contacts, GroundReaction, ground_reactions, stance_at
from rpctl.dynamics.reduced import OutsideForce, ReducedDynamics, push_at, pushed_efforts
from rpctl.equivalence.contact.plan import AHEAD, start
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

CIRCLE_SPANS = 1.5  # radius of the circle, of the distance between the outermost contacts
STEERING_MARGIN = 1.5  # of the tightest bend that the steering allows
SLIPS, TIPS = "slips", "tips"
REST = np.zeros(3)
SMALLEST, LARGEST = 1e-3, 64.0  # of the natural size: where an onset is looked for
RESOLUTION = 1e-4  # relative, of a predicted onset
ALMOST = 0.98  # of the value at which it tips: up to there its wheels must not slip
SLIPS_FIRST = "the wheels that must drive carry no load where it would tip: it slips before"
LOAD_RESOLUTION = 1e-9  # of the weight: a smaller load is rounding


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
    pushed: OutsideForce
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
        yield Manoeuvre(f"circle of {radius:.2g} m", ending, "m/s", twist=(1.0, 0.0, 1.0 / radius))
    rate = 1.0 / robot.mass
    yield Manoeuvre("drives off", ending, "N", acceleration=rate)
    yield Manoeuvre("brakes", ending, "N", acceleration=-rate, before=braking_time)
    height = pushed_height(dynamics)
    for words, push in (("to its left", (0.0, 1.0)), ("ahead", (1.0, 0.0))):
        yield Manoeuvre(f"pushed {words} at {height:.2g} m", ending, "N", height=height, push=push)


def circle_radius(robot: Robot, contacts: Contacts) -> float:
    """Return the radius of the circle that a robot is to drive, m."""
    points = contacts.points
    span = float(np.hypot(*(points[:, None] - points[None]).T).max())
    tightest = heading_radius(robot.drive, robot.description.joint)
    return max(CIRCLE_SPANS * span, STEERING_MARGIN * tightest)


def pushed_height(dynamics: ReducedDynamics) -> float:
    """Return the height of the highest link above the ground with the arm at home, m."""
    model, data = dynamics.robot.model, dynamics.placements(start(dynamics.robot, AHEAD))
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
    q = start(robot, np.array(manoeuvre.twist) if any(manoeuvre.twist) else AHEAD)
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


def _speeds_of_twist(dynamics: ReducedDynamics, q: Array) -> Array:
    """Return the map (dof, 3) from twists of P to ν, all but the base's own speeds 0."""
    robot = dynamics.robot
    count = len(BASE_SPEEDS[robot.drive.type])
    found = np.zeros((robot.dof, 3))
    found[:count] = np.linalg.pinv(robot.point_velocity @ dynamics.basis(q)[:3, :count])
    return found


class SlipsFirst(RpctlError):
    """A robot does not tip that way: whatever the friction, it slips before."""


@dataclass(frozen=True)
class Predicted:
    """An onset as predicted, in the manoeuvre's unit; infinite where there is none.

    Attributes:
        could: From here on it slips for one split of the load at least; tips.
        would: From here on it slips for all of them; tips. The same number where it is one.
        equal: That of equally stiff contacts: ``would`` where loads are determinate.
    """

    could: float
    would: float
    equal: float


def predict(dynamics: ReducedDynamics, contacts: Contacts, manoeuvre: Manoeuvre) -> Predicted:
    """Return where a manoeuvre ends.

    Args:
        dynamics: The robot's reduced dynamics.
        contacts: How it stands, and its friction.
        manoeuvre: The manoeuvre.
    """
    size = natural_size(dynamics, manoeuvre)

    def first(ends: Callable[[_Balance], bool]) -> float:
        return find_onset(lambda value: ends(_balance(dynamics, contacts, manoeuvre, value)), size)

    if manoeuvre.ending != SLIPS:
        tips = first(_tips)
        if math.isfinite(tips):
            end, before = (
                _balance(dynamics, contacts, manoeuvre, share * tips) for share in (1.0, ALMOST)
            )
            held = contacts.friction * end.equal[: len(end.forces.least)].sum()
            if held < end.push or _slips(before, contacts.friction, before.equal):
                raise SlipsFirst(SLIPS_FIRST)
        return Predicted(tips, tips, tips)
    equal = first(lambda at: _slips(at, contacts.friction, at.equal))
    if contacts.determinate:
        return Predicted(equal, equal, equal)
    would = first(lambda at: _slips(at, contacts.friction, None))
    could = first(lambda at: any(_slips(at, contacts.friction, load) for load in at.corners()))
    return Predicted(min(could, equal), would, equal)


def natural_size(dynamics: ReducedDynamics, manoeuvre: Manoeuvre) -> float:
    """Return the size around which an onset lies: the weight, or the speed with it for an inertia.

    Args:
        dynamics: The robot's reduced dynamics.
        manoeuvre: The manoeuvre.
    """
    g = float(np.linalg.norm(dynamics.robot.model.gravity.linear))
    if manoeuvre.unit == "m/s":
        return math.sqrt(g / abs(manoeuvre.twist[2]))
    return dynamics.robot.mass * g


def find_onset(ends: Callable[[float], bool], size: float) -> float:
    """Return the number from which on a manoeuvre ends: 0 if any ends it, infinite if none does.

    Args:
        ends: Whether it ends at a number; once it does it does for all larger ones.
        size: Around which it lies.
    """
    high = SMALLEST * size
    if ends(high):
        return 0.0
    while not ends(high):
        high *= 2.0
        if high > LARGEST * size:
            return math.inf
    return bisected(ends, 0.5 * high, high, RESOLUTION)


def bisected(ends: Callable[[float], bool], low: float, high: float, resolution: float) -> float:
    """Return the number between two from which on a manoeuvre ends, to a relative resolution."""
    while high - low > resolution * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if ends(middle) else (middle, high)
    return 0.5 * (low + high)


@dataclass(frozen=True, eq=False)
class _Balance:
    """What the ground would have to do at one instant of a manoeuvre."""

    forces: WheelForces
    statics: Array
    moments: Array
    ground: GroundReaction

    @property
    def equal(self) -> Array:
        """Loads of equally stiff contacts (n,), N."""
        return self.ground.load[0]

    @property
    def push(self) -> float:
        """Size of the ground's horizontal force, N."""
        return float(np.hypot(*self.ground.force[0, :2]))

    def corners(self) -> list[Array]:
        """Return the loads (n,) of all triples of contacts that can bear the robot, N."""
        found = []
        for triple in combinations(range(self.statics.shape[1]), 3):
            part = self.statics[:, triple]
            if np.linalg.svd(part, compute_uv=False)[-1] < LOAD_RESOLUTION:
                continue
            load = np.linalg.solve(part, self.moments)
            if load.min() >= -LOAD_RESOLUTION * self.moments[0]:
                whole = np.zeros(self.statics.shape[1])
                whole[list(triple)] = load
                found.append(whole)
        return found


def _balance(
    dynamics: ReducedDynamics, contacts: Contacts, manoeuvre: Manoeuvre, value: float
) -> _Balance:
    at = instant(dynamics, manoeuvre, value)
    pushed = OutsideForce(*(part[None] for part in at.pushed))
    reactions = dynamics.reactions(at.q[None], at.nu[None], at.tau[None], outside=pushed)
    f, z = reactions.wrench[0], dynamics.robot.drive.ground
    return _Balance(
        forces=wheel_forces(dynamics, contacts, at.q, reactions, manoeuvre.height > 0.0),
        statics=stance_at(dynamics, contacts, at.q).statics,
        moments=np.array([f[2], z * f[0] - f[4], z * f[1] + f[3]]),
        ground=ground_reactions(dynamics, contacts, at.q[None], reactions),
    )


def _tips(at: _Balance) -> bool:
    margin = at.ground.tip_margin
    return margin is not None and bool(margin[0] < 0.0)


def _slips(at: _Balance, friction: float, load: Array | None) -> bool:
    if load is not None and load.min() < -LOAD_RESOLUTION * at.moments[0]:
        return True  # it tips before
    return missing_grip(at.forces, at.statics, at.moments, friction, load) > 0.0
