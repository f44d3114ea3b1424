"""Robots like another one."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl import ReducedDynamics, Robot, RpctlError, scale_limits, scale_masses, track
from rpctl.errors import UnknownNameError


def test_limits_scale_and_nothing_else(paper: Robot) -> None:
    half = scale_limits(paper, effort=0.5, velocity=0.25)
    np.testing.assert_array_equal(half.effort_limits, 0.5 * paper.effort_limits)
    run = track(half, "eight", duration=0.01)
    plain = track(paper, "eight", duration=0.01)
    np.testing.assert_array_equal(
        run.robot.effort_limits, 0.5 * np.array(plain.robot.effort_limits)
    )
    np.testing.assert_array_equal(
        run.robot.velocity_limits, 0.25 * np.array(plain.robot.velocity_limits)
    )
    assert [j.effort for j in half.joints] == [0.5 * j.effort for j in paper.joints]
    q = paper.configuration()
    np.testing.assert_array_equal(
        ReducedDynamics(half).inertia(q), ReducedDynamics(paper).inertia(q)
    )
    with pytest.raises(RpctlError, match="effort is 0; give a positive number"):
        scale_limits(paper, effort=0.0)


def test_masses_scale_where_the_pattern_fits(tiago: Robot) -> None:
    light = scale_masses(tiago, "arm_*", 0.7)
    arm = sum(i.mass for n, i in zip(tiago.model.names, tiago.model.inertias, strict=True)
              if n.startswith("arm_"))  # fmt: skip
    assert light.mass == pytest.approx(tiago.mass - 0.3 * arm)
    assert scale_masses(tiago, "*", 2.0).mass == pytest.approx(2.0 * tiago.mass)
    q = tiago.configuration()
    whole = ReducedDynamics(scale_masses(tiago, "*", 2.0)).inertia(q)
    np.testing.assert_allclose(whole, 2.0 * ReducedDynamics(tiago).inertia(q), atol=1e-12)
    with pytest.raises(UnknownNameError, match=r"joint 'leg_\*' is not known"):
        scale_masses(tiago, "leg_*", 0.7)
