"""Robots with random faults: see ``fault_scripts.py``, which runs a thousand."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

from tests.catalogue import robot_of
from tests.control.fault_scripts import ROBOTS, Fault, run, run_faults
from tests.grids import cells

FAULTS = {
    "what is measured is no number": Fault("nan", 2.0, 2.4, 0.0),
    "the clock misses a second": Fault("clock", 2.0, math.inf, 0.9),
    "the clock is set": Fault("clock", 2.0, math.inf, -40.0),
    "half of the samples are lost": Fault("loss", 2.0, 3.0, 0.5),
    "the pose jumps": Fault("jump", 2.0, math.inf, 0.3),
    "a wheel's motor fails for a while": Fault("dead", 2.0, 2.6, 1.0),
    "an emergency stop": Fault("stop", 2.0, 3.0, 0.0),
}


# Clocks and jumps of the pose, one by one, are in test_faults.py.
QUICK = ("what is measured is no number", "half of the samples are lost", "an emergency stop")


@pytest.mark.parametrize("fault", cells(FAULTS, QUICK, slow=["a wheel's motor fails for a while"]))
def test_a_robot_comes_back_from_a_fault_without_a_blow(fault: str) -> None:
    """Efforts jumped by 83 % of a limit where it was braked, and by 138 % where it went on."""
    told = run_faults(robot_of("paper"), [FAULTS[fault]], np.random.default_rng(0))
    assert not list(told.wrong())
    assert told.status == "ok"


@pytest.mark.parametrize(
    ("name", "seed"),
    cells([("paper", 1155), ("tiago", 2000)], [("paper", 1155)], [("tiago", 2000)]),
)
def test_faults_that_come_together(name: str, seed: int) -> None:
    """Two jumps of a pose in one sample: .24 m off after 5 s. NaN and losses: a leap of 42 %."""
    assert not list(run(name, seed).wrong())


def test_a_robot_whose_wheel_stays_dead_is_lost() -> None:
    """It went in circles with its wheel at its limit, and was ``ok``."""
    fault = Fault("dead", 2.0, math.inf, 0.0)
    told = run_faults(robot_of("paper"), [fault], np.random.default_rng(0))
    assert not list(told.wrong())
    assert told.status == "lost"


@pytest.mark.slow
def test_a_car_without_motors_is_lost() -> None:
    """It rolled on, 2.4 m off and ``ok``: each second a new way up began where it was."""
    told = run("car", 3169)
    assert not list(told.wrong())
    assert told.status == "lost"


@pytest.mark.slow
def test_the_arm_of_a_lost_robot_is_held() -> None:
    """Braked by the model alone, it was thrown at four times its speed: the base was elsewhere."""
    front, rear = Fault("dead", 2.5, math.inf, 1.0), Fault("dead", 2.9, math.inf, 2.0)
    told = run_faults(robot_of("mecanum"), [front, rear], np.random.default_rng(0))
    assert not list(told.wrong())
    assert told.status == "lost"


@pytest.mark.parametrize(
    ("kind", "size"),
    cells(
        [("nan", 0.5), ("delay", 0.2), ("jump", 3.0)],
        [("delay", 0.2)],
        [("nan", 0.5), ("jump", 3.0)],
    ),
)
def test_the_judge_tells_what_is_wrong(kind: str, size: float) -> None:
    """A robot that never comes back, that shakes, or that has no time to come back, is told."""
    told = run_faults(
        robot_of("paper"), [Fault(kind, 2.0, math.inf, size)], np.random.default_rng(0)
    )
    assert list(told.wrong())


SEEDS = {"few": range(4), "many": range(4, 40)}


@pytest.mark.parametrize(
    ("name", "seeds"),
    cells(product(ROBOTS, SEEDS), slow=[(name, "few") for name in ROBOTS if name != "tiago"]),
)
def test_random_scripts(name: str, seeds: str) -> None:
    told = {seed: list(run(name, seed).wrong()) for seed in SEEDS[seeds]}
    assert {seed: wrong for seed, wrong in told.items() if wrong} == {}
