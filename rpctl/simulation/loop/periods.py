"""Durations and delays rounded to whole control periods.

The loop samples at whole control periods only, so a duration ends with the last one that is within
it, and a delay is the nearest number of them; halves count up.
"""

from __future__ import annotations

import math

from rpctl.errors import require_positive

CONTROL_PERIOD = 0.002  # s, where none is asked for
WHOLE_PERIOD_TOLERANCE = 1e-6  # of a period: a quotient this near to a whole number counts as one


def whole_periods(duration: float, control_period: float) -> int:
    """Return how many control periods (s) lie within a duration (s); one at least.

    Raises:
        RpctlError: One of them is not positive.
    """
    require_positive("duration", duration)
    require_positive("control_period", control_period)
    return max(1, math.floor(duration / control_period + WHOLE_PERIOD_TOLERANCE))


def delay_periods(delay: float, control_period: float) -> int:
    """Return the number of control periods (s) nearest to a delay (s); halves count up."""
    return math.floor(delay / control_period + 0.5 + WHOLE_PERIOD_TOLERANCE)


def is_whole(time: float, control_period: float, periods: int) -> bool:
    """Return whether a time (s) is that many control periods (s)."""
    return abs(time / control_period - periods) <= WHOLE_PERIOD_TOLERANCE
