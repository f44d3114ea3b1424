"""A base path and an arm motion that take the end effector along a path of its own."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import BSpline

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference.path_reference import still
from rpctl.reference.paths import DEGREE, Path, clamped_knots, quintic, through
from rpctl.reference.planned.arm import Arm
from rpctl.reference.planned.curve import Goal
from rpctl.reference.planned.reach_problem import (
    POINTS_PER_KNOT,
    DrivingBase,
    GivenBase,
    ReachProblem,
    solve,
)
from rpctl.reference.sizing import Limits
from rpctl.robot.model import Robot

LARGE_MISS = 0.03  # m; an error message names the first miss as large as this, if there is one
END_EFFECTOR_TOLERANCE = 1e-3  # m: largest distance of the planned end effector from its path
KNOT_LENGTH, KNOT_TIME = 0.15, 0.3  # m of the path, s: spacing of the plan's knots
MIN_KNOTS, MAX_KNOTS = 10, 120  # knots of a plan
MAX_ARM_POINTS = 2500  # points of the arm's final spline, at most
TRIED_HEADINGS = 8  # headings of the base that are tried at the start
MIN_HITCH_AHEAD = 0.1  # m; the end effector is pulled from at least this far ahead of P
STATIONARY_SPAN_RATIO = 0.5  # of an arm's span: a longer path is not tried without driving
REVERSE_COST = 3.0  # cost of a metre backwards, in metres forwards, when a start is chosen


def plan_reach(
    robot: Robot, goal: Goal, limits: Limits, base: Path | None = None
) -> tuple[Path, BSpline]:
    """Return the base's path and the joints by s that take the end effector along its own path.

    The base stays where it is if the arm alone can do it; else it drives, smoothly and without
    sliding. Base and arm are splines found by nonlinear least squares: near a comfortable posture,
    with little driving and turning, within the limits. Inverse kinematics then brings the end
    effector onto the path; where it cannot follow, the error tells from where on, and how far.
    """
    arm = Arm(robot)
    fixed = not robot.drive.base_speeds
    height = (
        None if fixed else float(goal.position(np.linspace(goal.start, goal.end, 50))[:, 2].mean())
    )
    comfort = arm.comfortable_posture(height)
    seconds = goal.end - goal.start if goal.timed else 0.0
    wanted = max(goal.length / KNOT_LENGTH, seconds / KNOT_TIME)
    count = int(np.clip(math.ceil(wanted), MIN_KNOTS, MAX_KNOTS))
    knots = clamped_knots(np.linspace(goal.start, goal.end, count - DEGREE + 1))
    s = np.linspace(goal.start, goal.end, POINTS_PER_KNOT * count + 1)
    way = goal.position(np.linspace(goal.start, goal.end, 200))
    plans: list[tuple[GivenBase | DrivingBase, Array]] = []
    if base is not None or fixed:
        plans.append((GivenBase(base or still(np.zeros(3)), s), np.zeros(0)))
    else:
        if _diagonal(way) < STATIONARY_SPAN_RATIO * _span(arm):
            plans.append((DrivingBase(s, knots, []), _standing_pose(arm, way, comfort)))
        columns = [0, 1, 2] if robot.drive.omnidirectional else [0, 2]
        driving = DrivingBase(s, knots, columns)
        plans.append((driving, _driving_start(arm, goal, comfort, driving, s, columns)))
    for motion, start in plans:
        problem = ReachProblem(arm, goal, motion, comfort, s, knots, limits)
        z = solve(problem, start, np.tile(comfort, (count, 1)))
        path = motion.path(z[: motion.size])
        coarse = quintic(knots, problem.joints(z))
        joints = _solve_arm(arm, goal, path, coarse)
        fault = _fault(arm, goal, path, joints, coarse)
        if fault is None:
            whole = np.tile(robot.home, (len(joints.c), 1))
            whole[:, arm.joints] = joints.c
            return path, quintic(joints.t, whole)
    raise RpctlError(fault or "")


def _solve_arm(arm: Arm, goal: Goal, path: Path, coarse: BSpline) -> BSpline:
    """Return the arm's spline nearest to a coarse one whose end effector is on the path."""
    count = int(np.clip(6 * len(goal.position.c), 200, MAX_ARM_POINTS))
    s = np.linspace(goal.start, goal.end, count)
    positions = [
        arm.solve_ik(path(float(x)).pose, coarse(x), goal.position(x), goal.rotation(float(x)))
        for x in s
    ]
    return through(s, np.array(positions))


