"""Central differences: the derivatives that need no formula."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rpctl.arrays import Array


def slopes(function: Callable[[Array], Array], at: Array, step: float) -> Array:
    """Return the derivatives (m, n) of a function of n numbers."""
    ends = [(function(at + each), function(at - each)) for each in step * np.eye(len(at))]
    return np.transpose([(ahead - behind) / (2.0 * step) for ahead, behind in ends])
