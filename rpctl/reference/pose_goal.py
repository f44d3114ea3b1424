"""A goal of base and arm: where the robot is to stand, in which posture, and the way there."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.errors import RpctlError, require_known
from rpctl.reference.formula import Along, Columns
from rpctl.reference.motion import RowReference
from rpctl.reference.path_reference import TimedPath, still
from rpctl.reference.paths import Path, Place, constant, line, placed, posed, spin
from rpctl.reference.planned.curve import Waypoint, curve_through
from rpctl.reference.sizing import SPEED_RISE_TIME, Limits
from rpctl.reference.time_law import AT_REST, Bound, TimeLaw, time_law
from rpctl.robot.model import Robot

NEGLIGIBLE = 1e-6  # m or rad: a shorter way is none
HALF_TURN = math.pi

Leg = tuple[Path, float]  # a path, and the parameter s at its end; it begins at 0
GOAL = "goal"  # the first word of such a reference
MAX_DISTANCE = 1e4  # m: no goal is farther
POINTS = 301  # of a path, where limits are checked
ARM_SPEED = {"prismatic": 0.2, "other": 0.6}  # m/s, rad/s: an arm moves no faster on its way,
ARM_SPEED_RATIO = 0.5  # nor faster than this part of the joint's velocity limit
STEERING_SPEED = 0.5  # rad/s; wheels steer no faster on the way
MAX_STEERING_TURNS = 100.0  # rad in the time of the path, at the fastest; beyond, it is a jump
HOW = "write goal X,Y,THETA JOINT=POSITION ..., such as goal 1.5,0.5,1.57 (m and rad)"


def legs_between(robot: Robot, start: Array, goal: Array, limits: Limits) -> list[Leg]:
    """Return the paths, one after the other and each from rest to rest, that lead P to a goal.

    A base that moves in any direction goes straight there and turns on the way; one that turns on
    the spot turns, drives forwards or backwards, and turns again; one that steers drives one
    curve.

    Args:
        start: Pose of P (3,): x, y in m, heading in rad.

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
        legs = [(Path(lambda at: posed(at, (at.x * x, at.x * y, at.x * turn))), 1.0)]
    elif drive.steered:
        legs = [_curve(robot, x, y, turn, limits)]
    else:
        legs = _turn_drive_turn(x, y, turn)
    return [(placed(path, start), end) for path, end in legs]


def seen_from(start: Array, goal: Array) -> tuple[float, float, float]:
    """Return a pose (x, y, heading in [−π, π]) in the axes of another one (3,)."""
    dx, dy = goal[0] - start[0], goal[1] - start[1]
    cos, sin = math.cos(start[2]), math.sin(start[2])
    turn = math.remainder(goal[2] - start[2], 2.0 * HALF_TURN)
    return cos * dx + sin * dy, -sin * dx + cos * dy, turn


def _turn_drive_turn(x: float, y: float, turn: float) -> list[Leg]:
    """Return a turn on the spot, a straight line and another turn, whichever are needed."""
    length = math.hypot(x, y)
    if length < NEGLIGIBLE:
        return [(spin(math.copysign(1.0, turn)), abs(turn))]
    ways = []
    for sign in (1.0, -1.0):  # forwards, backwards
        first = math.atan2(sign * y, sign * x)
        last = math.remainder(turn - first, 2.0 * HALF_TURN)
        ways.append((abs(first) + abs(last), sign, first, last))
    # Forwards unless backwards spares more than a quarter turn: a robot looks where it drives.
    _, sign, first, last = min(ways, key=lambda way: way[0] + (way[1] < 0.0) * 0.5 * HALF_TURN)
    legs = [
        (spin(math.copysign(1.0, first)), abs(first)),
        (placed(line(sign), np.array([0.0, 0.0, first])), length),
        (placed(spin(math.copysign(1.0, last)), np.array([x, y, first])), abs(last)),
    ]
    return [leg for leg in legs if leg[1] > NEGLIGIBLE]


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

    def formula(at: Along) -> Place:
        (x, y, heading), (forward, left, turn), _ = path.formula(at)
        return Place((x, y, heading - HALF_TURN), (-forward, -left, turn))

    return Path(formula)


