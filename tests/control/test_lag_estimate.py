"""The lag that a robot's speeds tell: found where they do, and nothing said where they do not."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.control.lag_estimate import LagEstimate
from tests.grids import cells

Commanded = Callable[[float], float]
# rad/s or m/s, likewise, a fraction, and of a period.
SPOILT: list[dict[str, Any]] = [
    {"noise": 0.02},
    {"resolution": 0.05},
    {"lost": 0.3},
    {"jitter": 0.5},
]


def step(t: float) -> float:
    """Return a command that goes from rest to .5 at .5 s."""
    return 0.5 * (t >= 0.5)


def slow(t: float) -> float:
    """Return a command that changes over seconds, as those of a law on a reference."""
    return 0.5 * (1.0 - float(np.cos(0.8 * t))) + 0.1 * float(np.sin(2.0 * t))


def watched(
    command: Commanded,
    lag: float,
    dead_time: float,
    told: tuple[float, float] = (0.0, 0.0),
    period: float = 0.02,
    duration: float = 8.0,
    noise: float = 0.0,
    resolution: float = 0.0,
    lost: float = 0.0,
    gain: float = 1.0,
    jitter: float = 0.0,
    silent: tuple[float, float] = (0.0, 0.0),
    at_rest: float = 0.0,
) -> LagEstimate:
    """Return an estimate that watched one speed follow its commands, integrated piece by piece.

    Args:
        command: Of the time, s; held for a period.
        lag: s.
        dead_time: s.
        told: Both as they were told.
        period: s.
        duration: s.
        noise: Standard deviation of what is measured.
        resolution: Of what is measured.
        lost: Fraction of the samples that are not.
        gain: Of the robot.
        jitter: Of the sample's moments, of a period.
        silent: From when to when (s) no samples come.
        at_rest: Speed at the start.
    """
    rng = np.random.default_rng(1)
    found = LagEstimate(np.array([told[0]]), np.array([told[1]]), period)
    times = period * np.arange(round(duration / period))
    times = times + jitter * period * rng.uniform(-0.5, 0.5, len(times))
    times -= times[0]
    sent = np.array([command(t) for t in times])
    nu = at_rest
    for k, t in enumerate(times):
        seen = nu + noise * rng.normal()
        seen = resolution * round(seen / resolution) if resolution else seen
        if rng.uniform() >= lost and not silent[0] <= t < silent[1]:
            found.measured(float(t), np.array([seen]))
        found.sent(float(t), sent[k : k + 1])
        end = times[k + 1] if k + 1 < len(times) else t + period
        changes = times + dead_time
        pieces = [t, *changes[(changes > t + 1e-9) & (changes < end - 1e-9)], end]
        for a, b in pairwise(pieces):
            row = int(np.searchsorted(changes, 0.5 * (a + b))) - 1
            to = gain * sent[row] if row >= 0 else at_rest
            nu = to + (nu - to) * (np.exp(-(b - a) / lag) if lag else 0.0)
    return found


@pytest.mark.parametrize(
    "lag, dead_time, period",
    cells(
        [(T, D, P) for T in (0.0, 0.1, 0.2, 0.5) for D in (0.0, 0.1) for P in (0.002, 0.02, 0.05)],
        [(0.2, 0.1, 0.02), (0.2, 0.0, 0.002), (0.0, 0.1, 0.05), (0.0, 0.0, 0.02)],
    ),
)
def test_a_step_tells_lag_and_dead_time(lag: float, dead_time: float, period: float) -> None:
    found = watched(step, lag, dead_time, period=period, duration=4.0)
    assert found.learnt.all() == (lag + dead_time > 0.0)
    assert found.lag[0] == pytest.approx(lag, rel=0.08, abs=0.01)
    assert found.dead_times[0] == pytest.approx(dead_time, abs=0.01)


@pytest.mark.parametrize("period", [0.02, 0.05])
@pytest.mark.parametrize("spoilt", SPOILT)
def test_a_slow_motion_tells_their_sum(spoilt: dict[str, Any], period: float) -> None:
    """ν ≈ c(t − T − T_d) where c changes over a longer time than both."""
    found = watched(slow, 0.2, 0.1, period=period, **spoilt)
    assert found.lag[0] + found.dead_times[0] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize(
    "command, told, period",
    cells(
        [
            (command, *case)
            for command in (step, slow)
            for case in (((0.2, 0.07), 0.02), ((0.48, 0.3), 0.02), ((0.02, 0.055), 0.01))
        ],
        [(step, (0.48, 0.3), 0.02), (slow, (0.2, 0.07), 0.02), (slow, (0.02, 0.055), 0.01)],
    ),
)
def test_what_is_told_rightly_stays(
    command: Commanded, told: tuple[float, float], period: float
) -> None:
    """With noise and with samples at odd moments, whose commands change within a stride.

    A lag of .48 s lies in the middle between two that are tried, neither of which is as good. At
    10 ms a stride has two samples; the mean of what these end with is 5 ms early.
    """
    for spoilt in [{}, *SPOILT]:
        found = watched(command, *told, told=told, period=period, **spoilt)
        assert not found.learnt.any(), spoilt
        assert [found.lag[0], found.dead_times[0]] == pytest.approx(told, abs=1e-6)


@pytest.mark.parametrize(
    "command, gain", [(lambda t: 0.0, 1.0), (lambda t: 0.5, 1.0), (step, 0.0), (step, 0.9)]
)
def test_nothing_is_learnt_of_what_tells_nothing(command: Commanded, gain: float) -> None:
    """A robot that rests, one that moves evenly, a dead motor, and one that is only slower."""
    at_rest = gain * command(0.0)
    for spoilt in SPOILT:
        found = watched(command, 0.0, 0.0, gain=gain, at_rest=at_rest, **spoilt)
        assert not found.learnt.any(), spoilt


def test_chance_is_no_lag() -> None:
    """Of a motion of .1 under noise of .02 the best lag is off, but not better beyond chance."""
    found = watched(lambda t: 0.2 * slow(t), 0.1, 0.0, told=(0.1, 0.0), noise=0.02, duration=4.0)
    assert not found.learnt.any()


def test_a_lag_beyond_those_that_are_tried_stays_as_told() -> None:
    found = watched(step, 2.0, 0.0, told=(2.0, 0.0), duration=15.0)
    assert not found.learnt.any()


def test_half_a_lag_is_corrected_both_ways() -> None:
    for told in (0.1, 0.3):
        found = watched(slow, 0.2, 0.0, told=(told, 0.0))
        assert found.lag[0] + found.dead_times[0] == pytest.approx(0.2, abs=0.01)


def test_a_silence_teaches_nothing_wrong() -> None:
    """For a second the robot moves unseen; what was learnt stays, nothing else comes.

    In the second case it is sent a step unseen, which acts when it is seen again.
    """
    right = watched(slow, 0.2, 0.1, told=(0.2, 0.1), silent=(3.0, 4.0))
    assert not right.learnt.any()
    right = watched(
        lambda t: 0.5 * (t >= 3.95), 0.2, 0.2, told=(0.2, 0.2), silent=(3.0, 4.0), duration=5.0
    )
    assert not right.learnt.any()
    late = watched(slow, 0.2, 0.1, silent=(3.0, 4.0))
    assert late.lag[0] + late.dead_times[0] == pytest.approx(0.3, abs=0.01)


def test_an_estimate_is_taken_in_smoothly() -> None:
    """T goes to its value in .3 s; of a leap of .2 s each sample of 20 ms takes 1 − e^(−1/15)."""
    found, used = LagEstimate(np.zeros(1), np.zeros(1), 0.02), list[Array]()
    nu, left = 0.0, float(np.exp(-0.02 / 0.2))
    for k in range(150):
        found.measured(0.02 * k, np.array([nu]))
        found.sent(0.02 * k, np.array([step(0.02 * k)]))
        nu = step(0.02 * k) + (nu - step(0.02 * k)) * left
        used.append(found.lag)
    assert used[-1][0] == pytest.approx(0.2, abs=0.01)
    assert np.abs(np.diff(used, axis=0)).max() < 0.25 * (1.0 - np.exp(-1.0 / 15.0))


def test_the_sentence_says_what_was_told_and_what_to_tell() -> None:
    assert watched(step, 0.2, 0.1, told=(0.2, 0.1)).sentence(("v",)) == ""
    said = watched(step, 0.2, 0.1).sentence(("v",))
    assert "0.21 s of v (0 s set), after a dead time of 0.1 s (0 s set)" in said
    assert "--actuator-lag 0.21 --dead-time 0.1" in said


@pytest.mark.parametrize("later", [(0.1, 0.1), (0.1, 0.0), (-0.1, 0.06)])
def test_groups_of_told_dead_times_learn_each_their_own(later: tuple[float, float]) -> None:
    """A base told .2 s and a joint told .04 s, both sent steps; what is as told stays so."""
    told, true = np.array([0.2, 0.2, 0.04]), np.array([0.2, 0.2, 0.04])
    true += [later[0], later[0], later[1]]
    found, period = LagEstimate(np.full(3, 0.1), told, 0.02), 0.02
    nu, left = np.zeros(3), np.exp(-period / 0.1)
    for k in range(200):
        t = k * period
        found.measured(t, nu)
        found.sent(t, np.array([step(t), -step(t), step(t)]))
        to = np.array([step(t - d + 1e-9) for d in true]) * [1.0, -1.0, 1.0]
        nu = to + (nu - to) * left
    np.testing.assert_allclose(found.dead_times, true, atol=0.01)
    np.testing.assert_allclose(found.lag, 0.1, atol=0.01)
    assert found.learnt.tolist() == [later[0] != 0.0, later[0] != 0.0, later[1] != 0.0]
