"""Bounds on joints' accelerations in symbols against Python's, within the limits and beyond."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics
from rpctl.control.joint_limits import JointLimits
from rpctl.simulation.compiled.laws.dynamic import SymbolicJointLimits

HORIZON, PERIOD = 0.15, 0.002


@pytest.mark.parametrize("name", ["paper", pytest.param("car", marks=pytest.mark.slow)])
def test_bounds_and_where_they_may_be_broken(name: str, rng: np.random.Generator) -> None:
    """No acceleration is beyond a bound where there is no doubt; mostly, there is no doubt."""
    robot = rpctl.load(name)
    limits = JointLimits(ReducedDynamics(robot), PERIOD, HORIZON)
    count = len(limits.names)
    sizes = {"q": robot.nq, "rate": count, "acceleration": count, "down": count, "up": count}
    q, rate, acceleration, down, up = (casadi.SX.sym(*size) for size in sizes.items())
    symbolic = SymbolicJointLimits(limits, casadi.SX(HORIZON))
    bounds = symbolic.bounds(q, rate, [(down[j], up[j]) for j in range(count)])
    outputs = [casadi.densify(each) for each in vars(bounds).values()]
    outputs.append(symbolic.doubtful(q, rate, acceleration))
    function = casadi.Function("bounds", [q, rate, acceleration, down, up], outputs)
    broken = doubts = by_position = 0
    for k in range(120):
        at = robot.random_configuration(rng)
        if k % 4 == 1:
            at[4:] += 0.2 * rng.normal(size=robot.nq - 4)  # some beyond their limits
        v, a = (rng.choice([0.0, 0.1, 1.0]) * rng.normal(size=count) for _ in range(2))
        brakes = 10.0 ** rng.uniform(-2.0, 5.0, size=(2, count))
        wanted = limits.bounds(at, v, (brakes[0], brakes[1]))
        *found, doubtful = (each.full().ravel() for each in function(at, v, a, *brakes))
        for mine, theirs in zip(found, wanted, strict=True):
            np.testing.assert_allclose(mine, np.asarray(theirs, float), rtol=1e-12, atol=1e-12)
        beyond = bool(((a < wanted.lower) | (a > wanted.upper)).any())
        assert doubtful[0] or not beyond
        broken, doubts = broken + beyond, doubts + int(doubtful[0])
        by_position += int(wanted.by_lower.sum() + wanted.by_upper.sum())
    assert 10 < broken < doubts < 110
    assert by_position > 10
