"""The reference that a name or a file stands for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from pathlib import Path as FilePath
from typing import Any

from rpctl.errors import DescriptionError, RpctlError, UnknownNameError, is_number
from rpctl.files import toml
from rpctl.files.caps import cap, how_to_raise
from rpctl.reference.limits import Limits, limits_from
from rpctl.reference.motion import Reference
from rpctl.reference.named import BASE_PATHS, reference_by_name
from rpctl.reference.path_reference import TimedPath
from rpctl.reference.planned.curve import DEFAULT_CORNER, Waypoint, check_waypoints, polyline
from rpctl.reference.planned.waypoints import along_goal, along_waypoints, ee_square, slalom
from rpctl.reference.pose_goal import is_goal, read_goal, to_goal
from rpctl.reference.recorded.recording import reference_from_table
from rpctl.reference.recorded.table_file import read_table, refusal
from rpctl.reference.sizing import WISHES, SizingRequest, require_smoothing
from rpctl.robot.model import Robot

MAX_COORDINATE = 1e4  # m: no waypoint is farther
PLANNED_REFERENCES = {"waypoints": slalom, "ee-square": ee_square}


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


def load_reference(
    robot: Robot,
    source: str,
    size: float | None = None,
    speed: float | None = None,
    laps: float | None = None,
    smooth: float | str | None = None,
    retime: bool = False,
    collisions: bool = True,
) -> Reference:
    """Return a reference by its name, or from a file in CSV or TOML.

    Size and speed of a named one follow from the robot's size and limits; its ``sizing`` says
    what they are, and why.

    Args:
        robot: The robot.
        source: ``line``, ``reverse``, ``spin``, ``circle``, ``eight``, ``waypoints``,
            ``ee-square``, or a file: ``.csv`` or ``.toml``.
        size: Of a named one, instead, m: radius of the circle, half the length of the eight and
            of the waypoints, half the side of the square, length of the line.
        speed: Of a named one, instead: the largest along the path, m/s; of a spin the turning
            rate, rad/s.
        laps: How many times circle, eight and spin are gone through, once if not given.
        smooth: Of a CSV: the root mean square, in m, by which the reference may miss its rows, to
            be smooth; ``auto`` takes their noise. None passes every row.
        retime: Whether to slow a CSV down where it asks more than the robot's limits; it keeps its
            path. Its ``recording`` says what was changed, and what it asks beyond the limits.
        collisions: Whether the arm of a named one swings less where links would come too near to
            each other or to the ground.

    Raises:
        UnknownNameError: There is no such reference, and the name is no file's.
        RpctlError: The file has faults, or the robot cannot follow.
    """
    wish, suffix = SizingRequest(size, speed, laps), FilePath(source).suffix.lower()
    require_smoothing(smooth)
    if suffix != ".csv":
        _refuse_of_others(source, smooth, retime)
    if is_goal(source):
        wish.refuse("a goal says where to go; leave them out", *WISHES)
        return to_goal(robot, read_goal(source))
    if suffix in (".csv", ".toml"):
        wish.refuse(f"{source} has its own sizes and speeds; change them there", *WISHES)
        return _from_file(robot, source, suffix, smooth, retime)
    if source in PLANNED_REFERENCES:
        return PLANNED_REFERENCES[source](robot, wish)
    if source not in BASE_PATHS:
        raise UnknownNameError(
            "reference",
            source,
            (*BASE_PATHS, *PLANNED_REFERENCES, "goal X,Y,THETA", "FILE.csv", "FILE.toml"),
        )
    return reference_by_name(robot, source, wish, collisions)


def _from_file(
    robot: Robot, source: str, suffix: str, smooth: float | str | None, retime: bool
) -> TimedPath:
    """Return the reference of a file; an error names the file."""
    try:
        if suffix == ".csv":
            table = read_table(source, robot.joint_names)
            return reference_from_table(robot, table, Limits(), smooth, retime)
        asked = read_path_file(source)
        if asked.waypoints:
            return along_waypoints(robot, asked.waypoints, asked.limits)
        return along_goal(robot, polyline(asked.points, asked.corner), asked.limits)
    except DescriptionError:
        raise
    except RpctlError as error:
        raise refusal(source, [(None, str(error))]) from None


def _refuse_of_others(source: str, smooth: float | str | None, retime: bool) -> None:
    """Refuse to smooth or to retime what is no table.

    Raises:
        RpctlError: It is asked for.
    """
    if smooth is not None:
        raise RpctlError(f"smooth = {smooth}: {source} has no rows with noise; leave it out")
    if retime:
        raise RpctlError(f"retime: {source} has no times of its own to change; leave it out")
