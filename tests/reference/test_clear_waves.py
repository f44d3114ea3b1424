"""Default arm motions keep links clear of each other and of the ground, and are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.reference.named import KEPT_AT_MOST, MARGIN_M, clear_waves, reference_by_name
from rpctl.reference.path_reference import Waves, waves
from rpctl.robot import catalog
from rpctl.robot.collision import collision_model
from tests.folding import folding

LOW = (0.2, 0.6)  # rad: the tip hangs 4 cm above the ground
LOWER = (0.2, 0.748)  # some millimetres
FOLDED = (-0.9, 2.6)  # the forearm swings past the column
BETWEEN = 0.9  # of a distance that samples keep: what is left of it between them


def posed(folder: Path, home: tuple[float, float]) -> Robot:
    """Return the small robot whose shoulder and elbow are so at home, rad."""
    return folding(folder, shoulder=home[0], elbow=home[1])


def nearest(robot: Robot, arm: Waves, count: int = 600) -> float:
    """Return the least distance (m) of all pairs over random instants of a motion.

    Args:
        robot: The robot.
        arm: The motion.
        count: Of the instants.
    """
    model, rng = collision_model(robot), np.random.default_rng(0)
    distances, least = model.distances(), np.inf
    for s in rng.uniform(0.0, 200.0, count).tolist():
        joints = arm.centre + arm.amplitude * np.sin(arm.rate * s)
        distances.place(robot.configuration_at(np.zeros(3), joints))
        least = min(least, *map(distances.distance, range(len(model.pairs))))
    return least


def at_home(robot: Robot) -> float:
    """Return the least distance (m) at home."""
    arm = waves(robot)
    return nearest(robot, Waves(arm.centre, 0.0 * arm.amplitude, arm.rate), count=1)


def test_a_swing_that_is_clear_stays_as_it_is(tmp_path: Path) -> None:
    robot = folding(tmp_path)
    arm = waves(robot)
    assert nearest(robot, arm) > MARGIN_M
    found, note = clear_waves(arm, robot)
    assert found is arm
    assert note == ""


@pytest.mark.parametrize(
    ("home", "pair"), [(LOW, "forearm clear of ground"), (FOLDED, "column clear of forearm")]
)
def test_a_swing_shrinks_until_links_keep_their_distance(
    tmp_path: Path, home: tuple[float, float], pair: str
) -> None:
    robot = posed(tmp_path, home)
    arm = waves(robot)
    assert nearest(robot, arm) < 0.0 < MARGIN_M < at_home(robot)
    found, note = clear_waves(arm, robot)
    share = found.amplitude / arm.amplitude
    assert share == pytest.approx(share[0])  # all joints in proportion
    assert note == f"swing reduced to {100.0 * share[0]:.0f} % to keep {pair}"
    assert nearest(robot, found) > BETWEEN * MARGIN_M
    wider = Waves(arm.centre, found.amplitude / 0.8, arm.rate)
    assert nearest(robot, wider) < MARGIN_M / BETWEEN  # no more than it must


def test_links_near_at_home_keep_half_of_their_distance(tmp_path: Path) -> None:
    robot = posed(tmp_path, LOWER)
    home = at_home(robot)
    assert 0.002 < home < MARGIN_M
    found, _ = clear_waves(waves(robot), robot)
    assert found.amplitude.min() > 0.0
    assert BETWEEN * KEPT_AT_MOST * home < nearest(robot, found) < home


def test_a_named_reference_says_what_its_arm_keeps_clear_of(tmp_path: Path) -> None:
    robot = posed(tmp_path, LOW)
    reference, blind = (reference_by_name(robot, "line", collisions=each) for each in (True, False))
    assert reference.sizing is not None
    assert "to keep forearm clear of ground" in reference.sizing.sentence
    assert nearest(robot, reference.arm) > 0.0
    assert nearest(robot, blind.arm) < -0.1
    assert blind.sizing is not None
    assert "clear of" not in blind.sizing.sentence


@pytest.mark.thorough
@pytest.mark.parametrize("name", catalog.names())
def test_no_robot_of_the_catalogue_swings_its_links_into_each_other(name: str) -> None:
    robot = rpctl.load(name)
    if robot.joints and len(collision_model(robot).pairs):
        assert nearest(robot, reference_by_name(robot, "line").arm, count=200) > 0.0
