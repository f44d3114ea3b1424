"""What there is to know of a robot before it moves, as plain values."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from rpctl.robot.model import Robot


def facts(robot: Robot) -> dict[str, Any]:
    """Return a robot's facts: drive, wheels, joints with their limits, findings.

    Lengths are in m, angles in rad, masses in kg, efforts in N·m or N; a limit that the URDF does
    not give is infinite.
    """
    drive = robot.drive
    wheels = []
    for wheel in drive.wheels:
        joint = robot.description.joint[wheel.joint]
        limits = {"effort": joint.effort, "velocity": joint.velocity, "line": joint.line}
        wheels.append({**asdict(wheel), **limits})
    joints = [
        {
            "name": joint.name,
            "type": joint.kind,
            "lower": joint.lower,
            "upper": joint.upper,
            "velocity": joint.velocity,
            "effort": joint.effort,
            "line": joint.line,
        }
        for joint in robot.joints
    ]
    return {
        "name": robot.name,
        "file": str(robot.description.path),
        "dof": robot.dof,
        "nq": robot.nq,
        "nv": robot.nv,
        "mass": robot.mass,
        "estimated_links": robot.description.estimated_links,
        "drive": {
            "type": drive.type,
            "wheels": wheels,
            "track": drive.track,
            "point": drive.point,
            "heading_deg": math.degrees(drive.heading),
            "ground": drive.ground,
        },
        "joints": joints,
        "mimics": [joint.name for joint in robot.mimics],
        "locked": dict(robot.locked),
        "quasi_velocities": robot.quasi_velocities,
        "actuators": robot.actuators,
        "end_effector": robot.end_effector,
        "findings": [asdict(finding) for finding in robot.findings],
    }
