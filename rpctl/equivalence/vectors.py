"""Vectors and Jacobians of any scalar, one state or many: components are the last axes.

A vector is (..., 3), a Jacobian (..., 3, n); the axes before are states, none for one state. What
NumPy's operators do for stacks of matrices is used as it is; here is the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rpctl.arrays import Array


def components(a: Array) -> Array:
    """Return the components of vectors (..., k) one after the other: an array (k, ...)."""
    return a if a.ndim == 1 else np.moveaxis(a, -1, 0)


def vector(entries: Sequence[Any]) -> Array:
    """Return the vectors (..., k) of k components, each a scalar or of shape (...)."""
    stacked = np.array(entries)
    return stacked if stacked.ndim == 1 else np.moveaxis(stacked, 0, -1)


def lifted(scalar: Any) -> Array:
    """Return a scalar for each state, (...), as factors (..., 1) of vectors."""
    return np.asarray(scalar)[..., None]


def dot(a: Array, b: Array) -> Any:
    """Return a · b of vectors (..., k)."""
    return (a * b).sum(axis=-1)


def outer(a: Array, b: Array) -> Array:
    """Return a bᵀ (..., k, n) of vectors (..., k) and (..., n)."""
    return a[..., :, None] * b[..., None, :]


def cross(a: Array, b: Array) -> Array:
    """Return a × b of vectors (..., 3)."""
    (ax, ay, az), (bx, by, bz) = components(a), components(b)
    return vector([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def cross_columns(J: Array, b: Array) -> Array:
    """Return the columns of J (..., 3, n), each × b (..., 3)."""
    x, y, z = J[..., 0, :], J[..., 1, :], J[..., 2, :]
    bx, by, bz = b[..., 0, None], b[..., 1, None], b[..., 2, None]
    return np.moveaxis(np.array([y * bz - z * by, z * bx - x * bz, x * by - y * bx]), 0, -2)


def in_rows(rows: Sequence[Array]) -> Array:
    """Return matrices (..., rows, n) of rows (..., n), some of which may be of no state."""
    return np.stack(np.broadcast_arrays(*rows), axis=-2)
