"""The certificate is no formality: every planted error fails two checks or more."""

from __future__ import annotations

import pytest

import rpctl
from rpctl import Robot
from tests.equivalence.mutations import MUTATIONS, SAMPLES, noticed, victim


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return victim(tmp_path_factory.mktemp("mutations"))


def test_the_robot_has_what_the_errors_need(robot: Robot) -> None:
    assert {joint.kind for joint in robot.joints} == {"revolute", "prismatic", "continuous"}
    assert len(robot.mimics) == 1
    assert min(abs(wheel.offset) for wheel in robot.drive.wheels) > 1e-3
    assert min(abs(coordinate) for coordinate in robot.drive.point) > 1e-3


def test_without_an_error_it_passes(robot: Robot) -> None:
    assert rpctl.verify(robot, samples=SAMPLES).passed


@pytest.mark.parametrize("name", MUTATIONS)
def test_an_error_is_noticed_twice(robot: Robot, name: str) -> None:
    assert len({check.name for check in noticed(robot, MUTATIONS[name])}) >= 2


def test_an_error_leaves_nothing_behind(robot: Robot) -> None:
    """Runs last: the same certificate as before all the planting."""
    assert rpctl.verify(robot, samples=SAMPLES).passed
