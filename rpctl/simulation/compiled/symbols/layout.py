"""Several matrices in one column of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi


class Layout:
    """Where matrices stand in a column; only entries that are not constantly 0 do.

    Args:
        parts: Matrices ``casadi.SX`` by name.
    """

    def __init__(self, parts: Mapping[str, Any]) -> None:
        self._shapes = {name: part.sparsity() for name, part in parts.items()}
        self.size = sum(shape.nnz() for shape in self._shapes.values())
        self.column = casadi.vertcat(*(part.nz[:] for part in parts.values()))

    def parts(self, column: Any) -> dict[str, Any]:
        """Return the matrices in a column ``casadi.SX`` (size, 1) by name."""
        found, start = {}, 0
        for name, shape in self._shapes.items():
            found[name] = casadi.SX(shape, column[start : start + shape.nnz()])
            start += shape.nnz()
        return found
