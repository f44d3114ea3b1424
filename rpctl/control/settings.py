"""Settings of laws to and from plain tables, as TOML holds them: any frozen dataclass."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from rpctl.control.command import KinematicLaw
from rpctl.control.dynamic import DYNAMIC_LAWS
from rpctl.control.law import DynamicLaw, Startable
from rpctl.control.laws import KINEMATIC_LAWS
from rpctl.errors import RpctlError, UnknownNameError

Table = dict[str, Any]
Registry = Mapping[str, Callable[[], Any]]

LAW = "law"  # the key that names a law
LAWS: dict[object, tuple[str, Registry]] = {  # what a law within a law may be
    KinematicLaw: ("kinematic law", KINEMATIC_LAWS),
    KinematicLaw | Startable[KinematicLaw]: ("kinematic law", KINEMATIC_LAWS),
    DynamicLaw: ("dynamic law", DYNAMIC_LAWS),
}
WORDS: dict[object, str] = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a text",
}

Made = TypeVar("Made")


class _Unsaid(Exception):
    """A value that TOML has no words for; it never leaves this file."""


def law_to_table(law: object, registry: Registry) -> Table:
    """Return a law's name and settings.

    Raises:
        RpctlError: The law is none of the registry's, or a setting of it cannot be said in TOML.
    """
    for name, kind in registry.items():
        if type(law) is kind:
            return {LAW: name, **to_table(law)}
    raise RpctlError(f"{type(law).__name__} is none of {', '.join(registry)}; it has no name")


def to_table(settings: Any) -> Table:
    """Return a dataclass as a table; what is None, and would be by default, is left out.

    Raises:
        RpctlError: A setting cannot be said in TOML.
    """
    hints, default = get_type_hints(type(settings)), type(settings)()
    table = {}
    for item in dataclasses.fields(settings):
        value = getattr(settings, item.name)
        try:
            table[item.name] = _plain(value, hints[item.name])
        except _Unsaid:
            if value != getattr(default, item.name):
                told = f"{type(settings).__name__}.{item.name} is {value!r}"
                raise RpctlError(f"{told}, which no file can say") from None
    return table


def _plain(value: Any, hint: Any) -> Any:
    """Return what TOML holds of a value."""
    if hint in LAWS:
        return law_to_table(value, LAWS[hint][1])
    if dataclasses.is_dataclass(hint):
        return to_table(value)
    if get_origin(hint) in (Union, UnionType) and value is not None:
        return _plain(value, _without_none(hint))
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, tuple) and all(isinstance(each, str | float | int) for each in value):
        return list(value) if value else _refuse()
    return value if isinstance(value, str | float | int) else _refuse()


def law_from_table(table: Any, kind: str, registry: Registry, place: str, faults: list[str]) -> Any:
    """Return the law that a table names, or None; what is wrong is added to the faults.

    Args:
        table: ``law``, its name, and any of its settings.
        kind: What laws of the registry are called.
        registry: The laws by name.
        place: Where in the file the table is: ``kinematic``.
        faults: All that is wrong with the file so far.
    """
    if not isinstance(table, Mapping) or not isinstance(table.get(LAW), str):
        faults.append(
            f'{place}: names no law; write [{place}], then law = "{next(iter(registry))}"'
        )
        return None
    if table[LAW] not in registry:
        faults.append(f"{place}.{LAW}: {UnknownNameError(kind, table[LAW], registry)}")
        return None
    settings = {key: value for key, value in table.items() if key != LAW}
    return from_table(registry[table[LAW]], settings, place, faults)


def from_table(
    kind: Callable[..., Made], table: Mapping[str, Any], place: str, faults: list[str]
) -> Made | None:
    """Return a dataclass of a table's settings, or None; what is wrong is added to the faults.

    Args:
        kind: The dataclass.
        table: Any of its settings; the others keep their defaults.
        place: Where in the file the table is.
        faults: All that is wrong with the file so far.
    """
    hints, before, settings = get_type_hints(kind), len(faults), {}
    names = [item.name for item in dataclasses.fields(kind)]  # type: ignore[arg-type]
    for key, value in table.items():
        where = f"{place}.{key}"
        if key not in names:
            faults.append(f"{where}: {UnknownNameError('setting', key, names)}")
            continue
        known = len(faults)
        made = _read(value, hints[key], where, faults)
        if len(faults) == known:
            settings[key] = made
    try:
        made = kind(**settings)  # even if a fault is known: there may be another
    except RpctlError as error:
        faults.append(f"{place}: {error}")
    return made if len(faults) == before else None


def _read(value: Any, hint: Any, where: str, faults: list[str]) -> Any:
    """Return the value that TOML's stands for, or None; what is wrong is added to the faults."""
    origin, arguments = get_origin(hint), get_args(hint)
    if hint in LAWS:
        return law_from_table(value, *LAWS[hint], where, faults)
    if origin in (Union, UnionType):
        return _read(value, _without_none(hint), where, faults)
    table = isinstance(origin, type) and issubclass(origin, Mapping)
    if dataclasses.is_dataclass(hint) or table:
        if not isinstance(value, Mapping):
            faults.append(f"{where}: is {value!r}; write [{where}]")
        elif not table:
            return from_table(hint, value, where, faults)
        else:
            return {k: _read(v, arguments[1], f"{where}.{k}", faults) for k, v in value.items()}
        return None
    if origin is tuple:
        kinds = arguments if arguments[-1] is not ... else arguments[:1] * _length(value)
        if isinstance(value, list) and len(value) == len(kinds):
            return tuple(_read(*each, where, faults) for each in zip(value, kinds, strict=True))
        faults.append(f"{where}: is {value!r}; give {len(kinds) or 'some'} numbers, [0.1, ...]")
        return None
    return _read_word(value, hint, where, faults)


def _read_word(value: Any, hint: Any, where: str, faults: list[str]) -> Any:
    """Return a number, a text or a truth, or None; what is wrong is added to the faults."""
    allowed = (int, float) if hint is float else (hint,)
    if hint not in WORDS:
        faults.append(f"{where}: no file can say it; leave it out")
    elif not isinstance(value, allowed) or (isinstance(value, bool) and hint is not bool):
        faults.append(f"{where}: is {value!r}; give {WORDS[hint]}")
    else:
        return hint(value)
    return None


def _length(value: object) -> int:
    return len(value) if isinstance(value, list) else 0


def _without_none(hint: Any) -> Any:
    """Return T of ``T | None``."""
    return next(each for each in get_args(hint) if each is not NoneType)


def _refuse() -> Any:
    raise _Unsaid
