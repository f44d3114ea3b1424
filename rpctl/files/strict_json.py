"""JSON of others: no member twice, no number that nothing holds, no nesting without end."""

from __future__ import annotations

import json
from typing import Any

MAX_DEPTH = 24  # of objects and lists in one another
MAX_DIGITS = 19  # of a whole number
MOST = 2**63 - 1  # the largest of 64 bits, as seeds have them


def read_json(text: str) -> Any:
    """Return what a text of JSON says; NaN and Infinity are numbers in it, as Python writes them.

    Raises:
        ValueError: It is no JSON, or none that a program of good will writes.
    """
    try:
        value = json.loads(text, object_pairs_hook=_without_doubles, parse_int=_whole)
    except RecursionError:
        raise ValueError(f"nested deeper than {MAX_DEPTH}") from None
    _require_depth(value, MAX_DEPTH)
    return value


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f'"{name}" occurs twice')
        found[name] = value
    return found


def _whole(digits: str) -> int:
    if len(digits.lstrip("-")) > MAX_DIGITS or abs(found := int(digits)) > MOST:
        raise ValueError(f"a whole number of {len(digits)} digits")
    return found


def _require_depth(value: Any, left: int) -> None:
    if not isinstance(value, dict | list):
        return
    if not left:
        raise ValueError(f"nested deeper than {MAX_DEPTH}")
    for each in value.values() if isinstance(value, dict) else value:
        _require_depth(each, left - 1)
