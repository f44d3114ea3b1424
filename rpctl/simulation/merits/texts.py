"""Figures of a run in words."""

from __future__ import annotations


def length(value: float) -> str:
    """Return a length, given in m, as text in m, mm or µm."""
    for unit, size in (("m", 1.0), ("mm", 1e-3)):
        if abs(value) >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-6:.3g} µm" if value else "0 m"


def lag(time: float, distance: float) -> str:
    """Return a lag, given in s and in m along the path, as text."""
    return f"{time + 0.0:.2f} s ({length(distance)})"
