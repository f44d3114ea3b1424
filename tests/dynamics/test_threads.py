"""Threads that share one ``ReducedDynamics`` each get their own answers."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from rpctl import ReducedDynamics, Robot, load
from rpctl.arrays import Array
from rpctl.reference.planned.arm import Arm

STATES, ROUNDS, THREADS = 16, 60, 3


@pytest.fixture
def eager_switches() -> Iterator[None]:
    """Let threads take turns as often as Python can, so that what they share shows."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def _states(robot: Robot) -> list[tuple[Array, Array, Array]]:
    rng = np.random.default_rng(3)
    return [
        (
            robot.configuration_at(rng.normal(size=3), robot.home + 0.2 * rng.normal(size=n)),
            rng.normal(size=robot.dof),
            rng.normal(size=len(robot.actuators)),
        )
        for n in [len(robot.joints)] * STATES
    ]


def _agree_in_threads(
    answer: Callable[[Array, Array, Array], Array | float], states: list[tuple[Array, Array, Array]]
) -> None:
    alone = [answer(*state) for state in states]

    together = threading.Barrier(THREADS)

    def differing(_: int) -> int:
        together.wait()
        return sum(
            not np.array_equal(answer(*state), expected)
            for _ in range(ROUNDS)
            for state, expected in zip(states, alone, strict=True)
        )

    with ThreadPoolExecutor(THREADS) as pool:
        assert sum(pool.map(differing, range(THREADS))) == 0


@pytest.mark.usefixtures("eager_switches")
@pytest.mark.parametrize("name", ["paper", "swerve"])  # S constant, and made anew at each q
@pytest.mark.parametrize("what", ["forward", "reaction"])
def test_threads_share_a_dynamics(name: str, what: str) -> None:
    dynamics = ReducedDynamics(load(name))
    answers: dict[str, Callable[[Array, Array, Array], Array | float]] = {
        "forward": dynamics.forward,
        "reaction": lambda q, nu, tau: np.concatenate(dynamics.reaction(q, nu, tau)),
    }
    _agree_in_threads(answers[what], _states(dynamics.robot))


@pytest.mark.usefixtures("eager_switches")
def test_threads_share_a_projection() -> None:
    swerve = load("swerve")
    at = ReducedDynamics(swerve).at(_states(swerve)[0][0])
    _agree_in_threads(lambda q, nu, tau: at.drift(nu), 10 * _states(swerve))


@pytest.mark.usefixtures("eager_switches")
def test_threads_share_the_arm_of_a_reference(paper: Robot) -> None:
    arm = Arm(paper)

    def answer(q: Array, nu: Array, tau: Array) -> Array:
        positions = np.asarray(paper.joint_positions(q))[arm.joints]
        return np.asarray(arm.end_effector_pose(q[:3], positions).homogeneous)

    _agree_in_threads(answer, _states(paper))
