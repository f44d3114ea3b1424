"""Kinematic law that tracks the end effector first: the arm compensates the base's error."""

from __future__ import annotations

import math as numbers
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple

import daqp
import numpy as np
import pinocchio as pin
from scipy.optimize import brentq

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.horizon.law import Horizon, HorizonLaw
from rpctl.control.horizon.qp import DAQP_INFINITY, DAQP_OPTIMAL
from rpctl.control.law import Command, KinematicController, KinematicLaw, Rest, as_law
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import RpctlError, SolverError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.kernels.scalars import clipped, column
from rpctl.kernels.sheet import Evaluator
from rpctl.reference.motion import Reference, row_of
from rpctl.robot.model import Robot

MIN_KAPPA = 1e-6  # of κ: small enough for rows to be met, large enough for 1/κ to keep its digits
LOG_KAPPA_TOLERANCE = 1e-12  # of log κ
MAX_FULL_SPEED = 1.0  # rad/s or m/s; full speed of joints with a higher velocity limit
SPEED_FRACTION = 0.9  # of a velocity limit: largest commanded rate, with room for overshoot


class Task(NamedTuple):
    """What the arm's rates z, over its full speeds, should be."""

    G: Any  # (m, n)
    y: Any  # (m,): what G z should be
    posture: Any  # (n,): what z should be as far as G z = y leaves it open
    lower: Any  # (n,) of z
    upper: Any  # (n,)


class Nearest(NamedTuple):
    """What fulfils a :class:`Task` best, and which of its conditions hold it."""

    z: Array  # (n,)
    pull: Array  # (m,): what the rows pull with; z = posture + Gᵀ pull where no bound holds
    at_lower: Array  # (n,) bool: held by the lower bound
    at_upper: Array  # (n,) bool
    kappa: float = MIN_KAPPA
    bounded: bool = False  # whether the pull is as strong as it may be


def nearest(task: Task, strongest: float) -> Nearest:
    """Return the z (n,) in a box that has G z = y as nearly as it can, and is near a posture.

    It minimises ½ |z − posture|² + P(|G z − y|) over the box. P has the slope ``strongest``, down
    to next to nothing where it is rounded off. Such a penalty is exact: G z = y is met as long as
    the pull it takes, the multiplier of G z = y, is no longer than ``strongest``. Where it would
    be, near a singular G or in a corner of the box, the pull is ``strongest`` long and z is that of
    damped least squares, P = ½ |G z − y|²/κ with the κ that makes it so. So z never strays from the
    posture by more than ``strongest`` times what it moves.

    Raises:
        SolverError: The quadratic program was not solved.
    """
    found = _solve(task, MIN_KAPPA)
    if float(np.linalg.norm(found.pull)) <= strongest:
        return found
    farthest = task.G @ np.clip(task.posture, task.lower, task.upper) - task.y
    # |pull| falls as κ grows, and κ |pull| = |G z − y| does not: so the root is between.
    kappa = numbers.exp(
        brentq(
            lambda x: numbers.log(np.linalg.norm(_solve(task, numbers.exp(x)).pull) / strongest),
            numbers.log(MIN_KAPPA),
            numbers.log(np.linalg.norm(farthest) / strongest) + 1.0,
            xtol=LOG_KAPPA_TOLERANCE,
        )
    )
    return _solve(task, kappa)._replace(kappa=kappa, bounded=True)


def _solve(task: Task, kappa: float) -> Nearest:
    """Minimise ½ |z − posture|² + ½ |G z − y|²/κ over the box."""
    G, y, posture, lower, upper = task
    none = np.zeros(len(posture), dtype=bool)
    z, pull = _held(G, y, posture, none, kappa)
    if (z >= lower).all() and (z <= upper).all():
        return Nearest(z, pull, none, none)
    _, _, flag, info = daqp.solve(
        np.eye(len(z)) + G.T @ G / kappa,
        G.T @ (G @ posture - y) / kappa,
        np.empty((0, len(z))),
        np.clip(upper - posture, -DAQP_INFINITY, DAQP_INFINITY),
        np.clip(lower - posture, -DAQP_INFINITY, DAQP_INFINITY),
        np.zeros(len(z), dtype=np.intc),
    )
    if flag != DAQP_OPTIMAL:
        raise SolverError(
            f"no rates of the arm were found (DAQP ended with flag {flag}); shorten the control "
            "period or lengthen the horizons"
        )
    at_lower, at_upper = info["lam"] < 0.0, info["lam"] > 0.0
    start = np.where(at_upper, upper, np.where(at_lower, lower, posture))
    z, pull = _held(G, y, start, np.logical_or(at_lower, at_upper), kappa)
    return Nearest(np.clip(z, lower, upper), pull, at_lower, at_upper)


