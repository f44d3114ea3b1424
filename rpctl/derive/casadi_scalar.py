"""CasADi symbols as plain scalars, so that NumPy's object arrays can hold them."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np

from rpctl.equivalence.tree import Scalars


class CasadiScalar:
    """One ``casadi.SX`` that NumPy takes for a scalar.

    CasADi's own type looks like an array to NumPy and refuses to be an element of one.
    """

    __slots__ = ("sx",)

    def __init__(self, value: Any) -> None:
        self.sx: Any = value.sx if isinstance(value, CasadiScalar) else casadi.SX(float(value))

    @classmethod
    def of(cls, sx: Any) -> CasadiScalar:
        """Return an element that holds a scalar ``casadi.SX``."""
        element = cls(0.0)
        element.sx = sx
        return element

    def __neg__(self) -> CasadiScalar:
        return CasadiScalar.of(-self.sx)

    def __pow__(self, exponent: int) -> CasadiScalar:
        return CasadiScalar.of(self.sx**exponent)

    def __bool__(self) -> bool:
        return not (self.sx.is_constant() and float(self.sx) == 0.0)


def _operator(compute: Callable[[Any, Any], Any], swapped: bool) -> Callable[..., Any]:
    def apply(self: CasadiScalar, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # NumPy then takes this element for each of the array's
        left, right = self.sx, CasadiScalar(other).sx
        return CasadiScalar.of(compute(right, left) if swapped else compute(left, right))

    return apply


for _name in ("add", "sub", "mul", "truediv"):
    setattr(CasadiScalar, f"__{_name}__", _operator(getattr(operator, _name), False))
    setattr(CasadiScalar, f"__r{_name}__", _operator(getattr(operator, _name), True))


CASADI = Scalars(
    number=lambda value, kind, label: CasadiScalar(value),
    cos=lambda angle: CasadiScalar.of(casadi.cos(CasadiScalar(angle).sx)),
    sin=lambda angle: CasadiScalar.of(casadi.sin(CasadiScalar(angle).sx)),
    sqrt=lambda value: CasadiScalar.of(casadi.sqrt(CasadiScalar(value).sx)),
)
