"""A delay that nobody declares: the gains of the default laws withstand 50 ms of it."""

from __future__ import annotations

from itertools import product

import pytest

import rpctl
from rpctl import Plant
from rpctl.simulation.config import Config, RunSettings
from tests.grids import cells

ROBOTS = [
    "paper", "skid_steer", "car", "tricycle", "loader", "bicycle", "swerve", "omni", "mecanum",
    "caster_drive", "arm", "tiago",
]  # fmt: skip
FAST, SLOW = 0.002, 0.05  # s, the control period
OFF = (0.1, -0.1, 0.1)
GRID = tuple(product(ROBOTS, (FAST, SLOW)))
IN_CI = ("paper", SLOW), ("car", SLOW), ("swerve", SLOW), ("arm", FAST)


@pytest.mark.parametrize(("name", "period"), cells(GRID, slow=IN_CI))
def test_50_ms_of_delay_leave_millimetres(name: str, period: float) -> None:
    """With 7 Hz joints and a base of 3.7 Hz they leave decimetres, tip, or diverge."""
    robot = rpctl.load(name)
    off = OFF if robot.drive.wheels else (0.0, 0.0, 0.0)
    settings = RunSettings(control_period=period, initial_error=off)
    config = Config(run=settings, plant=Plant(delay=0.05))
    found = rpctl.summarize(rpctl.track(robot, "eight", config, collisions=False))
    assert found.outcome == "tracked"
    assert not found.limits_violated
    assert (found.final_base_error or 0.0) < 1.5e-3
    assert (found.final_end_effector_error or 0.0) < (3e-3 if period == FAST else 10e-3)
