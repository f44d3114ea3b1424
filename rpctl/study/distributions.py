"""Distributions of a number that differs from run to run, by their quantile functions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError, is_number, require_known
from rpctl.libraries import library


@runtime_checkable
class Distribution(Protocol):
    """A distribution of a number."""

    def quantile(self, p: Array) -> Array:
        """Return the numbers below which the shares p (...,), from 0 to 1, of all draws lie."""


class _Finite:
    def __post_init__(self) -> None:
        numbers = astuple(self)  # type: ignore[call-overload]
        if not all(map(math.isfinite, numbers)):
            given = ", ".join(f"{each:g}" for each in numbers)
            raise RpctlError(f"{type(self).__name__}({given}); give finite numbers")


@dataclass(frozen=True)
class Fixed(_Finite):
    """The same number in all runs."""

    value: float

    def quantile(self, p: Array) -> Array:
        """Return the number (...,)."""
        return np.full(np.shape(p), self.value)


@dataclass(frozen=True)
class Uniform(_Finite):
    """Evenly from ``low`` to ``high``."""

    low: float
    high: float

    def __post_init__(self) -> None:
        """Refuse what is no range."""
        super().__post_init__()
        _require_order(self.low, self.high)

    def quantile(self, p: Array) -> Array:
        """Return low + p (high − low), (...,)."""
        return np.asarray(self.low + np.asarray(p) * (self.high - self.low))


@dataclass(frozen=True)
class LogUniform(Uniform):
    """From ``low`` to ``high``, both positive, its logarithm evenly."""

    def __post_init__(self) -> None:
        """Refuse what has no logarithm."""
        super().__post_init__()
        if not self.low > 0.0:
            raise RpctlError(f"log-uniform from {self.low:g}; give a positive number")

    def quantile(self, p: Array) -> Array:
        """Return low (high/low)^p, (...,)."""
        low, high = math.log(self.low), math.log(self.high)
        found = np.exp(low + np.asarray(p) * (high - low))
        return np.asarray(np.clip(found, self.low, self.high))  # exp and log round


@dataclass(frozen=True)
class Normal:
    """Normal about ``mean``, cut off below ``low`` and above ``high``."""

    mean: float
    std: float
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.std) and self.std > 0.0):
            raise RpctlError(
                f"normal about {self.mean:g} with standard deviation {self.std:g}; give a finite "
                "mean and a positive deviation"
            )
        _require_order(self.low, self.high)

    def quantile(self, p: Array) -> Array:
        """Return the quantiles (...,) of what is left of the normal distribution."""
        special = library("scipy.special")
        # The tail that holds less is used: near 1 shares have no digits left.
        flip = self.low > self.mean
        a, b = ((x - self.mean) / self.std for x in (self.low, self.high))
        if flip:
            a, b, p = -b, -a, 1.0 - np.asarray(p)
        share = special.ndtr(a) + np.asarray(p) * (special.ndtr(b) - special.ndtr(a))
        units = special.ndtri(share)
        found = self.mean + self.std * (-units if flip else units)
        return np.asarray(np.clip(found, self.low, self.high))


@dataclass(frozen=True, init=False)
class AnyOf:
    """One of some numbers, each as often as the others."""

    values: tuple[float, ...]

    def __init__(self, *values: float) -> None:
        object.__setattr__(self, "values", tuple(map(float, values)))
        if not values or not all(map(math.isfinite, values)):
            raise RpctlError(f"choice of {list(values)}; give one finite number or more")

    def quantile(self, p: Array) -> Array:
        """Return the numbers (...,) in the order in which they were given."""
        index = np.minimum((np.asarray(p) * len(self.values)).astype(int), len(self.values) - 1)
        return np.asarray(np.array(self.values)[index])


DISTRIBUTIONS: dict[str, Any] = {
    "fixed": Fixed,
    "uniform": Uniform,
    "log-uniform": LogUniform,
    "normal": Normal,
    "choice": AnyOf,
}
SIGNATURES = {"fixed": "[value]", "normal": "[mean, std] or [mean, std, low, high]"}


def distribution_of(value: object, where: str) -> Distribution:
    """Return a distribution: itself, that of a number, or what a file says: ``{uniform = [0, 1]}``.

    Args:
        value: A distribution, a number, or a mapping from the name of one to its numbers.
        where: What it is of, for messages.

    Raises:
        RpctlError: It is none.
    """
    if isinstance(value, Distribution):
        return value
    if is_number(value):
        return Fixed(float(value))
    if not isinstance(value, Mapping) or len(value) != 1:
        raise RpctlError(f"{where} is {value!r}; give a number, or as {{ uniform = [0.9, 1.1] }}")
    ((name, numbers),) = value.items()
    require_known(f"{where}: distribution", [str(name)], DISTRIBUTIONS)
    numbers = numbers if isinstance(numbers, list | tuple) else [numbers]
    if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in numbers):
        raise RpctlError(f"{where}.{name} is {numbers!r}; give numbers")
    try:
        found: Distribution = DISTRIBUTIONS[name](*map(float, numbers))
    except TypeError:
        wanted = SIGNATURES.get(name, "[low, high]")
        raise RpctlError(f"{where}.{name} has {len(numbers)} numbers; give {wanted}") from None
    except RpctlError as error:
        raise RpctlError(f"{where}: {error}") from None
    return found


def distribution_table(distribution: Distribution) -> dict[str, list[float]]:
    """Return a distribution as a file says it; :func:`distribution_of` reads it.

    Raises:
        RpctlError: It is none of those that a file can name.
    """
    for name, kind in DISTRIBUTIONS.items():
        if type(distribution) is kind:
            return {name: list(getattr(distribution, "values", None) or astuple(distribution))}  # type: ignore[call-overload]
    raise RpctlError(
        f"{type(distribution).__name__} is none of {', '.join(DISTRIBUTIONS)}; no file can say it"
    )


def _require_order(low: float, high: float) -> None:
    if not low < high:
        raise RpctlError(f"from {low:g} to {high:g}; give the smaller number first")
