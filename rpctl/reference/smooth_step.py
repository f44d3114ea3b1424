"""The step that rises from 0 to 1 with neither a bend nor a corner: u³ (10 − 15 u + 6 u²)."""

from __future__ import annotations

from typing import Any, NamedTuple


class SmoothStep(NamedTuple):
    """The step at u, or at an array of them, with its integral from 0 and its derivatives by u."""

    area: Any
    value: Any
    slope: Any
    bend: Any


def smooth_step(u: Any) -> SmoothStep:
    """Return the step at u in [0, 1], a number or an array: its slope and bend are 0 at both ends.

    Beyond 1 the value stays 1, and the area goes on by u − 1; the caller sees to it.
    """
    square, rest = u * u, 1.0 - u
    return SmoothStep(
        area=square * square * (2.5 + u * (u - 3.0)),
        value=square * u * (10.0 + u * (6.0 * u - 15.0)),
        slope=30.0 * square * rest * rest,
        bend=60.0 * u * rest * (rest - u),
    )