def _held(G: Array, y: Array, start: Array, held: Array, kappa: float) -> tuple[Array, Array]:
    """Return the minimum with entries held where they start, and the pull: start + Fᵀ pull.

    F is G without the columns that are held, and (F Fᵀ + κ) pull = y − G start.
    """
    F = np.where(held, 0.0, G)
    pull = np.linalg.solve(F @ F.T + kappa * np.eye(len(y)), y - G @ start)
    return start + F.T @ pull, np.asarray(pull)


def nearest_rate(task: Task, moving: Any, rates: Any) -> tuple[list[Any], Any]:
    """Return the symbols of what holds z, and ż (n, 1) in scalars.

    The active bounds are held, which is the derivative wherever none of them is just being met or
    left; there it jumps, but z does not. A pull that is bounded keeps its length, by κ's rate.

    Args:
        task: The task in scalars.
        moving: The symbols that change (k, 1).
        rates: Their rates (k, 1).

    Returns:
        Symbols of :class:`Nearest`'s ``at_lower``, ``at_upper``, ``kappa`` and ``bounded``; ż.
    """
    m, n = task.G.shape
    at_lower, at_upper = math.SX.sym("at_lower", n), math.SX.sym("at_upper", n)
    kappa, bounded = math.SX.sym("kappa"), math.SX.sym("bounded")
    start = math.if_else(at_upper, task.upper, math.if_else(at_lower, task.lower, task.posture))
    F = task.G @ math.diag(1.0 - at_lower - at_upper)
    pull = math.solve(F @ F.T + kappa * math.SX.eye(m), task.y - task.G @ start)
    z = start + F.T @ pull
    change, easing = math.jtimes(pull, moving, rates), math.jacobian(pull, kappa)
    slack = -math.dot(pull, change) / math.dot(pull, easing)
    held = math.if_else(bounded, slack, 0.0)
    rate = math.jtimes(z, moving, rates) + math.jacobian(z, kappa) * held
    return [at_lower, at_upper, kappa, bounded], rate


def end_effector_link(robot: Robot) -> str:
    """Return the end effector's link.

    Raises:
        RpctlError: The robot has none.
    """
    if robot.end_effector is None or not robot.joints:
        raise RpctlError(
            f"{robot.name} has no arm, so no end effector; take a kinematic law of the base "
            'alone, such as "paper"'
        )
    return robot.end_effector


class FrameMotion(NamedTuple):
    """A frame in the world, in scalars."""

    R: Any  # (3, 3)
    p: Any  # (3, 1) m
    velocity: Any  # (6, 1) of the origin, m/s, then angular, rad/s; world axes


def _moving(R: Any, p: Any, symbols: Any, rates: Any) -> FrameMotion:
    """Return a frame that moves with some symbols (k, 1), at their rates (k, 1)."""
    turning = math.reshape(math.jtimes(math.vec(R), symbols, rates), 3, 3) @ R.T
    angular = math.vertcat(turning[2, 1], turning[0, 2], turning[1, 0])
    return FrameMotion(R, p, math.vertcat(math.jtimes(p, symbols, rates), angular))


