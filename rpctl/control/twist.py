"""A twist of the base to ask for."""

from __future__ import annotations

from typing import NamedTuple

from rpctl.arrays import Array


class Twist(NamedTuple):
    """P's speed forward and to the left (m/s) and the turning rate, and the rates of the three."""

    value: Array  # (3,)
    rate: Array  # (3,)
