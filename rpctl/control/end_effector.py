"""Kinematic law that tracks the end effector first: the arm compensates the base's error."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import daqp
import numpy as np
import pinocchio as pin
from scipy.optimize import brentq

from rpctl.arrays import Array
from rpctl.control.horizon.law import Horizon
from rpctl.control.law import Command, KinematicController, KinematicLaw, Preparing, Rest, as_law
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, SolverError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.model import BASE_NV, Robot

MIN_KAPPA = 1e-6  # of κ: small enough for rows to be met, large enough for 1/κ to keep its digits
LOG_KAPPA_TOLERANCE = 1e-12  # of log κ
DAQP_INFINITY = 1e30  # what DAQP takes for no bound
DAQP_OPTIMAL = 1  # DAQP's flag of an optimum
WORLD_ALIGNED = pin.LOCAL_WORLD_ALIGNED  # velocities of the frame's origin, in world axes
MAX_FULL_SPEED = 1.0  # rad/s or m/s; full speed of joints with a higher velocity limit
SPEED_FRACTION = 0.9  # of a velocity limit: largest commanded rate, with room for overshoot


class WithRate(NamedTuple):
    """A quantity and its derivative by time."""

    value: Array
    rate: Array


class Box(NamedTuple):
    """Bounds, with their derivatives."""

    lower: WithRate
    upper: WithRate


class _Problem(NamedTuple):
    G: WithRate  # (m, n)
    y: WithRate  # (m,)
    posture: WithRate  # (n,)
    box: Box


class _Solution(NamedTuple):
    z: Array  # (n,)
    pull: Array  # (m,): what the rows pull with; z = posture + Gᵀ pull where no bound holds
    lower: Array  # (n,) bool: held by the lower bound
    upper: Array  # (n,) bool


def nearest(G: WithRate, y: WithRate, posture: WithRate, box: Box, strongest: float) -> WithRate:
    """Return the z (n,) in a box that has G z = y as nearly as it can, and is near a posture.

    It minimises ½ |z − posture|² + P(|G z − y|) over the box. P has the slope ``strongest``, down
    to next to nothing where it is rounded off. Such a penalty is exact: G z = y is met as long as
    the pull it takes, the multiplier of G z = y, is no longer than ``strongest``. Where it would
    be, near a singular G or in a corner of the box, the pull is ``strongest`` long and z is that of
    damped least squares, P = ½ |G z − y|²/κ with the κ that makes it so. So z never strays from the
    posture by more than ``strongest`` times what it moves.

    The derivative holds the bounds that are active, which is the derivative wherever none of them
    is just being met or left; there it jumps, but z does not.

    Args:
        G: Matrix (m, n).
        y: What G z should be (m,).
        posture: What z should be (n,) as far as G z = y leaves it open.
        box: Bounds of z (n,).

    Raises:
        SolverError: The quadratic program was not solved.
    """
    problem = _Problem(G, y, posture, box)
    kappa = MIN_KAPPA
    solution = _solve(problem, kappa)
    length = float(np.linalg.norm(solution.pull))
    bounded = length > strongest
    if bounded:
        # |pull| falls as κ grows, and κ |pull| = |G z − y| does not: so the root is between.
        kappa = math.exp(
            brentq(
                lambda x: math.log(np.linalg.norm(_solve(problem, math.exp(x)).pull) / strongest),
                math.log(MIN_KAPPA),
                math.log(_farthest(problem) / strongest) + 1.0,
                xtol=LOG_KAPPA_TOLERANCE,
            )
        )
        solution = _solve(problem, kappa)
    return WithRate(solution.z, _rate(problem, solution, kappa, bounded))


def _farthest(problem: _Problem) -> float:
    """Return |G z − y| where nothing pulls."""
    lower, upper = problem.box
    z = np.clip(problem.posture.value, lower.value, upper.value)
    return float(np.linalg.norm(problem.G.value @ z - problem.y.value))


def _solve(problem: _Problem, kappa: float) -> _Solution:
    """Minimise ½ |z − posture|² + ½ |G z − y|²/κ over the box."""
    G, y, posture = (part.value for part in problem[:3])
    lower, upper = (bound.value for bound in problem.box)
    none = np.zeros(len(posture), dtype=bool)
    z, pull = _held(G, y, posture, none, kappa)
    if (z >= lower).all() and (z <= upper).all():
        return _Solution(z, pull, none, none)
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
    return _Solution(np.clip(z, lower, upper), pull, at_lower, at_upper)


def _held(G: Array, y: Array, start: Array, held: Array, kappa: float) -> tuple[Array, Array]:
    """Return the minimum with entries held where they start, and the pull: start + Fᵀ pull.

    F is G without the columns that are held, and (F Fᵀ + κ) pull = y − G start.
    """
    F = np.where(held, 0.0, G)
    pull = np.linalg.solve(F @ F.T + kappa * np.eye(len(y)), y - G @ start)
    return start + F.T @ pull, np.asarray(pull)


def _rate(problem: _Problem, solution: _Solution, kappa: float, bounded: bool) -> Array:
    """Return ż (n,), the active bounds held; where the pull is bounded, so is its length."""
    (G, G_rate), (_, y_rate), posture, (lower, upper) = problem
    pull, held = solution.pull, np.logical_or(solution.lower, solution.upper)
    start, start_rate = (
        np.where(solution.upper, high, np.where(solution.lower, low, middle))
        for low, middle, high in zip(lower, posture, upper, strict=True)
    )
    F, F_rate = np.where(held, 0.0, G), np.where(held, 0.0, G_rate)
    half = F_rate @ F.T
    right = y_rate - G_rate @ start - G @ start_rate - (half + half.T) @ pull
    N = F @ F.T + kappa * np.eye(len(pull))
    pull_rate, along = np.linalg.solve(N, np.column_stack([right, pull])).T
    if bounded:
        pull_rate = pull_rate - along * (pull @ pull_rate) / (pull @ along)  # κ̇ keeps |pull|
    return np.asarray(start_rate + F_rate.T @ pull + F.T @ pull_rate)


class FrameMotion(NamedTuple):
    """A frame's motion in the world: linear, then angular."""

    pose: pin.SE3
    velocity: Array  # (6,) m/s, rad/s
    acceleration: Array  # (6,) m/s² of the origin, rad/s²


