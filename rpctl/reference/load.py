"""The reference that a name or a file stands for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import DescriptionError, RpctlError, UnknownNameError
from rpctl.reference.arm import Arm
from rpctl.reference.csv_file import read_table, refusal
from rpctl.reference.curve import Waypoint, curve_through
from rpctl.reference.end_effector_plan import plan_reach
from rpctl.reference.goal import Goal, polyline
from rpctl.reference.limits import Limits, arm_bounds
from rpctl.reference.motion import Reference
from rpctl.reference.named import BASE_PATHS, reference_by_name
from rpctl.reference.pose_goal import is_goal, read_goal, to_goal
from rpctl.reference.recorded import reference_from_table
from rpctl.reference.splines import Curves
from rpctl.reference.time_law import time_law
from rpctl.reference.timed_path import TimedPath, along, constant
from rpctl.reference.toml_file import DEFAULT_CORNER, read_path_file
from rpctl.robot.model import Robot

LIMIT_SPACING = 0.01  # m of a path between the points where limits are checked
MAX_LIMIT_POINTS, MIN_LIMIT_POINTS = 3000, 300  # numbers of these points

SLALOM = ((0.0, 0.0, 0.0), (1.5, 0.6), (2.6, -0.5), (4.0, 0.2), (3.6, 1.7), (1.8, 1.9), (0.2, 1.2))
SLALOM_RADIUS = 0.6  # m; of its tightest bend, about: it grows where a robot cannot steer so
SQUARE_SIDE = 1.5  # m; of the end effector's square on a base that drives
FIXED_ARM_SIDE_RATIO = 0.15  # of how far a fixed arm holds its end effector: the side of its square
PLANNED_REFERENCES = ("waypoints", "ee-square")


def load_reference(robot: Robot, source: str) -> Reference:
    """Return a reference by its name, or from a file in CSV or TOML.

    Raises:
        UnknownNameError: There is no such reference, and the name is no file's.
        RpctlError: The file has faults, or the robot cannot follow.
    """
    if is_goal(source):
        return to_goal(robot, read_goal(source))
    suffix = FilePath(source).suffix.lower()
    if suffix == ".csv":
        table = read_table(source, robot.joint_names)
        return _in_file(source, lambda: reference_from_table(robot, table, Limits()))
    if suffix == ".toml":
        asked = read_path_file(source)
        if asked.waypoints:
            return _in_file(source, lambda: along_waypoints(robot, asked.waypoints, asked.limits))
        return _in_file(
            source, lambda: along_goal(robot, polyline(asked.points, asked.corner), asked.limits)
        )
    if source == "waypoints":
        scale = max(1.0, Limits().steerable(robot).turning_radius / SLALOM_RADIUS)
        rows = [(scale * x, scale * y, *heading) for x, y, *heading in SLALOM]
        return along_waypoints(robot, [Waypoint(*row) for row in rows], Limits())
    if source == "ee-square":
        return along_goal(robot, _square(robot), Limits())
    if source not in BASE_PATHS:
        raise UnknownNameError(
            "reference",
            source,
            (*BASE_PATHS, *PLANNED_REFERENCES, "goal X,Y,THETA", "FILE.csv", "FILE.toml"),
        )
    return reference_by_name(robot, source)


def along_waypoints(robot: Robot, waypoints: Sequence[Waypoint], limits: Limits) -> TimedPath:
    """Return a reference that leads P through waypoints, heading along, the arm at home.

    Args:
        robot: The robot.
        waypoints: Two or more.
        limits: The user's limits.

    Raises:
        RpctlError: No path through the waypoints keeps to the limits, or the base is fixed.
    """
    if not robot.drive.base_speeds:
        raise RpctlError(f"{robot.name} has a fixed base: it has no way to waypoints")
    limits = limits.steerable(robot)
    path, end = curve_through(waypoints, limits.turning_radius)
    s = _grid(0.0, end)
    timing = time_law(s, limits.base(robot, along(path, s)))
    return TimedPath(path, constant(robot.home, 0.0, end), timing)


def along_goal(robot: Robot, goal: Goal, limits: Limits) -> TimedPath:
    """Return a reference that leads the end effector along a path, as fast as the limits allow.

    Args:
        robot: The robot.
        goal: The end effector's path, by its length.
        limits: The user's limits.

    Raises:
        RpctlError: The end effector cannot follow.
    """
    limits = limits.steerable(robot)
    plan = plan_reach(robot, goal, limits)
    s = _grid(goal.start, goal.end)
    place, joints = goal.position, plan.joints
    bounds = [
        *limits.base(robot, along(plan.path, s)),
        *limits.end_effector(place(s, 1), place(s, 2)),
        *arm_bounds(robot, joints(s, 1), joints(s, 2)),
    ]
    return TimedPath(plan.path, Curves(joints), time_law(s, bounds))


def _square(robot: Robot) -> Goal:
    """Return a level square that begins where a comfortable arm holds the end effector."""
    arm = Arm(robot)
    start = arm.end_effector_pose(np.zeros(3), arm.comfortable_posture(None)).translation
    side, shift = SQUARE_SIDE, 0.0
    if not robot.drive.base_speeds:
        side = FIXED_ARM_SIDE_RATIO * float(np.linalg.norm(start))
        shift = -0.5 * side
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]]) * side + shift
    corners[:, 2] = 0.0
    return polyline((start + corners).tolist(), min(DEFAULT_CORNER, 0.25 * side))


def _grid(start: float, end: float) -> Array:
    count = int(np.clip((end - start) / LIMIT_SPACING, MIN_LIMIT_POINTS, MAX_LIMIT_POINTS))
    return np.linspace(start, end, count + 1)


def _in_file(path: str, make: Callable[[], TimedPath]) -> TimedPath:
    """Return what is made of a file; an error names the file."""
    try:
        return make()
    except DescriptionError:
        raise
    except RpctlError as error:
        raise refusal(path, [(None, str(error))]) from None
