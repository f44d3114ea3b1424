"""Ties between joints: mimics, and swivels that keep to the common centre of rotation.

What a tie rod does on a car, a constraint does here. Where one swivel leads, its follower's angle
is a polynomial of its own (MuJoCo's joint equality). Where several lead, a fixed tendon ties the
follower to them along their Jacobian, and :class:`Follower` keeps that up to date.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Drive
from rpctl.drive.steering import MAX_STEERING, follower_positions
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.robot.model import Robot

STEPS = 4.0  # timesteps: time constant of a tie
SOLIMP = (0.99, 0.999, 1e-3, 0.5, 2.0)
DEGREE = 4  # of MuJoCo's polynomial
FIT = 2e-3  # rad: largest error of a polynomial that stands for a tie rod
DIFFERENCE_STEP = 1e-6  # rad, of a difference quotient


@dataclass(frozen=True)
class Follower:
    """A swivel whose angle several others determine.

    Attributes:
        joint: Its joint.
        leaders: Joints of the others.
        tie: Name of the tendon and of the equality that tie it.
    """

    joint: str
    leaders: tuple[str, ...]
    tie: str


def tie_mimics(spec: Any, robot: Robot, settings: ContactSettings) -> None:
    """Tie mimic joints to what they follow.

    Args:
        spec: The ``MjSpec``, with its joints.
        robot: The robot.
        settings: Its timestep.
    """
    for joint in robot.mimics:
        if joint.mimic is not None and joint.mimic.joint not in robot.locked:
            coefficients = (joint.mimic.offset, joint.mimic.multiplier)
            _tie(spec, joint.name, joint.mimic.joint, coefficients, settings)


def tie_followers(
    spec: Any, robot: Robot, settings: ContactSettings
) -> tuple[tuple[Follower, ...], tuple[str, ...]]:
    """Tie followers to the swivels that lead them; return those that change, and notes.

    Args:
        spec: The ``MjSpec``, with its joints.
        robot: The robot.
        settings: Its timestep.
    """
    drive = robot.drive
    leaders = tuple(swivel.joint for swivel in drive.steered)
    changing, polynomials = [], []
    for swivel in drive.followers:
        fitted = _polynomial(robot, swivel.joint, leaders[0]) if len(leaders) == 1 else None
        if fitted is not None:
            _tie(spec, swivel.joint, leaders[0], tuple(fitted), settings)
            polynomials.append(swivel.joint)
            continue
        follower = Follower(swivel.joint, leaders, f"{swivel.joint}/tie")
        _add_tendon(spec, drive, follower, settings)
        changing.append(follower)
    notes: tuple[str, ...] = ()
    if polynomials:
        notes += (f"a tie rod, as a polynomial of degree {DEGREE}, turns {', '.join(polynomials)}",)
    if changing:
        names = ", ".join(follower.joint for follower in changing)
        notes += (
            f"tie rods that change with the steering hold {names} to the common centre of "
            "rotation; a model file alone has them as they are straight ahead",
        )
    return tuple(changing), notes


def linearised(drive: Drive, follower: Follower, at: dict[str, float]) -> tuple[float, Array]:
    """Return a follower's angle (rad) and its derivatives by the leaders' (n,).

    Args:
        drive: The drive.
        follower: The follower.
        at: The leaders' angles, rad.
    """
    place = follower_positions(drive, at)[follower.joint]
    jacobian = np.empty(len(follower.leaders))
    for k, leader in enumerate(follower.leaders):
        there = follower_positions(drive, at | {leader: at[leader] + DIFFERENCE_STEP})
        jacobian[k] = math.remainder(there[follower.joint] - place, math.pi) / DIFFERENCE_STEP
    return place, jacobian


def _polynomial(robot: Robot, follower: str, leader: str) -> Array | None:
    """Return the coefficients (5,) of a follower's angle, or None where none fits."""
    joint = robot.description.joint[leader]
    low, high = max(joint.lower, -MAX_STEERING), min(joint.upper, MAX_STEERING)
    angles = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.linspace(0.0, math.pi, 41))
    places = [follower_positions(robot.drive, {leader: float(a)})[follower] for a in angles]
    found = np.polynomial.polynomial.polyfit(angles, places, DEGREE)
    off = np.polynomial.polynomial.polyval(angles, found) - places
    return np.asarray(found) if np.abs(off).max() <= FIT else None


def _tie(
    spec: Any,
    follower: str,
    leader: str,
    coefficients: tuple[float, ...],
    settings: ContactSettings,
) -> None:
    """Make a joint's position a polynomial of another's."""
    mujoco = mujoco_library()
    tie = spec.add_equality(name1=follower, name2=leader)
    tie.type, tie.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
    tie.data[: len(coefficients)] = coefficients
    _stiffen(tie, settings)


def _add_tendon(spec: Any, drive: Drive, follower: Follower, settings: ContactSettings) -> None:
    mujoco = mujoco_library()
    place, jacobian = linearised(drive, follower, dict.fromkeys(follower.leaders, 0.0))
    tendon = spec.add_tendon(name=follower.tie)
    tendon.wrap_joint(follower.joint, 1.0)
    for leader, derivative in zip(follower.leaders, jacobian.tolist(), strict=True):
        tendon.wrap_joint(leader, -derivative)
    tie = spec.add_equality(name=follower.tie, name1=follower.tie)
    tie.type, tie.objtype = mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtObj.mjOBJ_TENDON
    tie.data[:] = 0.0
    tie.data[0] = place
    _stiffen(tie, settings)


def _stiffen(tie: Any, settings: ContactSettings) -> None:
    tie.solref, tie.solimp = [STEPS * settings.timestep, 1.0], SOLIMP
