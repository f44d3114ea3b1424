"""Robots with tighter limits, and one that is easy to tip."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rpctl.description.records import Joint
from rpctl.robot.load import load
from rpctl.robot.model import Robot
from tests.robots import SET_A, ball, cargo, platform, write


def limited(robot: Robot, effort: float = 1.0, speed: float = 1.0) -> Robot:
    """Return a robot whose limits are these shares of what they were."""

    def tighter(joint: Joint) -> Joint:
        return replace(joint, effort=effort * joint.effort, velocity=speed * joint.velocity)

    joints = tuple(map(tighter, robot.description.joints))
    description = replace(robot.description, joints=joints)
    return replace(robot, description=description, joints=tuple(map(tighter, robot.joints)))


def tall(folder: Path) -> Robot:
    """Return a platform on two wheels and a ball, 30 kg of cargo at 1.6 m."""
    extra = ball(0.9) + cargo(30.0, 0.35, 0.0, 1.6)
    return load(write(folder, platform(SET_A, extra=extra), "tall.urdf"))
