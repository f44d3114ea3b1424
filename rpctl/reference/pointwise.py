"""Formulas of one number and of many alike: each is written once.

A number is a float, and many are an array (K,). A vector of a number is an array (n,), and of many
it is an array (K, n), a row each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rpctl.arrays import Array

Numbers = Any  # a float or an array (K,)
Answer = TypeVar("Answer", bound=NamedTuple)


def functions(s: Numbers) -> Any:
    """Return the module whose sin, cos, atan2 and sqrt are the quickest for numbers."""
    return np if isinstance(s, np.ndarray) else math


def beside(s: Numbers) -> Any:
    """Return numbers such that they scale vectors of as many."""
    return s[:, None] if isinstance(s, np.ndarray) else s


def entries(vectors: Array) -> list[Any]:
    """Return the entries of a vector (n,) or of vectors (K, n): n numbers, or n arrays (K,)."""
    found: list[Any] = vectors.tolist() if vectors.ndim == 1 else list(vectors.T)
    return found


def vector(s: Numbers, parts: Sequence[Numbers]) -> Array:
    """Return a vector (n,) of its entries, or as many (K, n) as there are numbers.

    Args:
        s: The numbers.
        parts: The entries (n,): of all, or those of each.
    """
    if not isinstance(s, np.ndarray):
        return np.array(parts)
    found = np.empty((len(s), len(parts)))
    for column, part in enumerate(parts):
        found[:, column] = part
    return found


def matrix(s: Numbers, rows: Sequence[Sequence[Numbers]]) -> Array:
    """Return a matrix (m, n) of its rows' entries, or as many (K, m, n) as there are numbers.

    Args:
        s: The numbers.
        rows: The rows, n entries each.
    """
    if not isinstance(s, np.ndarray):
        return np.array(rows)
    return vector(s, [part for row in rows for part in row]).reshape(len(s), len(rows), -1)


def split_rows(matrices: Array) -> Array:
    """Return the rows of a matrix (m, n) or of matrices (K, m, n), to be unpacked."""
    return matrices if matrices.ndim == 2 else matrices.swapaxes(0, 1)


def stack_rows(*rows: Array) -> Array:
    """Return the matrix of rows (n,), or the matrices of rows (K, n)."""
    found = np.array(rows)
    return found if found.ndim == 2 else np.ascontiguousarray(found.swapaxes(0, 1))


def choose(
    condition: Any,
    s: Numbers,
    then: Callable[[Any], Answer],
    otherwise: Callable[[Any], Answer],
) -> Answer:
    """Return one of two formulas' answers, for each number that of its own.

    Args:
        condition: Whether it is the first one's; of many numbers an array (K,).
        s: The numbers.
        then: The first formula.
        otherwise: The second.
    """
    if not isinstance(s, np.ndarray):
        return then(s) if condition else otherwise(s)
    if condition.all():
        return then(s)
    if not condition.any():
        return otherwise(s)
    first, second = then(s[condition]), otherwise(s[~condition])
    found = []
    for a, b in zip(first, second, strict=True):
        whole = np.empty((len(s), *np.shape(a)[1:]))
        whole[condition], whole[~condition] = a, b
        found.append(whole)
    make: Callable[..., Answer] = type(first)
    return make(*found)
