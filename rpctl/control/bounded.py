"""The dynamic predictive law within limits: [MS21, Eq. 25] as a quadratic program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from rpctl.control.joint_limits import JointBounds, JointLimits
from rpctl.control.kinematic import Command
from rpctl.control.law import Efforts, Limit
from rpctl.control.least_distance import shortest
from rpctl.description.records import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import UnknownNameError, require_positive

IDLE = 1e-6  # weight of efforts that move nothing, against 1 of a predicted error of 1 m/s
AT_REST = 1e-3  # m/s; a slower base has no direction to keep
PULLS = 1e-9  # a multiplier beyond it is of a limit that binds, one below of rounding
MOVES_NOTHING = 1e-12  # N·m or N per unit of acceleration; such an actuator has no say


@dataclass(frozen=True)
class BoundedDynamic:
    """The predictive law of [MS21, Eq. 21-26] within the limits of the URDF.

    It minimises the paper's own cost over the box of effort limits,

        J = ½ pᵀ W′ p,    p = ε + h1 ε̇,    |τ| ≤ τ_max,

    and within the bounds of :class:`JointLimits`, which keep joint rates and positions. While no
    limit binds, the minimum is zero and the law is the paper's. Efforts never leave their box;
    bounds on rates and positions that the efforts cannot keep are broken by the least possible.

    W′ is diagonal for the joints. For the base, p_b is taken in speeds of the wheels' contact
    points, and with d the direction of ν_d + h1 ν̇_d in the same speeds, W′_b is
    I − (1 − along) d dᵀ: an error along the motion asked for is cheaper than one across it. A robot
    whose wheels have come to a limit so slows down, v and ω in proportion, and keeps the curvature.

    Attributes:
        horizon_dyn: Prediction time h1, s.
        along: Weight of the base's error along its motion, where one across weighs 1.
        weights: w′ of quasi-velocities by name; 1 for those left out.
    """

    horizon_dyn: float = 0.15
    along: float = 1e-2
    weights: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse settings that leave the minimum open."""
        require_positive("horizon_dyn", self.horizon_dyn)
        require_positive("along", self.along)
        for name, weight in self.weights.items():
            require_positive(f"the weight of {name}", weight)

    def start(self, dynamics: ReducedDynamics, control_period: float) -> BoundedLaw:
        """Return the law of one run.

        Raises:
            UnknownNameError: A weight is of no quasi-velocity of the robot.
        """
        return BoundedLaw(self, dynamics, control_period)


class _Sample(NamedTuple):
    """What is asked for at one time, and what stands against it."""

    tau: Array  # (n_act,) that ν̇* takes
    gain: Array  # (n_act, dof): how τ changes with ν̇
    rows: Array  # (k, dof): ẍ of the limited joints by ν̇
    acceleration: Array  # (k,): ẍ under ν̇*
    bounds: JointBounds  # on ẍ


