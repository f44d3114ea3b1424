"""Kinematic law that tracks the end effector first: the arm compensates the base's error."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.control.box_least_squares import Box, WithRate, nearest
from rpctl.control.frame_kinematics import (
    end_effector_frame,
    jacobian,
    reference_motion,
    tracking_velocity,
)
from rpctl.control.horizon.law import Horizon
from rpctl.control.law import (
    Command,
    KinematicController,
    KinematicLaw,
    Preparing,
    Rest,
    as_law,
)
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, require_positive
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.model import Robot

MAX_FULL_SPEED = 1.0  # rad/s or m/s; full speed of joints with a higher velocity limit
SPEED_FRACTION = 0.9  # of a velocity limit: largest commanded rate, with room for overshoot


@dataclass(frozen=True)
class EndEffector:
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

    Attributes:
        base: The law of the base; its arm rates are the posture's.
        horizon: Prediction time h of the end effector, s.
        orientation: Whether its orientation is an output too, or its position only.
        lever: Length (m) at the end of which an error of orientation counts as one of position.
        damping: m/s; directions in which the arm at full speed is slower count as singular.
    """

    base: KinematicLaw = field(default_factory=Horizon)
    horizon: float = 0.4
    orientation: bool = False
    lever: float = 0.3
    damping: float = 0.01

    def __post_init__(self) -> None:
        """Refuse settings that leave the law undefined."""
        for name in ("horizon", "lever", "damping"):
            require_positive(name, getattr(self, name))
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
        frame = end_effector_frame(dynamics.robot)
        return EndEffectorLaw(self, as_law(self.base).start(dynamics, period, rest), frame)


class EndEffectorLaw:
    """:class:`EndEffector` on one robot.

    Args:
        law: Its settings.
        base: The controller of the base.
        frame: Pinocchio's index of the end effector.
    """

    def __init__(self, law: EndEffector, base: KinematicController, frame: int) -> None:
        self._law, self._base, self._frame = law, base, frame
        self._preparing = base if isinstance(base, Preparing) else None

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and its analytic derivative along the actual motion.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """
        robot = dynamics.robot
        first = robot.dof - len(robot.joints)
        base = self._base(dynamics, reference, t, q, nu)
        S, full = dynamics.basis(q), np.minimum(_velocity_limits(robot), MAX_FULL_SPEED)
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
            t: Time of the last sample, s.
            q: Configuration (nq,) then.
            nu: Quasi-velocities (dof,) then.
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

        Args:
            dynamics: The robot's dynamics.
            state: The reference.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
            base: Command of the base's law.
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
            robot: The robot.
            q: Configuration (nq,).
            rates: Rates of the arm's joints (n_joints,).
            full: Full speeds of the joints (n_joints,).
        """
        fastest, positions = SPEED_FRACTION * _velocity_limits(robot), robot.joint_positions(q)
        bounds = []
        for limits in zip(*((joint.lower, joint.upper) for joint in robot.joints), strict=True):
            room = (np.array(limits) - positions) / self._law.horizon
            value = np.clip(room, -fastest, fastest)
            rate = np.where(value == room, -rates / self._law.horizon, 0.0)
            bounds.append(WithRate(value / full, rate / full))
        return Box(*bounds)


def _velocity_limits(robot: Robot) -> Array:
    """Return the velocity limits of the arm's joints (n_joints,), rad/s or m/s."""
    return np.array([joint.velocity for joint in robot.joints])
