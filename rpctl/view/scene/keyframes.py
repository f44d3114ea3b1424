"""Selection of keyframes from which a viewer interpolates a motion to a tolerance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array

POSITION_TOLERANCE_M = 5e-4  # m; a third of a pixel where a robot of 1.5 m fills the picture
ROTATION_TOLERANCE_RAD = 2e-3  # rad; moves what is 0.3 m away from the axis by as much
MAX_STEP_RAD = 2.0  # rad from one frame to the next

Deviation = Callable[[int, int], Array]


def position_keyframes(times: Array, values: Array) -> NDArray[np.int64]:
    """Return the frames from which straight lines give positions (n, 3) to a tolerance.

    Args:
        times: Times of the frames (n,), s.
        values: m.
    """

    def deviation(first: int, last: int) -> Array:
        fraction = _fractions(times, first, last)[:, None]
        line = (1.0 - fraction) * values[first] + fraction * values[last]
        return np.asarray(np.linalg.norm(values[first : last + 1] - line, axis=1))

    return _keep(len(times), deviation, POSITION_TOLERANCE_M)


def rotation_keyframes(times: Array, values: Array) -> NDArray[np.int64]:
    """Return the frames from which great arcs give unit quaternions (n, 4) to a tolerance.

    Args:
        times: Times of the frames (n,), s.
        values: Quaternions, of either sign.
    """

    def deviation(first: int, last: int) -> Array:
        fraction = _fractions(times, first, last)[:, None]
        start, end = values[first], values[last]
        cosine = start @ end
        if cosine < 0.0:  # the same turn, by the nearer of its two quaternions
            cosine, end = -cosine, -end
        half = np.arccos(min(cosine, 1.0))
        if half > MAX_STEP_RAD / 2.0:  # towards half a turn, rounding would choose the way
            return np.pi * np.minimum(fraction, 1.0 - fraction)[:, 0]
        if half < 1e-9:
            arc = np.broadcast_to(start, (len(fraction), 4))
        else:
            arc = (
                np.sin((1.0 - fraction) * half) * start + np.sin(fraction * half) * end
            ) / np.sin(half)
        nearness = np.abs(np.einsum("ij,ij->i", values[first : last + 1], arc))
        return np.asarray(2.0 * np.arccos(np.minimum(nearness, 1.0)))

    return _keep(len(times), deviation, ROTATION_TOLERANCE_RAD)


def _fractions(times: Array, first: int, last: int) -> Array:
    return np.asarray((times[first : last + 1] - times[first]) / (times[last] - times[first]))


def _keep(count: int, deviation: Deviation, tolerance: float) -> NDArray[np.int64]:
    """Return first and last frame and, recursively, the worst of each interval."""
    kept, stretches = {0, count - 1}, [(0, count - 1)]
    while stretches:
        first, last = stretches.pop()
        if last - first < 2:
            continue
        away = deviation(first, last)
        worst = first + int(away.argmax())
        if away[worst - first] > tolerance:
            kept.add(worst)
            stretches += [(first, worst), (worst, last)]
    return np.array(sorted(kept))
