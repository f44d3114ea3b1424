"""The reference file in CSV: a header, and a row of poses a time; every bad row is named."""

from __future__ import annotations

import csv
import io
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from rpctl.arrays import Array
from rpctl.description.urdf.findings import Fault, excerpt, parse_numbers
from rpctl.errors import DescriptionError, Finding, fault_at
from rpctl.files.caps import cap, how_to_raise, read_text

MAX_LINE = 20_000  # characters of a row: a hundred for each of as many columns as there may be
TRANSLATIONS = {  # by separator: its name, and what makes commas of it and points of decimal commas
    ";": ("semicolons", "tr ',;' '.,' < FILE > NEW.csv"),
    "\t": ("tabs", "tr ',\\t' '.,' < FILE > NEW.csv"),
    "|": ("bars", "tr ',|' '.,' < FILE > NEW.csv"),
    " ": ("blanks", "tr -s ' ' ',' < FILE > NEW.csv"),
}
BASE_COLUMNS, HEADING = ("x", "y"), "theta"
EE_COLUMNS, QUATERNION = ("ee_x", "ee_y", "ee_z"), ("ee_qx", "ee_qy", "ee_qz", "ee_qw")
POSE_COLUMNS = (*BASE_COLUMNS, HEADING, *EE_COLUMNS, *QUATERNION)
OTHER_NAMES = {
    "t": ("time", "times", "timestamp", "stamp", "sec", "seconds", "zeit", "temps", "tiempo"),
    HEADING: ("yaw", "heading", "orientation", "angle", "phi", "psi", "th", "θ"),
}
ORIENTATION = "orientation."  # of a field of a message; by itself it means the heading
TRAJECTORY_CELLS = 8  # time, position, quaternion
TRAJECTORY_TO_TABLE = (
    '(echo t,x,y,theta; awk \'!/^#/ {print $1","$2","$3","2*atan2($7,$8)}\' FILE) > NEW.csv'
)
MEANT = {other: name for name, others in OTHER_NAMES.items() for other in others}
MIN_ROWS = 6  # rows that a quintic spline takes
QUATERNION_TOLERANCE = 1e-3  # how far a quaternion's length may be from 1
MAX_ABSOLUTE = 1e6  # m or rad: no row of a robot's motion reaches it


TextRow = tuple[int, list[str]]  # the number of a line, and its cells without blanks around them


def read_rows(path: str | Path) -> Iterator[TextRow]:
    """Yield a table's rows with their lines, its header first; empty lines and # are left out.

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
            raise fault_at(
                path,
                line,
                f"a row of {len(content)} characters; at most {MAX_LINE} are allowed; give only t "
                "and columns of the robot",
            )
        cells = [cell.strip() for cell in _cells(path, line, content)]
        if len(cells) > most_columns:
            raise fault_at(
                path,
                line,
                f"{len(cells)} columns; at most {most_columns} are allowed; "
                f"{how_to_raise('MAX_COLUMNS')}",
            )
        if count > most_rows:  # the header is none of them
            raise fault_at(
                path, line, f"over {most_rows} rows; thin it out, or {how_to_raise('MAX_ROWS')}"
            )
        count += 1
        yield line, cells


def _cells(path: str | Path, line: int, content: str) -> list[str]:
    if '"' not in content:
        return content.split(",")
    try:
        return next(csv.reader([content], strict=True, skipinitialspace=True))
    except csv.Error as error:
        raise fault_at(
            path, line, f"not CSV: {error} in a cell with quotation marks; numbers need none"
        ) from None


def separator_fault(cells: list[str]) -> str:
    """Return how a row's only cell is separated, and what to do; empty if it is one."""
    for separator, (name, translation) in TRANSLATIONS.items():
        if len(cells) == 1 and separator in cells[0]:
            return (
                f"columns are separated by {name}; use commas between columns and decimal points "
                f"in numbers, as {translation} does"
            )
    return ""