class BoundedLaw:
    """:class:`BoundedDynamic` on one robot at one control period.

    Args:
        law: Its settings.
        dynamics: The robot's dynamics.
        control_period: s.
    """

    def __init__(
        self, law: BoundedDynamic, dynamics: ReducedDynamics, control_period: float
    ) -> None:
        robot = dynamics.robot
        for name in law.weights:
            if name not in robot.quasi_velocities:
                raise UnknownNameError("quasi-velocity", name, robot.quasi_velocities)
        self._law = law
        self._box = robot.effort_limits
        self._unit = np.where(np.isfinite(self._box), self._box, 1.0)
        self._effort_limits = tuple(Limit(name, "effort") for name in robot.actuators)
        self._joints = JointLimits(dynamics, control_period, law.horizon_dyn)
        self._base = len(robot.drive.base_speeds)
        self._wheels = len(robot.drive.wheels)
        weights = np.array([law.weights.get(name, 1.0) for name in robot.quasi_velocities])
        self._root_weights = np.sqrt(weights)

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        """Return τ (n_act,) and the limits that bind."""
        return self.efforts(dynamics, q, nu, command, np.zeros_like(nu))

    def wanted(self, nu: Array, command: Command) -> Array:
        """Return ν̇* (dof,)."""
        return np.asarray(command.nu_d_dot - (nu - command.nu_d) / self._law.horizon_dyn)

    def efforts(
        self,
        dynamics: ReducedDynamics,
        q: Array,
        nu: Array,
        command: Command,
        disturbance: Array,
    ) -> Efforts:
        """Return τ (n_act,) and the limits that bind, for a robot that a disturbance accelerates.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            command: What to follow.
            disturbance: What ν̇ (dof,) is beyond that of ``dynamics``.
        """
        sample = self._sample(dynamics, q, nu, self.wanted(nu, command), disturbance)
        free = (
            (np.abs(sample.tau) <= self._box).all()
            and (sample.acceleration >= sample.bounds.lower).all()
            and (sample.acceleration <= sample.bounds.upper).all()
        )
        if free:
            return Efforts(sample.tau)
        B = dynamics.actuation(q)
        return self._within(sample, B, self._spread(B, command))

    def _sample(
        self, dynamics: ReducedDynamics, q: Array, nu: Array, nu_dot: Array, disturbance: Array
    ) -> _Sample:
        tau = np.asarray(dynamics.efforts(q, dynamics.inverse(q, nu, nu_dot - disturbance)))
        gain = np.asarray(dynamics.efforts(q, dynamics.inertia(q)))
        rows, drift = self._joints.rows(dynamics, q, nu)
        bounds = self._joints.bounds(q, rows @ nu, self._brakes(tau - gain @ nu_dot, gain, rows))
        return _Sample(tau, gain, rows, rows @ nu_dot + drift, bounds)

    def _brakes(self, hold: Array, gain: Array, rows: Array) -> tuple[Array, Array]:
        """Return the largest accelerations (k,) of each joint alone, down and up.

        The other quasi-velocities keep theirs at zero, and every actuator within its limit.
        """
        cost = gain @ (rows.T / np.square(rows).sum(axis=1))  # (n_act, k)
        size = np.maximum(np.abs(cost), MOVES_NOTHING)
        pull = np.sign(cost) * hold[:, None]
        box = self._box[:, None]
        return ((box + pull) / size).min(axis=0), ((box - pull) / size).min(axis=0)

    def _spread(self, B: Array, command: Command) -> Array:
        """Return T (dof, dof) with p = T y and J = ½ |y|²: W′ = T⁻ᵀ T⁻¹."""
        T = np.diag(1.0 / self._root_weights)
        if self._base:
            base = slice(self._base)
            speeds = np.linalg.norm(B[base, : self._wheels], axis=1)  # of the wheels, per unit of ν
            speeds = np.where(speeds > 0.0, speeds / speeds.max(), 1.0)
            ahead = speeds * (command.nu_d + self._law.horizon_dyn * command.nu_d_dot)[base]
            d = ahead / np.hypot(np.linalg.norm(ahead), AT_REST)
            cut = 1.0 - np.sqrt(self._law.along)
            stretch = np.eye(self._base) + cut / (1.0 - cut * (d @ d)) * np.outer(d, d)
            T[base, base] = stretch / speeds[:, None] @ T[base, base]
        return T

    def _within(self, sample: _Sample, B: Array, T: Array) -> Efforts:
        """Return the efforts of least cost within all bounds.

        The unknowns are y, the errors spread out by T, and the efforts that move nothing.
        """
        box, unit = self._box, self._unit
        by_y = sample.gain @ T / (self._law.horizon_dyn * unit[:, None])
        idle = null_space(B * unit) / np.sqrt(IDLE)
        by_x = np.hstack([by_y, idle])  # (n_act, dof + n_idle): τ in units of its limits
        joints = np.hstack([sample.rows @ T, np.zeros((len(sample.rows), idle.shape[1]))])
        room = self._law.horizon_dyn * (np.array(sample.bounds[:2]) - sample.acceleration)
        solution = shortest(
            by_x,
            ((-box - sample.tau) / unit, (box - sample.tau) / unit),
            joints,
            (room[0], room[1]),
        )
        tau = np.clip(sample.tau + unit * (by_x @ solution.x), -box, box)
        return Efforts(tau, self._binding(solution.hard, solution.soft, sample.bounds))

    def _binding(self, efforts: Array, joints: Array, bounds: JointBounds) -> tuple[Limit, ...]:
        names = [self._effort_limits[i] for i in np.flatnonzero(np.abs(efforts) > PULLS)]
        names += [bounds.upper_limits[i] for i in np.flatnonzero(joints > PULLS)]
        names += [bounds.lower_limits[i] for i in np.flatnonzero(joints < -PULLS)]
        return tuple(names)
