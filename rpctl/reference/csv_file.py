"""The reference file in CSV: a header, and a row of poses a time; every bad row is named."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rpctl.arrays import Array
from rpctl.description.findings import Fault, excerpt, parse_numbers
from rpctl.errors import DescriptionError, Finding
from rpctl.files.caps import cap, how_to_raise
from rpctl.reference.csv_header import (
    QUATERNION,
    header_faults,
)
from rpctl.reference.csv_rows import TextRow, read_rows, separator_fault

MIN_ROWS = 6  # rows that a quintic spline takes
QUATERNION_TOLERANCE = 1e-3  # how far a quaternion's length may be from 1
MAX_ABSOLUTE = 1e6  # m or rad: no row of a robot's motion reaches it


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
        path: The file.
        joints: Names of the robot's joints.

    Raises:
        DescriptionError: The file is missing or has faults; all are named with their lines.
    """
    rows = read_rows(path)
    first = next(rows, None)
    if first is None:
        raise refusal(path, [(None, "empty; give a header such as t,x,y,theta, and rows")])
    header, names = first
    faults = header_faults(names, joints)
    if faults:
        raise refusal(path, [(header, fault) for fault in faults])
    values, lines, bad = _values(rows, names)
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


def _values(
    rows: Iterable[TextRow], names: list[str]
) -> tuple[Array, list[int], list[tuple[int, str]]]:
    """Return the numbers (K, n) of good rows, their lines, and the faults of the others."""
    values = array("d")
    lines: list[int] = []
    faults: list[tuple[int, str]] = []
    for line, row in rows:
        found = len(faults)
        if wrong := _length_fault(row, names):
            faults.append((line, wrong))
            continue
        numbers = []
        for name, text in zip(names, row, strict=True):
            try:
                number = _number(name, text)
            except Fault as fault:
                faults.append((line, str(fault)))
                continue
            numbers.append(number)
        if len(faults) == found:
            values.extend(numbers)
            lines.append(line)
    return np.array(values).reshape(-1, len(names)), lines, faults


def _length_fault(row: list[str], names: list[str]) -> str:
    """Return what is wrong with the number of a row's entries; empty if nothing is."""
    if len(row) == len(names):
        return ""
    fault = f"{len(row)} entries where the header names {len(names)}"
    if separated := separator_fault(row):
        return f"{fault}: {separated}"
    if len(row) > len(names) and not any("." in text for text in row):
        return f"{fault}; if its numbers have decimal commas, write points, as 0.5 for 0,5"
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
        raise Fault(f"{name} is {number:g}, which is absurd; use s, m and rad")
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
    lengths = np.linalg.norm(values[:, columns], axis=1)
    return [
        (
            line,
            f"the quaternion {', '.join(QUATERNION)} has length {length:.4g}; scale it to length 1",
        )
        for line, length in zip(lines, lengths, strict=True)
        if abs(length - 1.0) > QUATERNION_TOLERANCE
    ]
