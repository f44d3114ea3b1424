"""Facts of a robot at rest, as plain values for JSON, and what tells it from another."""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.robot.idealised import idealisations
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import Robot


def facts(robot: Robot) -> dict[str, Any]:
    """Return a robot's facts: its drive with the evidence, joints, limits and idealisations.

    Lengths are in m, angles in rad, masses in kg, efforts in N·m or N; a limit that the URDF does
    not give is infinite.
    """
    return {
        "name": robot.name,
        "file": str(robot.description.path),
        "dof": robot.dof,
        "nq": robot.nq,
        "nv": robot.nv,
        "mass": robot.mass,
        "estimated_links": robot.description.estimated_links,
        "drive": _drive(robot),
        "leans": _leaning(robot) if isinstance(robot, LeaningRobot) else None,
        "joints": [
            {
                "name": joint.name,
                "type": joint.kind,
                "lower": joint.lower,
                "upper": joint.upper,
                "velocity": joint.velocity,
                "effort": joint.effort,
                "line": joint.line,
                "home": home,
            }
            for joint, home in zip(robot.joints, robot.home.tolist(), strict=True)
        ],
        "losses": losses(robot),
        "mimics": [joint.name for joint in robot.mimics],
        "locked": dict(robot.locked),
        "quasi_velocities": robot.quasi_velocities,
        "meanings": meanings(robot),
        "actuators": robot.actuators,
        "end_effector": robot.end_effector,
        "idealised": [asdict(each) for each in idealisations(robot)],
        "findings": [asdict(finding) for finding in robot.findings],
    }


def losses(robot: Robot) -> list[dict[str, Any]]:
    """Return what each joint loses, and its rotor's inertia: joints that have neither are left out.

    ``damping`` is in N·m·s/rad or N·s/m, ``friction`` in N·m or N, ``rate`` in rad/s or m/s: a
    slower joint has less than its friction. ``armature`` is in kg·m² or kg.
    """
    found = []
    for name in robot.moving_joint_names:
        index, joint = robot.velocity_index(name), robot.description.joint[name]
        of = {"damping": 0.0, "friction": 0.0, "rate": 0.0}
        if robot.losses is not None:
            of = {key: float(getattr(robot.losses, key)[index]) for key in of}
        of["armature"] = float(robot.armature[index])
        if of["damping"] or of["friction"] or of["armature"]:
            found.append({"joint": name, "line": joint.line, "type": joint.kind, **of})
    return found


def _leaning(robot: LeaningRobot) -> dict[str, Any]:
    """Return about what a robot leans, at home, and how high its centre of mass is above that, m.

    That is the axle of wheels side by side, and of a bicycle the line on the ground.
    """
    at_home = dict(zip(robot.joint_names, robot.home.tolist(), strict=True))
    q, data = robot.configuration(joints=at_home), robot.model.createData()
    height = float(pin.centerOfMass(robot.model, data, q)[2])
    pin.forwardKinematics(robot.model, data, q)
    names = " and ".join(wheel.joint for wheel in robot.drive.wheels)
    if robot.rolls_sideways:
        return {
            "about": f"the line on the ground between {names}",
            "tilt": "roll",
            "height": height,
        }
    axle = robot.axles[0]
    height -= float(data.oMi[axle.joint].act(axle.centre)[2])
    return {"about": f"the axle of {names}", "tilt": "pitch", "height": height}


def _drive(robot: Robot) -> dict[str, Any]:
    """Return the drive with its evidence, and its wheels and swivels with their lines."""
    drive, joints = robot.drive, robot.description.joint
    wheels = [
        {
            **asdict(wheel),
            "effort": joints[wheel.joint].effort,
            "velocity": joints[wheel.joint].velocity,
            "line": joints[wheel.joint].line,
        }
        for wheel in drive.wheels
    ]
    swivels = [{**asdict(each), "line": joints[each.joint].line} for each in drive.swivels]
    return {
        "type": drive.type,
        "wheels": wheels,
        "track": drive.track,
        "point": drive.point,
        "heading_deg": math.degrees(drive.heading),
        "ground": drive.ground,
        "swivels": swivels,
        "evidence": drive.evidence,
        "doubts": drive.doubts,
    }


def meanings(robot: Robot) -> dict[str, str]:
    """Return the meaning and unit of each quasi-velocity, in words."""
    drive = robot.drive
    labels = {
        "vx": "speed of the root link's origin along its x axis, m/s",
        "vy": "speed of the root link's origin along its y axis, m/s",
        "v": "forward speed of P, m/s",
        "omega": "turning rate of the base, rad/s",
        "pitch_rate": "rate of the root link's pitch, forward positive, rad/s",
        "roll_rate": "rate of the root link's roll, to the right positive, rad/s",
    }
    if drive.steered and not drive.has_axle:
        first = [drive.wheels[i].joint for i in drive.carried(drive.steered[0])]
        labels["v"] = f"rolling speed of {' and '.join(first)} on average, m/s"
        if len(first) == 1:
            labels["v"] = f"rolling speed of {first[0]}, m/s"
    labels |= {swivel.joint: "steering rate, rad/s" for swivel in drive.steered}
    for joint in robot.joints:
        labels[joint.name] = "rate, m/s" if joint.kind == "prismatic" else "rate, rad/s"
    return {name: labels[name] for name in robot.quasi_velocities}


def robot_identity(robot: Robot) -> dict[str, Any]:
    """Return what tells a robot from another: its file, how it was loaded, its model's numbers."""
    return {
        "name": robot.name,
        "urdf": robot.description.sha256,
        "locked": dict(robot.locked),
        "home": dict(zip(robot.joint_names, robot.home.tolist(), strict=True)),
        "end_effector": robot.end_effector,
        "drive": _digest(repr(robot.drive).encode()),
        "model": model_digest(robot),
    }


def model_digest(robot: Robot) -> str:
    """Return a digest of all numbers of a robot's model: inertias, places, limits, losses."""
    model, described = robot.model, robot.description.joint
    moving = [described[name] for name in robot.moving_joint_names]
    parts = [
        *(inertia.toDynamicParameters() for inertia in model.inertias),
        *(place.homogeneous for place in model.jointPlacements),
        model.armature,
        robot.effort_limits,
        robot.velocity_limits,
        [(j.lower, j.upper, j.velocity, j.effort) for j in moving],
    ]
    if model.gravity.linear.tolist() != pin.Model.gravity981.tolist():  # all others' is that
        parts.append(model.gravity.linear)
    if robot.losses is not None:
        parts += [robot.losses.damping, robot.losses.friction]
    return _digest(b"".join(np.ascontiguousarray(part, float).tobytes() for part in parts))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
