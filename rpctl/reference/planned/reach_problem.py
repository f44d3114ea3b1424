"""Nonlinear least squares of a plan: base and arm that take the end effector along its path."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array, eye_array, hstack, kron, vstack

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.reference.formula import Along
from rpctl.reference.paths import Path, Place, basis, quintic
from rpctl.reference.planned.arm import Arm, error_rows
from rpctl.reference.planned.curve import Goal
from rpctl.reference.sizing import VELOCITY_LIMIT_FRACTION, Limits, wheel_rates

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(6)  # exact up to degree 11
POINTS_PER_KNOT = 3  # points a knot at which the end effector is compared with its path
LIMIT_FRACTION = 0.95  # of a joint's range and of a curvature limit: what a plan uses
MIN_SPEED_RATIO = 0.05  # of the end effector's mean speed: a base that steers keeps rolling

# Weights of the regularising cost, each a mean over the path; derivatives are by metres of the end
# effector's path, joints in halves of their ranges. They only resolve what the path leaves free.
POSTURE_WEIGHT = 0.3  # distance from the comfortable posture
JOINT_RATE_WEIGHT, JOINT_CHANGE_WEIGHT = 0.15, 0.05  # joint rates, and their changes
BASE_SPEED_WEIGHT, TURNING_WEIGHT = 0.1, 0.1
BASE_CHANGE_WEIGHT = 0.2  # changes of base speed and turning
LIMIT_WEIGHT = 30.0  # of exceeding a limit, relative to the limit
END_EFFECTOR_SIGMAS = (0.2, 0.05, 0.01)  # m; tolerances of the end effector, one after the other
LEVENBERG_STEPS = 12  # Levenberg-Marquardt steps for each tolerance
COST_TOLERANCE = 1e-3  # of the cost: a step that gains less ends it
ACTIVE_SET_STEPS = 8  # Newton steps that find the limits a step runs into
MAX_DAMPING = 1e8  # damping beyond which no smaller step is tried


class GivenBase:
    """A base whose path is given: its poses are functions of no parameters."""

    size = 0

    def __init__(self, path: Path, s: Array) -> None:
        self._path = path
        self._poses = path(s).pose

    def poses(self, z: Array) -> tuple[Array, Array]:
        """Return the known poses (N, 3) and their derivatives by no parameters (N, 3, 0)."""
        return self._poses, np.zeros((len(self._poses), 3, 0))

    def path(self, z: Array) -> Path:
        """Return the known path."""
        return self._path


class DrivingBase:
    """A base whose twist is a spline: a pose to start from, and the spline's coefficients.

    Args:
        s: Points of the path (N,), uniform.
        knots: Knots of the spline (m + 6,).
        columns: Free entries of the twist (forward, left, turning); the others are zero. Without
            any the base stays where it starts.
    """

    def __init__(self, s: Array, knots: Array, columns: list[int]) -> None:
        self.knots, self._columns, self._s = knots, columns, s
        functions = basis(knots)
        self.count = len(functions.c)
        self.size = 3 + self.count * len(columns)
        step = s[1] - s[0]
        points = (s[:-1, None] + 0.5 * step * (1.0 + GAUSS_NODES)).ravel()
        self._quadrature_weights = np.tile(0.5 * step * GAUSS_WEIGHTS, len(s) - 1)
        whole = functions.antiderivative()
        self._basis, self._angle_basis = functions(points), whole(points) - whole(s[0])  # (Q, m)
        self._angle_basis_at_s = whole(s) - whole(s[0])  # (N, m)

    def twist(self, z: Array) -> Array:
        """Return the coefficients of the twist (m, 3)."""
        coefficients = np.zeros((self.count, 3))
        coefficients[:, self._columns] = z[3:].reshape(len(self._columns), self.count).T
        return coefficients

    def poses(self, z: Array) -> tuple[Array, Array]:
        """Return poses (N, 3) and their derivatives by start and coefficients (N, 3, size)."""
        c = self.twist(z)
        theta, twist = z[2] + self._angle_basis @ c[:, 2], self._basis @ c[:, :2]
        heading = np.exp(1j * theta)
        velocity = heading * (twist[:, 0] + 1j * twist[:, 1])
        parts = {0: heading[:, None] * self._basis, 1: 1j * heading[:, None] * self._basis}
        parts[2] = 1j * velocity[:, None] * self._angle_basis
        change = np.hstack([(1j * velocity)[:, None], *(parts[i] for i in self._columns)])
        place, moved = self._sum(velocity), self._sum(change)
        poses = np.column_stack(
            [z[0] + place.real, z[1] + place.imag, z[2] + self._angle_basis_at_s @ c[:, 2]]
        )
        jacobian = np.zeros((len(poses), 3, self.size))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = jacobian[:, 2, 2] = 1.0
        jacobian[:, 0, 2:], jacobian[:, 1, 2:] = moved.real, moved.imag
        if self._columns:
            jacobian[:, 2, -self.count :] = self._angle_basis_at_s  # turning is the last entry
        return poses, jacobian

    def _sum(self, rates: Array) -> Array:
        """Return the integral of rates at the quadrature's points up to each s (N, ...)."""
        weighted = (rates.T * self._quadrature_weights).T
        pieces = weighted.reshape(len(self._s) - 1, len(GAUSS_NODES), *rates.shape[1:]).sum(axis=1)
        return np.concatenate([np.zeros((1, *pieces.shape[1:])), np.cumsum(pieces, axis=0)])

    def path(self, z: Array) -> Path:
        """Return the path: poses by quadrature from the nearest point before."""
        return _twist_path(self._s, self.poses(z)[0], quintic(self.knots, self.twist(z)))


