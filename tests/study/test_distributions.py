"""Quantiles of cut-off normal distributions, against the whole one's tails."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import log_ndtr
from scipy.stats import norm

from rpctl.study.scatter import Normal

SHARES = np.array([0.0, 0.1, 0.5, 0.9])


@pytest.mark.parametrize("low", [-1.0, 0.5, 10.0, 30.0])
def test_a_cut_off_normal_has_its_shares_left(low: float) -> None:
    """Q(x) = (1 − p) Q(low), even where 1 − Q(low) is 1 to all digits; mirrored likewise."""
    x = (Normal(2.0, 3.0, low=2.0 + 3.0 * low).quantile(SHARES) - 2.0) / 3.0
    np.testing.assert_allclose(log_ndtr(-x), np.log1p(-SHARES) + log_ndtr(-low), rtol=1e-9)
    mirrored = Normal(2.0, 3.0, high=2.0 - 3.0 * low).quantile(1.0 - SHARES)
    np.testing.assert_allclose(2.0 - mirrored, 3.0 * x, rtol=1e-9, atol=1e-9)


def test_between_two_bounds_the_median_halves_what_is_left() -> None:
    low, high = 1.0, 2.5
    middle = float(Normal(0.0, 1.0, low=low, high=high).quantile(np.array([0.5]))[0])
    assert norm.cdf(middle) - norm.cdf(low) == pytest.approx(norm.cdf(high) - norm.cdf(middle))
