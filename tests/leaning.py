"""The project's own robots that lean, as what they are."""

from __future__ import annotations

import rpctl
from rpctl.robot.leaning import LeaningRobot

OWN = ("balancer", "wheel_legs", "whipple")


def leaning(name: str) -> LeaningRobot:
    """Return a robot of the catalogue that leans."""
    robot = rpctl.load(name)
    assert isinstance(robot, LeaningRobot)
    return robot