def header_faults(names: list[str], joints: Sequence[str]) -> list[str]:
    """Return what is wrong with a table's columns; nothing if the list is empty.

    Args:
        names: What its first row names.
        joints: Names of the robot's joints.
    """
    if _is_trajectory(names):
        return [
            "a trajectory of time, position and quaternion separated by blanks; convert it, as "
            f"{TRAJECTORY_TO_TABLE} does"
        ]
    if fault := separator_fault(names):
        return [fault]
    if all(map(_is_number, names)):
        return [
            "the first row has numbers instead of column names; add a row above it, such as "
            "t,x,y,theta"
        ]
    known = ("t", *POSE_COLUMNS, *joints)
    faults = []
    for name in dict.fromkeys(names):
        if name not in known:
            faults.append(f'column "{excerpt(name)}" is not known; {_hint(name, known)}')
        if names.count(name) > 1:
            faults.append(f'column "{excerpt(name)}" occurs {names.count(name)} times; keep one')
    return faults + _missing(names)


def _missing(names: list[str]) -> list[str]:
    faults = []
    if "t" not in names:
        faults.append("there is no column t; add the time in s")
    for group in (BASE_COLUMNS, EE_COLUMNS, QUATERNION):
        missing = [name for name in group if name not in names]
        if missing and len(missing) < len(group):
            there = next(name for name in group if name in names)
            faults.append(f"column {', '.join(missing)} is missing beside {there}; add it")
    for name, needed in ((HEADING, BASE_COLUMNS), (QUATERNION[0], EE_COLUMNS)):
        if name in names and needed[0] not in names:
            faults.append(f"column {name} needs {', '.join(needed)} beside it; add them")
    if not faults and len(names) == 1:
        faults.append("there are only times; add x,y or ee_x,ee_y,ee_z or joints")
    return faults


def _hint(name: str, known: Sequence[str]) -> str:
    """Return which column is meant by a name: without its unit and case, or by another word."""
    plain = name.partition("[")[0].partition("(")[0].strip("% _").casefold()
    if ORIENTATION in plain:
        return "give theta = 2 atan2(z, w) of the quaternion instead, in rad"
    plain = re.split(r"[./]", plain)[-1]  # of a field of a message: pose.pose.position.x
    folded = {each.casefold(): each for each in known}
    near = get_close_matches(plain, folded, n=1, cutoff=0.5)
    meant = folded.get(plain) or MEANT.get(plain) or (folded[near[0]] if near else None)
    return f"did you mean {meant}?" if meant else f"columns are {', '.join(known)}"


def _is_trajectory(names: list[str]) -> bool:
    """Return whether a row is one of ``timestamp tx ty tz qx qy qz qw``, between blanks."""
    cells = names[0].split() if len(names) == 1 else []
    return len(cells) == TRAJECTORY_CELLS and all(map(_is_number, cells))


def _is_number(text: str) -> bool:
    try:
        parse_numbers(text, 1)
    except Fault:
        return False
    return True


@dataclass(frozen=True)
class Table:
    """A reference file's rows.

    Attributes:
        path: The file.
        lines: Line of each row.
        header: Line of the header.
        t: Time (K,), increasing from zero, s.
        columns: The other columns (K,) by name.
    """

    path: str
    lines: tuple[int, ...] = field(repr=False)
    header: int
    t: Array = field(repr=False)
    columns: dict[str, Array] = field(repr=False)

    def stack(self, names: Iterable[str]) -> Array:
        """Return columns (K, n) side by side."""
        return np.column_stack([self.columns[name] for name in names])

    def refuse(self, faults: Sequence[tuple[int, str]]) -> DescriptionError:
        """Return the error that names faults, each by its line."""
        return refusal(self.path, faults)


def refusal(path: str | Path, faults: Sequence[tuple[int | None, str]]) -> DescriptionError:
    """Return the error of a reference file, each fault with its line."""
    return DescriptionError(path, [Finding("error", line, fault) for line, fault in faults])


