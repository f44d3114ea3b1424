"""The reference file in CSV: a header, and a row of poses a time; every bad row is named."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from rpctl.arrays import Array
from rpctl.description.findings import Fault, excerpt, parse_numbers
from rpctl.errors import DescriptionError, Finding
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.opening import read_text

BASE_COLUMNS, HEADING = ("x", "y"), "theta"
EE_COLUMNS, QUATERNION = ("ee_x", "ee_y", "ee_z"), ("ee_qx", "ee_qy", "ee_qz", "ee_qw")
POSE_COLUMNS = (*BASE_COLUMNS, HEADING, *EE_COLUMNS, *QUATERNION)
MIN_ROWS = 6  # rows that a quintic spline takes
QUATERNION_TOLERANCE = 1e-3  # how far a quaternion's length may be from 1
MAX_ABSOLUTE = 1e6  # m, rad or s: no row of a robot's motion reaches it


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
    reader = csv.reader(io.StringIO(read_text(path, "MAX_BYTES", "a reference file"), newline=""))
    rows: list[tuple[int, list[str]]] = []
    most = cap("MAX_ROWS")
    try:
        for row in reader:
            if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#"):
                rows.append((reader.line_num, [cell.strip() for cell in row]))
            if len(rows) > most + 1:
                fault = f"over {most} rows; thin it out, or {how_to_raise('MAX_ROWS')}"
                raise refusal(path, [(reader.line_num, fault)])
    except csv.Error as error:
        fault = f"not CSV: {error}; separate numbers by commas"
        raise refusal(path, [(reader.line_num, fault)]) from None
    if not rows:
        raise refusal(path, [(None, "empty; give a header such as t,x,y,theta, and rows")])
    (header, names), *rows = rows
    faults = _header_faults(names, joints)
    if faults:
        raise refusal(path, [(header, fault) for fault in faults])
    values, lines, bad = _values(rows, names)
    bad += _time_faults(values, lines, names.index("t"))
    if set(QUATERNION) <= set(names):
        bad += _quaternion_faults(values, lines, [names.index(name) for name in QUATERNION])
    if not bad and len(rows) < MIN_ROWS:
        bad.append((lines[-1] if lines else header, f"{len(rows)} rows; give {MIN_ROWS} or more"))
    if bad:
        raise refusal(path, sorted(bad))
    columns = dict(zip(names, values.T, strict=True))
    t = columns.pop("t")
    return Table(str(path), tuple(lines), header, t - t[0], columns)


def _header_faults(names: list[str], joints: Sequence[str]) -> list[str]:
    known = ("t", *POSE_COLUMNS, *joints)
    faults = []
    for name in dict.fromkeys(names):
        if name not in known:
            near = get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]}?" if near else f"columns are {', '.join(known)}"
            faults.append(f'column "{excerpt(name)}" is not known; {hint}')
        if names.count(name) > 1:
            faults.append(f'column "{excerpt(name)}" comes {names.count(name)} times; keep one')
    if "t" not in names:
        faults.append("no column t; add the time in s")
    for group in (BASE_COLUMNS, EE_COLUMNS, QUATERNION):
        missing = [name for name in group if name not in names]
        if missing and len(missing) < len(group):
            there = next(name for name in group if name in names)
            faults.append(f"column {', '.join(missing)} is missing beside {there}; add it")
    for name, needed in ((HEADING, BASE_COLUMNS), (QUATERNION[0], EE_COLUMNS)):
        if name in names and needed[0] not in names:
            faults.append(f"column {name} needs {', '.join(needed)} beside it; add them")
    if not faults and len(names) == 1:
        faults.append("only times; add x,y or ee_x,ee_y,ee_z or joints")
    return faults


def _values(
    rows: list[tuple[int, list[str]]], names: list[str]
) -> tuple[Array, list[int], list[tuple[int, str]]]:
    """Return the numbers (K, n) of good rows, their lines, and the faults of the others."""
    values: list[list[float]] = []
    lines: list[int] = []
    faults: list[tuple[int, str]] = []
    for line, row in rows:
        found = len(faults)
        numbers = []
        if len(row) != len(names):
            faults.append((line, f"{len(row)} entries where the header names {len(names)}; "
                           "complete the row or leave it out"))  # fmt: skip
        for name, text in zip(names, row, strict=False):
            try:
                number = parse_numbers(text, 1)[0] if text else None
            except Fault as fault:
                faults.append((line, f'{name} "{excerpt(text)}" {fault}'))
                continue
            if number is None:
                faults.append((line, f"{name} is empty; give a number or leave the row out"))
            elif abs(number) > MAX_ABSOLUTE:
                faults.append((line, f"{name} is {number:g}, which is absurd; use s, m and rad"))
            else:
                numbers.append(number)
        if len(faults) == found:
            values.append(numbers)
            lines.append(line)
    return np.array(values).reshape(-1, len(names)), lines, faults


def _time_faults(values: Array, lines: list[int], column: int) -> list[tuple[int, str]]:
    faults: list[tuple[int, str]] = []
    latest = -math.inf
    for line, t in zip(lines, values[:, column], strict=True):
        if t <= latest:
            faults.append((line, f"t is {t:g} after {latest:g}; times must increase"))
        else:
            latest = t
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
