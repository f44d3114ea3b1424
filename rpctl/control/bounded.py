"""The dynamic predictive law within limits: [MS21, Eq. 25] as a quadratic program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import daqp
import numpy as np
from scipy.linalg import null_space

from rpctl.arrays import Array
from rpctl.control.dynamic import by_velocity, joint_gains, midpoint
from rpctl.control.joint_limits import JointBounds, JointLimits
from rpctl.control.law import Command, Efforts, Limit, ReportsNothing, Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SolverError, UnknownNameError
from rpctl.files.records import POSITIVE, Record, Setting

COMPLIANCE = 1e-4  # of x: the square that breaking a soft bound by one is worth; well conditioned
PRIMAL_TOLERANCE = 1e-9  # of a bound; the solver's own 1e-6 would show in a log
DAQP_OPTIMAL = 1
# Default weight of a joint's error relative to the base's 1: a joint at its limit must not make the
# base drift.
JOINT_ERROR_WEIGHT = 1e-4
NULLSPACE_EFFORT_WEIGHT = 1e-6  # weight of efforts that move nothing, relative to their limits
REST_SPEED_FRACTION = 1e-3  # of the full speed; a slower base has no direction to keep
ROUNDING = 1e-12  # N·m or N per unit of acceleration, or a rate per unit of ν: rounding


class Solution(NamedTuple):
    """A minimiser, and how hard each row pulls it: negative multipliers belong to lower bounds."""

    x: Array  # (n,)
    hard: Array  # (hard rows,)
    soft: Array  # (soft rows,)


def shortest(
    hard: Array, hard_bounds: tuple[Array, Array], soft: Array, soft_bounds: tuple[Array, Array]
) -> Solution:
    """Return the x of least ½|x|² + ½|s|²/COMPLIANCE with s by how much soft bounds are broken.

    Args:
        hard: Rows (m, n) whose values must stay within ``hard_bounds``.
        hard_bounds: Lower and upper bounds (m,); infinite ones bind nothing.
        soft: Rows (k, n) whose values should stay within ``soft_bounds``.
        soft_bounds: Lower and upper bounds (k,).

    Raises:
        SolverError: The solver failed; the hard bounds may contradict each other.
    """
    n, m, k = hard.shape[1], len(hard), len(soft)
    rows = np.zeros((m + k, n + k))
    rows[:m, :n], rows[m:, :n] = hard, soft
    rows[m:, n:] = np.sqrt(COMPLIANCE) * np.eye(k)
    lower, upper = (np.concatenate(pair) for pair in zip(hard_bounds, soft_bounds, strict=True))
    x, _, flag, info = daqp.solve(
        np.eye(n + k),
        np.zeros(n + k),
        rows,
        upper,
        lower,
        np.zeros(m + k, dtype=np.int32),
        primal_tol=PRIMAL_TOLERANCE,
    )
    if flag != DAQP_OPTIMAL:
        raise SolverError(
            f"DAQP ended with status {flag} on a quadratic program of {n} unknowns, {m} hard and "
            f"{k} soft bounds"
        )
    return Solution(np.asarray(x)[:n], info["lam"][:m], info["lam"][m:])


@dataclass(frozen=True)
class BoundedDynamic(Record):
    """The predictive law of [MS21, Eq. 21-26] within the limits of the URDF.

    It minimises the paper's own cost over the box of effort limits,

        J = ½ pᵀ W′ p,    p = ε + h1 ε̇,    |τ| ≤ τ_max,

    and within the bounds of :class:`JointLimits`, which keep joint rates and positions. While no
    limit binds, the minimum is zero and the law is the paper's. Efforts never leave their box;
    bounds on rates and positions that the efforts cannot keep are broken by the least possible.

    The weights matter only when a limit is active. They apply to p divided by full speed, the speed
    at which the first actuator reaches its velocity limit. Joints have w′ᵢ; the base has

        W′ = √w′ (I − c d dᵀ)² √w′,    c = 1 − √along,

    with d the direction of ν_d + h1 ν̇_d, divided by full speed as well: an error along the desired
    motion is cheaper than one across it. So a robot whose wheels have reached a limit slows down, v
    and ω in proportion, and keeps the curvature. By default the base comes before the joints: a
    joint that its actuator cannot hold does not make the robot drive off under it.

    Efforts are held for a period, so M and h are those of its middle, see
    :func:`~rpctl.control.dynamic.midpoint`.
    """

    horizon_dyn: Annotated[
        float, POSITIVE, Setting("s", "Horizon h₁", "Prediction time h1 of the base.")
    ] = 0.15
    along: Annotated[
        float,
        POSITIVE,
        Setting("", "", "Weight of the base's error along its motion, where one across weighs 1."),
    ] = 1e-2
    weights: Annotated[
        Mapping[str, float],
        POSITIVE,
        Setting(
            "",
            "",
            "w′ by name of the quasi-velocity; 1 for the base's and 1e-4 for joints' if not given.",
        ),
    ] = field(default_factory=dict)
    joint_horizon_dyn: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Joints' horizon h₁",
            "Prediction time of the arm's joints; of each what its bandwidth allows if not given.",
        ),
    ] = None
    midpoint: Annotated[
        bool,
        Setting(
            "",
            "M, h of the period's middle",
            "Whether M and h are those of the middle of the period, or those of the sample.",
        ),
    ] = True

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> BoundedLaw:
        """Return the controller of one run.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            rest: Not used.

        Raises:
            UnknownNameError: A weight is of no quasi-velocity of the robot.
        """
        return BoundedLaw(self, dynamics, period)


class _Sample(NamedTuple):
    """Terms of the QP at one sample; M, h and B are those of the middle of the period."""

    B: Array  # (dof, n_act)
    tau: Array  # (n_act,) of ν̇*
    gain: Array  # (n_act, dof): how τ changes with ν̇
    rows: Array  # (k, dof): ẍ of the limited joints by ν̇
    acceleration: Array  # (k,): ẍ under ν̇*
    bounds: JointBounds  # on ẍ


class BoundedLaw(ReportsNothing):
    """:class:`BoundedDynamic` on one robot at one control period.

    Args:
        period: Control period, s.
    """

    def __init__(self, law: BoundedDynamic, dynamics: ReducedDynamics, period: float) -> None:
        robot = dynamics.robot
        for name in law.weights:
            if name not in robot.quasi_velocities:
                raise UnknownNameError("quasi-velocity", name, robot.quasi_velocities)
        self._law = law
        joints = (
            joint_gains(dynamics, period).horizon_dyn
            if law.joint_horizon_dyn is None
            else np.full(len(robot.joints), law.joint_horizon_dyn)
        )
        self.times = by_velocity(dynamics, law.horizon_dyn, joints)
        self.held_for = period if law.midpoint else 0.0
        self.effort_limits = robot.effort_limits
        self._unit = np.where(np.isfinite(self.effort_limits), self.effort_limits, 1.0)
        self._effort_labels = tuple(Limit(name, "effort") for name in robot.actuators)
        self.joints = JointLimits(dynamics, period, law.horizon_dyn)
        self._base = len(robot.drive.base_speeds)
        fastest = robot.velocity_limits
        self.fastest = np.where(np.isfinite(fastest), fastest, 1.0)
        default = dict.fromkeys(robot.drive.base_speeds, 1.0)
        weights = [
            law.weights.get(name, default.get(name, JOINT_ERROR_WEIGHT))
            for name in robot.quasi_velocities
        ]
        self.root_weights = np.sqrt(weights)

    def __call__(
        self,
        dynamics: ReducedDynamics,
        q: Array,
        nu: Array,
        command: Command,
        disturbance: Array | float = 0.0,
    ) -> Efforts:
        """Return τ (n_act,) and the limits that bind.

        Args:
            disturbance: Acceleration ν̇ (dof,) of the robot in addition to that of ``dynamics``.
        """
        sample = self._sample(dynamics, q, nu, command, disturbance)
        free = (
            (np.abs(sample.tau) <= self.effort_limits).all()
            and (sample.acceleration >= sample.bounds.lower).all()
            and (sample.acceleration <= sample.bounds.upper).all()
        )
        if free:
            return Efforts(sample.tau)
        return self._solve_within_limits(sample, self._cost_factor(sample.B, command))

    def desired_acceleration(self, nu: Array, command: Command) -> Array:
        """Return ν̇* (dof,)."""
        return np.asarray(command.nu_d_dot - (nu - command.nu_d) / self.times)

    def _sample(
        self,
        dynamics: ReducedDynamics,
        q: Array,
        nu: Array,
        command: Command,
        disturbance: Array | float,
    ) -> _Sample:
        nu_dot = self.desired_acceleration(nu, command)
        rows, drift = self.joints.rows(dynamics, q, nu)
        middle = midpoint(dynamics, q, nu, command, self.held_for)
        force = dynamics.inverse(middle.q, middle.nu, nu_dot - disturbance, middle.nu_d)
        tau = np.asarray(dynamics.efforts(middle.q, force))
        gain = np.asarray(dynamics.efforts(middle.q, dynamics.inertia(middle.q)))
        bounds = self.joints.bounds(
            q, rows @ nu, self._max_accelerations(tau - gain @ nu_dot, gain, rows)
        )
        B = dynamics.actuation(middle.q)
        return _Sample(B, tau, gain, rows, rows @ nu_dot + drift, bounds)

    def _max_accelerations(
        self, holding_efforts: Array, gain: Array, rows: Array
    ) -> tuple[Array, Array]:
        """Return the largest accelerations (k,) of each joint alone, down and up.

        The accelerations of the other joints are zero, and every actuator stays within its limit.

        Args:
            holding_efforts: Efforts at zero acceleration (n_act,).
            gain: Derivative of the efforts by ν̇ (n_act, dof).
        """
        cost = gain @ (rows.T / np.maximum(np.square(rows).sum(axis=1), ROUNDING))  # (n_act, k)
        size = np.maximum(np.abs(cost), ROUNDING)
        # What is rounding has no sign: an actuator that the joint does not need holds nothing back.
        pull = np.sign(np.where(size > ROUNDING, cost, 0.0)) * holding_efforts[:, None]
        box = self.effort_limits[:, None]
        return ((box + pull) / size).min(axis=0), ((box - pull) / size).min(axis=0)

    def _cost_factor(self, B: Array, command: Command) -> Array:
        """Return T (dof, dof) with p = T y and J = ½ |y|²: W′ = T⁻ᵀ T⁻¹."""
        full = 1.0 / np.abs(B / self.fastest).max(axis=1)  # speed of the first velocity limit
        T = np.diag(full / self.root_weights)
        base = slice(self._base)
        ahead = (command.nu_d + self._law.horizon_dyn * command.nu_d_dot)[base] / full[base]
        d = ahead / np.hypot(np.linalg.norm(ahead), REST_SPEED_FRACTION)
        c = 1.0 - np.sqrt(self._law.along)
        T[base, base] @= np.eye(len(d)) + c / (1.0 - c * (d @ d)) * np.outer(d, d)
        return T

    def _solve_within_limits(self, sample: _Sample, T: Array) -> Efforts:
        """Return the efforts of least cost within all bounds.

        The unknowns are y with p = T y, and the efforts that move nothing. The violation of a
        joint's bound is the base's h1 times an acceleration, divided by the joint's full speed.

        Args:
            T: Factor of the cost (dof, dof).
        """
        B, box, unit, h1 = sample.B, self.effort_limits, self._unit, self._law.horizon_dyn
        nullspace = (
            null_space(B * unit) / np.sqrt(NULLSPACE_EFFORT_WEIGHT)
            if B.shape[0] < B.shape[1]
            else B[:, :0]
        )
        change = T / self.times[:, None]  # of ν̇ by y: p is h1 times it
        efforts = np.hstack([sample.gain @ change / unit[:, None], nullspace])  # over the limits
        full = self.joints.full
        joints = h1 * sample.rows @ change / full[:, None]
        joints = np.hstack([joints, np.zeros((len(joints), nullspace.shape[1]))])
        bounds, now = sample.bounds, sample.acceleration
        solution = shortest(
            efforts,
            ((-box - sample.tau) / unit, (box - sample.tau) / unit),
            joints,
            (h1 * (bounds.lower - now) / full, h1 * (bounds.upper - now) / full),
        )
        tau = np.clip(sample.tau + unit * (efforts @ solution.x), -box, box)
        return Efforts(tau, self._binding(solution.hard, solution.soft, bounds))

    def _binding(self, efforts: Array, joints: Array, bounds: JointBounds) -> tuple[Limit, ...]:
        names = [self._effort_labels[i] for i in np.flatnonzero(efforts)]
        names += [
            self.joints.limit(i, bounds, bool(pull > 0.0)) for i, pull in enumerate(joints) if pull
        ]
        return tuple(names)
