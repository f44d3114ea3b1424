"""TOML files in: read once, all faults of one named at once, each with its line."""

from __future__ import annotations

import math
import re
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from rpctl.errors import DescriptionError, Finding, fault_at
from rpctl.files.caps import read_text

if sys.version_info >= (3, 11):
    import tomllib
else:  # the standard library has it from 3.11 on
    import tomli as tomllib

Table = dict[str, Any]
Content = TypeVar("Content")
Schema = Callable[
    [Table, list[str]], Content
]  # from a file's table; adds what is wrong to the list
AT_LINE = re.compile(r" \(at line (\d+), column \d+\)")  # where tomllib saw what is no TOML
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

KEY = r"""(?:"[^"\n]*"|'[^'\n]*'|[\w-]+)"""
KEYS = rf"{KEY}(?:[ \t]*\.[ \t]*{KEY})*"
HEADER = re.compile(rf"[ \t]*(\[\[?)[ \t]*({KEYS})[ \t]*\]")
SETTING = re.compile(rf"[ \t]*({KEYS})[ \t]*=")
QUOTES = re.compile(r"""["' \t]""")


def read(path: str | Path, schema: Schema[Content], kind: str) -> Content:
    """Return what a TOML file holds.

    Args:
        path: The file.
        schema: Turns the file's table into what it stands for, and adds to the list each fault.
        kind: What the file is, in words: ``"a drive file"``.

    Raises:
        DescriptionError: The file is missing, too long, no TOML, or has faults; all are named.
    """
    text = read_text(path, "MAX_TOML_BYTES", kind).replace("\r\n", "\n")
    if beyond := too_deep_or_long(text):
        raise fault_at(path, *beyond)
    try:
        data = tomllib.loads(text, parse_float=read_float)
    except tomllib.TOMLDecodeError as error:
        at = AT_LINE.search(str(error))  # in the text only: the exception has no line before 3.14
        fault = f"not TOML: {AT_LINE.sub('', str(error))}; {kind} is TOML"
        raise fault_at(path, int(at[1]) if at else None, fault) from None
    faults = value_faults(data)
    if not faults:  # else a schema would have to expect them
        content = schema(data, faults)
    if faults:
        found = [Finding("error", _line(text, fault), fault) for fault in faults]
        raise DescriptionError(path, found)
    return content


def _line(text: str, fault: str) -> int | None:
    """Return the line that a fault is about: ``run.size: is 0``, or ``run: size is 0``."""
    place, _, sentence = fault.partition(": ")
    return line_of(text, ".".join([place, *sentence.split(" ", 1)[:1]]))


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
                return line, f"a number of {digits} digits; at most {MAX_DIGITS} are allowed"
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
        return "is larger than 1.8e308; give a smaller number"
    if isinstance(value, float) and not math.isfinite(value):
        return f"is {value}; give a finite number"
    if isinstance(value, int) and not -MAX_INT <= value < MAX_INT:
        return "is a whole number of more than 64 bits; give a smaller one"
    return ""


def line_of(text: str, path: str) -> int | None:
    """Return the line of a setting, or of the nearest table around it; None: it has none.

    Args:
        text: The file's.
        path: Of the setting, as ``study.count``, ``scatter."plant.delay"`` or
            ``kinematic.base_obstacles[2].radius``.
    """
    wanted = QUOTES.sub("", path)
    around = [
        (name, line)
        for name, line in _places(text)
        if wanted == name or (wanted.startswith(name) and wanted[len(name)] in ".[")
    ]
    return max(around, key=lambda each: len(each[0]), default=("", None))[1]


def _places(text: str) -> list[tuple[str, int]]:
    """Return the tables and settings of a file by their paths, without quotes, and their lines."""
    places, table, numbers = [], "", Counter[str]()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := HEADER.match(line):
            table = QUOTES.sub("", header[2])
            if header[1] == "[[":
                numbers[table] += 1
                table = f"{table}[{numbers[table]}]"
            places.append((table, number))
        elif setting := SETTING.match(line):
            key = QUOTES.sub("", setting[1])
            places.append((f"{table}.{key}" if table else key, number))
    return places