@dataclass(frozen=True)
class PoseGoal:
    """Where base and arm are to be in the end.

    Attributes:
        pose: Of P: x, y in m, heading in rad; None: where it is.
        joints: Positions of joints of the arm by name, rad or m; the others stay.
    """

    pose: tuple[float, float, float] | None = None
    joints: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return the goal as :func:`read_goal` reads it."""
        pose = [] if self.pose is None else [",".join(f"{value:.10g}" for value in self.pose)]
        joints = [f"{name}={position:.10g}" for name, position in self.joints.items()]
        return shlex.join([GOAL, *pose, *joints])


class GoalMotion(RowReference):
    """A reference from rest to rest: the base's paths one after the other, the arm meanwhile."""

    def __init__(self, base: tuple[TimedPath, ...], arm: TimedPath) -> None:
        self._base, self._arm = base, arm
        self.duration = max(sum(leg.duration for leg in base), arm.duration)

    @cached_property
    def row(self) -> Columns:  # type: ignore[override]
        """Its row by time, s."""
        at = Along()
        arm = at.values(self._arm.row, at.x)
        legs, number, t = [leg.row.function for leg in self._base], casadi.SX(0), at.x
        for leg in self._base[:-1]:
            done = t >= leg.duration
            number, t = number + done, casadi.if_else(done, t - leg.duration, t)
        which = casadi.Function.conditional("legs", legs, legs[-1])
        base = at.call(which, which.numel_out(0), number, t)
        return at.columns([*base[:9], *arm[9:-9], *base[-9:]])


def is_goal(source: str) -> bool:
    """Return whether the name of a reference is a goal's."""
    return source.split()[:1] == [GOAL]


def read_goal(source: str) -> PoseGoal:
    """Return the goal that ``goal X,Y,THETA JOINT=POSITION ...`` names.

    Raises:
        RpctlError: It is of another form.
    """
    try:
        words = shlex.split(source)[1:]
        pose, joints = None, {}
        for word in words:
            name, given, position = word.rpartition("=")
            if given:
                joints[name] = float(position)
            elif pose is None:
                x, y, theta = map(float, word.split(","))
                pose = x, y, theta
            else:
                raise ValueError(word)
    except ValueError:
        raise RpctlError(f"reference {source!r}: {HOW}") from None
    if not words:
        raise RpctlError(f"reference {source!r} gives no goal: {HOW}")
    return PoseGoal(pose, joints)


def to_goal(
    robot: Robot,
    goal: PoseGoal,
    start: Array | None = None,
    posture: Array | None = None,
    limits: Limits | None = None,
) -> GoalMotion:
    """Return a reference from rest to rest that leads base and arm to a goal.

    Args:
        start: Pose of P at the start (3,): x, y in m, heading in rad; None: the origin.
        posture: Positions of the arm at the start (n_joints,), rad or m; None: at home.
        limits: Limits of the base's motion; None: the default ones.

    Raises:
        UnknownNameError: A joint of the goal is none of the arm's.
        RpctlError: The goal is beyond a joint's limits, or the base cannot get there.
    """
    start = np.zeros(3) if start is None else start
    posture = robot.home if posture is None else posture
    way = _end_posture(robot, goal.joints, posture) - posture
    pose = start if goal.pose is None else np.array(goal.pose)
    if not np.isfinite(pose).all() or np.abs(pose[:2]).max() > MAX_DISTANCE:
        raise RpctlError(f"goal {goal.pose}: give finite numbers below {MAX_DISTANCE:g} m; {HOW}")
    limits = (limits or Limits()).steerable(robot)
    legs = [_timed_leg(robot, leg, limits) for leg in legs_between(robot, start, pose, limits)]
    legs = legs or [TimedPath(still(start), constant(posture), AT_REST)]
    timing = _arm_timing(robot, way, sum(leg.duration for leg in legs))
    ends = list(zip(posture.tolist(), way.tolist(), strict=True))
    arm = TimedPath(still(start), lambda at: [a + at.x * change for a, change in ends], timing)
    return GoalMotion(tuple(legs), arm)