def end_effector_frame(robot: Robot) -> int:
    """Return Pinocchio's index of the end effector.

    Raises:
        RpctlError: The robot has none.
    """
    if robot.end_effector is None or not robot.joints:
        raise RpctlError(
            f"{robot.name} has no arm, so no end effector to put first; take a kinematic law of "
            'the base alone, such as "paper"'
        )
    return int(robot.model.getFrameId(robot.end_effector, pin.FrameType.BODY))


def reference_motion(
    dynamics: ReducedDynamics, state: ReferenceState, arm: Array, frame: int
) -> FrameMotion:
    """Return the motion of the end effector of a robot that is on its reference.

    Args:
        frame: Pinocchio's index of the end effector.
    """
    robot = dynamics.robot
    q = robot.configuration_at(state.pose, state.joints)
    v, a = arm @ state.joint_rates, arm @ state.joint_accelerations
    v[:BASE_NV] += robot.root_velocity @ state.twist
    a[:BASE_NV] += robot.root_velocity @ state.twist_dot
    model, data = robot.model, dynamics.placements(q)
    pin.forwardKinematics(model, data, q, v, a)
    return FrameMotion(
        pin.updateFramePlacement(model, data, frame).copy(),
        pin.getFrameVelocity(model, data, frame, WORLD_ALIGNED).vector,
        pin.getFrameClassicalAcceleration(model, data, frame, WORLD_ALIGNED).vector,
    )


def jacobian(
    dynamics: ReducedDynamics, q: Array, v: Array, frame: int
) -> tuple[pin.SE3, Array, Array]:
    """Return a frame's pose, its Jacobian (6, nv) and that one's derivative along a motion.

    Args:
        frame: Pinocchio's index of the frame.
    """
    model, data = dynamics.robot.model, dynamics.placements(q)
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    return (
        pin.updateFramePlacement(model, data, frame).copy(),
        pin.getFrameJacobian(model, data, frame, WORLD_ALIGNED),
        pin.getFrameJacobianTimeVariation(model, data, frame, WORLD_ALIGNED),
    )


