"""The project's own robots that lean, as what they are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import rpctl
from rpctl import Plant, Run, Wrench
from rpctl.robot.leaning import LeaningRobot

OWN = ("balancer", "wheel_legs", "whipple")
PUSHES = {  # 10 N s half a metre high, 3 N s at the hips, 2 N s from the side
    "balancer": Wrench("base_link", (100.0, 0.0, 0.0), (0.0, 50.0, 0.0), start=3.0, end=3.1),
    "wheel_legs": Wrench("base_link", (30.0, 0.0, 0.0), start=3.0, end=3.1),
    "whipple": Wrench("base_link", (0.0, 20.0, 0.0), (-18.0, 0.0, 0.0), start=3.0, end=3.1),
}


@cache  # its linear model takes half a second, and is kept for the robot itself
def leaning(name: str) -> LeaningRobot:
    """Return a robot of the catalogue that leans."""
    robot = rpctl.load(name)
    assert isinstance(robot, LeaningRobot)
    return robot


def pushed_on_an_eight(name: str, plant: Plant) -> Run:
    """Return 8 s of a robot of the catalogue on an eight, on a plant that pushes it after 3 s."""
    robot = leaning(name)
    size, speed = (10.0, 3.0) if robot.rolls_sideways else (0.5, 0.3)
    return rpctl.track(robot, "eight", duration=8.0, size=size, speed=speed, collisions=False,
                       plant=replace(plant, wrenches=(PUSHES[name],)))  # fmt: skip
