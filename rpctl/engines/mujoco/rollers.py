"""Rollers of mecanum and omni wheels: barrels around the wheel, each free about its own axis.

MuJoCo's friction has no direction that turns with a wheel, so what lets such a wheel slide along
one direction is what lets a real one: rollers. A roller's barrel is an ellipsoid whose profile has
the curvature of the wheel's rim along the roller, which lies at an angle γ to the axle: half its
length is √(b (r − b cos²γ))/sin γ with b its radius, so that the rim is round to fourth order.
Barrels overlap, for they do not collide.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.description.records import rotation
from rpctl.drive.drive import Wheel
from rpctl.engines.mujoco.bodies import body_name
from rpctl.engines.mujoco.inertias import BodyInertia, is_physical, set_inertia
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.engines.mujoco.touch import add_touching
from rpctl.robot.model import Robot

COUNT = 12  # of rollers on a wheel: its rim is round to a hundredth of its radius
THICKNESS = 0.25  # radius of a roller, of the wheel's
MASS = 5e-3  # of a roller, of the wheel's: rolling models give rollers none
HARD_STEPS = 3.0  # timesteps: time constant of a roller's contact; a soft one takes energy as each
HARD_IMPEDANCE = (0.9, 0.95, 1e-3, 0.5, 2.0)  # roller presses in and leaves
NOTE = (
    f"mecanum and omni wheels have {COUNT} barrel rollers each, at the drive's angle and of a "
    "two hundredth of the wheel's mass, taken from it"
)


def has_rollers(robot: Robot) -> bool:
    """Return whether a robot's wheels carry rollers."""
    return robot.drive.type in ("mecanum", "omni")


def add_rollers(
    spec: Any, robot: Robot, wheel: Wheel, settings: ContactSettings, friction: float
) -> dict[str, str]:
    """Add a wheel's rollers; return whose contact each of their geoms is.

    Args:
        spec: The ``MjSpec``, with its bodies.
        robot: The robot.
        wheel: The wheel.
        settings: How hard the contacts are.
        friction: Coefficient between rollers and ground.
    """
    joint = robot.description.joint[wheel.joint]
    R = robot.tree.pose(joint.child)[:3, :3]
    axle, along = np.array(wheel.axis), R.T @ np.array([*wheel.direction, 0.0])
    down = R.T @ np.array([0.0, 0.0, -1.0])
    b = THICKNESS * wheel.radius
    carried = robot.model.inertias[robot.model.getJointId(wheel.joint)]
    mass = MASS * float(carried.mass)
    inertia = BodyInertia(mass, np.zeros(3), 0.4 * mass * b * b * np.eye(3))
    cos = float(along @ axle)
    half = math.sqrt(b * (wheel.radius - b * cos**2) / (1.0 - cos**2))
    body = spec.body(body_name(joint.child))
    owners, places = {}, []
    for k in range(COUNT):
        turn = rotation(axle, 2.0 * math.pi * k / COUNT)
        name, pose = f"{wheel.joint}/roller{k}", np.eye(4)
        axis = turn @ along
        pose[:3, :3] = _frame(axis)
        place = wheel.offset * axle + (wheel.radius - b) * (turn @ down)
        roller = body.add_body(name=name, pos=place)
        roller.add_joint(name=name, type=mujoco_library().mjtJoint.mjJNT_HINGE, axis=axis)
        set_inertia(roller, inertia)
        size = [b, b, half]
        pair = add_touching(spec, roller, name, "ELLIPSOID", size, pose, friction, settings)
        pair.solref, pair.solimp = [HARD_STEPS * settings.timestep, 1.0], HARD_IMPEDANCE
        owners[name] = wheel.joint
        places.append(place)
    rest = _without(carried, inertia, places)
    if is_physical(rest):
        set_inertia(body, rest)
    return owners


def _frame(axis: Array) -> Array:
    """Return a rotation (3, 3) whose z axis is ``axis`` (3,)."""
    across = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(axis, across), axis])


def _without(carried: pin.Inertia, roller: BodyInertia, places: list[Array]) -> BodyInertia:
    """Return what is left of a wheel without rollers at some places (3,), by Steiner's rule."""
    mass = float(carried.mass) - len(places) * roller.mass
    moment = carried.mass * carried.lever - roller.mass * np.sum(places, axis=0)
    com = moment / mass
    inertia = carried.inertia + carried.mass * _spread(carried.lever)
    for place in places:
        inertia = inertia - roller.inertia - roller.mass * _spread(place)
    return BodyInertia(mass, com, inertia - mass * _spread(com))


def _spread(r: Array) -> Array:
    """Return the inertia (3, 3) of a unit mass at r (3,) about the origin."""
    return np.asarray(r @ r * np.eye(3) - np.outer(r, r))
