"""The reference that a name or a file stands for."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from rpctl.errors import SMALLEST, DescriptionError, RpctlError, UnknownNameError
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.records import Range, Record, read_toml
from rpctl.reference.motion import Reference
from rpctl.reference.named import BASE_PATHS, reference_by_name
from rpctl.reference.path_reference import TimedPath
from rpctl.reference.planned.curve import DEFAULT_CORNER, Waypoint, polyline
from rpctl.reference.planned.waypoints import along_goal, along_waypoints, ee_square, slalom
from rpctl.reference.pose_goal import is_goal, read_goal, to_goal
from rpctl.reference.recorded.recording import reference_from_table
from rpctl.reference.recorded.table_file import read_table, refusal
from rpctl.reference.sizing import WISHES, Limits, SizingRequest, require_smoothing
from rpctl.robot.model import Robot

MAX_COORDINATE = 1e4  # m: no waypoint is farther
PLANNED_REFERENCES = {"waypoints": slalom, "ee-square": ee_square}


@dataclass(frozen=True)
class PathFile(Record):
    """What a file asks for: one of waypoints and points of the end effector.

    Attributes:
        waypoints: Of the base, (x, y) or (x, y, heading), m and rad.
        end_effector: Its points (x, y, z), m.
        corner: Where the rounding of the end effector's corners begins, m.
        limits: Of both.
    """

    waypoints: tuple[tuple[float, ...], ...] = ()
    end_effector: tuple[tuple[float, float, float], ...] = ()
    corner: Annotated[float, Range(SMALLEST, MAX_COORDINATE, "metres, more than 0")] = (
        DEFAULT_CORNER
    )
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        """Refuse what is no path."""
        super().__post_init__()
        points, most = self.waypoints or self.end_effector, cap("MAX_WAYPOINTS")
        if not points or (self.waypoints and self.end_effector):
            raise RpctlError(
                "give either waypoints = [[x, y], ...] or end_effector = [[x, y, z], ...]"
            )
        if len(points) > most:
            fault = f"{len(points)} points; {most} are the most"
            raise RpctlError(f"{fault}; {how_to_raise('MAX_WAYPOINTS')}")
        if any(abs(value) > MAX_COORDINATE for point in points for value in point):
            raise RpctlError(f"a point is farther than {MAX_COORDINATE:g} m; use metres")
        if any(len(point) not in (2, 3) for point in self.waypoints):
            raise RpctlError("waypoints are [x, y] or [x, y, heading] in m and rad")


def load_reference(
    robot: Robot,
    source: str,
    *,
    smooth: float | str | None = None,
    retime: bool = False,
    collisions: bool = True,
    **sizes: float | None,
) -> Reference:
    """Return a reference by its name, or from a file in CSV or TOML.

    Its ``sizing`` says how large and fast a named one is, its ``recording`` what became of a CSV.

    Args:
        robot: The robot.
        source: As of ``--reference``: a name, or a file: ``.csv`` or ``.toml``.
        smooth: Of a CSV: by how much it may miss its rows, m rms; ``auto``: by their noise.
        retime: Whether to slow a CSV down where it asks more than the robot's limits.
        collisions: Whether the arm of a named one keeps its links clear.
        **sizes: Of a named one: ``size`` (m), ``speed`` (m/s, of a spin rad/s), ``laps``.

    Raises:
        UnknownNameError: There is no such reference, and the name is no file's.
        RpctlError: The file has faults, or the robot cannot follow.
    """
    wish, suffix = SizingRequest(**sizes), Path(source).suffix.lower()
    require_smoothing(smooth)
    if suffix in (".csv", ".toml"):
        wish.refuse(f"{source} has its own sizes and speeds; change them there", *WISHES)
        return _from_file(robot, source, smooth, retime)
    _refuse_for_table(source, smooth, retime)
    if is_goal(source):
        wish.refuse("a goal says where to go; leave them out", *WISHES)
        return to_goal(robot, read_goal(source))
    if source in PLANNED_REFERENCES:
        return PLANNED_REFERENCES[source](robot, wish)
    if source not in BASE_PATHS:
        known = *BASE_PATHS, *PLANNED_REFERENCES, "goal X,Y,THETA", "FILE.csv", "FILE.toml"
        raise UnknownNameError("reference", source, known)
    return reference_by_name(robot, source, wish, collisions)


def _refuse_for_table(source: str, smooth: float | str | None, retime: bool) -> None:
    """Refuse to smooth or to retime what is no table."""
    if smooth is not None:
        raise RpctlError(f"smooth = {smooth}: {source} has no rows with noise; leave it out")
    if retime:
        raise RpctlError(f"retime: {source} has no times of its own to change; leave it out")


def _from_file(robot: Robot, source: str, smooth: float | str | None, retime: bool) -> TimedPath:
    """Return the reference of a file; an error names the file."""
    try:
        if source.lower().endswith(".csv"):
            table = read_table(source, robot.joint_names)
            return reference_from_table(robot, table, Limits(), smooth, retime)
        _refuse_for_table(source, smooth, retime)
        asked = read_toml(source, PathFile, "a path file")
        if asked.waypoints:
            waypoints = [Waypoint(*row) for row in asked.waypoints]
            return along_waypoints(robot, waypoints, asked.limits)
        return along_goal(robot, polyline(asked.end_effector, asked.corner), asked.limits)
    except DescriptionError:
        raise
    except RpctlError as error:
        raise refusal(source, [(None, str(error))]) from None
