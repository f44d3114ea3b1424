"""What there is to know of a robot before it moves, as plain values."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from rpctl.robot.idealised import idealisations
from rpctl.robot.model import Robot


def facts(robot: Robot) -> dict[str, Any]:
    """Return a robot's facts: drive and its evidence, joints with their limits, what is idealised.

    Lengths are in m, angles in rad, masses in kg, efforts in N·m or N; a limit that the URDF does
    not give is infinite.
    """
    drive = robot.drive
    wheels = []
    for wheel in drive.wheels:
        joint = robot.description.joint[wheel.joint]
        limits = {"effort": joint.effort, "velocity": joint.velocity, "line": joint.line}
        wheels.append({**asdict(wheel), **limits})
    swivels = [
        {**asdict(swivel), "line": robot.description.joint[swivel.joint].line}
        for swivel in drive.swivels
    ]
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
            "swivels": swivels,
            "evidence": drive.evidence,
            "doubts": drive.doubts,
        },
        "joints": joints,
        "mimics": [joint.name for joint in robot.mimics],
        "locked": dict(robot.locked),
        "quasi_velocities": robot.quasi_velocities,
        "meanings": meanings(robot),
        "actuators": robot.actuators,
        "end_effector": robot.end_effector,
        "idealised": [asdict(each) for each in idealisations(robot)],
        "findings": [asdict(finding) for finding in robot.findings],
    }


def meanings(robot: Robot) -> dict[str, str]:
    """Return what each quasi-velocity is, in words, with its unit."""
    drive = robot.drive
    labels = {
        "vx": "speed of the root link's origin along its x axis, m/s",
        "vy": "speed of the root link's origin along its y axis, m/s",
        "v": "forward speed of P, m/s",
        "omega": "turning rate of the base, rad/s",
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