def tracking_velocity(
    target: FrameMotion, pose: pin.SE3, velocity: Array, horizon: float
) -> WithRate:
    """Return the velocity (6,) that makes the errors of a frame decay at 1/h, and its derivative.

    The position's is p* = ṗ_r + (p_r − p)/h. With the error e = log(E), E = R_r Rᵀ, of the
    orientation, a rotation vector in the world's axes, Ė = [w]× E for w = ω_r − E ω, and

        ω* = Eᵀ ω_r + e/h

    gives w = −e/h and so ė = −e/h: a rotation vector that only changes its length. At |e| = π it
    turns over; a frame that faces away from its reference may come back either way.

    Args:
        target: Reference motion of the frame.
        pose: Present pose of the frame in the world.
        velocity: Present velocity of the frame (6,), in world axes, m/s and rad/s.
        horizon: Prediction time h, s.
    """
    position_error = target.pose.translation - pose.translation
    position_error_rate = target.velocity[:3] - velocity[:3]
    E = target.pose.rotation @ pose.rotation.T
    omega_r, rotated_omega = target.velocity[3:], E @ velocity[3:]
    rotation_error = pin.log3(E)
    # The inverse left Jacobian is the transpose of the right one.
    rotation_error_rate = pin.Jlog3(E).T @ (omega_r - rotated_omega)
    value = np.concatenate(
        [target.velocity[:3] + position_error / horizon, E.T @ omega_r + rotation_error / horizon]
    )
    linear = target.acceleration[:3] + position_error_rate / horizon
    angular = (
        E.T @ (target.acceleration[3:] + pin.skew(rotated_omega) @ omega_r)
        + rotation_error_rate / horizon
    )
    return WithRate(value, np.concatenate([linear, angular]))


@dataclass(frozen=True)
class EndEffector(Record):
    """A predictive law whose outputs are the base's pose and the end effector's.

    The base follows a law of its own. Given the base's quasi-velocities ν_b of that law, the arm's
    rates q̇ make the end effector's error, predicted to first order over the horizon h, vanish:

        J_arm q̇ + J_base ν_b = p*,    p* = ṗ_r + (p_r − p)/h

    so it decays as exp(−t/h) whatever the base's error does. The reference p_r is where the end
    effector is when base and arm are on theirs, so both outputs agree once the base is there.

    - Redundancy: of all such rates the law takes those nearest, relative to the joints' full
      speeds, to the rates that the base's law gives the arm (q̇_r + (q_r − q)/h, or the horizon
      law's plan).
    - Limits: |q̇| ≤ 0.9 q̇_max, and the posture predicted over the horizon, q + h q̇, stays inside
      the position limits: a joint approaches its limit as exp(−t/h), and never passes it.
    - Singularities and unreachable targets: p* is met as long as the multiplier of that equality is
      at most 1/``damping``; beyond, the rates come as near as a multiplier of that size brings
      them, see :func:`nearest`. Along a direction in which the arm at full speed moves the end
      effector at σ (m/s), they differ from the posture's by at most σ/``damping`` full speeds.

    The base does not wait for the arm: where it leaves p_r out of the arm's reach, the error grows
    until it is back. By default the base's law is the horizon law; any other law will do.

    ν̇_d is the analytic derivative along the actual motion, of the active bounds where there are
    any; it jumps when a bound becomes active, ν_d does not. Of a base whose S changes with q the
    drift Ṡν is that of the actual motion, exact once ν has come to ν_d.
    """

    base: Annotated[
        KinematicLaw,
        Setting("", "Law of the base", "The law of the base; its arm rates are the posture's."),
    ] = field(default_factory=Horizon)
    horizon: Annotated[
        float, POSITIVE, Setting("s", "Horizon h", "Prediction time h of the end effector.")
    ] = 0.4
    orientation: Annotated[
        bool,
        Setting("", "", "Whether its orientation is an output too, or its position only."),
    ] = False
    lever: Annotated[
        float,
        POSITIVE,
        Setting(
            "m",
            "Lever",
            "Length at the end of which an error of orientation counts as one of position.",
        ),
    ] = 0.3
    damping: Annotated[
        float,
        POSITIVE,
        Setting(
            "m/s",
            "Damping",
            "Directions in which the arm at full speed is slower count as singular.",
        ),
    ] = 0.01

    def __post_init__(self) -> None:
        """Refuse what is no law of a base."""
        super().__post_init__()

        if isinstance(self.base, Horizon) and self.base.end_effector_obstacles:
            raise RpctlError(
                "the end effector that comes first would run into end_effector_obstacles; take the "
                "horizon law alone, which keeps clear of them"
            )

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> EndEffectorLaw:
        """Return the controller of one run, and start that of the base.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            rest: State before the run, for the base's law.

        Raises:
            RpctlError: The robot has no arm.
        """
        base = as_law(self.base).start(dynamics, period, rest)
        return EndEffectorLaw(self, base, dynamics.robot)


