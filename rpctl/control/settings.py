"""Settings of laws to and from plain tables, as TOML holds them: any frozen dataclass."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from types import NoneType, UnionType
from typing import Any, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.control.obstacles import OBSTACLES, Obstacle
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.control.unregistered import Unregistered, to_json
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.files.toml import Table


class Registry(NamedTuple):
    """The classes that a table can name: laws, or obstacles."""

    label: str
    key: str  # of the name
    factories: Mapping[str, Callable[..., Any]]  # by name


KINEMATIC_REGISTRY = Registry("kinematic law", "law", KINEMATIC_LAWS)
DYNAMIC_REGISTRY = Registry("dynamic law", "law", DYNAMIC_LAWS)
OBSTACLE_REGISTRY = Registry("obstacle", "shape", OBSTACLES)
REGISTRIES: dict[object, Registry] = {  # what a setting may be, by its type
    KinematicLaw: KINEMATIC_REGISTRY,
    DynamicLaw: DYNAMIC_REGISTRY,
    Obstacle: OBSTACLE_REGISTRY,
}
TYPE_LABELS: dict[object, str] = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
}

Made = TypeVar("Made")
NO_FILE_CAN_SAY = {"no_file_can_say": True}  # metadata of a setting that stays in Python


class _NoTomlValue(Exception):
    """A value that TOML cannot hold; it never leaves this file."""


def named_to_table(thing: object, kind: Registry) -> Table:
    """Return the name and settings of a law or an obstacle.

    Raises:
        RpctlError: Its class has no name, or TOML cannot hold one of its settings.
    """
    for name, known in kind.factories.items():
        if type(thing) is known:
            return {kind.key: name, **to_table(thing)}
    if isinstance(thing, Unregistered):
        return {kind.key: thing.name, "settings": to_json(thing.settings)}
    raise RpctlError(
        f"{type(thing).__name__} is none of {', '.join(kind.factories)}; it has no name"
    )


def to_table(settings: Any) -> Table:
    """Return a dataclass as a table, without the settings that are None by default.

    Raises:
        RpctlError: A setting cannot be said in TOML.
    """
    hints = get_type_hints(type(settings))
    table = {}
    for item in dataclasses.fields(settings):
        value = getattr(settings, item.name)
        try:
            hint = NoneType if item.metadata == NO_FILE_CAN_SAY else hints[item.name]
            table[item.name] = _toml_value(value, hint)
        except _NoTomlValue:
            if value is None and _may_be_off(hints[item.name]) and item.default is not None:
                table[item.name] = False
            elif value != item.default:
                label = f"{type(settings).__name__}.{item.name} is {value!r}"
                raise RpctlError(f"{label}, which no file can say") from None
    return table


def _toml_value(value: Any, hint: Any) -> Any:
    """Return what TOML holds of a value."""
    if hint in REGISTRIES:
        return named_to_table(value, REGISTRIES[hint])
    if dataclasses.is_dataclass(hint):
        return to_table(value)
    if get_origin(hint) in (Union, UnionType) and value is not None:
        return _toml_value(value, _without_none(hint))
    if isinstance(value, Mapping):
        return {key: list(each) if isinstance(each, tuple) else each for key, each in value.items()}
    if isinstance(value, tuple) and all(isinstance(each, str | float | int) for each in value):
        return list(value) if value else _no_toml_value()
    if get_origin(hint) is tuple and get_args(hint)[0] in REGISTRIES:
        return [named_to_table(each, REGISTRIES[get_args(hint)[0]]) for each in value]
    if get_origin(hint) is tuple and dataclasses.is_dataclass(get_args(hint)[0]):
        return [to_table(each) for each in value]
    return value if isinstance(value, str | float | int) else _no_toml_value()


def named_from_table(table: Any, kind: Registry, path: str, faults: list[str]) -> Any:
    """Return the law or obstacle that a table names, or None; what is wrong joins the faults.

    Args:
        table: Its name and any of its settings.
        kind: What it may be.
        path: Where in the file the table is: ``kinematic``, ``kinematic.base_obstacles[1]``.
        faults: All that is wrong with the file so far.
    """
    if isinstance(table, Unregistered):
        return table
    key = kind.key
    if not isinstance(table, Mapping) or not isinstance(table.get(key), str):
        head = f"[[{path[: path.index('[')]}]]" if "[" in path else f"[{path}]"
        faults.append(
            f'{path}: names no {key}; write {head}, then {key} = "{next(iter(kind.factories))}"'
        )
        return None
    if table[key] not in kind.factories:
        faults.append(f"{path}.{key}: {UnknownNameError(kind.label, table[key], kind.factories)}")
        return None
    settings = {name: value for name, value in table.items() if name != key}
    return from_table(kind.factories[table[key]], settings, path, faults)


def from_table(
    kind: Callable[..., Made], table: Mapping[str, Any], path: str, faults: list[str]
) -> Made | None:
    """Return a dataclass of a table's settings, or None; what is wrong is added to the faults.

    Args:
        kind: The dataclass.
        table: Any of its settings; the others keep their defaults, if they have any.
        path: Where in the file the table is.
        faults: All that is wrong with the file so far.
    """
    hints, before, settings = get_type_hints(kind), len(faults), {}
    items = dataclasses.fields(kind)  # type: ignore[arg-type]
    names = [item.name for item in items if item.metadata != NO_FILE_CAN_SAY]
    needed = [
        item.name
        for item in items
        if item.default is item.default_factory is dataclasses.MISSING and item.name not in table
    ]
    for key, value in table.items():
        where = f"{path}.{key}"
        if key not in names:
            faults.append(f"{where}: {UnknownNameError('setting', key, names)}")
            continue
        known = len(faults)
        made = _read(value, hints[key], where, faults)
        if len(faults) == known:
            settings[key] = made
    if needed:
        faults.append(f"{path}: lacks {', '.join(needed)}")
        return None
    try:
        made = kind(**settings)  # even if a fault is known: there may be another
    except RpctlError as error:
        faults.append(f"{path}: {error}")
    return made if len(faults) == before else None


def _read(value: Any, hint: Any, where: str, faults: list[str]) -> Any:
    """Return the value that TOML's stands for, or None; what is wrong is added to the faults."""
    origin, arguments = get_origin(hint), get_args(hint)
    if hint in REGISTRIES:
        return named_from_table(value, REGISTRIES[hint], where, faults)
    if origin in (Union, UnionType):
        off = value is False and _may_be_off(hint)
        known = type(value) if type(value) in arguments else _without_none(hint)
        return None if off else _read(value, known, where, faults)
    table = isinstance(origin, type) and issubclass(origin, Mapping)
    if dataclasses.is_dataclass(hint) or table:
        if not isinstance(value, Mapping):
            head = f"[[{where[: where.index('[')]}]]" if "[" in where else f"[{where}]"
            faults.append(f"{where}: is {value!r}; write {head}")
        elif not table:
            return from_table(hint, value, where, faults)
        else:
            return {k: _read(v, arguments[1], f"{where}.{k}", faults) for k, v in value.items()}
        return None
    if origin is tuple and (arguments[0] in REGISTRIES or dataclasses.is_dataclass(arguments[0])):
        if not isinstance(value, list):
            faults.append(f"{where}: is {value!r}; write [[{where}]]")
            return None
        places = enumerate(value, start=1)
        return tuple(_read(each, arguments[0], f"{where}[{k}]", faults) for k, each in places)
    if origin is tuple:
        kinds = arguments if arguments[-1] is not ... else arguments[:1] * _length(value)
        if isinstance(value, list) and len(value) == len(kinds):
            return tuple(_read(*each, where, faults) for each in zip(value, kinds, strict=True))
        faults.append(f"{where}: is {value!r}; give {len(kinds) or 'some'} numbers, [0.1, ...]")
        return None
    return _read_scalar(value, hint, where, faults)


def _read_scalar(value: Any, hint: Any, where: str, faults: list[str]) -> Any:
    """Return a number, a text or a truth, or None; what is wrong is added to the faults."""
    allowed = (int, float) if hint is float else (hint,)
    if hint not in TYPE_LABELS:
        faults.append(f"{where}: no file can say it; leave it out")
    elif not isinstance(value, allowed) or (isinstance(value, bool) and hint is not bool):
        faults.append(f"{where}: is {value!r}; give {TYPE_LABELS[hint]}")
    else:
        return hint(value)
    return None


def _length(value: object) -> int:
    return len(value) if isinstance(value, list) else 0


def _without_none(hint: Any) -> Any:
    """Return T of ``T | None``."""
    return next(each for each in get_args(hint) if each is not NoneType)


def _may_be_off(hint: Any) -> bool:
    """Return whether a setting is a record or None, for which a file says ``false``."""
    optional = get_origin(hint) in (Union, UnionType)
    return optional and dataclasses.is_dataclass(_without_none(hint))


def _no_toml_value() -> Any:
    raise _NoTomlValue
