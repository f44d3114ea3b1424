"""Base paths from one pose to another, by what a drive can do."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference.curve import Waypoint, curve_through
from rpctl.reference.limits import Limits
from rpctl.reference.paths import Path, PathPoint, steady
from rpctl.reference.pointwise import Numbers, entries, functions, matrix, vector
from rpctl.robot.model import Robot

NEGLIGIBLE = 1e-6  # m or rad: a shorter way is none
HALF_TURN = math.pi

Leg = tuple[Path, float]  # a path, and the parameter s at its end; it begins at 0


def legs_between(robot: Robot, start: Array, goal: Array, limits: Limits) -> list[Leg]:
    """Return the paths, one after the other and each from rest to rest, that lead P to a goal.

    A base that moves in any direction goes straight there and turns on the way; one that turns on
    the spot turns, drives forwards or backwards, and turns again; one that steers drives one
    curve.

    Args:
        robot: The robot.
        start: Pose of P (3,): x, y in m, heading in rad.
        goal: Its pose at the end (3,).
        limits: What the paths are to keep to; only their turning radius counts here.

    Returns:
        The paths; none where P is at the goal already.

    Raises:
        RpctlError: The base is fixed, or cannot steer there in one curve.
    """
    x, y, turn = seen_from(start, goal)
    if max(math.hypot(x, y), abs(turn)) < NEGLIGIBLE:
        return []
    drive = robot.drive
    if not drive.base_speeds:
        raise RpctlError(f"{robot.name} has a fixed base: give a goal for its arm only")
    if drive.omnidirectional:
        return [(_placed(_straight(x, y, turn), start), 1.0)]
    if drive.steered:
        path, end = _curve(robot, x, y, turn, limits)
        return [(_placed(path, start), end)]
    return [(_placed(path, start), end) for path, end in _turn_drive_turn(x, y, turn)]


def seen_from(start: Array, goal: Array) -> tuple[float, float, float]:
    """Return a pose (x, y, heading in [−π, π]) in the axes of another one (3,)."""
    dx, dy = goal[0] - start[0], goal[1] - start[1]
    cos, sin = math.cos(start[2]), math.sin(start[2])
    turn = math.remainder(goal[2] - start[2], 2.0 * HALF_TURN)
    return cos * dx + sin * dy, -sin * dx + cos * dy, turn


def _placed(path: Path, start: Array) -> Path:
    """Return a path that begins at the origin as one that begins at a pose (3,)."""
    cos, sin = math.cos(start[2]), math.sin(start[2])

    def at(s: Numbers) -> PathPoint:
        pose, direction = path(s)
        x, y, heading = entries(pose)
        place = (start[0] + cos * x - sin * y, start[1] + sin * x + cos * y, start[2] + heading)
        return PathPoint(vector(s, place), direction)

    return at


def _straight(x: float, y: float, turn: float) -> Path:
    """Return the straight way to a pose, turning evenly; s from 0 to 1.

    In the axes of the base, the direction w turns against it: w' = −θ' J w, J the quarter turn.
    """

    def at(s: Numbers) -> PathPoint:
        cos, sin = functions(s).cos(turn * s), functions(s).sin(turn * s)
        forward, left = cos * x + sin * y, -sin * x + cos * y
        direction = (
            (forward, left, turn),
            (turn * left, -turn * forward, 0.0),
            (-(turn**2) * forward, -(turn**2) * left, 0.0),
        )
        return PathPoint(vector(s, (s * x, s * y, s * turn)), matrix(s, direction))

    return at


def _turn_drive_turn(x: float, y: float, turn: float) -> list[Leg]:
    """Return a turn on the spot, a straight line and another turn, whichever are needed."""
    length = math.hypot(x, y)
    if length < NEGLIGIBLE:
        return [_spin(0.0, 0.0, 0.0, turn)]
    ways = []
    for sign in (1.0, -1.0):  # forwards, backwards
        first = math.atan2(sign * y, sign * x)
        last = math.remainder(turn - first, 2.0 * HALF_TURN)
        ways.append((abs(first) + abs(last), sign, first, last))
    # Forwards unless backwards spares more than a quarter turn: a robot looks where it drives.
    _, sign, first, last = min(ways, key=lambda way: way[0] + (way[1] < 0.0) * 0.5 * HALF_TURN)
    drive = _line(sign * length, first)
    turns = _spin(0.0, 0.0, 0.0, first), _spin(x, y, first, last)
    return [leg for leg in (turns[0], drive, turns[1]) if leg[1] > NEGLIGIBLE]


def _spin(x: float, y: float, start: float, turn: float) -> Leg:
    sense = math.copysign(1.0, turn)

    def at(s: Numbers) -> PathPoint:
        return PathPoint(vector(s, (x, y, start + sense * s)), steady(s, 0.0, sense))

    return at, abs(turn)


def _line(length: float, heading: float) -> Leg:
    """Return a line of a length, backwards where it is negative, at a heading."""
    step = math.copysign(1.0, length)
    cos, sin = step * math.cos(heading), step * math.sin(heading)

    def at(s: Numbers) -> PathPoint:
        return PathPoint(vector(s, (s * cos, s * sin, heading)), steady(s, step, 0.0))

    return at, abs(length)


def _curve(robot: Robot, x: float, y: float, turn: float, limits: Limits) -> Leg:
    """Return a curve that a base can steer, driven forwards, or else backwards."""
    ways: Sequence[tuple[float, Callable[[Path], Path]]] = ((0.0, lambda p: p), (HALF_TURN, _back))
    for flip, drive in ways:
        ends = Waypoint(0.0, 0.0, flip), Waypoint(x, y, turn + flip)
        try:
            path, end = curve_through(ends, limits.turning_radius)
        except RpctlError:
            continue
        return drive(path), end
    raise RpctlError(
        f"{robot.name} does not get to ({x:.3g}, {y:.3g}) m, {turn:.3g} rad from where it stands "
        f"in one curve, forwards or backwards: it is a {robot.drive.type} and takes bends of "
        f"{limits.turning_radius:.3g} m or more; set the goal farther off or turn it along the way"
    )


def _back(path: Path) -> Path:
    """Return a path driven backwards: the robot faces against it."""

    def at(s: Numbers) -> PathPoint:
        pose, direction = path(s)
        return PathPoint(pose - [0.0, 0.0, HALF_TURN], direction * [-1.0, -1.0, 1.0])

    return at
