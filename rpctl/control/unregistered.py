"""Laws and obstacles of somebody's own, as a run keeps them: their name and settings, no code."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from rpctl.control.obstacles import OBSTACLES
from rpctl.errors import RpctlError

OBSTACLE_NAMES = {kind: name for name, kind in OBSTACLES.items()}


@dataclass(frozen=True)
class Unregistered:
    """A law or an obstacle that rpctl has no name for; it cannot be started.

    Attributes:
        name: Name of its class or function.
        settings: Its settings by name: numbers, texts, tuples, mappings, discs and half-planes;
            all else, laws as well, is unregistered in turn.
    """

    name: str
    settings: Mapping[str, object] = field(default_factory=dict)

    def named_table(self, key: str) -> dict[str, Any]:
        """Return what a run's file says of it."""
        return {key: self.name, "settings": to_json(self.settings)}

    def start(self, *_: object) -> NoReturn:
        """Refuse to start.

        Raises:
            RpctlError: Always.
        """
        raise RpctlError(f"only the name of {self.name} is known; give the law itself")


def unregistered(thing: object) -> Unregistered:
    """Return the name of a law, an obstacle or a function, and its settings if it has fields."""
    if isinstance(thing, Unregistered):
        return thing
    settings = {name: _plain(value) for name, value in settings_of(thing).items()}
    return Unregistered(name_of(thing), settings)


def name_of(thing: object) -> str:
    """Return the name of a law's or an obstacle's class, or of a function."""
    if isinstance(thing, Unregistered):
        return thing.name
    return str(getattr(thing, "__name__", type(thing).__name__))


def settings_of(thing: object) -> Mapping[str, object]:
    """Return the settings of a law or an obstacle by name; nothing if it has no fields."""
    if isinstance(thing, Unregistered):
        return thing.settings
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        return {item.name: getattr(thing, item.name) for item in dataclasses.fields(thing)}
    return {}


def to_json(value: object) -> Any:
    """Return what JSON says of an :class:`Unregistered`, or of one of its settings."""
    if isinstance(value, Unregistered):
        return {"law": value.name, "settings": to_json(value.settings)}
    if type(value) in OBSTACLE_NAMES:
        return {"shape": OBSTACLE_NAMES[type(value)], **vars(value)}  # type: ignore[index]
    if isinstance(value, Mapping):
        return {key: to_json(each) for key, each in value.items()}
    return [to_json(each) for each in value] if isinstance(value, tuple) else value


def from_json(value: Any) -> Any:
    """Return what :func:`to_json` took apart."""
    if isinstance(value, list):
        return tuple(map(from_json, value))
    if not isinstance(value, Mapping):
        return value
    for key in ("shape", "law"):
        if isinstance(value.get(key), str):
            rest = {name: each for name, each in value.items() if name != key}
            return _named_from_json(value[key], from_json(rest.get("settings", rest)))
    return {key: from_json(each) for key, each in value.items()}


def _named_from_json(name: str, settings: Mapping[str, Any]) -> object:
    """Return an obstacle, or what there is no name for."""
    try:
        return OBSTACLES[name](**settings)
    except (TypeError, KeyError, RpctlError):
        return Unregistered(name, settings)


def _plain(value: object) -> object:
    """Return a setting as :class:`Unregistered` holds it."""
    if (
        value is None
        or isinstance(value, str | bool | int | float)
        or type(value) in OBSTACLE_NAMES
    ):
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, tuple | list | np.ndarray):
        return tuple(map(_plain, value))
    return value.item() if isinstance(value, np.generic) else unregistered(value)
