"""Whole control periods, where decimals are none of a binary fraction."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest

from rpctl import Plant, RpctlError
from rpctl.simulation.config import Config, RunSettings, delay_periods, is_whole, whole_periods
from rpctl.simulation.loop.notes import run_notes

PERIODS = ("0.001", "0.002", "0.003", "0.005", "0.01", "0.7")


@pytest.mark.parametrize("period", PERIODS)
def test_they_count_as_decimals_do(period: str) -> None:
    """Against exact fractions of what was written, up to the hours of a long run."""
    for tenths in (*range(1, 400), 1_000_000, 36_000_005):
        time = Fraction(period) * Fraction(tenths, 10)
        whole = tenths % 10 == 0
        periods = whole_periods(float(time), float(period))
        assert periods == max(1, math.floor(time / Fraction(period)))
        assert delay_periods(float(time), float(period)) == (tenths + 5) // 10
        assert is_whole(float(time), float(period), tenths // 10) is whole
    assert delay_periods(0.0, float(period)) == 0


def test_what_is_simulated_is_told() -> None:
    run = RunSettings(duration=1.0, control_period=0.3)
    ends, late = run_notes(Config(run=run, plant=Plant(delay=0.5)))
    said = "is not a whole number of control periods of"
    assert ends == f"a duration of 1 s {said} 0.3 s: the run ends at 0.9 s"
    assert late == f"a delay of 0.5 s {said} 0.3 s: the plant delays by 0.6 s"
    assert run_notes(Config(run=run, plant=Plant(delay=0.5)), whole=False) == (late,)


def test_what_is_no_time_is_told() -> None:
    with pytest.raises(RpctlError, match="duration is nan; give a positive number"):
        whole_periods(math.nan, 0.002)
    with pytest.raises(RpctlError, match="control_period is 0; give a positive number"):
        whole_periods(1.0, 0.0)
