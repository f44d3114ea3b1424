"""TOML files in: read once, all faults of one named at once."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from rpctl.errors import DescriptionError, Finding
from rpctl.files.opening import read_text
from rpctl.files.toml_limits import read_float, too_deep_or_long, value_faults
from rpctl.files.toml_lines import line_of

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


def read(path: str | Path, schema: Schema[Content], kind: str) -> Content:
    """Return what a TOML file holds.

    Args:
        path: The file.
        schema: Turns the file's table into what it stands for, and adds to the list each fault.
        kind: What the file is, in words: ``"a drive file"``.

    Raises:
        DescriptionError: The file is missing, too long, no TOML, or has faults; all are named.
    """
    text = read_text(path, "MAX_TOML_BYTES", kind)
    data = _parse(path, text, kind)
    faults = value_faults(data)
    if not faults:  # else a schema would have to expect them
        content = schema(data, faults)
    if faults:
        found = [Finding("error", _line(text, fault), fault) for fault in faults]
        raise DescriptionError(path, found)
    return content


def _parse(path: str | Path, text: str, kind: str) -> Table:
    text = text.replace("\r\n", "\n")
    if beyond := too_deep_or_long(text):
        raise _refused(path, *beyond)
    try:
        return tomllib.loads(text, parse_float=read_float)
    except tomllib.TOMLDecodeError as error:
        at = AT_LINE.search(str(error))  # in the text only: the exception has no line before 3.14
        reason = AT_LINE.sub("", str(error))
        fault = f"not TOML: {reason}; {kind} is TOML"
        raise _refused(path, int(at[1]) if at else None, fault) from None


def _line(text: str, fault: str) -> int | None:
    """Return the line that a fault is about: ``run.size: is 0``, or ``run: size is 0``."""
    place, _, sentence = fault.partition(": ")
    return line_of(text, ".".join([place, *sentence.split(" ", 1)[:1]]))


def _refused(path: str | Path, line: int | None, fault: str) -> DescriptionError:
    return DescriptionError(path, [Finding("error", line, fault)])