def _twist_path(s: Array, poses: Array, twist: BSpline) -> Path:
    """Return the path of a twist: its poses are the twist's integral, to rounding.

    Args:
        s: Points (N,), uniform.
        poses: Poses there (N, 3).
        twist: By s, with values (3,).
    """
    whole = quintic(twist.t, np.ascontiguousarray(twist.c[:, 2])).antiderivative()
    known = BSpline(np.array([s[0], *s, s[-1]]), poses, 1)
    first, step, most = float(s[0]), float(s[1] - s[0]), len(s) - 1

    def formula(at: Along) -> Place:
        number = casadi.fmin(casadi.fmax(casadi.floor((at.x - first) / step), 0.0), most)
        start = first + step * number
        x, y, heading = at.spline(known, start)
        half, (before,), (after,) = 0.5 * (at.x - start), at.spline(whole, start), at.spline(whole)
        for node, weight in zip(GAUSS_NODES.tolist(), GAUSS_WEIGHTS.tolist(), strict=True):
            between = start + half * (1.0 + node)
            forward, left, _ = at.spline(twist, between)
            angle = heading - before + at.spline(whole, between)[0]
            cos, sin = casadi.cos(angle), casadi.sin(angle)
            x += half * weight * (cos * forward - sin * left)
            y += half * weight * (sin * forward + cos * left)
        return Place((x, y, heading - before + after), at.spline(twist))

    return Path(formula)


@dataclass(frozen=True)
class ReachProblem:
    """An end effector's motion to plan.

    Attributes:
        arm: The arm.
        goal: The end effector's path.
        base: The base's parametrised motion.
        comfort: Posture to stay near (n,).
        s: Points of the path (N,), uniform.
        knots: Knots of the arm's spline (m + 6,).
        limits: The user's limits.
    """

    arm: Arm
    goal: Goal
    base: GivenBase | DrivingBase
    comfort: Array = field(repr=False)
    s: Array = field(repr=False)
    knots: Array = field(repr=False)
    limits: Limits

    def joints(self, z: Array) -> Array:
        """Return the coefficients (m, n) of the arm's spline."""
        return z[self.base.size :].reshape(len(self.comfort), -1).T


