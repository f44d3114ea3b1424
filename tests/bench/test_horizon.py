"""Speed of the horizon law on TIAGo, N = 20: its quadratic program and a whole solve."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.pace import Preview
from rpctl.control.horizon.planner import Planned, Planner
from rpctl.control.horizon.qp import Linearisation
from rpctl.control.horizon.solver import CondensedQp
from rpctl.control.horizon.target import TimeScaling, look_ahead
from rpctl.reference.named import reference_by_name
from rpctl.reference.quasi_velocities import reference_rates

GROUP = "horizon law of TIAGo, N = 20"
NOW = 5.0  # s
OFF = (0.1, -0.1, 0.2)  # of the closed loop's start: limits bind for a second or so
AWAY = (-0.5, 0.4, 0.6)  # of P: limits bind


def planner_and_state(robot: Robot, off: tuple[float, ...]) -> tuple[Planner, Array, Array]:
    state = reference_by_name(robot, "eight")(NOW)
    q = robot.configuration_at(state.pose + off, state.joints)
    return Planner(Horizon(), ReducedDynamics(robot)), q, np.zeros(robot.dof)


def linearised(robot: Robot, off: tuple[float, ...]) -> tuple[Planner, Linearisation]:
    planner, q, nu = planner_and_state(robot, off)
    model = planner.model
    times = np.asarray(NOW + model.dt * np.arange(model.steps + 1))
    read = Preview(robot, reference_by_name(robot, "eight"))
    target = look_ahead(
        model, read, TimeScaling(times, np.ones(len(times))), model.joint_positions(q)
    )
    motion = model.predict(q, nu, np.zeros((model.steps, robot.dof)))
    return planner, planner.linearise(motion, target)


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.0), AWAY], ids=["nothing binds", "limits bind"])
@pytest.mark.benchmark(group=GROUP)
def test_qp(benchmark: BenchmarkFixture, tiago: Robot, off: tuple[float, ...]) -> None:
    planner, values = linearised(tiago, off)
    none = np.empty(0, dtype=np.intp)
    benchmark(lambda: CondensedQp(planner.structure, values).solve(values, none))


@pytest.mark.benchmark(group=GROUP)
def test_sample(benchmark: BenchmarkFixture, tiago: Robot) -> None:
    planner, q, _ = planner_and_state(tiago, (0.0, 0.0, 0.0))
    reference = reference_by_name(tiago, "eight")
    nu = reference_rates(tiago, reference(NOW)).nu
    last = planner.plan(reference, NOW, q, nu, None).plan

    def sample() -> Planned:
        return planner.plan(reference, NOW, q, nu, last)

    benchmark(sample)


def timed(call: Callable[..., Any], seconds: list[float]) -> Callable[..., Any]:
    """Return a call that notes the processor time it took, s."""

    def noted(*args: Any) -> Any:
        began = time.thread_time()
        result = call(*args)
        seconds.append(time.thread_time() - began)
        return result

    return noted


def part_seconds(
    robot: Robot, law: Horizon, parts: dict[str, str], duration: float
) -> dict[str, list[float]]:
    """Return the processor times (s) of parts of the planner, call by call, over a closed loop.

    Args:
        robot: The robot.
        law: The law.
        parts: Methods of the planner by label.
        duration: Of the loop, s.
    """
    figures: dict[str, list[float]] = {label: [] for label in parts}
    usual = {name: getattr(Planner, name) for name in parts.values()}
    for label, name in parts.items():
        setattr(Planner, name, timed(usual[name], figures[label]))
    try:
        rpctl.track(robot, "eight", duration=duration, initial_error=OFF, kinematic=law)
    finally:
        for name, call in usual.items():
            setattr(Planner, name, call)
    return figures
