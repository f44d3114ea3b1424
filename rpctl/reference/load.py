"""The reference that a name or a file stands for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath

from rpctl.errors import DescriptionError, RpctlError, UnknownNameError
from rpctl.reference.csv_file import read_table, refusal
from rpctl.reference.goal import polyline
from rpctl.reference.limits import Limits
from rpctl.reference.motion import Reference
from rpctl.reference.named import BASE_PATHS, reference_by_name
from rpctl.reference.planned import along_goal, along_waypoints, ee_square, slalom
from rpctl.reference.pose_goal import is_goal, read_goal, to_goal
from rpctl.reference.recorded import reference_from_table
from rpctl.reference.sizing import WISHES, SizingRequest
from rpctl.reference.smooth_wish import require_smoothing
from rpctl.reference.timed_path import TimedPath
from rpctl.reference.toml_file import read_path_file
from rpctl.robot.model import Robot

PLANNED_REFERENCES = {"waypoints": slalom, "ee-square": ee_square}


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
    return reference_by_name(robot, source, size, speed, laps, collisions)


def _from_file(
    robot: Robot, source: str, suffix: str, smooth: float | str | None, retime: bool
) -> TimedPath:
    if suffix == ".csv":
        table = read_table(source, robot.joint_names)
        return _in_file(
            source, lambda: reference_from_table(robot, table, Limits(), smooth, retime)
        )
    asked = read_path_file(source)
    if asked.waypoints:
        return _in_file(source, lambda: along_waypoints(robot, asked.waypoints, asked.limits))
    return _in_file(
        source, lambda: along_goal(robot, polyline(asked.points, asked.corner), asked.limits)
    )


def _refuse_of_others(source: str, smooth: float | str | None, retime: bool) -> None:
    """Refuse to smooth or to retime what is no table.

    Raises:
        RpctlError: It is asked for.
    """
    if smooth is not None:
        raise RpctlError(f"smooth = {smooth}: {source} has no rows with noise; leave it out")
    if retime:
        raise RpctlError(f"retime: {source} has no times of its own to change; leave it out")


def _in_file(path: str, make: Callable[[], TimedPath]) -> TimedPath:
    """Return what is made of a file; an error names the file."""
    try:
        return make()
    except DescriptionError:
        raise
    except RpctlError as error:
        raise refusal(path, [(None, str(error))]) from None
