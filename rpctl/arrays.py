"""``Array``: the one type of every vector and matrix, and how a record keeps one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NOTHING: Array = np.empty(0)  # where there are no numbers


def read_only(values: Any) -> Array:
    """Return a copy of numbers as an array that nobody can write to."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
