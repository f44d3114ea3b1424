"""What the rows' residuals are relative to, by paper and pencil."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics
from rpctl.arrays import Array
from rpctl.equivalence import checks
from rpctl.equivalence.gibbs_appell import GibbsAppell, RollingTerms, rolling_terms
from rpctl.equivalence.state import State, find_rounding_scales
from tests.robots import SET_A, platform, write

PLANTED = 1e-3  # kg/s, in the entry of C that v has with itself


@pytest.mark.parametrize("v", [4.0, 0.01])
def test_skewness_is_relative_to_the_larger_of_c_and_a_small_robots_own_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, v: float
) -> None:
    """With its centre of mass in P a platform has C = 0 and Ṁ = 0, so nothing but a floor is left.

    It is 1, or M v where that is less, with M = m_c + 2 m_w + 2 I_s/r². The row tells the largest
    entry of (Ṁ − 2C) + (Ṁ − 2C)ᵀ, four times that of C.
    """
    original = pin.computeCoriolisMatrix

    def computed(*arguments: object) -> Array:
        C = original(*arguments).copy()
        C[0, 0] += PLANTED
        return np.asarray(C)

    dynamics = ReducedDynamics(rpctl.load(write(tmp_path, platform(SET_A | {"d": 0.0}))))
    robot, nu = dynamics.robot, np.array([v, 0.5 * v])
    state = State(robot.configuration(), np.zeros(robot.nv), nu, np.zeros(2), np.zeros(2))
    scales = find_rounding_scales(dynamics, state, None)
    monkeypatch.setattr(pin, "computeCoriolisMatrix", computed)
    rows = {row.name: row for row in checks.coriolis(dynamics, scales, state)}
    heaviest = SET_A["m_c"] + 2.0 * SET_A["m_w"] + 2.0 * SET_A["I_s"] / SET_A["r"] ** 2
    floor = min(1.0, heaviest * v)
    row = rows["Ṁ − 2C skew-symmetric"]
    assert row.residual == pytest.approx(4.0 * PLANTED / floor, rel=1e-6)
    assert row.entry == "v, v"
    assert row.limit == 1e-6


@pytest.mark.parametrize("size, passed", [(1e6, True), (1e-3, False)])
def test_the_row_of_g_knows_what_it_is_the_difference_of(
    tmp_path: Path, size: float, passed: bool
) -> None:
    """G(ν̇ + ν) − G(ν̇ − ν) is rounded to EPS of both, however little is left of them.

    Relative to the power, some (M |ν̇|) |ν| = 1 W, a gap of 1e-11 W is rounding of 1e6 W alone.
    """
    robot = rpctl.load(write(tmp_path, platform(SET_A | {"d": 0.0})))
    dynamics, oracle = ReducedDynamics(robot), GibbsAppell(robot)
    heaviest = SET_A["m_c"] + 2.0 * SET_A["m_w"] + 2.0 * SET_A["I_s"] / SET_A["r"] ** 2
    nu = np.array([1.0, 0.0])
    state = State(robot.configuration(), np.zeros(robot.nv), nu, nu / heaviest, np.zeros(2))
    (found,) = rolling_terms(oracle, [state])
    assert isinstance(found, RollingTerms)
    assert found.rise == pytest.approx(2.0)  # 2 M ν̇ ν
    weighed = (SET_A["m_c"] + 2.0 * SET_A["m_w"]) * 9.81**2  # a body that lies still "falls" up
    assert found.rise_size == pytest.approx(
        weighed + heaviest * (1.0 + 1.0 / heaviest**2), rel=1e-9
    )
    scales = find_rounding_scales(dynamics, state, found.terms.h_size)
    found = replace(found, rise=found.rise + 2e-11 * scales.force, rise_size=size * scales.force)
    rows = {row.name: row for row in checks.reduced(dynamics, oracle, found, scales, state)}
    assert rows["inverse dynamics along ν"].passed == passed
