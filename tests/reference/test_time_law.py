"""Time laws: the fastest that limits allow, then smooth; and recorded paths slowed down."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline

from rpctl import ReducedDynamics, Robot, set_limits
from rpctl.arrays import Array
from rpctl.reference.load import load_reference
from rpctl.reference.paths import PathTime
from rpctl.reference.recorded.demands import PACE_RISE, find_demands, limits_along
from rpctl.reference.recorded.recording import RecordedPath
from rpctl.reference.recorded.table_file import read_table
from rpctl.reference.time_law import (
    KNOT_SPACING,
    Bound,
    TimeLaw,
    _slowdown,
    max_squared_rate,
    time_law,
)
from tests.grids import cells
from tests.reference.differences import check_derivatives, check_rest

S = np.linspace(0.0, 3.0, 601)
FLAT = np.zeros(len(S))


def test_on_a_line_the_fastest_is_a_trapezoid() -> None:
    speed, acceleration = 0.7, 0.4
    x = max_squared_rate(S, [Bound(np.ones(len(S)), FLAT, speed, acceleration)])
    ramps = np.minimum(2 * acceleration * S, 2 * acceleration * (S[-1] - S))
    np.testing.assert_allclose(x, np.minimum(ramps, speed**2), atol=1e-9)


def test_a_bend_costs_acceleration() -> None:
    """A coordinate sin s with |d²/dt²| ≤ a: where it turns back, ṡ² ≤ a."""
    speed = math.inf
    slope, bend = np.cos(S), -np.sin(S)
    x = max_squared_rate(S, [Bound(slope, bend, speed, 0.3), Bound(FLAT + 1.0, FLAT, 5.0)])
    turning = int(np.abs(S - 0.5 * math.pi).argmin())
    assert x[turning] == pytest.approx(0.3, rel=0.02)
    pace = 0.5 * np.diff(x) / (S[1] - S[0])
    for end in (slice(None, -1), slice(1, None)):
        assert np.abs(bend[end] * x[end] + slope[end] * pace).max() <= 0.3 * (1.0 + 1e-6)


def test_the_clock_is_smooth_within_limits_and_hardly_slower() -> None:
    speed, acceleration = 0.7, 0.4
    timing = time_law(S, [Bound(np.ones(len(S)), FLAT, speed, acceleration)])
    best = S[-1] / speed + speed / acceleration
    assert best < timing.duration < best + 6.0 * KNOT_SPACING
    t = np.linspace(0.0, timing.duration, 5000)
    s, rate, change = timing(t)
    assert (s[0], s[-1]) == pytest.approx((0.0, S[-1]), abs=1e-12)
    assert np.diff(s).min() >= 0.0
    assert rate.max() <= speed
    assert np.abs(change).max() <= acceleration
    assert np.abs(np.diff(change)).max() < 0.01 * acceleration  # no jump
    np.testing.assert_allclose(np.gradient(s, t)[1:-1], rate[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(rate, t)[1:-1], change[1:-1], atol=1e-4)
    for end in (-1.0, 0.0, timing.duration, timing.duration + 1.0):
        assert timing(end)[1:] == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_clock_is_slowed_by_the_root_of_its_acceleration() -> None:
    """Run k times slower, ṡ falls by k and s̈ by k²: with ṡ = 2 throughout, on c' = 1, c'' = −3,
    speeds are 2 and accelerations 12."""
    duration = S[-1] / 2.0
    straight = BSpline(np.repeat([0.0, duration], 3), np.array([0.0, 0.5, 1.0]) * S[-1], 2)
    timing = TimeLaw(lambda at, t: at.spline(straight, t)[0], duration)
    bend = FLAT - 3.0
    for speed, acceleration, expected in ((0.5, math.inf, 4.0), (math.inf, 0.75, 4.0),
                                          (4.0, 48.0, 0.5), (1.0, 3.0, 2.0)):  # fmt: skip
        bounds = [Bound(FLAT + 1.0, bend, speed, acceleration), Bound(FLAT + 1.0, FLAT, 1e3)]
        for order in (bounds, bounds[::-1]):
            assert _slowdown(timing, S, order) == pytest.approx(expected)


def test_smoothing_breaks_no_acceleration_on_a_bend() -> None:
    """A sharp bend, whose fastest motion changes within less than the clock's smoothing."""
    slope, bend = np.ones(len(S)), 8.0 * np.exp(-(((S - 1.5) / 0.05) ** 2))
    bounds = [Bound(slope, FLAT, 1.0, 2.0), Bound(slope, bend, 1.0, 1.0)]
    timing = time_law(S, bounds)
    at, rate, change = timing(np.linspace(0.0, timing.duration, 20000))
    for bound in bounds:
        c1, c2 = np.interp(at, S, bound.slope), np.interp(at, S, bound.bend)
        assert np.abs(c1 * rate).max() <= bound.speed
        assert np.abs(c2 * rate**2 + c1 * change).max() <= bound.acceleration


