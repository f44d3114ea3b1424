"""Grids of cases that differ little: a few stand for all of them until a release."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def cells(
    grid: Iterable[Any], quick: Collection[Any] = (), slow: Collection[Any] = ()
) -> list[Any]:
    """Return a grid as ``pytest.mark.parametrize`` takes it.

    Args:
        grid: All cells, each a value or a tuple of values; ``make thorough`` runs the rest.
        quick: Those that ``make test`` runs.
        slow: Those that ``make slow`` runs.
    """
    whole = list(grid)
    unknown = {*quick, *slow} - {*whole}
    assert not unknown, f"no cells of the grid: {unknown}"

    def param(cell: Any) -> Any:
        values = cell if isinstance(cell, tuple) else (cell,)
        later = pytest.mark.slow if cell in slow else pytest.mark.thorough
        return pytest.param(*values, marks=[] if cell in quick else later)

    return [param(cell) for cell in whole]


def every(step: int, grid: Iterable[Any]) -> list[Any]:
    """Return a grid of which each ``step``-th cell is quick, the others slow."""
    whole = list(grid)
    return cells(whole, whole[::step], [cell for k, cell in enumerate(whole) if k % step])