class EndEffectorLaw:
    """:class:`EndEffector` on one robot.

    Args:
        frame: Pinocchio's index of the end effector.
    """

    def __init__(self, law: EndEffector, base: KinematicController, robot: Robot) -> None:
        self._law, self._base, self._frame = law, base, end_effector_frame(robot)
        self._fastest = np.array([joint.velocity for joint in robot.joints])  # rad/s or m/s
        self._preparing = base if isinstance(base, Preparing) else None

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and its analytic derivative along the actual motion."""
        robot = dynamics.robot
        first = robot.dof - len(robot.joints)
        base = self._base(dynamics, reference, t, q, nu)
        S, full = dynamics.basis(q), np.minimum(self._fastest, MAX_FULL_SPEED)
        G, y = self._task(dynamics, reference(t), q, nu, base)
        G = WithRate(*(part @ (S[:, first:] * full) for part in G))
        z = nearest(
            G,
            y,
            WithRate(*(part[first:] / full for part in base)),
            self._box(robot, q, nu[first:], full),
            1.0 / self._law.damping,
        )
        return Command(
            np.concatenate([base.nu_d[:first], full * z.value]),
            np.concatenate([base.nu_d_dot[:first], full * z.rate]),
        )

    def prepare(self, t: float, q: Array, nu: Array, after: float) -> None:
        """Let the base's controller compute ahead; see :class:`rpctl.control.law.Preparing`.

        Args:
            after: Time until the next sample, s.
        """
        if self._preparing is not None:
            self._preparing.prepare(t, q, nu, after)

    def report(self) -> dict[str, float]:
        """Return the report of the base's controller."""
        return self._base.report()

    def _task(
        self, dynamics: ReducedDynamics, state: ReferenceState, q: Array, nu: Array, base: Command
    ) -> tuple[WithRate, WithRate]:
        """Return the end effector's Jacobian J_arm, and p* less the base's part, J_base ν_b.

        Both have 3 rows, or 6 with the orientation, in m/s.
        """
        law, frame = self._law, self._frame
        first = dynamics.robot.dof - len(dynamics.robot.joints)
        S = dynamics.basis(q)
        v, base_velocity = S @ nu, S[:, :first] @ base.nu_d[:first]
        base_acceleration = S[:, :first] @ base.nu_d_dot[:first] + dynamics.basis_drift(q, nu)
        target = reference_motion(dynamics, state, S[:, first:], frame)
        pose, J, J_dot = jacobian(dynamics, q, v, frame)
        desired = tracking_velocity(target, pose, J @ v, law.horizon)
        arm_velocity = desired.value - J @ base_velocity
        arm_acceleration = desired.rate - J_dot @ base_velocity - J @ base_acceleration
        size = np.repeat([1.0, law.lever], 3)[: 6 if law.orientation else 3]
        rows = slice(len(size))
        return (
            WithRate(size[:, None] * J[rows], size[:, None] * J_dot[rows]),
            WithRate(size * arm_velocity[rows], size * arm_acceleration[rows]),
        )

    def _box(self, robot: Robot, q: Array, rates: Array, full: Array) -> Box:
        """Return the bounds of the arm's rates, divided by ``full``.

        Args:
            rates: Rates of the arm's joints (n_joints,).
            full: Full speeds of the joints (n_joints,).
        """
        fastest, positions = SPEED_FRACTION * self._fastest, robot.joint_positions(q)
        bounds = []
        for limits in zip(*((joint.lower, joint.upper) for joint in robot.joints), strict=True):
            room = (np.array(limits) - positions) / self._law.horizon
            value = np.clip(room, -fastest, fastest)
            rate = np.where(value == room, -rates / self._law.horizon, 0.0)
            bounds.append(WithRate(value / full, rate / full))
        return Box(*bounds)
