"""Any wheeled robot: the drive is found as it was built, and every derivation agrees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.equivalence.gibbs_appell import GibbsAppell
from rpctl.equivalence.mujoco_engine import MujocoEngine, installed
from tests.grids import cells
from tests.proofs import failed
from tests.random_robots import WheeledRobot, generate, random_robot, robots
from tests.robots import write

EXACT = 1e-12  # as in the certificate
REPEATABLE = settings(
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder for all examples of a test: the last that fails, the simplest, stays in it."""
    return tmp_path_factory.mktemp("robots")


def check(folder: Path, built: WheeledRobot, seed: int = 0) -> None:
    """Write, load, verify; a file that fails stays, and the command that repeats it is told."""
    path = write(folder, built.text, f"seed_{seed}.urdf")
    try:
        robot = rpctl.load(path)
        check_drive(robot, built)
        proof = rpctl.verify(robot, samples=2, seed=seed)
        assert not failed(proof)
        if installed():
            check_engine(robot, seed)
    except Exception as error:
        again = f"rpctl verify {path} --samples 2 --seed {seed}"
        raise AssertionError(f"{error}\nto repeat: {again}") from error


def check_drive(robot: Robot, built: WheeledRobot) -> None:
    drive = robot.drive
    found = (drive.track, *drive.point, drive.heading, drive.ground)
    made = (built.track, *built.point, built.heading, built.ground)
    assert drive.type == "differential"
    assert [wheel.joint for wheel in drive.wheels] == ["left_joint", "right_joint"]
    assert [wheel.radius for wheel in drive.wheels] == [built.radius] * 2
    np.testing.assert_allclose(found, made, rtol=0, atol=1e-14)
    assert len(robot.mimics) == built.mimics
    assert robot.dof == 2 + built.joints - built.mimics


def check_engine(robot: Robot, seed: int) -> None:
    engine, dynamics, oracle = MujocoEngine(robot), ReducedDynamics(robot), GibbsAppell(robot)
    rng = np.random.default_rng([seed, 1])
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    terms, M, B = engine.reduced(q, nu), dynamics.inertia(q), dynamics.actuation(q)
    size = oracle.reduced(q, nu).h_size.max()
    np.testing.assert_allclose(terms.M, M, rtol=0, atol=EXACT * np.abs(M).max())
    np.testing.assert_allclose(terms.B, B, rtol=0, atol=EXACT * np.abs(B).max())
    np.testing.assert_allclose(terms.h, dynamics.bias(q, nu), rtol=0, atol=EXACT * size)


@pytest.mark.slow
@settings(REPEATABLE, max_examples=15)
@given(robots())
def test_random_robots_are_verified(folder: Path, built: WheeledRobot) -> None:
    check(folder, built)


@pytest.mark.thorough
@settings(REPEATABLE, max_examples=500)
@given(robots())
def test_many_random_robots_are_verified(folder: Path, built: WheeledRobot) -> None:
    check(folder, built, seed=1)


@pytest.mark.parametrize("seed", cells(range(30), (0, 10, 20), range(1, 30, 6)))
def test_robots_of_general_numbers_are_verified(folder: Path, seed: int) -> None:
    check(folder, generate(np.random.default_rng(seed)), seed)


def test_a_seed_is_one_robot() -> None:
    first, again, other = (random_robot(np.random.default_rng(seed), 3) for seed in (1, 1, 2))
    assert first == again != other
    assert first.count("<axis") == 5