class EndEffectorFormulas:
    """The law's formulas on one robot, each for all of a sample's numbers.

    The velocity of the end effector that makes its position's error decay at 1/h is
    p* = ṗ_r + (p_r − p)/h. With the error e = log(E), E = R_r Rᵀ, of the orientation, a rotation
    vector in the world's axes, Ė = [w]× E for w = ω_r − E ω, and

        ω* = Eᵀ ω_r + e/h

    gives w = −e/h and so ė = −e/h: a rotation vector that only changes its length. At |e| = π it
    turns over; a frame that faces away from its reference may come back either way.

    Attributes:
        orientations: From q, and the reference, to E (9,).
        task: From a sample to :class:`Task`.
        rate: From a sample and what holds z to ż.
        full: Full speeds of the arm's joints (n_joints,), rad/s or m/s.
    """

    def __init__(self, law: EndEffector, robot: Robot) -> None:
        n, dof, SX = len(robot.joints), robot.dof, math.SX
        q, nu, row = SX.sym("q", robot.nq), SX.sym("nu", dof), SX.sym("reference", 9 + 3 * n)
        nu_d, nu_d_dot = SX.sym("nu_d", dof), SX.sym("nu_d_dot", dof)
        e, turned = SX.sym("e", 3), SX.sym("turned", 3, 3)
        sample, link = [q, nu, row, nu_d, nu_d_dot, e, turned], end_effector_link(robot)
        ends = [0, 3, 6, 9, *(9 + k * n for k in (1, 2, 3))]
        pose, twist, twist_dot, joints, rates, accelerations = math.vertsplit(row, ends)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        x, y = cos * twist[0] - sin * twist[1], sin * twist[0] + cos * twist[1]
        driven, symbols = math.vertcat(x, y, twist[2]), SymbolicDynamics(robot)
        named = dict(zip(robot.joint_names, math.vertsplit(joints), strict=True))
        there = symbols.placement(symbols.configuration(pose, named), link)
        target = _moving(*there, math.vertcat(pose, joints), math.vertcat(driven, rates))
        q_dot = symbols.configuration_rate(q, symbols.basis(q) @ nu)
        tip = _moving(*symbols.placement(q, link), q, q_dot)
        E = target.R @ tip.R.T
        linear = target.velocity[:3] + (target.p - tip.p) / law.horizon
        desired = math.vertcat(linear, E.T @ target.velocity[3:] + e / law.horizon)
        J = math.jacobian(tip.velocity, nu)
        task = _task(law, robot, J, desired, nu_d, symbols.joint_positions(q))
        moving = math.vertcat(q, pose, joints, twist, rates, nu_d, e)
        e_dot = turned @ (target.velocity[3:] - E @ tip.velocity[3:])
        changes = math.vertcat(q_dot, driven, rates, twist_dot, accelerations, nu_d_dot, e_dot)
        held, rate = nearest_rate(task, moving, changes)
        parts = [math.densify(part) for part in task]
        self.task = Evaluator(math.Function("task", sample, math.cse(parts)))
        self.rate = Evaluator(math.Function("rate", [*sample, *held], math.cse([rate])))
        self.orientations = Evaluator(math.Function("E", [q, row], [math.densify(E)]))
        self.full = _full_speeds(robot)


def _full_speeds(robot: Robot) -> Array:
    """Return the speeds (n_joints,) that count as full, rad/s or m/s."""
    return np.array([min(joint.velocity, MAX_FULL_SPEED) for joint in robot.joints])


def _task(law: EndEffector, robot: Robot, J: Any, desired: Any, nu_d: Any, positions: Any) -> Task:
    """Return the task in scalars.

    Args:
        J: Jacobian of the end effector (6, dof).
        desired: Its desired velocity (6, 1).
        nu_d: Quasi-velocities that the base's law asks for (dof, 1).
        positions: Of the arm's joints (n_joints, 1).
    """
    first, count = robot.dof - len(robot.joints), 6 if law.orientation else 3
    fastest = np.array([joint.velocity for joint in robot.joints])  # rad/s or m/s
    full = _full_speeds(robot)
    size = math.DM(np.repeat([1.0, law.lever], 3)[:count])
    velocity = size * (desired - J[:, :first] @ nu_d[:first])[:count]
    bounds = []
    for limits in zip(*((joint.lower, joint.upper) for joint in robot.joints), strict=True):
        room = [(limit - positions[k]) / law.horizon for k, limit in enumerate(limits)]
        largest = (SPEED_FRACTION * fastest).tolist()
        inside = (clipped(x, -v, v) for x, v in zip(room, largest, strict=True))
        bounds.append(column(inside) / math.DM(full))
    G = math.diag(size) @ J[:count, first:] @ math.diag(math.DM(full))
    return Task(G, velocity, nu_d[first:] / math.DM(full), *bounds)


