"""What differs from run to run: settings by their paths, each with a distribution.

A path names a number of a :class:`~rpctl.simulation.config.Config`: its table, the setting, and
what the setting holds. ``plant.masses.arm_*`` is the entry of the pattern ``arm_*`` in the masses
of the plant; others are ``plant.track``, ``plant.noise.position``, ``plant.joint_friction.wheel_*``
(N·m or N, as in a file), ``run.initial_error.theta``, ``kinematic.horizon``, ``dynamic.gain``. So
every run is that of a configuration file.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, field
from fnmatch import fnmatchcase
from typing import Any, Protocol, cast, get_args, get_origin, runtime_checkable

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError, UnknownNameError, is_number, require_known
from rpctl.files.records import fields_of
from rpctl.libraries import library
from rpctl.simulation.config import Config

PATTERN = "PATTERN"  # stands for a pattern of names in the list of what there is
TABLES = ("plant", "run", "kinematic", "dynamic")
TUPLES = {  # names of entries
    "initial_error": ("x", "y", "theta"),
    "centres": ("x", "y", "z"),
    "com": ("x", "y", "z"),
    "slope": ("along_x", "along_y"),
}
WHOLE = ("encoder_bits",)  # numbers that are rounded
OF_SPEEDS = ("plant.lag", "plant.dead_time")  # what is said of robots that take speeds only
TAIL = 1e-3  # where a design asks for the end of a distribution that has none


@dataclass(frozen=True)
class Scatter:
    """Distributions of settings, by path."""

    distributions: Mapping[str, Distribution] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """The paths."""
        return tuple(self.distributions)

    def values(self, points: Array) -> Array:
        """Return the settings (K, n) at points (K, n) of the unit cube."""
        pairs = zip(self.distributions.values(), points.T, strict=True)
        columns = [distribution.quantile(p) for distribution, p in pairs]
        return np.column_stack(columns) if columns else np.empty((len(points), 0))


def scatter_of(given: Scatter | Mapping[str, Any] | None, config: Config) -> Scatter:
    """Return a scatter of the settings of a configuration.

    Args:
        given: Distributions, numbers, or what a file says of them, by path; None: nothing differs.
        config: What no run changes, and the laws.

    Raises:
        UnknownNameError: A path is none of the configuration's; those that there are are listed.
        RpctlError: A distribution is none.
    """
    scatter = (
        given
        if isinstance(given, Scatter)
        else Scatter({name: distribution_of(each, name) for name, each in (given or {}).items()})
    )
    choices = scattered_paths(config)
    for name in scatter.names:
        if not any(fnmatchcase(name, choice.replace(PATTERN, "?*")) for choice in choices):
            raise UnknownNameError("scattered setting", name, choices)
    return scatter


def scattered_paths(config: Config) -> tuple[str, ...]:
    """Return the paths of all numbers of a configuration that may differ from run to run.

    Of ``run`` that is the start alone: the samples of all runs are at the same times, and of the
    same reference.
    """
    return tuple(
        path
        for table in TABLES
        for path in _paths(getattr(config, table), table)
        if path != "plant.computing_time"
        and (config.output is not None or not path.startswith(OF_SPEEDS))
        and (not path.startswith("run.") or path.startswith("run.initial_error."))
    )


def _paths(record: Any, above: str) -> Iterator[str]:
    """Yield the paths of the numbers that a record holds, or may hold."""
    kind: Any = type(record)
    for name, item in fields_of(kind).items() if dataclasses.is_dataclass(record) else ():
        value, inner = getattr(record, name), get_args(item.type)
        named = isinstance(item.default, Mapping)
        pattern = f".{PATTERN}" if named else ""
        if dataclasses.is_dataclass(value):
            yield from _paths(value, f"{above}.{name}")
        elif name in TUPLES:
            yield from (f"{above}.{name}{pattern}.{entry}" for entry in TUPLES[name])
        elif named and inner[1] is float:
            yield f"{above}.{name}{pattern}"
        elif (
            name in WHOLE
            or item.type is float
            or (float in inner and get_origin(item.type) is not tuple)
        ):
            yield f"{above}.{name}"


def with_values(config: Config, names: tuple[str, ...], values: Array) -> Config:
    """Return a configuration with some settings changed.

    Args:
        config: The configuration.
        names: Paths of the settings.
        values: The settings (n,).

    Raises:
        RpctlError: A setting is out of range.
    """
    return with_entries(config, [key_path(config, name) for name in names], values.tolist())


def with_entries(config: Config, paths: Sequence[Sequence[str]], values: Sequence[Any]) -> Config:
    """Return a configuration with other values at the keys along some paths.

    Raises:
        RpctlError: A value is out of range.
    """
    changes: dict[str, Any] = {}
    for (*above, last), value in zip(paths, values, strict=True):
        place = changes
        for key in above:
            place = place.setdefault(key, {})
        place[last] = value
    return cast("Config", _changed(config, changes))


def settings_at(scatter: Scatter, points: Array) -> Array:
    """Return the settings (K, n) at points (K, n); where a distribution has no end, near it.

    Args:
        scatter: The distributions.
        points: Shares, from 0 to 1.
    """
    values = scatter.values(points)
    return np.where(np.isfinite(values), values, scatter.values(np.clip(points, TAIL, 1.0 - TAIL)))


def key_path(config: Config, name: str) -> list[str]:
    """Return the keys along a path; a pattern of names may hold dots."""
    keys: list[str] = []
    record: Any = config
    rest = name
    while rest and not isinstance(record, Mapping):
        key, _, rest = rest.partition(".")
        keys.append(key)
        record = getattr(record, key, None)
    named = rest.rsplit(".", 1) if keys[-1] in TUPLES else [rest]
    return [*keys, *named] if rest else keys


def _changed(value: Any, changes: Any, key: str = "") -> Any:
    """Return a record, mapping or tuple with entries changed, or the number in its place."""
    if not isinstance(changes, dict):
        return round(changes) if key in WHOLE and math.isfinite(changes) else changes
    if dataclasses.is_dataclass(value):
        fields = {k: _changed(getattr(value, k), each, k) for k, each in changes.items()}
        return dataclasses.replace(value, **fields)  # type: ignore[type-var]
    if key in TUPLES and not isinstance(value, Mapping):
        entries = value if value is not None else (0.0,) * len(TUPLES[key])
        return tuple({**dict(zip(TUPLES[key], entries, strict=True)), **changes}.values())
    return {**value, **{k: _changed(value.get(k), each, key) for k, each in changes.items()}}


# ---- distributions -----------------------------------------------------------------------


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
    """The same number in all runs.

    Attributes:
        value: The number, in the unit of the setting.

    Raises:
        RpctlError: The number is not finite.
    """

    value: float

    def quantile(self, p: Array) -> Array:
        """Return the number for each of the shares p (...,)."""
        return np.full(np.shape(p), self.value)


@dataclass(frozen=True)
class Uniform(_Finite):
    """A uniform distribution from ``low`` to ``high``.

    Attributes:
        low: Lower end, in the unit of the setting.
        high: Upper end, likewise.

    Raises:
        RpctlError: An end is not finite, or ``low`` is not below ``high``.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        """Refuse what is no range."""
        super().__post_init__()
        _require_order(self.low, self.high)

    def quantile(self, p: Array) -> Array:
        """Return the quantiles low + p (high − low) (...,) at shares p (...,)."""
        return np.asarray(self.low + np.asarray(p) * (self.high - self.low))


