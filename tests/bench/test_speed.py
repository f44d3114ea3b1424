"""Speeds, each beside a peer in the same run: compare ratios, not absolute times."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.control.registry import dynamic_by_name
from rpctl.dynamics.motion import rk4_step
from rpctl.robot import catalog
from rpctl.study.compare import LawPair, controllers

State = tuple[ReducedDynamics, Array, Array, Array]


DRIVES = (*(entry.name for entry in catalog.ENTRIES if entry.own), "tiago", "tiago_pro")


def state_of(robot: Robot) -> State:
    rng = np.random.default_rng(20210601)
    q = robot.random_configuration(rng)
    tau = rng.normal(size=len(robot.actuators))
    return ReducedDynamics(robot), q, rng.normal(size=robot.dof), tau


@pytest.fixture
def state(tiago: Robot) -> State:
    return state_of(tiago)


def floor(state: State) -> Callable[[], object]:
    """Pinocchio's two algorithms alone: what no projection can undercut."""
    dynamics, q, nu, _ = state
    model, v = dynamics.robot.model, dynamics.basis(q) @ nu
    data, still = model.createData(), np.zeros(model.nv)

    def run() -> object:
        return pin.crba(model, data, q), pin.rnea(model, data, q, v, still)

    return run


def naive(state: State) -> Callable[[], object]:
    """The same projection as a first draft would write it."""
    dynamics, q, nu, tau = state
    model, S, B = dynamics.robot.model, dynamics.basis(q), dynamics.actuation(q)

    data = model.createData()

    def run() -> Array:
        M = S.T @ pin.crba(model, data, q) @ S
        h = S.T @ pin.nonLinearEffects(model, data, q, S @ nu)
        return np.asarray(np.linalg.solve(M, B @ tau - h))

    return run


def projected(state: State) -> Callable[[], object]:
    """Forward dynamics where the robot was not before: nothing of the last call serves again."""
    dynamics, q, nu, tau = state
    places = itertools.cycle((q, dynamics.robot.configuration()))
    return lambda: dynamics.forward(next(places), nu, tau)


@pytest.mark.benchmark(group="forward dynamics of TIAGo")
@pytest.mark.parametrize("make", [floor, projected, naive], ids=lambda make: make.__name__)
def test_forward(benchmark: BenchmarkFixture, state: State, make: Callable[..., object]) -> None:
    benchmark(make(state))


@pytest.mark.parametrize("make", [floor, projected], ids=lambda make: make.__name__)
@pytest.mark.parametrize("name", DRIVES)
def test_forward_of_each_drive(
    benchmark: BenchmarkFixture, name: str, make: Callable[..., Callable[[], object]]
) -> None:
    benchmark.group = f"forward dynamics of {name}"
    benchmark(make(state_of(rpctl.load(name))))


@pytest.mark.benchmark(group="control sample of TIAGo")
@pytest.mark.parametrize("pair", controllers(), ids=str)
def test_control_sample(benchmark: BenchmarkFixture, tiago: Robot, pair: LawPair) -> None:
    """A step of each controller that ``rpctl compare`` compares, off its reference."""
    controller = rpctl.Controller(tiago, "eight", pair.kinematic, pair.dynamic)
    state = controller.reference(7.0)
    q = tiago.configuration_at(state.pose + 0.05, state.joints)
    nu = np.concatenate([state.twist[[0, 2]], state.joint_rates])
    times = itertools.count()

    def sample() -> object:  # a law that solves now and then does so as in a run
        return controller.step(7.0 + 0.002 * next(times), q, nu)

    benchmark(sample)


@pytest.mark.benchmark(group="dynamic law of TIAGo")
@pytest.mark.parametrize("size", [0.01, 10.0], ids=["free", "at limits"])
@pytest.mark.parametrize("name", ["paper", "bounded", "integral"])
def test_dynamic_law(
    benchmark: BenchmarkFixture, tiago: Robot, rng: np.random.Generator, name: str, size: float
) -> None:
    dynamics, q = ReducedDynamics(tiago), tiago.configuration_at(np.zeros(3), tiago.home)
    nu, nu_d, nu_d_dot = size * rng.normal(size=(3, tiago.dof))
    law = dynamic_by_name(name).start(dynamics, 0.002)
    benchmark(law, dynamics, q, nu, Command(nu_d, nu_d_dot))


@pytest.mark.benchmark(group="closed loop of TIAGo")
def test_plant_step(benchmark: BenchmarkFixture, state: State) -> None:
    dynamics, q, nu, tau = state
    benchmark(rk4_step, dynamics, q, nu, tau, 1e-3)


@pytest.mark.benchmark(group="whole tasks on TIAGo")
def test_load(benchmark: BenchmarkFixture) -> None:
    benchmark(rpctl.load, "tiago")


@pytest.mark.benchmark(group="whole tasks on TIAGo")
def test_verify_ten_states(benchmark: BenchmarkFixture, tiago: Robot) -> None:
    benchmark(rpctl.verify, tiago, 10)


@pytest.mark.benchmark(group="whole tasks on TIAGo")
def test_track_one_second(benchmark: BenchmarkFixture, tiago: Robot) -> None:
    benchmark(rpctl.track, tiago, "eight", duration=1.0)