def _fault(arm: Arm, goal: Goal, path: Path, joints: BSpline, coarse: BSpline) -> str | None:
    """Return why a plan fails, or None if it does not."""
    s = np.linspace(goal.start, goal.end, 2 * len(joints.c) + 1)
    misses = np.array([_miss(arm, goal, path, joints, float(x)) for x in s])
    if (misses > END_EFFECTOR_TOLERANCE).any():
        # Where inverse kinematics fails it strays; the least squares then came nearer.
        near = [_miss(arm, goal, path, coarse, float(x)) for x in s]
        far = misses > END_EFFECTOR_TOLERANCE
        misses = np.where(far, np.minimum(misses, near), misses)
        far = far & (misses > min(0.5 * misses.max(), LARGE_MISS))
        worst = int(misses.argmax())
        return (
            f"{arm.robot.name} cannot take its end effector ({arm.robot.end_effector}) along the "
            f"path: from {goal.label(s[int(far.argmax())])} it would miss it, by up to "
            f"{misses[worst]:.2g} m at {goal.label(s[worst])}; bring the path nearer (its height, "
            "its orientation) or give it more time"
        )
    q = joints(s)
    for i, index in enumerate(arm.joints):
        joint = arm.robot.joints[index]
        beyond = (q[:, i] < joint.lower - 1e-9) | (q[:, i] > joint.upper + 1e-9)
        if beyond.any():
            at = goal.label(s[int(beyond.argmax())])
            return f"the end effector's path takes {joint.name} beyond its limits from {at}"
        fast = np.abs(joints(s, 1)[:, i]) > joint.velocity
        if goal.timed and fast.any():
            at = goal.label(s[int(fast.argmax())])
            return f"the end effector's path is too fast for {joint.name} from {at}; give it time"
    return None


def _miss(arm: Arm, goal: Goal, path: Path, joints: BSpline, s: float) -> float:
    return float(np.linalg.norm(goal.error(arm.end_effector_pose(path(s).pose, joints(s)), s)))


def _diagonal(points: Array) -> float:
    """Return the diagonal of the box around points (n, 3), m."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _span(arm: Arm) -> float:
    """Return the approximate extent of the arm's workspace while the base stands, m."""
    rng = np.random.default_rng(0)
    draws = arm.middle + arm.half_range * rng.uniform(-1, 1, (200, len(arm.joints)))
    return _diagonal(np.array([arm.end_effector_pose(np.zeros(3), q).translation for q in draws]))


def _standing_pose(arm: Arm, way: Array, comfort: Array) -> Array:
    """Return a pose (3,) from which the comfortable arm is in the middle of a path's points."""
    middle, first = way[:, :2].mean(axis=0), way[0, :2]
    x, y, _ = arm.end_effector_pose(np.zeros(3), comfort).translation
    theta = float(np.angle(complex(*(middle - first)))) if np.any(middle != first) else 0.0
    held = complex(x, y) * np.exp(1j * theta)
    return np.array([middle[0] - held.real, middle[1] - held.imag, theta])


def _driving_start(
    arm: Arm, goal: Goal, comfort: Array, driving: DrivingBase, s: Array, columns: list[int]
) -> Array:
    """Return an initial base motion: the end effector pulls the base by a stiff arm.

    A point at (d, l) of a base that cannot slide moves at (v − l ω, d ω) in the base's axes, so
    its velocity is the base's (a tractrix). Of some headings to start with, the one that takes the
    least way and turning is taken; a base that can slide keeps its heading.
    """
    x, y, _ = arm.end_effector_pose(np.zeros(3), comfort).translation
    hitch = complex(max(x, MIN_HITCH_AHEAD), y)
    fine = np.linspace(goal.start, goal.end, 8 * len(s))
    p = goal.position(fine)[:, :2] @ [1.0, 1j]
    first = next((step for step in np.diff(p) if abs(step) > 1e-9), 1.0)
    tries = []
    for k in range(1 if 1 in columns else TRIED_HEADINGS):
        theta = float(np.angle(first)) + 2.0 * math.pi * k / TRIED_HEADINGS
        trail = _tractrix(p, hitch, theta, sliding=1 in columns)
        back, turn = np.maximum(-trail[:, 0], 0.0), np.abs(trail[:, 2])
        effort = np.abs(trail[:, 0]) + (REVERSE_COST - 1.0) * back + abs(hitch) * turn
        tries.append((round(float(effort.sum()), 9), theta, trail))  # of equal ones the first
    _, theta, trail = min(tries, key=lambda each: each[0])
    rates, place = trail / (fine[1] - fine[0]), p[0] - hitch * np.exp(1j * theta)
    basis = BSpline.design_matrix(0.5 * (fine[1:] + fine[:-1]), driving.knots, DEGREE)
    coefficients = np.linalg.lstsq(basis.toarray(), rates[:, columns], rcond=None)[0]
    return np.concatenate([[place.real, place.imag, theta], coefficients.T.ravel()])


def _tractrix(p: Array, hitch: complex, theta: float, sliding: bool) -> Array:
    """Return the base's small motions (K, 3) as its hitch is pulled along points p (K + 1,).

    Args:
        p: Points x + iy, m.
        hitch: The hitch in the base's axes, x + iy, m.
        theta: Heading at the first point, rad.
        sliding: Whether the base can move sideways.
    """
    motions = []
    for step in np.diff(p):
        local = step * np.exp(-1j * theta)
        if sliding:
            motions.append((local.real, local.imag, 0.0))
            continue
        turn = local.imag / hitch.real
        motions.append((local.real + hitch.imag * turn, 0.0, turn))
        theta += turn
    return np.array(motions)
