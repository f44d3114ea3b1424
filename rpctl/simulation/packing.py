"""Columns of numbers as bytes that deflate well, and back, bit for bit.

A column is told from coarse to fine: its first number, the one in its middle, those of its
quarters, and so on. Each is predicted from the ten nearest of those known before, by the polynomial
through them, and only the difference is kept, of the two numbers' ranks among all doubles. Motion
is smooth, so that what is left is little more than the rounding noise; interpolation amplifies that
noise by 1.3, where differences of fifth order, as long a prediction from one side alone, amplify it
by 16. The differences' bytes are sorted by significance, so that deflate meets them in runs.

The predictions are sums and products of doubles, one rounding each, and so the same on every
machine that NumPy runs on.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from rpctl.arrays import Array

PLANES = 8  # bytes of a double
BLOCK = 2**16  # numbers of a column that are predicted together, so that memory stays small
# Of the numbers 1, 3, 5, 7 and 9 half steps away, on both sides: the polynomial of degree 9.
WEIGHTS = tuple(w / 65536.0 for w in (39690.0, -8820.0, 2268.0, -405.0, 35.0))

Bytes = npt.NDArray[np.uint8]
Codes = np.ndarray[Any, np.dtype[np.int64]]


def pack(columns: Array, single: bool = False) -> Bytes:
    """Return columns (n, K) as bytes (n, 8, K), least significant first.

    Args:
        columns: Any doubles, not finite ones included.
        single: Whether they all are numbers of single precision; fewer bytes are then not zero.
    """
    count, rows = columns.shape
    codes: Codes = np.empty((count, rows), np.int64)
    codes[:, :1] = _ranks(columns[:, :1])
    at = 1
    for known, wanted, first in _levels(columns):
        end = at + wanted.shape[1]
        predicted = _interpolated(known, first, wanted.shape[1], single)
        codes[:, at:end] = _ranks(wanted) - _ranks(predicted)
        at = end
    codes = (codes << 1) ^ (codes >> 63)  # the sign last, so that small differences are small
    raw = codes.astype("<i8", copy=False).view(np.uint8).reshape(count, rows, PLANES)
    return np.ascontiguousarray(raw.transpose(0, 2, 1))


def unpack(planes: Bytes, single: bool = False) -> Array:
    """Return the columns (n, K) that :func:`pack` took apart.

    Args:
        planes: Bytes (n, 8, K).
        single: As they were packed.
    """
    count, _, rows = planes.shape
    raw = np.ascontiguousarray(planes.transpose(0, 2, 1))
    codes = raw.view("<i8").reshape(count, rows).astype(np.int64, copy=False)
    codes = ((codes >> 1) & np.int64(2**63 - 1)) ^ -(codes & 1)
    columns = np.empty((count, rows))
    columns[:, :1] = _numbers(codes[:, :1])
    at = 1
    for known, wanted, first in _levels(columns):
        end = at + wanted.shape[1]
        predicted = _interpolated(known, first, wanted.shape[1], single)
        wanted[:] = _numbers(_ranks(predicted) + codes[:, at:end])
        at = end
    return columns


def _levels(columns: Array) -> Iterator[tuple[Array, Array, int]]:
    """Yield what is known, a block of what comes next, and the number of its first; views all.

    What comes next lies in the middle behind each number known; the first number of all is known.
    """
    step = 1 << max(columns.shape[1] - 1, 0).bit_length() >> 1
    while step:
        known, middle = columns[:, :: 2 * step], columns[:, step :: 2 * step]
        for first in range(0, middle.shape[1], BLOCK):
            yield known, middle[:, first : first + BLOCK], first
        step //= 2


def _interpolated(known: Array, first: int, count: int, single: bool) -> Array:
    """Return predictions (n, count) of the numbers in the middle behind the known ones.

    Args:
        known: Numbers (n, m).
        first: Number of the known one before the first that is predicted.
        count: How many are predicted.
        single: Whether they are of single precision.
    """
    at, last = np.arange(first, first + count), known.shape[1] - 1
    found = np.zeros((known.shape[0], count))
    with np.errstate(all="ignore"):
        for k, weight in enumerate(WEIGHTS):
            pair = known[:, np.maximum(at - k, 0)] + known[:, np.minimum(at + 1 + k, last)]
            found = found + weight * pair
        if single:
            found = found.astype(np.float32).astype(np.float64)
    found[~np.isfinite(found)] = 0.0  # the bits of what is no number differ between machines
    return found


def _ranks(numbers: Array) -> Codes:
    """Return the doubles' ranks: whole numbers in their order, −0 before 0."""
    bits = np.ascontiguousarray(numbers).view(np.int64)
    return bits ^ ((bits >> 63) & np.int64(2**63 - 1))


def _numbers(ranks: Codes) -> Array:
    """Return the doubles of these ranks."""
    return (ranks ^ ((ranks >> 63) & np.int64(2**63 - 1))).view(np.float64)
