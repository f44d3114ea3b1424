"""Findings of one reading: all faults of a file, each with its line and the correction."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from rpctl.errors import SEVERITIES, Finding

MAX_NUMBER = 1e9  # no length, mass, inertia or angle of a robot, in SI units, reaches it
MAX_DIGITS = 64  # characters of one number; a double needs 24
EXCERPT_CHARS = 80  # characters of the file that one message shows

NUMBER = re.compile(rf"(?=.{{1,{MAX_DIGITS}}}$)[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
UNIT = re.compile(r"([+-]?[\d.]+(?:[eE][+-]?\d+)?) ?(°|[A-Za-zµ°][\w*/^²³·]*)", re.ASCII)
PLAIN = re.compile(r"[\d.eE+ -]*", re.ASCII)
COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)
INFINITE = frozenset({"inf", "infinity", "nan", "1.#inf", "1.#qnan"})
VARYING = re.compile(r'"[^"]*"|[+-]?\d[\d.]*(?:e[+-]?\d+)?')  # names and numbers of a message
NAME = re.compile(r'"([^"]*)"')
MAX_NAMED = 4  # further places that one line names


class Fault(ValueError):
    """Why an attribute holds no numbers, and the way out."""


def excerpt(text: str) -> str:
    """Return the beginning of a text of the file."""
    return text if len(text) <= EXCERPT_CHARS else f"{text[:EXCERPT_CHARS]}..."


def parse_numbers(text: str, count: int) -> list[float]:
    """Return exactly ``count`` finite numbers, written as XML's decimals, separated by blanks.

    Raises:
        Fault: The text is something else.
    """
    words = text.split()
    for word in words:
        if not NUMBER.fullmatch(word):
            raise Fault(_not_a_number(text, word))
    values = [float(word) for word in words]
    if len(values) != count:
        raise Fault(f"has {len(values)} numbers; give {count}")
    if not all(map(math.isfinite, values)):
        raise Fault("is not finite; give a finite number")
    return values


def _not_a_number(text: str, word: str) -> str:
    if "${" in text or "$(" in text:
        return "is not a number but unexpanded xacro; run `xacro` on the file first"
    if word.lower().lstrip("+-") in INFINITE:
        return "is not finite; give a finite number"
    if COMMA.fullmatch(word):
        return f'is not a number: it has a decimal comma; write "{word.replace(",", ".")}"'
    if "," in word or ";" in word:
        return "is not a number: separate numbers by blanks, without commas"
    unit = UNIT.fullmatch(text.strip()) or UNIT.fullmatch(word)
    if unit:
        return f'is not a number: leave out the unit "{unit[2]}"; write "{unit[1]}" in SI units'
    return "is not a number; write digits with a decimal point"


class Findings:
    """Collects what is wrong, so that several faults show at once."""

    def __init__(self) -> None:
        self.items: list[Finding] = []

    def add_at(self, severity: str, line: int | None, message: str) -> None:
        """Note a finding at a line."""
        self.items.append(Finding(severity, line, message))

    @property
    def errors(self) -> bool:
        """Whether one of them is an error."""
        return any(finding.severity == "error" for finding in self.items)

    def sorted(self) -> list[Finding]:
        """Return the findings, errors first, then in the order of the file."""
        return sorted(self.items, key=lambda f: (SEVERITIES.index(f.severity), f.line or 0))

    def error(self, element: Any, message: str) -> None:
        """Note an error at the line of an element."""
        self.add_at("error", element.sourceline, message)

    def warn(self, element: Any, message: str) -> None:
        """Note a warning at the line of an element."""
        self.add_at("warning", element.sourceline, message)

    def numbers(self, element: Any, attribute: str, count: int, default: str | None) -> list[float]:
        """Return ``count`` sane numbers of an attribute; on a fault note it and return zeros.

        Args:
            element: The element, or None to take the default.
            default: What stands for a missing attribute; None makes it an error.
        """
        text = default if element is None else element.get(attribute, default)
        zeros = [0.0] * count
        if text is None:
            self.error(element, f'<{element.tag}> has no attribute "{attribute}"; add it')
            return zeros
        try:
            values = parse_numbers(text, count)
            if any(abs(value) > MAX_NUMBER for value in values):
                raise Fault("is too large; URDF uses metres, kilograms, seconds and radians")
        except Fault as fault:
            self.error(element, f'<{element.tag} {attribute}="{excerpt(text)}"> {fault}')
            return zeros
        if element is not None and not PLAIN.fullmatch(text):
            element.set(attribute, " ".join(text.split()))  # other readers know no other blanks
        return values

    def number(self, element: Any, attribute: str, default: str | None = None) -> float:
        """Return one sane number of an attribute; see :meth:`numbers` for the arguments.

        Args:
            element: The XML element, or None.
            default: The text that stands for a missing attribute; None: it has to be there.
        """
        return self.numbers(element, attribute, 1, default)[0]

    def only(self, element: Any, tag: str) -> Any:
        """Return the one child of a tag, or None; further ones are noted and removed."""
        children = element.findall(tag)
        for child in children[1:]:
            self.warn(child, f"a second <{tag}> in <{element.tag}>; rpctl reads only the first")
            element.remove(child)
        return children[0] if children else None


def condense(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return one finding for those that differ in names and numbers only, the weightiest first.

    Errors come before warnings, and these before remarks; then what stands there most often.
    """
    alike: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        alike.setdefault((finding.severity, VARYING.sub("#", finding.message)), []).append(finding)
    groups = [sorted(group, key=lambda f: f.line or 0) for group in alike.values()]
    groups.sort(key=lambda group: (SEVERITIES.index(group[0].severity), -len(group)))
    return tuple(map(_sum, groups))


def _sum(group: list[Finding]) -> Finding:
    """Return the first finding of a group, with the places of the others."""
    first, *others = group
    places = [*dict.fromkeys(_place(first, other) for other in others)][:MAX_NAMED]
    more = f" and {len(others) - MAX_NAMED} more" if len(others) > MAX_NAMED else ""
    also = f" (and so {', '.join(places)}{more})" if others else ""
    return replace(first, message=f"{first.message}{also}")


def _place(first: Finding, other: Finding) -> str:
    """Return where another finding of a group stands: the name that the first lacks, its line."""
    pairs = zip(NAME.findall(first.message), NAME.findall(other.message), strict=False)
    name = next((f'"{new}"' for known, new in pairs if new != known), "")
    line = "" if other.line is None else f"line {other.line}"
    return f"{name} ({line})" if name and line else name or line or "once more"
