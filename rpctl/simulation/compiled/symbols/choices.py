"""Choices between numbers in CasADi's symbols; what is not chosen is computed, too.

So no branch may divide by 0 or take the root of less where its derivative is wanted.
"""

from __future__ import annotations

import math
from typing import Any

import casadi


def clipped(value: Any, lower: Any, upper: Any) -> Any:
    """Return a value within bounds, as ``numpy.clip``; infinite bounds are left out.

    Args:
        value: (1, 1).
        lower: (1, 1).
        upper: (1, 1).
    """
    above = value if _is_infinite(lower) else casadi.fmax(value, lower)
    return above if _is_infinite(upper) else casadi.fmin(above, upper)


def _is_infinite(bound: Any) -> bool:
    return isinstance(bound, float) and math.isinf(bound)


def rounded(value: Any) -> Any:
    """Return the nearest integer (1, 1); of two the even one, as Python's ``round``."""
    below = casadi.floor(value)
    rest = value - below
    odd = below - 2.0 * casadi.floor(0.5 * below)
    return below + casadi.logic_or(rest > 0.5, casadi.logic_and(rest == 0.5, odd))


def any_nonzero(values: Any) -> Any:
    """Return whether any entry (n, 1) is not 0."""
    found = casadi.SX(0)
    for k in range(values.numel()):
        found = casadi.logic_or(found, values[k] != 0)
    return found
