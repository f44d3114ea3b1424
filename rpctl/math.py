"""The functions that formulas are written with: CasADi's, of its symbols and of floats.

``math.cos``, ``math.if_else``, ``math.fmax`` and all others of CasADi. A formula that is written
with them runs in machine code, is written as C or LaTeX, and its rate is taken, not typed. CasADi
is imported when the first of them is asked for.
"""

from __future__ import annotations

from typing import Any

SERIES_RADIUS = 1e-2  # rad; below it the series of sin(x)/x is exact to rounding


def __getattr__(name: str) -> Any:
    import casadi

    return getattr(casadi, name)


def sinc(x: Any) -> Any:
    """Return sin(x)/x, 1 at 0; its rate is finite there, too."""
    import casadi

    near, square = casadi.fabs(x) < SERIES_RADIUS, x * x
    series = 1.0 - square / 6.0 * (1.0 - square / 20.0)
    return casadi.if_else(near, series, casadi.sin(x) / casadi.if_else(near, 1.0, x))