def read_table(path: str | Path, joints: Sequence[str] = ()) -> Table:
    """Read a table of poses.

    The header names the columns: ``t``; ``x``, ``y`` and maybe ``theta`` of P; ``ee_x``, ``ee_y``,
    ``ee_z`` and maybe ``ee_qx``, ``ee_qy``, ``ee_qz``, ``ee_qw`` of the end effector; joints by
    name. Units are s, m and rad. Empty lines and lines that begin with # are passed over.

    Args:
        joints: Names of the robot's joints.

    Raises:
        DescriptionError: The file is missing or has faults; all are named with their lines.
    """
    rows = read_rows(path)
    first = next(rows, None)
    if first is None:
        raise fault_at(path, None, "empty; give a header such as t,x,y,theta, and rows")
    header, names = first
    faults = header_faults(names, joints)
    if faults:
        raise refusal(path, [(header, fault) for fault in faults])
    values, lines, bad = read_values(rows, names, names)
    bad += _time_faults(values, lines, names.index("t"))
    if set(QUATERNION) <= set(names):
        bad += _quaternion_faults(values, lines, [names.index(name) for name in QUATERNION])
    if not bad and len(lines) < MIN_ROWS:
        bad.append((lines[-1] if lines else header, f"{len(lines)} rows; give {MIN_ROWS} or more"))
    if bad:
        raise refusal(path, sorted(bad))
    columns = dict(zip(names, values.T, strict=True))
    t = columns.pop("t")
    return Table(str(path), tuple(lines), header, t - t[0], columns)


def read_values(
    rows: Iterable[TextRow], names: list[str], wanted: Sequence[str]
) -> tuple[Array, list[int], list[tuple[int, str]]]:
    """Return some numbers (K, n) of good rows, their lines, and the faults of the others.

    Args:
        names: Of all columns.
        wanted: Of those that are read, in this order.
    """
    values, places = array("d"), [names.index(name) for name in wanted]
    lines: list[int] = []
    faults: list[tuple[int, str]] = []
    for line, row in rows:
        found = len(faults)
        if wrong := _length_fault(row, names):
            faults.append((line, wrong))
            continue
        numbers = []
        for name, index in zip(wanted, places, strict=True):
            try:
                number = _number(name, row[index])
            except Fault as fault:
                faults.append((line, str(fault)))
                continue
            numbers.append(number)
        if len(faults) == found:
            values.extend(numbers)
            lines.append(line)
    return np.array(values).reshape(-1, len(wanted)), lines, faults


def _length_fault(row: list[str], names: list[str]) -> str:
    """Return what is wrong with the number of a row's entries; empty if nothing is."""
    if len(row) == len(names):
        return ""
    fault = f"{len(row)} entries, but the header has {len(names)}"
    if separated := separator_fault(row):
        return f"{fault}: {separated}"
    if len(row) > len(names) and not any("." in text for text in row):
        return f"{fault}; if its numbers have decimal commas, write points, such as 0.5 for 0,5"
    return f"{fault}; complete the row or leave it out"


def _number(name: str, text: str) -> float:
    """Return the number in a cell.

    Raises:
        Fault: There is none, or none of a robot's.
    """
    if not text:
        raise Fault(f"{name} is empty; give a number or leave the row out")
    try:
        number = parse_numbers(text, 1)[0]
    except Fault as fault:
        raise Fault(f'{name} "{excerpt(text)}" {fault}') from None
    if abs(number) > MAX_ABSOLUTE and name != "t":  # times may count from 1970 on
        raise Fault(f"{name} is {number:g}, which is too large; use s, m and rad")
    return number


def _time_faults(values: Array, lines: list[int], column: int) -> list[tuple[int, str]]:
    faults: list[tuple[int, str]] = []
    most, latest = cap("MAX_REFERENCE_SECONDS"), -math.inf
    times = values[:, column].tolist()
    for line, t in zip(lines, times, strict=True):
        if t <= latest:
            faults.append((line, f"t is {t:.12g} after {latest:.12g}; times must increase"))
            continue
        latest = t
        if t - times[0] > most:
            fault = f"t is {t:.12g}, over {most} s after the first row; use seconds"
            faults.append((line, f"{fault}; {how_to_raise('MAX_REFERENCE_SECONDS')}"))
    return faults


def _quaternion_faults(
    values: Array, lines: list[int], columns: list[int]
) -> list[tuple[int, str]]:
    return [
        (
            line,
            f"the quaternion {', '.join(QUATERNION)} has length {length:.4g}; scale it to length 1",
        )
        for line, length in zip(lines, np.linalg.norm(values[:, columns], axis=1), strict=True)
        if abs(length - 1.0) > QUATERNION_TOLERANCE
    ]
