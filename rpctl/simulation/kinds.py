"""Kinds of JSON values that a run's file holds: each refuses what it is not, and makes records."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from rpctl.errors import RpctlError, is_number

MAX_CHARACTERS = 100_000  # of one text
MAX_ITEMS = 100_000  # of one list or mapping
MAX_FILE_CHARACTERS = 4 * 2**20  # of a file that a run holds
SHOWN_CHARACTERS = 60  # of a value in a message
SURROGATES = re.compile("[\ud800-\udfff]")  # halves of characters: no text; a path may hold them

Kind = Callable[[Any, str], Any]  # of a value and the name of its place; returns what records hold


class EntryError(RpctlError):
    """An entry of a run's file that is not what it must be."""


def fault(where: str, value: object, wanted: str) -> EntryError:
    """Return the refusal of a value.

    Args:
        where: Its place in the file: ``drive.wheels[0].radius``.
        value: It.
        wanted: What it must be.
    """
    shown = repr(value)[: SHOWN_CHARACTERS + 1]
    if len(shown) > SHOWN_CHARACTERS:
        shown = f"{shown[:SHOWN_CHARACTERS]}..."
    return EntryError(f'entry "{where}" is {shown}; it must be {wanted}')


def path(value: Any, where: str) -> str:
    """Accept a text of bounded length; bytes that are no text may stand in it as surrogates."""
    return _bytes_as_text(value, where, MAX_CHARACTERS)


def file(value: Any, where: str) -> str:
    """Accept the text of a whole file, as :func:`path` is one."""
    return _bytes_as_text(value, where, MAX_FILE_CHARACTERS)


def _bytes_as_text(value: Any, where: str, most: int) -> str:
    if not isinstance(value, str) or len(value) > most or "\0" in value:
        raise fault(where, value, f"a text of at most {most} characters")
    if SURROGATES.search(value):
        try:
            value.encode("utf-8", "surrogateescape")
        except UnicodeEncodeError:
            raise fault(where, value, "a text") from None
    return value


def text(value: Any, where: str) -> str:
    """Accept a text of bounded length."""
    if SURROGATES.search(path(value, where)):
        raise fault(where, value, "a text")
    return str(value)


def digest(value: Any, where: str) -> str:
    """Accept a SHA-256 in hexadecimal digits."""
    if not re.fullmatch("[0-9a-f]{64}", text(value, where)):
        raise fault(where, value, "64 hexadecimal digits")
    return str(value)


def flag(value: Any, where: str) -> bool:
    """Accept true or false."""
    if not isinstance(value, bool):
        raise fault(where, value, "true or false")
    return value


def whole(value: Any, where: str) -> int:
    """Accept a whole number that is not negative."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise fault(where, value, "a whole number")
    return value


def number(value: Any, where: str) -> float:
    """Accept a finite number."""
    if not is_number(value):
        raise fault(where, value, "a finite number")
    return value


def positive(value: Any, where: str) -> float:
    """Accept a finite number above zero."""
    if not number(value, where) > 0.0:
        raise fault(where, value, "a positive number")
    return float(value)


def limit(value: Any, where: str) -> float:
    """Accept a number, also an infinite one."""
    if not isinstance(value, float) or math.isnan(value):
        return number(value, where)
    return value


def figure(value: Any, where: str) -> float:
    """Accept any number, not finite ones included."""
    return value if isinstance(value, float) else number(value, where)


def choice(*known: str) -> Kind:
    """Return the kind of a text that is one of these."""

    def accept(value: Any, where: str) -> str:
        if not isinstance(value, str) or value not in known:
            raise fault(where, value, f"one of {', '.join(known)}")
        return value

    return accept


def optional(kind: Kind) -> Kind:
    """Return the kind of null, or of something."""
    return lambda value, where: None if value is None else kind(value, where)


def many(kind: Kind) -> Kind:
    """Return the kind of a list of any length; it becomes a tuple."""

    def accept(value: Any, where: str) -> tuple[Any, ...]:
        if not isinstance(value, list) or len(value) > MAX_ITEMS:
            raise fault(where, value, f"a list of at most {MAX_ITEMS}")
        return tuple(kind(each, f"{where}[{k}]") for k, each in enumerate(value))

    return accept


def names(value: Any, where: str) -> tuple[str, ...]:
    """Accept a list of texts of which none is there twice."""
    found: tuple[str, ...] = many(text)(value, where)
    if len(set(found)) < len(found):
        raise fault(where, value, "a list of names, none of them twice")
    return found


def row(*kinds: Kind) -> Kind:
    """Return the kind of a list of as many values, each of its own kind; it becomes a tuple."""

    def accept(value: Any, where: str) -> tuple[Any, ...]:
        if not isinstance(value, list) or len(value) != len(kinds):
            raise fault(where, value, f"a list of {len(kinds)}")
        pairs = enumerate(zip(kinds, value, strict=True))
        return tuple(kind(each, f"{where}[{k}]") for k, (kind, each) in pairs)

    return accept


def mapping(kind: Kind) -> Kind:
    """Return the kind of values by any names."""

    def accept(value: Any, where: str) -> dict[str, Any]:
        if not isinstance(value, Mapping) or len(value) > MAX_ITEMS:
            raise fault(where, value, f"a mapping of at most {MAX_ITEMS}")
        return {text(key, where): kind(each, f"{where}.{key}") for key, each in value.items()}

    return accept


def table(needed: Mapping[str, Kind], known: Mapping[str, Kind], rest: Kind | None = None) -> Kind:
    """Return the kind of a mapping with given names.

    Args:
        needed: Kinds of what must be there.
        known: Kinds of what may be there besides.
        rest: Kind of what has another name; None: there is none such.
    """
    kinds = {**needed, **known}

    def accept(value: Any, where: str) -> dict[str, Any]:
        found = mapping(lambda each, _: each)(value, where)
        if missing := needed.keys() - found.keys():
            raise EntryError(f'entry "{where}" lacks {", ".join(sorted(missing))}')
        made = {}
        for key, each in found.items():
            kind = kinds.get(key, rest)
            if kind is None:
                raise EntryError(f'entry "{where}" has "{key[:SHOWN_CHARACTERS]}", not known')
            made[key] = kind(each, f"{where}.{key}")
        return made

    return accept


def record(made: Callable[..., Any], needed: Mapping[str, Kind], known: Mapping[str, Kind]) -> Kind:
    """Return the kind of a mapping that becomes a record.

    Args:
        made: The record's class.
        needed: Kinds of the fields that must be there.
        known: Kinds of those that may be left out.
    """
    accept = table(needed, known)
    return lambda value, where: made(**accept(value, where))


def plain(kind: Kind) -> Kind:
    """Return the kind of what is checked, and kept as JSON says it."""

    def accept(value: Any, where: str) -> Any:
        kind(value, where)
        return value

    return accept


def free(value: Any, where: str) -> Any:
    """Accept any texts, numbers, truths, nulls, lists and mappings of them."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        return path(value, where)  # a certificate names its robot's file
    if isinstance(value, list):
        return list(many(free)(value, where))
    if isinstance(value, Mapping):
        return mapping(free)(value, where)
    return figure(value, where)
