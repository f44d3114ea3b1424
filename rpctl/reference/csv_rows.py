"""A table's text, row by row: cells between commas, a line each; what is separated otherwise."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rpctl.errors import DescriptionError, Finding
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.opening import read_text

MAX_LINE = 20_000  # characters of a row: a hundred for each of as many columns as there may be
TRANSLATIONS = {  # by separator: its name, and what makes commas of it and points of decimal commas
    ";": ("semicolons", "tr ',;' '.,' < FILE > NEW.csv"),
    "\t": ("tabs", "tr ',\\t' '.,' < FILE > NEW.csv"),
    "|": ("bars", "tr ',|' '.,' < FILE > NEW.csv"),
    " ": ("blanks", "tr -s ' ' ',' < FILE > NEW.csv"),
}


class TextRow(NamedTuple):
    """The cells of a line, without blanks around them, and the line's number."""

    line: int
    cells: list[str]


def read_rows(path: str | Path) -> Iterator[TextRow]:
    """Yield a table's rows, its header first; empty lines and those that begin with # are left out.

    Raises:
        DescriptionError: The file is missing, too long or no UTF-8, or a line is no row.
    """
    most_rows, most_columns, count = cap("MAX_ROWS"), cap("MAX_COLUMNS"), 0
    text = io.StringIO(read_text(path, "MAX_BYTES", "a reference file"), newline=None)
    for line, content in enumerate(text, start=1):
        content = content.strip()
        if not content.strip(", ") or content.startswith("#"):
            continue
        if len(content) > MAX_LINE:
            fault = f"a row of {len(content)} characters; {MAX_LINE} are the most"
            raise _refused(path, line, f"{fault}; keep to t and the columns of a robot")
        cells = [cell.strip() for cell in _cells(path, line, content)]
        if len(cells) > most_columns:
            fault = f"{len(cells)} columns; {most_columns} are the most"
            raise _refused(path, line, f"{fault}; {how_to_raise('MAX_COLUMNS')}")
        if count > most_rows:  # the header is none of them
            fault = f"over {most_rows} rows; thin it out, or {how_to_raise('MAX_ROWS')}"
            raise _refused(path, line, fault)
        count += 1
        yield TextRow(line, cells)


def _cells(path: str | Path, line: int, content: str) -> list[str]:
    if '"' not in content:
        return content.split(",")
    try:
        return next(csv.reader([content], strict=True, skipinitialspace=True))
    except csv.Error as error:
        fault = f"not CSV: {error} in a cell with quotation marks; numbers need none"
        raise _refused(path, line, fault) from None


def separator_fault(cells: list[str]) -> str:
    """Return how a row's only cell is separated, and what to do; empty if it is one."""
    for separator, (name, translation) in TRANSLATIONS.items():
        if len(cells) == 1 and separator in cells[0]:
            return (
                f"separated by {name}; put commas between the columns and points into the numbers, "
                f"as {translation} does"
            )
    return ""


def _refused(path: str | Path, line: int, fault: str) -> DescriptionError:
    return DescriptionError(path, [Finding("error", line, fault)])