DURATION, STEP = 8.0, 0.05  # s
SLOWER = 1.3  # times what the fastest motion within the limits takes, which has no smooth forces


def random_way(seed: int) -> tuple[Array, Array]:
    """Return times (K,) and poses (K, 3) of a base that rolls: its speeds are sums of sines."""
    rng = np.random.default_rng(seed)
    fine = np.linspace(0.0, DURATION, 8001)
    phase, rate = rng.uniform(0.0, 2.0 * math.pi, (2, 3)), 2.0 * math.pi * rng.uniform(0.1, 0.4, 3)
    v, omega = (np.sin(fine[:, None] * rate + each).sum(axis=1) for each in phase)
    step = fine[1] - fine[0]

    def whole(rates: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(0.5 * step * (rates[1:] + rates[:-1]))])

    theta = whole(omega)
    x, y = whole(v * np.cos(theta)), whole(v * np.sin(theta))
    stride = round(STEP / step)
    return fine[::stride], np.column_stack([x, y, theta])[::stride]


def written(path: Path, t: Array, poses: Array) -> str:
    rows = np.column_stack([t, poses])
    np.savetxt(path, rows, delimiter=",", header="t,x,y,theta", comments="", fmt="%.12g")
    return str(path)


def read(robot: Robot, path: str, retime: bool) -> RecordedPath:
    found = load_reference(robot, path, retime=retime)
    assert isinstance(found, RecordedPath)
    return found


def shortest(robot: Robot, reference: RecordedPath, end: float) -> float:
    """Return the least time within the limits that the time law knows, s."""
    s = np.linspace(0.0, end, 400)
    bounds = [bound for bound, _ in limits_along(ReducedDynamics(robot), reference, s)]
    pace = Bound(np.ones(400), np.zeros(400), 1.0, PACE_RISE)
    rate = np.sqrt(max_squared_rate(s, [pace, *bounds]))
    return float((np.diff(s) / (0.5 * (rate[1:] + rate[:-1]))).sum())


@pytest.mark.parametrize("seed", cells(range(20), [1], [2]))
def test_a_random_path_is_driven_within_the_limits(paper: Robot, tmp_path: Path, seed: int) -> None:
    t, poses = random_way(seed)
    path = written(tmp_path / "a.csv", t, poses)
    robot = (
        set_limits(paper, effort={"wheel_*": 3.0}) if seed % 2 else paper
    )  # efforts bind, or speeds
    fast, slow = (read(robot, path, retime) for retime in (False, True))
    assert fast.recording is not None
    assert slow.recording is not None
    assert fast.recording.demands[0].ratio > 1.1  # otherwise nothing is tested
    assert (fast.recording.demands[0].quantity == "effort") == bool(seed % 2)
    told = slow.recording.retimed
    assert told is not None
    assert all(each.ratio < 1.02 for each in slow.recording.demands)
    assert slow.duration == told.duration
    assert slow.duration < SLOWER * shortest(robot, fast, told.recorded)
    for at in np.linspace(0.0, slow.duration, 60):
        instant = slow.time_law(at)
        assert -1e-9 <= instant.rate <= 1.0 + 1e-9
        np.testing.assert_array_equal(slow(at).pose, fast.at(PathTime(instant.s, 0.0, 0.0)).pose)
    check_rest(slow, 0.0)
    check_rest(slow, slow.duration)
    check_derivatives(slow, np.linspace(0.5, slow.duration - 0.5, 10))


@pytest.mark.slow
def test_what_slows_it_is_told(paper: Robot, tmp_path: Path) -> None:
    """A line at 1 m/s, and for a while 2.7: wheels of 0.15 m at 12 rad/s allow 0.9 · 1.8 m/s."""
    t = np.arange(0.0, 20.0, 0.1)
    u = np.clip((np.minimum(t, 20.0 - t) - 7.0) / 2.0, 0.0, 1.0)
    v = np.minimum(np.minimum(t, 19.9 - t) / 2.0, 1.0) + 1.7 * u**2 * (3.0 - 2.0 * u)
    x = np.concatenate([[0.0], np.cumsum(0.05 * (v[1:] + v[:-1]))])
    path = written(tmp_path / "a.csv", t, np.column_stack([x, 0.0 * x, 0.0 * x]))
    slow = read(paper, path, retime=True)
    told = slow.recording.retimed if slow.recording else None
    assert told is not None
    assert told.pace == pytest.approx(0.9 * 1.8 / 2.7, rel=0.06)
    assert 90 <= told.line <= 115
    assert told.reason == "the velocity of wheel_left_joint"
    assert told.sentence.startswith(f"takes {told.duration:.3g} s instead of 19.9 s: at line")
    assert not find_demands(ReducedDynamics(paper), slow, read_table(path))