@dataclass(frozen=True)
class LogUniform(Uniform):
    """A distribution from ``low`` to ``high`` whose logarithm is uniform.

    Attributes:
        low: Lower end, positive, in the unit of the setting.
        high: Upper end, likewise.

    Raises:
        RpctlError: An end is not finite or not positive, or ``low`` is not below ``high``.
    """

    def __post_init__(self) -> None:
        """Refuse what has no logarithm."""
        super().__post_init__()
        if not self.low > 0.0:
            raise RpctlError(f"log-uniform from {self.low:g}; give a positive number")

    def quantile(self, p: Array) -> Array:
        """Return the quantiles low (high/low)^p (...,) at shares p (...,)."""
        low, high = math.log(self.low), math.log(self.high)
        found = np.exp(low + np.asarray(p) * (high - low))
        return np.asarray(np.clip(found, self.low, self.high))  # exp and log round


@dataclass(frozen=True)
class Normal:
    """A normal distribution, truncated below ``low`` and above ``high``.

    Attributes:
        mean: Mean before truncation, in the unit of the setting.
        std: Standard deviation before truncation, likewise; positive.
        low: Lower end; −inf by default.
        high: Upper end; inf by default.

    Raises:
        RpctlError: Mean or deviation is not finite, the deviation is not positive, or ``low`` is
            not below ``high``.
    """

    mean: float
    std: float
    low: float = field(default=-math.inf, kw_only=True)
    high: float = field(default=math.inf, kw_only=True)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.std) and self.std > 0.0):
            raise RpctlError(
                f"normal about {self.mean:g} with standard deviation {self.std:g}; give a finite "
                "mean and a positive deviation"
            )
        _require_order(self.low, self.high)

    def quantile(self, p: Array) -> Array:
        """Return the quantiles (...,) of the truncated distribution at shares p (...,)."""
        a, b = ((x - self.mean) / self.std for x in (self.low, self.high))
        found = library("scipy.stats").truncnorm.ppf(p, a, b, self.mean, self.std)
        return np.asarray(np.clip(found, self.low, self.high))


@dataclass(frozen=True, init=False)
class AnyOf:
    """A choice of numbers, each equally likely.

    Args:
        *values: The numbers, in the unit of the setting.

    Raises:
        RpctlError: There are no numbers, or one is not finite.
    """

    values: tuple[float, ...]

    def __init__(self, *values: float) -> None:
        object.__setattr__(self, "values", tuple(map(float, values)))
        if not values or not all(map(math.isfinite, values)):
            raise RpctlError(f"choice of {list(values)}; give one finite number or more")

    def quantile(self, p: Array) -> Array:
        """Return the numbers (...,) at shares p (...,), in their given order."""
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
        return DISTRIBUTIONS[name](*map(float, numbers))
    except TypeError:
        wanted = SIGNATURES.get(name, "[low, high]")
        raise RpctlError(f"{where}.{name} has {len(numbers)} numbers; give {wanted}") from None
    except RpctlError as error:
        raise RpctlError(f"{where}: {error}") from None


def distribution_table(distribution: Distribution) -> dict[str, list[float]]:
    """Return a distribution as a file says it; :func:`distribution_of` reads it.

    Raises:
        RpctlError: It is none of those that a file can name.
    """
    for name, kind in DISTRIBUTIONS.items():
        if type(distribution) is kind:
            return {name: list(getattr(distribution, "values", None) or astuple(distribution))}  # type: ignore[call-overload]
    raise RpctlError(
        f"{type(distribution).__name__} is none of {', '.join(DISTRIBUTIONS)}; a file cannot "
        "store it"
    )


def _require_order(low: float, high: float) -> None:
    if not low < high:
        raise RpctlError(f"from {low:g} to {high:g}; give the smaller number first")
