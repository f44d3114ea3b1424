"""Path error and lag: cases that paper and pencil know."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.simulation.merits.path_error import PathTrace, path_figures, trace_path

COUNT = 2001
T: Array = np.linspace(0.0, 20.0, COUNT)  # s
PERIOD = float(T[1])  # s


def circle(angle: Array, radius: float) -> Array:
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def eight(s: Array) -> Array:
    """Return a figure-eight of 2 m by 2 m that crosses itself at s = 0, π and 2π."""
    return np.column_stack([np.sin(s), np.sin(2.0 * s)])


def late(reference: Array, samples: int) -> Array:
    """Return a motion that is some samples behind its reference, from a wait at the start."""
    return np.concatenate([np.repeat(reference[:1], samples, axis=0), reference])[: len(reference)]


@pytest.mark.parametrize("turns", [0.75, 3.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("away", [0.1, -0.1])
def test_a_circle_driven_too_wide_or_too_narrow(turns: float, sign: float, away: float) -> None:
    """Driven to the left with a larger radius, the path lies to the left, by the difference."""
    angle = sign * np.linspace(0.0, 2.0 * math.pi * turns, COUNT)
    trace = trace_path(T, circle(angle, 2.0 + away), circle(angle, 2.0))
    np.testing.assert_allclose(trace.error, abs(away), atol=2e-5)  # of a polygon of short sides
    np.testing.assert_allclose(trace.lateral, sign * away, atol=2e-5)
    np.testing.assert_allclose(trace.lag, 0.0, atol=1e-3)
    figures = path_figures(trace, planar=True)
    assert figures.mean_lateral == pytest.approx(sign * away, abs=2e-5)
    assert path_figures(trace, planar=False).mean_lateral is None


@pytest.mark.parametrize("samples", [1, 40, 700])
def test_a_lag_of_some_samples(samples: int) -> None:
    """On the eight: on the path all the time, though up to 2 m from the reference."""
    reference = eight(0.4 * T)
    trace = trace_path(T, late(reference, samples), reference)
    assert trace.error.max() < 1e-9
    np.testing.assert_allclose(trace.lag[samples:], samples * PERIOD, atol=1e-6)
    np.testing.assert_allclose(trace.lag[:samples], T[:samples], atol=1e-6)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(reference, axis=0), axis=1))])
    np.testing.assert_allclose(trace.lag_distance[samples:], arc[samples:] - arc[:-samples])
    figures = path_figures(trace, planar=True)
    assert figures.final_lag == pytest.approx(samples * PERIOD)
    assert figures.largest_lag == pytest.approx(samples * PERIOD)
    assert figures.final_lag_distance == pytest.approx(trace.lag_distance[-1])
    assert figures.largest_lag_distance == pytest.approx(trace.lag_distance.max())


def test_the_crossing_of_the_eight_is_no_shortcut() -> None:
    """A robot 0.1 m to the left of one branch is nearer to the other one at the crossing."""
    reference = eight(0.4 * T)
    side = np.gradient(reference, axis=0)
    left = np.column_stack([-side[:, 1], side[:, 0]]) / np.linalg.norm(side, axis=1)[:, None]
    behind = late(reference + 0.1 * left, 150)  # 1.5 s late: the reference is elsewhere
    everywhere = np.linalg.norm(behind[:, None] - reference[None, ::4], axis=2).min(axis=1)
    trace = trace_path(T, behind, reference)
    driven = slice(150, None)
    np.testing.assert_allclose(trace.error[driven], 0.1, atol=1e-4)
    np.testing.assert_allclose(trace.lateral[driven], -0.1, atol=1e-4)
    np.testing.assert_allclose(trace.lag[driven], 1.5, atol=2e-2)
    assert everywhere[driven].min() < 0.02  # where all of the path counts


def test_a_path_that_is_driven_back_is_followed_back() -> None:
    """Forwards and backwards over the same line: the robot, 0.5 s late, is not left at its end."""
    there = np.concatenate([np.linspace(0.0, 1.0, 1001), np.linspace(1.0, 0.0, 1001)[1:]])
    reference = np.column_stack([there, np.zeros(COUNT)])
    trace = trace_path(T, late(reference, 50) + np.array([0.0, 0.003]), reference)
    np.testing.assert_allclose(trace.error[50:], 0.003, atol=1e-6)
    np.testing.assert_allclose(trace.lag[50:], 0.5, atol=0.02)
    assert trace.lateral[900] == pytest.approx(-0.003)  # the path is to the right, then left
    assert trace.lateral[1500] == pytest.approx(0.003)


def test_a_robot_ahead_may_wait_and_return() -> None:
    """It starts 0.5 m ahead on a line and drives back to meet its reference: never off the path."""
    reference = np.column_stack([0.2 * T, np.zeros(COUNT)])
    x = np.maximum(0.5 - 0.1 * T, 0.2 * T)
    trace = trace_path(T, np.column_stack([x, np.zeros(COUNT)]), reference)
    assert trace.error.max() < 1e-9
    np.testing.assert_allclose(trace.lag, np.minimum(0.0, T - x / 0.2), atol=1e-9)


def test_the_error_is_never_larger_than_that_against_time() -> None:
    """Stuck at the crossing for a whole lobe, the robot goes on with the reference."""
    s = 0.4 * T
    reference = eight(s)
    actual = np.where((s < math.pi)[:, None], reference[0], reference)
    trace = trace_path(T, actual, reference)
    assert trace.error.max() < 1e-9
    np.testing.assert_allclose(trace.lag[s >= math.pi], 0.0, atol=1e-9)
    middle = int(0.5 * math.pi / 0.4 / PERIOD)
    assert trace.lag[middle] == pytest.approx(T[middle])


def test_time_in_which_the_reference_stands_is_no_lag() -> None:
    """It drives 1 m in 10 s and stands; the robot comes to a stand 0.2 m before its place."""
    reference = np.column_stack([np.minimum(0.1 * T, 1.0), np.zeros(COUNT)])
    actual = np.minimum(reference, [0.8, 0.0])
    trace = trace_path(T, actual, reference)
    assert trace.lag[-1] == pytest.approx(2.0)
    assert trace.lag_distance[-1] == pytest.approx(0.2)
    assert trace.error.max() < 1e-9


def test_a_path_in_space() -> None:
    """A helix with a pitch of 1 m a turn, driven 0.2 m beside its axis and late."""
    angle = 2.0 * T
    helix = np.column_stack([circle(angle, 1.0), angle / (2.0 * math.pi)])
    inner = np.column_stack([circle(angle, 0.8), angle / (2.0 * math.pi)])
    trace = trace_path(T, late(inner, 30), helix)
    np.testing.assert_allclose(trace.error[30:], 0.2, atol=1e-4)
    np.testing.assert_allclose(trace.lag[30:-30], 0.3, atol=1e-3)
    assert not trace.lateral.any()


def test_beyond_its_ends_the_path_is_as_far_as_its_end() -> None:
    reference = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    actual = np.array([[-0.3, 0.4], [1.3, 0.4], [1.0, 0.25]])
    trace = trace_path(np.arange(3.0), actual, reference)
    np.testing.assert_allclose(trace.error, [0.5, 0.5, 0.25])
    np.testing.assert_allclose(trace.lateral, [-0.4, -0.4, -0.25])


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_a_reference_that_stands_has_a_path_of_one_point(columns: int) -> None:
    actual = np.full((3, columns), 2.0)
    trace = trace_path(np.arange(3.0), actual, np.zeros((3, columns)))
    np.testing.assert_allclose(trace.error, 2.0 * math.sqrt(columns))
    assert not np.any([trace.lateral, trace.lag, trace.lag_distance])
    one = trace_path(np.zeros(1), actual[:1], np.zeros((1, columns)))
    assert one.error == pytest.approx(2.0 * math.sqrt(columns))


def test_a_reference_that_starts_late_has_a_left_side() -> None:
    reference = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
    trace = trace_path(np.arange(3.0), reference + np.array([0.0, -0.2]), reference)
    np.testing.assert_allclose(trace.lateral, 0.2)
    np.testing.assert_allclose(trace.lag, 0.0, atol=1e-12)


def test_what_is_not_finite_is_not_on_the_path() -> None:
    reference = np.column_stack([np.arange(4.0), np.zeros(4)])
    actual = np.array(reference)
    actual[1, 0] = np.nan
    trace = trace_path(np.arange(4.0), actual, reference)
    for array in (trace.error, trace.lateral, trace.lag, trace.lag_distance):
        assert np.isnan(array[1])
    np.testing.assert_allclose(trace.error[[0, 2, 3]], 0.0, atol=1e-12)


def test_figures_are_of_the_halves_they_say() -> None:
    error = np.array([0.9, 0.1, 0.3, 0.2])
    lag = np.array([-0.1, 0.4, 0.2, -0.3])
    found = path_figures(PathTrace(error, 0.5 * error, lag, 2.0 * lag, 7.0), planar=True)
    assert found.length == 7.0
    assert found.rms == pytest.approx(math.sqrt((0.81 + 0.01 + 0.09 + 0.04) / 4.0))
    assert (found.final, found.settled) == (0.2, 0.3)
    assert found.mean_lateral == pytest.approx(0.125)
    assert (found.final_lag, found.final_lag_distance) == (-0.3, -0.6)
    assert (found.largest_lag, found.largest_lag_distance) == (0.4, 0.8)