def solve(problem: ReachProblem, base: Array, coefficients: Array) -> Array:
    """Return the parameters of base and arm that follow the path best, by Levenberg-Marquardt."""
    z = np.concatenate([base, coefficients.T.ravel()])
    regulariser, preferred = _regularisation(problem)
    inequalities, upper_bounds = _inequalities(problem)
    values = basis(problem.knots)(problem.s)
    for sigma in END_EFFECTOR_SIGMAS:
        damping = 1e-3

        def cost(x: Array, tolerance: float = sigma) -> float:
            beyond = np.maximum(inequalities @ x - upper_bounds, 0.0)
            away = x - preferred
            return float(
                np.mean(_misses(problem, values, x) ** 2) / tolerance**2
                + away @ (regulariser @ away)
                + LIMIT_WEIGHT**2 * beyond @ beyond
            )

        now = cost(z)
        for _ in range(LEVENBERG_STEPS):
            miss, rows = _linearize(problem, values, z)
            weight = 1.0 / (sigma**2 * len(miss))
            hessian = weight * rows.T @ rows + regulariser
            descent = weight * rows.T @ miss - regulariser @ (z - preferred)
            then = math.inf
            while damping < MAX_DAMPING:
                damped = hessian + damping * np.diag(np.diag(hessian) + 1e-9)
                trial = z + _step(damped, descent, inequalities, upper_bounds - inequalities @ z)
                then = cost(trial)
                if then < now:
                    break
                damping *= 10.0
            if then >= now:
                break
            gain, z, now, damping = now - then, trial, then, max(0.1 * damping, 1e-12)
            if gain < COST_TOLERANCE * now:
                break
    return z


def _step(hessian: Array, descent: Array, inequalities: csr_array, room: Array) -> Array:
    """Return the step d of least ½ dᵀ H d − gᵀ d + ½ w² |max(W d − r, 0)|².

    Newton's method on the inequalities that the step itself runs into, with w = LIMIT_WEIGHT.

    Args:
        hessian: H (size, size).
        descent: Negative gradient g (size,).
        inequalities: W (k, size).
        room: r (k,).
    """
    hit = np.flatnonzero(room < 0.0)
    step = np.zeros(len(descent))
    for _ in range(ACTIVE_SET_STEPS):
        active = inequalities[hit]
        stiff = hessian + LIMIT_WEIGHT**2 * (active.T @ active).toarray()
        step = cho_solve(cho_factor(stiff), descent + LIMIT_WEIGHT**2 * (active.T @ room[hit]))
        now = np.flatnonzero(inequalities @ step > room)
        if np.array_equal(now, hit):
            break
        hit = now
    return step


def _misses(problem: ReachProblem, values: Array, z: Array) -> Array:
    """Return the end effector's error at every point (N, 3 or 6), m."""
    poses, _ = problem.base.poses(z[: problem.base.size])
    positions, goal = values @ problem.joints(z), problem.goal
    return np.array(
        [
            goal.error(problem.arm.end_effector_pose(pose, q), s)
            for s, pose, q in zip(problem.s, poses, positions, strict=True)
        ]
    )


def _linearize(problem: ReachProblem, values: Array, z: Array) -> tuple[Array, Array]:
    """Return the errors (N k,), and their derivatives by the parameters (N k, size), negated."""
    poses, jacobian = problem.base.poses(z[: problem.base.size])
    positions, goal = values @ problem.joints(z), problem.goal
    misses, rows = [], []
    for i, s in enumerate(problem.s):
        found, base, joints = problem.arm.jacobian(poses[i], positions[i])
        misses.append(goal.error(found, s))
        whole = np.hstack([base @ jacobian[i], np.kron(joints, values[i])])
        rows.append(error_rows(whole, len(misses[0])))
    return np.concatenate(misses), np.vstack(rows)


def _metres(problem: ReachProblem) -> float:
    """Return metres of the end effector's path a unit of s."""
    return max(problem.goal.length, 0.1) / (problem.s[-1] - problem.s[0])


