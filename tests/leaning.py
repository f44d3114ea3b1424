"""The project's own robots that lean, as what they are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import rpctl
from rpctl import Plant, Run, Wrench
from rpctl.robot.leaning import LeaningRobot
from tests.catalogue import robot_of

COARSE: dict[str, Any] = {"control_period": 0.005, "plant_step": 0.005, "collisions": False}
OWN = ("balancer", "wheel_legs", "whipple")
PUSHES = {  # 10 N s half a metre high, 3 N s at the hips, 2 N s from the side
    "balancer": Wrench("base_link", (100.0, 0.0, 0.0), (0.0, 50.0, 0.0)),
    "wheel_legs": Wrench("base_link", (30.0, 0.0, 0.0)),
    "whipple": Wrench("base_link", (0.0, 20.0, 0.0), (-18.0, 0.0, 0.0)),
}


def leaning(name: str) -> LeaningRobot:
    """Return a robot of the catalogue that leans."""
    robot = robot_of(name)
    assert isinstance(robot, LeaningRobot)
    return robot


def pushed_on_an_eight(name: str, plant: Plant, after: float, **settings: Any) -> Run:
    """Return a run of a robot of the catalogue on an eight, on a plant that pushes it.

    Args:
        name: The robot.
        plant: The plant.
        after: When it pushes, s.
        settings: Others of the run.
    """
    robot, push = leaning(name), replace(PUSHES[name], start=after, end=after + 0.1)
    size, speed = (10.0, 3.0) if robot.rolls_sideways else (0.5, 0.3)
    return rpctl.track(robot, "eight", size=size, speed=speed, **settings,
                       plant=replace(plant, wrenches=(push,)))  # fmt: skip
