"""What the process that expands xacro says, and how its answer is checked.

It may have run hostile code. The module needs the standard library only: both sides import it.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

Answer = Mapping[str, Any]  # of the process that expands
ENVIRONMENT = "env:"  # how the name of an argument begins that is a variable of the environment
READ, GONE = b"\1", b"\0"  # how the reply to a request for a file begins
MAX_TOLD = 1000  # rows of each list that are kept
TEXT, LINE = (str,), (int, type(None))
SINGLES: dict[str, tuple[type, ...]] = {  # the types of what is one value
    "told": TEXT, "error": TEXT, "file": (str, type(None)), "line": LINE,
    "argument": TEXT, "variable": TEXT, "no_file": TEXT,
}  # fmt: skip
TEXTS = ("dropped", "undeclared", "early", "unused", "macros", "asked")  # lists of texts
ROWS: dict[str, tuple[tuple[type, ...], ...]] = {  # lists of rows; a file's path is FILE
    "wants": (TEXT, TEXT, LINE, TEXT),
    "left_out": (TEXT, LINE, TEXT),
    "moved": (TEXT, TEXT),
    "arguments": (TEXT, (str, type(None)), TEXT, (int,)),
    "old": (TEXT, TEXT, (int,)),
}
FILES = {"wants": 1, "left_out": 0, "arguments": 2, "old": 0}  # columns that name files read


def check_answer(answer: Any, known: Container[str], missing: Container[str]) -> dict[str, Any]:
    """Return an answer that is of the form it should have.

    Args:
        answer: What a process said.
        known: The files that it has asked for; it may name no other.
        missing: Those that were not there.

    Raises:
        ValueError: It is of another form.
    """
    if not isinstance(answer, Mapping) or not answer.keys() <= {*SINGLES, *TEXTS, *ROWS}:
        raise ValueError("its answer is of an unknown form")
    checked: dict[str, Any] = {name: [] for name in (*TEXTS, *ROWS)}
    checked |= {"told": "", "file": None, "line": None}
    for name, value in answer.items():
        if name in SINGLES:
            _require(isinstance(value, SINGLES[name]), name)
        else:
            _require(isinstance(value, list), name)
            value = value[:MAX_TOLD]
            for row in value:
                _require(_is_row(row, name), name)
                _require(name not in FILES or row[FILES[name]] in known, name)
        checked[name] = value
    _require(checked["file"] is None or checked["file"] in known, "file")
    _require(all(file in known for file in checked["undeclared"]), "undeclared")
    if checked.get("no_file") not in missing:
        checked.pop("no_file", None)
    return checked


def _is_row(row: Any, name: str) -> bool:
    if name in TEXTS:
        return isinstance(row, str)
    types = ROWS[name]
    return (
        isinstance(row, list)
        and len(row) == len(types)
        and all(isinstance(each, type_) for each, type_ in zip(row, types, strict=True))
    )


def _require(holds: bool, name: str) -> None:
    if not holds:
        raise ValueError(f'"{name}" of its answer is of an unknown form')