def _regularisation(problem: ReachProblem) -> tuple[Array, Array]:
    """Return the quadratic cost (size, size) of base and arm, and where it is least (size,)."""
    scale, size = _metres(problem), problem.base.size
    half, s = problem.arm.half_range, problem.s
    functions = basis(problem.knots)
    count = len(functions.c)
    one, two, three = (
        functions.derivative(i)(s) / scale**i if i else functions(s) for i in (0, 1, 2)
    )
    arm = (
        POSTURE_WEIGHT**2 * one.T @ one
        + JOINT_RATE_WEIGHT**2 * two.T @ two
        + JOINT_CHANGE_WEIGHT**2 * three.T @ three
    )
    total = size + count * len(half)
    cost = np.zeros((total, total))
    cost[size:, size:] = np.kron(np.diag(1.0 / half**2), arm / len(s))
    if isinstance(problem.base, DrivingBase):
        roll = one / scale
        change = BASE_CHANGE_WEIGHT**2 * (two / scale).T @ (two / scale)
        for start in range(3, size, count):
            place = slice(start, start + count)
            weight = TURNING_WEIGHT if start + count == size else BASE_SPEED_WEIGHT
            cost[place, place] = (weight**2 * roll.T @ roll + change) / len(s)
    preferred = np.zeros(total)
    preferred[size:] = np.repeat(problem.comfort, count)
    return cost, preferred


def _inequalities(problem: ReachProblem) -> tuple[csr_array, Array]:
    """Return linear inequalities W z ≤ r that keep the limits, each divided by its limit."""
    size, arm = problem.base.size, problem.arm
    functions = basis(problem.knots)
    count = len(functions.c)
    inverse = csr_array(np.diag(1.0 / arm.half_range))
    middle = np.repeat(arm.middle / arm.half_range, count)
    box = hstack([csr_array((len(middle), size)), kron(inverse, eye_array(count))])
    inequalities, upper_bounds = [box, -box], [LIMIT_FRACTION + middle, LIMIT_FRACTION - middle]
    if problem.goal.timed:
        slope = functions.derivative()(problem.s)
        rates = kron(
            csr_array(np.diag(1.0 / (LIMIT_FRACTION * VELOCITY_LIMIT_FRACTION * arm.velocity))),
            csr_array(slope),
        )
        rates = hstack([csr_array((rates.shape[0], size)), rates])
        inequalities += [rates, -rates]
        upper_bounds += [np.ones(rates.shape[0])] * 2
    if isinstance(problem.base, DrivingBase):
        rows, base_bounds = _base_inequalities(problem)
        for row, bound in zip(rows, base_bounds, strict=True):
            part = kron(csr_array(row[None, :]), eye_array(count))
            after = csr_array((count, count * len(arm.joints)))
            inequalities.append(hstack([csr_array((count, 3)), part, after]))
            upper_bounds.append(np.full(count, bound))
    return csr_array(vstack(inequalities)), np.concatenate(upper_bounds)


def _base_inequalities(problem: ReachProblem) -> tuple[list[Array], list[float]]:
    """Return inequalities on the base's free twist; if its coefficients keep them, it does."""
    robot, radius = problem.arm.robot, problem.limits.turning_radius
    columns = [0, 1, 2] if robot.drive.omnidirectional else [0, 2]
    rows: list[Array] = []
    base_bounds: list[float] = []
    if problem.goal.timed:
        for wheel, rate in zip(robot.drive.wheels, wheel_rates(robot), strict=True):
            bound = (
                LIMIT_FRACTION
                * VELOCITY_LIMIT_FRACTION
                * robot.description.joint[wheel.joint].velocity
            )
            rows += [rate[columns] / bound, -rate[columns] / bound]
            base_bounds += [1.0, 1.0]
    if radius > 0.0:
        forward, turn = np.eye(3)[0], np.eye(3)[2] * radius / LIMIT_FRACTION
        slow = forward / (MIN_SPEED_RATIO * _metres(problem))
        rows += [(turn - forward)[columns], (-turn - forward)[columns], -slow[columns]]
        base_bounds += [0.0, 0.0, -1.0]
    return rows, base_bounds
