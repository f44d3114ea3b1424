"""Speed of the horizon law on TIAGo, N = 20: its QP and the whole sample.

``python -m tests.bench.test_horizon`` prints medians and 99th percentiles over a closed loop.
"""

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
from rpctl.control.horizon.law import Horizon, HorizonLaw
from rpctl.control.horizon.preview import Preview
from rpctl.control.horizon.qp import QuadraticProgram
from rpctl.control.horizon.solver import Solver
from rpctl.control.horizon.target import TimeScaling, look_ahead
from rpctl.control.law import Command
from rpctl.reference.named import reference_by_name
from rpctl.reference.quasi_velocities import reference_rates

NOW = 5.0  # s
OFF = (0.1, -0.1, 0.2)  # of the closed loop's start: limits bind for a second or so
AWAY = (-0.5, 0.4, 0.6)  # of P: limits bind


def law_and_state(robot: Robot, off: tuple[float, ...]) -> tuple[HorizonLaw, Array, Array]:
    state = reference_by_name(robot, "eight")(NOW)
    q = robot.configuration_at(state.pose + off, state.joints)
    return Horizon().start(ReducedDynamics(robot), 0.002), q, np.zeros(robot.dof)


def program(robot: Robot, off: tuple[float, ...]) -> QuadraticProgram:
    run, q, nu = law_and_state(robot, off)
    model = run.model
    times = np.asarray(NOW + model.dt * np.arange(model.steps + 1))
    time_scaling = TimeScaling(times, np.ones(model.steps + 1))
    target = look_ahead(
        model,
        Preview(robot, reference_by_name(robot, "eight")),
        time_scaling,
        model.joint_positions(q),
    )
    still = np.zeros((model.steps, robot.dof))
    motion = model.predict(q, nu, still)
    return run.build_qp(motion, target)


@pytest.mark.benchmark(group="horizon law of TIAGo, N = 20")
def test_qp_where_nothing_binds(benchmark: BenchmarkFixture, tiago: Robot) -> None:
    benchmark(Solver().unbounded, program(tiago, (0.0, 0.0, 0.0)))


@pytest.mark.benchmark(group="horizon law of TIAGo, N = 20")
def test_qp_where_limits_bind(benchmark: BenchmarkFixture, tiago: Robot) -> None:
    benchmark(Solver().solve, program(tiago, AWAY))


@pytest.mark.benchmark(group="horizon law of TIAGo, N = 20")
def test_sample(benchmark: BenchmarkFixture, tiago: Robot) -> None:
    run, q, _ = law_and_state(tiago, (0.0, 0.0, 0.0))
    reference = reference_by_name(tiago, "eight")
    nu = reference_rates(tiago, reference(NOW)).nu

    def sample() -> Command:
        run.solved_at = -np.inf  # each call solves
        return run(run.model.dynamics, reference, NOW, q, nu)

    benchmark(sample)


def timed(call: Callable[..., Any], wall: list[float], cpu: list[float]) -> Callable[..., Any]:
    """Return a call that notes how long it took, ms."""

    def noted(*args: Any) -> Any:
        began = time.perf_counter(), time.thread_time()
        result = call(*args)
        wall.append(1e3 * (time.perf_counter() - began[0]))
        cpu.append(1e3 * (time.thread_time() - began[1]))
        return result

    return noted


def main() -> None:
    """Print what the parts of a sample take over a closed loop of 10 s."""
    robot = rpctl.load("tiago")
    figures: dict[str, tuple[list[float], list[float]]] = {"QP": ([], []), "sample": ([], [])}
    Solver.solve = timed(Solver.solve, *figures["QP"])  # type: ignore[method-assign]
    solve = timed(HorizonLaw._solve, *figures["sample"])
    HorizonLaw._solve = solve  # type: ignore[method-assign]
    run = rpctl.track(robot, "eight", 10.0, OFF, kinematic=Horizon())
    for name, clocks in figures.items():
        for clock, values in zip(("wall", "CPU"), clocks, strict=True):
            median, late = np.percentile(values[1:], [50, 99])
            print(f"{name:6} {clock:4}  median {median:5.2f} ms  99th percentile {late:5.2f} ms")
    print(rpctl.summarize(run).kinematic_report)


if __name__ == "__main__":
    main()
