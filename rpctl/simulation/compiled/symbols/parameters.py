"""What one plant has otherwise than another: entries of a vector p instead of constants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError

SAME = 1e-12  # of an array's largest entry: numbers so near to each other are the same


@dataclass(frozen=True)
class Varied:
    """What is not the same in all the robots that one graph is for.

    Attributes:
        bodies: Joints whose bodies (all links up to the next joints) have other masses, centres or
            inertias; ``"root_joint"`` is the base.
        rolling: Whether radii, track, trails or pivots differ.
        losses: Joints whose damping or friction differs.
        slope: Whether the slope of the ground differs.
    """

    bodies: tuple[str, ...] = ()
    rolling: bool = False
    losses: tuple[str, ...] = ()
    slope: bool = False


NOTHING = Varied()


class Parameters:
    """Arrays of numbers by name, of which some entries are symbols.

    Args:
        numbers: The arrays of the robot that the graph is made for.
        varied: Which of their entries are symbols; none of those left out.

    Attributes:
        symbols: ``casadi.SX`` (n, 1), array after array.
    """

    def __init__(
        self, numbers: Mapping[str, Array], varied: Mapping[str, NDArray[np.bool_]]
    ) -> None:
        self._numbers = dict(numbers)
        self._varied = {
            name: varied.get(name, np.zeros(array.shape, bool)) for name, array in numbers.items()
        }
        self.symbols = casadi.SX.sym("p", sum(int(mask.sum()) for mask in self._varied.values()))

    def scalars(self) -> dict[str, Any]:
        """Return the arrays as nested lists of floats and symbols, by name."""
        found, first = {}, 0
        for name, array in self._numbers.items():
            mask = self._varied[name]
            values = array.astype(object)
            for k, place in enumerate(zip(*np.nonzero(mask), strict=True), start=first):
                values[place] = _Held(self.symbols[k])
            first += int(mask.sum())
            found[name] = _released(values.tolist())
        return found

    def values(self, numbers: Mapping[str, Array]) -> Array:
        """Return the values (n,) of the symbols that stand for other arrays of the same shapes.

        Args:
            numbers: Arrays by name; stacks of them (..., shape) give values (..., n).

        Raises:
            RpctlError: They differ in more than symbols stand for.
        """
        found = []
        for name, nominal in self._numbers.items():
            mask, array = self._varied[name], numbers[name]
            change = np.abs(array - nominal)[..., ~mask]
            if change.max(initial=0.0) > SAME * np.abs(nominal).max(initial=1.0):
                raise RpctlError(
                    f"the variant differs from its robot in more than what is varied ({name})"
                )
            found.append(array[..., mask])
        stack = np.broadcast_shapes(*(values.shape[:-1] for values in found))
        return np.concatenate(
            [np.broadcast_to(values, (*stack, values.shape[-1])) for values in found], axis=-1
        )


@dataclass(frozen=True, eq=False)
class _Held:
    """A symbol that NumPy does not take for an array."""

    symbol: Any


def _released(values: Any) -> Any:
    if isinstance(values, list):
        return [_released(value) for value in values]
    return values.symbol if isinstance(values, _Held) else float(values)
