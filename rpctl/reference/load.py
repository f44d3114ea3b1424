"""The reference that a name or a file stands for, and those that are planned.

Planned are those through waypoints, and along a path of the end effector.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SMALLEST, DescriptionError, RpctlError, UnknownNameError, fault_at
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.records import Range, Record, read_toml
from rpctl.reference import paths
from rpctl.reference.fitting import assumptions, reason, slow_down, too_weak, usage_of
from rpctl.reference.motion import Reference
from rpctl.reference.named import BASE_PATHS, reference_by_name
from rpctl.reference.path_reference import TimedPath
from rpctl.reference.paths import constant, spline_curve
from rpctl.reference.planned.arm import Arm
from rpctl.reference.planned.curve import DEFAULT_CORNER, Goal, Waypoint, curve_through, polyline
from rpctl.reference.planned.reach import plan_reach
from rpctl.reference.pose_goal import is_goal, read_goal, to_goal
from rpctl.reference.recorded.recording import reference_from_table
from rpctl.reference.recorded.table_file import read_table
from rpctl.reference.sizing import (
    WISHES,
    Limits,
    Sizing,
    SizingRequest,
    arm_bounds,
    comfortable_radius,
    require_smoothing,
    robot_length,
)
from rpctl.reference.time_law import time_law
from rpctl.robot.model import Robot

MAX_COORDINATE = 1e4  # m: no waypoint is farther


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
            raise RpctlError(
                f"{len(points)} points; at most {most} are allowed; {how_to_raise('MAX_WAYPOINTS')}"
            )
        if any(abs(value) > MAX_COORDINATE for point in points for value in point):
            raise RpctlError(f"a point is farther than {MAX_COORDINATE:g} m; use metres")
        if any(len(point) not in (2, 3) for point in self.waypoints):
            raise RpctlError("waypoints are [x, y] or [x, y, heading] in m and rad")


def load_reference(
    robot: Robot,
    source: str | Path,
    *,
    smooth: float | str | None = None,
    retime: bool = False,
    collisions: bool = True,
    **sizes: float | None,
) -> Reference:
    """Return a reference by its name, or from a file in CSV or TOML.

    The ``sizing`` of a named reference says how large and fast it is; the ``recording`` of a CSV
    file says how its rows were changed.

    Args:
        robot: The robot.
        source: A name, or a ``.csv`` or ``.toml`` file, as for ``--reference``.
        smooth: For a CSV file, root mean square distance (m) by which smoothing may deviate from
            the rows; ``"auto"``: as their noise requires; None: no smoothing.
        retime: Whether to slow a CSV file down where it exceeds the robot's limits.
        collisions: Whether a named reference keeps the arm's links clear of collisions.
        **sizes: For a named reference ``size`` (m), ``speed`` (m/s; rad/s for a spin), ``laps``.

    Returns:
        The reference; called with a time (s) it returns a :class:`ReferenceState`.

    Raises:
        UnknownNameError: There is neither a reference nor a file with this name.
        RpctlError: The file has faults, or the robot cannot follow the reference.
    """
    source, wish, suffix = str(source), SizingRequest(**sizes), Path(source).suffix.lower()
    require_smoothing(smooth)
    if suffix in (".csv", ".toml"):
        wish.refuse(f"{source} has its own sizes and speeds; change them there", *WISHES)
        return _from_file(robot, source, smooth, retime)
    _refuse_for_table(source, smooth, retime)
    if is_goal(source):
        wish.refuse("a goal sets where to go; leave them out", *WISHES)
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
        raise RpctlError(f"smooth = {smooth}: {source} has no rows to smooth; leave it out")
    if retime:
        raise RpctlError(f"retime: {source} has no times to change; leave it out")


def _from_file(robot: Robot, source: str, smooth: float | str | None, retime: bool) -> TimedPath:
    """Return the reference of a file; an error names the file."""
    try:
        if source.lower().endswith(".csv"):
            table = read_table(source, robot.joint_names)
            return reference_from_table(robot, table, Limits(), smooth, retime)
        _refuse_for_table(source, smooth, retime)
        asked = read_toml(source, PathFile, "a path file")
        if asked.waypoints:
            return along_waypoints(robot, [Waypoint(*row) for row in asked.waypoints], asked.limits)
        return along_goal(robot, polyline(asked.end_effector, asked.corner), asked.limits)
    except DescriptionError:
        raise
    except RpctlError as error:
        raise fault_at(source, None, str(error)) from None


LIMIT_SPACING = 0.01  # m of a path between the points where limits are checked
MAX_LIMIT_POINTS, MIN_LIMIT_POINTS = 3000, 300  # numbers of these points
SPEED_SAMPLES = 400  # times at which a reference's largest speed is looked for

# Waypoints of a robot 1 m long, m, rad.
SLALOM = ((0.0, 0.0, 0.0), (1.5, 0.6), (2.6, -0.5), (4.0, 0.2), (3.6, 1.7), (1.8, 1.9), (0.2, 1.2))
SLALOM_SIZE = 2.0  # m; half their length along x
SLALOM_RADIUS = 0.6  # m; of its tightest bend, about: it grows where a robot cannot steer so
SQUARE_SIZE = 0.75  # of the robot's length: half the side of its end effector's square
FIXED_ARM_SIZE = 0.075  # of how far a fixed arm holds its end effector: half the side of its square


def slalom(robot: Robot, wish: SizingRequest) -> TimedPath:
    """Return the reference ``waypoints``: a slalom and back, by the robot's size and limits.

    Args:
        wish: Its size is half the slalom's length.

    Raises:
        RpctlError: The base is fixed, or cannot steer so sharply; it has laps.
    """
    wish.refuse(
        "waypoints do not form a closed path; give their size, half their length in m", "laps"
    )
    _require_base(robot)
    least = SLALOM_SIZE / SLALOM_RADIUS * comfortable_radius(robot)
    size = wish.size or max(SLALOM_SIZE * robot_length(robot), least)
    scale = size / SLALOM_SIZE
    limits = _paced(Limits().steerable(robot), scale, wish.speed)
    # The curve is that of a robot 1 m long, so that its shape is the same at every size.
    curve = replace(limits, turning_radius=limits.turning_radius / scale)
    path, end = curve_through([Waypoint(*row) for row in SLALOM], curve.turning_radius)
    path = paths.scaled(path, scale)
    found = _driven(robot, path, end, limits)

    return _sized(robot, "waypoints", found, size, wish, lambda s: path(s).twist[:, 0, :2])


def ee_square(robot: Robot, wish: SizingRequest) -> TimedPath:
    """Return the reference ``ee-square``: a square of the end effector, by the robot's size.

    Args:
        wish: Its size is half the square's side, its speed the end effector's.

    Raises:
        RpctlError: The end effector cannot follow; it has laps.
    """
    wish.refuse("ee-square has one lap; leave them out", "laps")
    arm = Arm(robot)
    start = arm.end_effector_pose(np.zeros(3), arm.comfortable_posture(None)).translation
    length, size, shift = robot_length(robot), wish.size, 0.0
    if not robot.drive.base_speeds:
        size = size or FIXED_ARM_SIZE * float(np.linalg.norm(start))
        shift = -size
    size = size or SQUARE_SIZE * length
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]]) * 2.0 * size + shift
    corners[:, 2] = 0.0
    goal = polyline((start + corners).tolist(), min(DEFAULT_CORNER, 0.5 * size))
    ratio = None if wish.speed is None else wish.speed / Limits.end_effector_speed * Limits.speed
    found = along_goal(robot, goal, _paced(Limits(), length, ratio))
    return _sized(robot, "ee-square", found, size, wish, goal.position.derivative())


PLANNED_REFERENCES = {"waypoints": slalom, "ee-square": ee_square}


def _paced(limits: Limits, scale: float, speed: float | None) -> Limits:
    """Return limits for a path ``scale`` times larger, accelerations as they are.

    Args:
        speed: Of P instead, m/s; all else then changes as if time ran faster.
    """
    comfort = math.sqrt(scale) * limits.speed
    pace = 1.0 if speed is None else speed / comfort
    return replace(
        limits,
        speed=pace * comfort,
        acceleration=pace**2 * limits.acceleration,
        turning_speed=pace * limits.turning_speed / math.sqrt(scale),
        turning_acceleration=pace**2 * limits.turning_acceleration / scale,
        lateral_acceleration=pace**2 * limits.lateral_acceleration,
        end_effector_speed=pace * math.sqrt(scale) * limits.end_effector_speed,
        end_effector_acceleration=pace**2 * limits.end_effector_acceleration,
    )


def _sized(
    robot: Robot,
    name: str,
    found: TimedPath,
    size: float,
    wish: SizingRequest,
    velocity: Callable[[Array], Array],
) -> TimedPath:
    """Return a reference slowed down to its share of the limits, unless its speed is given.

    Args:
        size: m.
        velocity: Returns velocities (K, n) by s, m.
    """
    dynamics = ReducedDynamics(robot)
    if wish.speed is None:
        found, usage = slow_down(dynamics, found)
    else:
        usage = usage_of(dynamics, found)
    s, rate, _ = found.time_law(np.linspace(0.0, found.duration, SPEED_SAMPLES))
    top = float((np.linalg.norm(velocity(s), axis=1) * np.abs(rate)).max())
    why, weak = reason(usage, robot, given=wish.speed is not None), too_weak(dynamics, found)
    sizing = Sizing(name, size, top, None, found.duration, why, weak, assumptions(robot))
    return replace(found, sizing=sizing)


def along_waypoints(robot: Robot, waypoints: Sequence[Waypoint], limits: Limits) -> TimedPath:
    """Return a reference that leads P through waypoints, heading along, the arm at home.

    Raises:
        RpctlError: No path through the waypoints keeps to the limits, or the base is fixed.
    """
    _require_base(robot)
    limits = limits.steerable(robot)
    path, end = curve_through(waypoints, limits.turning_radius)
    return _driven(robot, path, end, limits)


def _driven(robot: Robot, path: paths.Path, end: float, limits: Limits) -> TimedPath:
    """Return the reference along a path as fast as limits allow, the arm at home."""
    s = _grid(0.0, end)
    return TimedPath(path, constant(robot.home), time_law(s, limits.base(robot, path(s).twist)))


def along_goal(robot: Robot, goal: Goal, limits: Limits) -> TimedPath:
    """Return a reference that leads the end effector along a path, as fast as the limits allow.

    Raises:
        RpctlError: The end effector cannot follow.
    """
    limits = limits.steerable(robot)
    path, spline = plan_reach(robot, goal, limits)
    s = _grid(goal.start, goal.end)
    place = goal.position
    bounds = [
        *limits.base(robot, path(s).twist),
        *limits.end_effector(place(s, 1), place(s, 2)),
        *arm_bounds(robot, spline(s, 1), spline(s, 2)),
    ]
    return TimedPath(path, spline_curve(spline), time_law(s, bounds))


def _require_base(robot: Robot) -> None:
    if not robot.drive.base_speeds:
        raise RpctlError(f"{robot.name} has a fixed base and cannot drive to waypoints")


def _grid(start: float, end: float) -> Array:
    count = int(np.clip((end - start) / LIMIT_SPACING, MIN_LIMIT_POINTS, MAX_LIMIT_POINTS))
    return np.linspace(start, end, count + 1)
