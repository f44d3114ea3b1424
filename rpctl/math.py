"""The functions that formulas are written with: CasADi's, of its symbols and of floats.

``math.cos``, ``math.if_else``, ``math.fmax`` and all others of CasADi. A formula that is written
with them runs in machine code, is written as C or LaTeX, and its rate is taken, not typed. CasADi
is imported when the first of them is asked for.
"""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    import casadi

    return getattr(casadi, name)
