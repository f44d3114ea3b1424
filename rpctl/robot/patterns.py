"""Values by patterns of names (``"arm_*"``): the last pattern that matches a name counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TypeVar

from rpctl.errors import UnknownNameError

Value = TypeVar("Value")


def by_pattern(given: Mapping[str, Value], names: Sequence[str], kind: str) -> dict[str, Value]:
    """Return values by name; names that nothing matches are left out.

    Args:
        given: Values by pattern of names.
        kind: What they are the names of, for messages.

    Raises:
        UnknownNameError: A pattern matches none of them.
    """
    found: dict[str, Value] = {}
    for pattern, value in given.items():
        found.update(dict.fromkeys(matching(pattern, names, kind), value))
    return found


def matching(pattern: str, names: Sequence[str], kind: str) -> list[str]:
    """Return the names that a pattern matches.

    Args:
        pattern: The pattern.
        kind: What they are the names of, for messages.

    Raises:
        UnknownNameError: It matches none of them.
    """
    found = [name for name in names if fnmatchcase(name, pattern)]
    if not found:
        begins = {f"{each[: k + 1]}*" for each in names for k, c in enumerate(each) if c == "_"}
        choices = sorted(begins) if pattern.endswith("*") and begins else names
        raise UnknownNameError(kind, pattern, choices)
    return found
