"""What a TOML file may not hold, told before its reader recurses, and of numbers by their keys."""

from __future__ import annotations

import math
import re
from typing import Any

MAX_NESTING = 30  # tables and lists in one another; rpctl's own files have 5
MAX_DIGITS = 400  # of a number; Python refuses to read 4300 as a whole number, without a line
MAX_INT = 2**63  # whole numbers of TOML are from minus this to below it
# What is never closed is taken to its line's or the text's end, once: else time is its square.
TOKEN = re.compile(
    r'''"""(?:[^"\\]+|\\.|"(?!""))*(?:""")?|\'\'\'(?:[^']+|'(?!''))*(?:\'\'\')?'''
    r"""|"(?:[^"\\\n]+|\\.)*"?|'[^'\n]*'?|\#[^\n]*"""
    r"""|(?P<mark>[\[\]{}=,.\n])|(?P<word>[^\s\[\]{}=,."'\#]+)""",
    re.DOTALL,
)
DIGITS = re.compile(r"[+-]?[\d_]+")


class OutOfRange(float):
    """Infinity that a file does not ask for: its number is beyond the range of floats."""


def read_float(text: str) -> float:
    """Return a number of a file; one that is too large is marked."""
    value = float(text)
    return OutOfRange(value) if math.isinf(value) and "inf" not in text else value


def too_deep_or_long(text: str) -> tuple[int, str] | None:
    """Return the line where a text nests too deep or has too long a number, and that; else None."""
    line, place, nesting, dots = 1, 0, 0, 0
    for token in TOKEN.finditer(text):
        mark, word = token["mark"], token["word"]
        if mark == ".":
            dots += 1
        elif mark:
            dots = 0
            nesting = max(0, nesting + (mark in "[{") - (mark in "]}"))
        digits = len(word.lstrip("+-")) if word and DIGITS.fullmatch(word) else 0
        if digits > MAX_DIGITS or max(nesting, dots) > MAX_NESTING:
            line += text.count("\n", place, token.start())
            if digits > MAX_DIGITS:
                return line, f"a number of {digits} digits; {MAX_DIGITS} are the most"
            return line, f"nested over {MAX_NESTING} deep; write it flatter"
    return None


def value_faults(table: dict[str, Any]) -> list[str]:
    """Return what is wrong with a table whatever it stands for: its depth, its numbers."""
    faults = []
    pending: list[tuple[str, Any, int]] = [("", table, 0)]
    while pending:
        label, value, nesting = pending.pop()
        if nesting > MAX_NESTING:
            return [f"{label}: nested over {MAX_NESTING} deep; write it flatter"]
        if isinstance(value, dict):
            inside = [(f"{label}.{key}" if label else key, each) for key, each in value.items()]
        elif isinstance(value, list):
            inside = [(f"{label}[{k}]", each) for k, each in enumerate(value, start=1)]
        else:
            inside = []
            if fault := _number_fault(value):
                faults.append(f"{label}: {fault}")
        pending += [(name, each, nesting + 1) for name, each in reversed(inside)]
    return faults


def _number_fault(value: object) -> str:
    """Return why no setting can have a value; empty if one can."""
    if isinstance(value, OutOfRange):
        return "is beyond the range of numbers, 1.8e308; give a smaller one"
    if isinstance(value, float) and not math.isfinite(value):
        return f"is {value}; give a finite number"
    if isinstance(value, int) and not -MAX_INT <= value < MAX_INT:
        return "is a whole number of over 64 bits; give a smaller one"
    return ""