def _timed_leg(robot: Robot, leg: Leg, limits: Limits) -> TimedPath:
    path, end = leg
    s = np.linspace(0.0, end, POINTS)
    timing = time_law(s, [*limits.base(robot, path(s).twist), *_steering_bounds(robot, path, s)])
    return TimedPath(path, constant(robot.home), timing)


def _steering_bounds(robot: Robot, path: Path, s: Array) -> list[Bound]:
    """Return the bounds that the joints which steer set to a path at points (N,).

    Raises:
        RpctlError: A pivot would stand on the centre of rotation: its wheel turned in no time.
    """
    steering = [each for each in robot.drive.swivels if not each.trails]
    if not robot.drive.steered:
        return []
    at = Along()
    ahead, left, turn = casadi.vertsplit(
        robot.root_velocity @ casadi.vertcat(*path.formula(at).twist)
    )
    angles = [
        casadi.atan2(left + x * turn, ahead - y * turn)
        for x, y in (swivel.pivot for swivel in steering)
    ]
    _, slopes, bends = np.split(at.columns(at.orders(angles))(s), 3, axis=1)
    bounds = []
    for swivel, slope, bend in zip(steering, slopes.T, bends.T, strict=True):
        if not np.abs(slope).max() * s[-1] <= MAX_STEERING_TURNS:
            raise RpctlError(
                f"on the way to the goal {robot.name} turns about {swivel.joint}, which would "
                "have to steer instantly; set another heading, or go there and turn afterwards"
            )
        limit = robot.description.joint[swivel.joint].velocity
        speed = min(STEERING_SPEED, ARM_SPEED_RATIO * limit)
        bounds.append(Bound(slope, bend, speed, speed / SPEED_RISE_TIME))
    return bounds


def _arm_timing(robot: Robot, change: Array, least: float) -> TimeLaw:
    """Return when an arm is where on a straight way (n_joints,); it takes ``least`` s or more."""
    if not np.abs(change).max(initial=0.0) > 0.0:
        return AT_REST
    bounds = []
    for joint, way in zip(robot.joints, change, strict=True):
        comfort = ARM_SPEED["prismatic" if joint.kind == "prismatic" else "other"]
        speed = min(comfort, ARM_SPEED_RATIO * joint.velocity)
        bounds.append(Bound(np.full(POINTS, way), np.zeros(POINTS), speed, speed / SPEED_RISE_TIME))
    law = time_law(np.linspace(0.0, 1.0, POINTS), bounds)
    return law.lasting(max(least, law.duration))


def _end_posture(robot: Robot, joints: Mapping[str, float], posture: Array) -> Array:
    """Return the arm's positions at the goal (n_joints,).

    Raises:
        UnknownNameError: A joint is none of the arm's.
        RpctlError: A position is beyond its limits.
    """
    there = posture.astype(float)
    require_known("joint of the arm", joints, robot.joint_names)
    for name, position in joints.items():
        number = robot.joint_names.index(name)
        joint, unit = robot.joints[number], robot.joints[number].kind == "prismatic"
        if not (math.isfinite(position) and joint.lower <= position <= joint.upper):
            raise RpctlError(
                f"goal of {name}: {position:.6g} is not within its limits, {joint.lower:.6g} to "
                f"{joint.upper:.6g} {'m' if unit else 'rad'}"
            )
        there[number] = position
    return there


def goal_of_words(pose: str | None, joints: Iterable[str]) -> str:
    """Return the reference that the options ``--goal`` and ``--arm-goal`` name.

    Args:
        pose: ``X,Y,THETA``, or None.
        joints: ``NAME=POSITION``, each.

    Raises:
        RpctlError: They are of another form.
    """
    words = [*([] if pose is None else [pose]), *joints]
    return str(read_goal(shlex.join([GOAL, *words])))
