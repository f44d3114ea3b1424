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
from dataclasses import dataclass, field
from typing import Any, get_args, get_origin

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import UnknownNameError
from rpctl.files.records import fields_of
from rpctl.simulation.config import Config
from rpctl.study.distributions import Distribution, distribution_of

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
    scatter = given
    if not isinstance(scatter, Scatter):
        items = (scatter or {}).items()
        scatter = Scatter({name: distribution_of(value, name) for name, value in items})
    choices = scattered_paths(config)
    for name in scatter.names:
        if not any(_is_path(name, choice) for choice in choices):
            raise UnknownNameError("scattered setting", name, choices)
    return scatter


def _is_path(name: str, choice: str) -> bool:
    """Return whether a path is one of the list of what there is."""
    head, pattern, tail = choice.partition(PATTERN)
    long = len(name) > len(head) + len(tail)
    matches = pattern and long and name.startswith(head) and name.endswith(tail)
    return name == choice or bool(matches)


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
    changed: Config = _changed(config, changes)
    return changed


def settings_at(scatter: Scatter, points: Array) -> Array:
    """Return the settings (K, n) at points (K, n); where a distribution has no end, near it.

    Args:
        scatter: The distributions.
        points: Shares, from 0 to 1.
    """
    values = scatter.values(points)
    inner = scatter.values(np.clip(points, TAIL, 1.0 - TAIL))
    return np.where(np.isfinite(values), values, inner)


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
