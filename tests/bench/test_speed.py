"""Speeds of controllers and of dynamic laws, beside each other in the same run."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.control.law import Command
from rpctl.control.registry import read_law
from rpctl.study.compare import LawPair, controllers


@pytest.mark.benchmark(group="control sample of TIAGo")
@pytest.mark.parametrize("pair", controllers(), ids=str)
def test_control_sample(benchmark: BenchmarkFixture, tiago: Robot, pair: LawPair) -> None:
    """A step of each controller that ``rpctl compare`` compares, off its reference."""
    controller = rpctl.Controller(tiago, "eight", kinematic=pair.kinematic, dynamic=pair.dynamic)
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
    law = read_law("dynamic", name).start(dynamics, 0.002)
    benchmark(law, dynamics, q, nu, Command(nu_d, nu_d_dot))
