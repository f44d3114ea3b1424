"""The reference file in TOML: waypoints of the base, or points of the end effector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rpctl.errors import RpctlError, is_number
from rpctl.files import toml
from rpctl.files.caps import cap, how_to_raise
from rpctl.reference.curve import Waypoint, check_waypoints
from rpctl.reference.limits import Limits, limits_from

MAX_COORDINATE = 1e4  # m: no waypoint is farther
DEFAULT_CORNER = 0.15  # m


@dataclass(frozen=True)
class PathFile:
    """What a file asks for: one of waypoints and points.

    Attributes:
        waypoints: Of the base.
        points: Of the end effector (x, y, z), m.
        corner: Where the rounding of the end effector's corners begins, m.
        limits: Of both.
    """

    waypoints: tuple[Waypoint, ...]
    points: tuple[tuple[float, ...], ...]
    corner: float
    limits: Limits


def read_path_file(path: str | Path) -> PathFile:
    """Read a path.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    return toml.read(path, _path_file, "a path file")


def _path_file(data: toml.Table, faults: list[str]) -> PathFile:
    """Return what a file's table asks for; what is wrong is added to the faults."""
    extra = sorted(data.keys() - {"waypoints", "end_effector", "corner", "limits"})
    faults += [
        f'"{key}" is not known; a path has waypoints or end_effector, corner and limits'
        for key in extra
    ]
    if ("waypoints" in data) == ("end_effector" in data):
        faults.append("give either waypoints = [[x, y], ...] or end_effector = [[x, y, z], ...]")
    waypoints = _rows(faults, data, "waypoints", "waypoint", (2, 3), "[x, y] or [x, y, heading]")
    points = _rows(faults, data, "end_effector", "point", (3,), "[x, y, z]")
    corner = data.get("corner", DEFAULT_CORNER)
    if not is_number(corner) or not 0.0 < corner < MAX_COORDINATE:
        faults.append(f"corner is {corner!r}; give a positive number of metres")
    limits = Limits()
    table = data.get("limits", {})
    try:
        if not isinstance(table, dict):
            raise RpctlError("limits is no table; write [limits], then speed = 0.5")
        limits = limits_from(table)
    except RpctlError as error:
        faults.append(str(error))
    passed = tuple(Waypoint(*row) for row in waypoints)
    if not faults and passed:
        faults += check_waypoints(passed)
    return PathFile(passed, tuple(points), float(corner) if is_number(corner) else 0.0, limits)


def _rows(
    faults: list[str], data: dict[str, Any], key: str, label: str, lengths: Sequence[int], form: str
) -> list[tuple[float, ...]]:
    """Return the rows of numbers under a key; what is wrong is added to the faults."""
    if key not in data:
        return []
    rows, most = data[key], cap("MAX_WAYPOINTS")
    if not isinstance(rows, list) or not rows or len(rows) < 2:
        faults.append(f"{key} needs two {label}s or more; write {key} = [{form}, ...]")
        return []
    if len(rows) > most:
        faults.append(f"{len(rows)} {label}s; {most} are the most; {how_to_raise('MAX_WAYPOINTS')}")
        return []
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, list) or len(row) not in lengths or not all(map(is_number, row)):
            faults.append(f"{label} {number} is {row!r}; write {form} in m and rad")
        elif any(abs(value) > MAX_COORDINATE for value in row):
            faults.append(
                f"{label} {number} is {row!r}, farther than {MAX_COORDINATE:g} m; use metres"
            )
    return [] if faults else [tuple(map(float, row)) for row in rows]