class EndEffectorLaw:
    """:class:`EndEffector` on one robot."""

    def __init__(self, law: EndEffector, base: KinematicController, robot: Robot) -> None:
        self._law, self._base, self._formulas = law, base, EndEffectorFormulas(law, robot)

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and its analytic derivative along the actual motion."""
        robot, formulas = dynamics.robot, self._formulas
        dynamics.basis(q)  # refuses singular steering
        n, base = len(robot.joints), self._base(dynamics, reference, t, q, nu)
        row = row_of(reference(t))[: 9 + 3 * n]
        error, turned = np.zeros(3), np.zeros((3, 3))
        if self._law.orientation:
            E = formulas.orientations(q, row)[0].reshape(3, 3).T
            error, turned = pin.log3(E), pin.Jlog3(E)  # ė = Jᵀ (ω_r − E ω), column by column
        sample = q, nu, row, *base, error, turned.ravel()
        G, *rest = formulas.task(*sample)
        found = nearest(Task(G.reshape(n, -1).T, *rest), 1.0 / self._law.damping)
        held = found.at_lower, found.at_upper, found.kappa, found.bounded
        (rate,) = formulas.rate(*sample, *held)
        nu_d, nu_d_dot, full = base.nu_d.copy(), base.nu_d_dot.copy(), formulas.full
        nu_d[-n:], nu_d_dot[-n:] = full * found.z, full * rate
        return Command(nu_d, nu_d_dot)

    def report(self) -> dict[str, float]:
        """Return the report of the base's controller."""
        return self._base.report()

    def notes(self) -> tuple[str, ...]:
        """Return the sentences of the base's controller."""
        return self._base.notes() if isinstance(self._base, HorizonLaw) else ()


@dataclass(frozen=True, kw_only=True)
class EndEffector(Record):
    """A predictive law that tracks the poses of the base and of the end effector.

    The base follows a law of its own. Given its quasi-velocities ν_b, the arm's rates q̇ make the
    end effector's error vanish, predicted to first order over the horizon h:

        J_arm q̇ + J_base ν_b = p*,    p* = ṗ_r + (p_r − p)/h

    so this error decays as exp(−t/h) for any error of the base. The reference p_r is the pose of
    the end effector with base and arm on their references, so both outputs agree once the base has
    reached its reference.

    - Redundancy: of all such rates the law takes those nearest, relative to the joints' velocity
      limits, to the arm rates of the base's law (q̇_r + (q_r − q)/h, or the horizon law's plan).
    - Limits: |q̇| ≤ 0.9 q̇_max, and the predicted posture q + h q̇ stays within the position limits:
      a joint approaches its limit as exp(−t/h) and never exceeds it.
    - Singularities and unreachable targets: the equality holds as long as its multiplier is at most
      1/``damping``; otherwise the multiplier is limited to that, see :func:`nearest`. In a
      direction in which the arm at full speed moves the end effector at σ (m/s), the rates differ
      from those of the base's law by at most σ/``damping`` full speeds.

    The base does not wait for the arm: while p_r is out of the arm's reach, the error grows. By
    default the base's law is the horizon law; any other kinematic law is possible.

    ν̇_d is the analytic derivative along the actual motion, with the active bounds taken into
    account; it jumps when a bound becomes active, ν_d does not.
    """

    base: Annotated[
        KinematicLaw,
        Setting("", "Law of the base", "The law of the base; its arm rates set the posture."),
    ] = field(default_factory=Horizon)
    horizon: Annotated[
        float, POSITIVE, Setting("s", "Horizon h", "Prediction time h of the end effector.")
    ] = 0.4
    orientation: Annotated[
        bool,
        Setting("", "", "Whether to track its orientation too, or its position only."),
    ] = False
    lever: Annotated[
        float,
        POSITIVE,
        Setting(
            "m",
            "Lever",
            "Length that converts an error of orientation to one of position.",
        ),
    ] = 0.3
    damping: Annotated[
        float,
        POSITIVE,
        Setting(
            "m/s",
            "Damping",
            "Directions in which the arm's largest speed is lower count as singular.",
        ),
    ] = 0.01

    def __post_init__(self) -> None:
        """Refuse what is no law of a base."""
        super().__post_init__()

        if isinstance(self.base, Horizon) and self.base.end_effector_obstacles:
            raise RpctlError(
                "the end-effector law does not avoid end_effector_obstacles; take the horizon "
                "law alone, which does"
            )

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> EndEffectorLaw:
        """Return the controller of one run, which contains that of the base.

        Args:
            dynamics: The dynamics of the controller's model.
            period: Control period, s.
            rest: State before the run, for the base's law.

        Raises:
            RpctlError: The robot has no arm.
        """
        base = as_law(self.base).start(dynamics, period, rest)
        return EndEffectorLaw(self, base, dynamics.robot)
