"""The catalogue: every name stands for a file, and the robots that rpctl models load."""

from __future__ import annotations

import pytest

import rpctl
from rpctl.robot.catalog import ENTRIES, find, names
from tests.grids import cells

ONE_OF_EACH = [*(name for name in names() if find(name).own), "tiago", "panda"]
DETECTED = {  # where the wheels tell another drive than a differential one
    "car": "car-like",
    "tricycle": "tricycle",
    "loader": "articulated",
    "bicycle": "bicycle",
    "swerve": "steered",
    "twin_casters": "steered",
    "caster_drive": "powered-casters",
    "omni": "omni",
    "balancer": "self-balancing",
    "wheel_legs": "wheel-legs",
    "whipple": "leaning-bicycle",
}


def test_every_entry_has_a_file() -> None:
    assert [entry.name for entry in ENTRIES if not entry.path.is_file()] == []


@pytest.mark.parametrize("name", cells(names(), ONE_OF_EACH))
def test_robots_load(name: str) -> None:
    robot = rpctl.load(name)
    assert robot.name == name
    assert robot.drive.type == (find(name).drive or DETECTED.get(name, "differential"))
    tilts = robot.drive.leans  # which nothing drives
    assert robot.dof <= len(robot.actuators) + tilts
