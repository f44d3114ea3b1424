"""A reference from a function of time: its derivatives are those of the function."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl.reference.function import as_reference
from rpctl.reference.motion import ReferenceState

RATE = 0.7


def wave(t: float) -> list[float]:
    """Return a pose that moves sideways, too, a heading that jumps by a turn, and one joint."""
    heading = 3.0 + RATE * t
    return [np.sin(t), 0.3 * t**3, np.angle(np.exp(1j * heading)), np.cos(2.0 * t)]


def wave_state(t: float) -> ReferenceState:
    """Return the same, differentiated by hand."""
    heading = 3.0 + RATE * t
    cos, sin = np.cos(heading), np.sin(heading)
    velocity = np.array([np.cos(t), 0.9 * t**2])
    acceleration = np.array([-np.sin(t), 1.8 * t])
    axes = np.array([[cos, sin], [-sin, cos]])
    turning = RATE * np.array([[-sin, cos], [-cos, -sin]])
    return ReferenceState(
        np.array([np.sin(t), 0.3 * t**3, heading]),
        np.array([*axes @ velocity, RATE]),
        np.array([*axes @ acceleration + turning @ velocity, 0.0]),
        np.array([np.cos(2.0 * t)]),
        np.array([-2.0 * np.sin(2.0 * t)]),
        np.array([-4.0 * np.cos(2.0 * t)]),
    )


@pytest.mark.parametrize("t", [0.0, 0.004, 0.2, 1.37, 1.999, 2.0])
def test_derivatives_are_the_functions(t: float) -> None:
    found, expected = as_reference(wave, duration=2.0)(t), wave_state(t)
    assert np.angle(np.exp(1j * (found.pose[2] - expected.pose[2]))) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(found.pose[:2], expected.pose[:2], atol=1e-13)
    for name in ("twist", "twist_dot", "joints", "joint_rates", "joint_accelerations"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=2e-8)


def test_the_function_is_called_between_zero_and_its_end_only() -> None:
    called = []

    def line(t: float) -> tuple[float, float, float]:
        called.append(t)
        return t, 0.0, 0.0

    reference = as_reference(line, duration=1.0)
    for t in (-0.5, 0.0, 0.01, 0.5, 0.99, 1.0, 3.0):
        reference(t)
    assert 0.0 <= min(called) < 1e-12
    assert 1.0 - 1e-12 < max(called) <= 1.0 + 1e-12


def test_after_its_end_it_stands_still() -> None:
    state = as_reference(wave, duration=2.0)(2.5)
    np.testing.assert_allclose(state.pose[:2], [np.sin(2.0), 2.4], atol=1e-12)
    for values in (state.twist, state.twist_dot, state.joint_rates, state.joint_accelerations):
        assert not values.any()


def test_heading_along_the_path() -> None:
    def ellipse(t: float) -> tuple[float, float]:
        return 2.0 * np.cos(t), np.sin(t)

    reference = as_reference(ellipse, joints=[0.4], along_path=True)
    for t in (0.0, 0.02, 0.9, 4.0):
        state = reference(t)
        velocity = np.array([-2.0 * np.sin(t), np.cos(t)])
        speed = np.hypot(*velocity)
        turning = 2.0 / speed**2  # (x' y'' - y' x'') / v² of this ellipse
        v_dot = (velocity @ np.array([-2.0 * np.cos(t), -np.sin(t)])) / speed
        turning_dot = -2.0 * turning * v_dot / speed
        np.testing.assert_allclose(state.pose[2], np.arctan2(velocity[1], velocity[0]), atol=1e-9)
        np.testing.assert_allclose(state.twist, [speed, 0.0, turning], atol=1e-8)
        np.testing.assert_allclose(state.twist_dot, [v_dot, 0.0, turning_dot], atol=1e-6)
        np.testing.assert_array_equal(state.joints, [0.4])
        assert not state.joint_rates.any()
        assert not state.joint_accelerations.any()


@pytest.mark.parametrize(
    "value", [None, (1.0, 2.0), (0.0, 0.0, float("nan")), "x, y", [[0.0], [1.0], [2.0]]]
)
def test_what_a_function_has_to_return_is_said(value: object) -> None:
    with pytest.raises(
        rpctl.RpctlError, match=r"return finite numbers: x, y, heading .*, then the arm"
    ):
        as_reference(lambda t: value)(0.3)  # type: ignore[arg-type, return-value]


def test_what_a_user_would_try_is_told_what_to_give(paper: rpctl.Robot) -> None:
    """Points without times, a path without a heading, poses without joints."""
    points: Any = [(0.0, 0.0), (1.0, 0.0)]
    tried: dict[str, Any] = {
        "rpctl.as_reference makes of one that returns x, y and heading, or x and y with "
        "along_path=True": points,
        "x, y, heading .x, y alone with along_path=True.*none with joints=": as_reference(
            lambda t: (t, 0.0)
        ),
        r"has 0 joints, paper has 2 .arm_.*joints= where they stay": as_reference(
            lambda t: (0.1 * t, 0.0), along_path=True
        ),
    }
    for told, given in tried.items():
        with pytest.raises(rpctl.RpctlError, match=told):
            rpctl.track(paper, given, duration=0.1)
    with pytest.raises(rpctl.RpctlError, match=r"the reference is array.*; give a name"):
        as_reference(np.zeros(3))  # type: ignore[arg-type]
    with pytest.raises(rpctl.RpctlError, match="in the order of joint_names"):
        as_reference(lambda t: (0.0, 0.0, 0.0), joints={"arm": 0.0})  # type: ignore[arg-type]
    with pytest.raises(rpctl.RpctlError, match="; give a name, a file"):
        rpctl.Controller(paper, points)


def test_a_reference_may_be_a_path(paper: rpctl.Robot, tmp_path: Path) -> None:
    table = tmp_path / "line.csv"
    table.write_text("t,x,y,theta\n" + "".join(f"{k},{0.1 * k},0,0\n" for k in range(8)))
    run = rpctl.track(paper, table, duration=0.1, collisions=False)
    assert run.config.run.reference == str(table)
    assert rpctl.Controller(paper, table).reference(2.0).pose[0] == pytest.approx(0.2, abs=1e-3)


def test_a_reference_too_short_is_refused() -> None:
    with pytest.raises(rpctl.RpctlError, match=r"at least 0\.06 s"):
        as_reference(wave, duration=0.05)
