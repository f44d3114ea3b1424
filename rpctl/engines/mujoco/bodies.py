"""The tree of bodies: one for each joint of the model, with its motor, limits and losses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.engines.mujoco.inertias import body_inertia, head_link, set_inertia
from rpctl.engines.mujoco.library import mujoco_library
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot

NO_LIMIT = 1e6  # rad or m: MuJoCo has no range that is open on one side
STOP_STEPS = 4.0  # timesteps: time constant of joint stops and of dry friction that holds
STOP_SOLIMP = (0.99, 0.999, 1e-3, 0.5, 2.0)
RESERVED = "world"  # MuJoCo's own body


def body_name(link: str) -> str:
    """Return what the body of a link is called: as the link, but for MuJoCo's own name."""
    return f"{link}_link" if link == RESERVED else link


def add_bodies(spec: Any, robot: Robot, settings: ContactSettings) -> tuple[str, ...]:
    """Add a robot's bodies and joints to a spec, its root link free; return what was mended.

    Links fixed to one another are one body, named after the first; the others are sites of it.

    Args:
        spec: The ``MjSpec``.
        robot: The robot.
        settings: Whether its joints lose anything.
    """
    model, bodies = robot.model, {0: spec.worldbody}
    said: list[str] = []
    for joint in range(ROOT_JOINT, model.njoints):
        link = head_link(robot, joint)
        place = np.eye(4) if joint == ROOT_JOINT else model.jointPlacements[joint].homogeneous
        body = bodies[model.parents[joint]].add_body(name=body_name(link))
        body.pos, body.quat = place[:3, 3], quaternion(place)
        bodies[joint] = body
        inertia, mended = body_inertia(robot, joint)
        set_inertia(body, inertia)
        said += mended
        if joint == ROOT_JOINT:
            body.add_freejoint()
        else:
            _add_joint(body, robot, robot.description.joint[model.names[joint]], settings)
        for name, pose in robot.tree.rigid_links(link):
            if name != link:
                body.add_site(name=name, pos=pose[:3, 3], quat=quaternion(pose))
    return tuple(said)


def add_motors(spec: Any, robot: Robot) -> None:
    """Add a motor to each actuator's joint, saturating at its limit, named after it.

    Its control is the effort at the joint, N·m or N: a gear is in the limit and in the rotor's
    inertia, seen from there.

    Args:
        spec: The ``MjSpec``, with its bodies.
        robot: The robot.
    """
    for name, limit in zip(robot.actuators, robot.effort_limits.tolist(), strict=True):
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco_library().mjtTrn.mjTRN_JOINT
        )
        motor.set_to_motor()
        motor.ctrllimited = math.isfinite(limit)
        if math.isfinite(limit):
            motor.ctrlrange = [-limit, limit]


def quaternion(pose: Array) -> Array:
    """Return MuJoCo's quaternion (4,) w, x, y, z of a pose (4, 4)."""
    found = np.zeros(4)
    mujoco_library().mju_mat2Quat(found, np.ascontiguousarray(pose[:3, :3]).ravel())
    return found


def _add_joint(body: Any, robot: Robot, joint: Joint, settings: ContactSettings) -> None:
    kinds = mujoco_library().mjtJoint
    kind = kinds.mjJNT_SLIDE if joint.kind == "prismatic" else kinds.mjJNT_HINGE
    added = body.add_joint(name=joint.name, type=kind, axis=joint.axis)
    index = robot.velocity_index(joint.name)
    added.armature = float(robot.armature[index])
    limited = not joint.endless and math.isfinite(min(abs(joint.lower), abs(joint.upper)))
    added.limited = limited
    if limited:
        added.range = np.clip([joint.lower, joint.upper], -NO_LIMIT, NO_LIMIT)
    added.solref_limit = added.solref_friction = [STOP_STEPS * settings.timestep, 1.0]
    added.solimp_friction = STOP_SOLIMP
    if settings.losses and robot.losses is not None:
        _set_damping(added, float(robot.losses.damping[index]))
        added.frictionloss = float(robot.losses.friction[index])


def _set_damping(joint: Any, damping: float) -> None:
    """Set viscous damping; from MuJoCo 4 on it is the first coefficient of a polynomial."""
    if np.ndim(joint.damping):
        joint.damping[0] = damping
    else:
        joint.damping = damping
