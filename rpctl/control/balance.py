"""The laws of robots that lean: what a kinematic law wishes, and a regulator that balances it.

The kinematic law's wish is P's speed and turning rate, and the arm's posture. The motion that has
them for ever is the steady motion of the moment: its tilt, its steering and its efforts follow from
the equations of motion. About it the robot is linear,

    ẋ = A x + B u,   x = (tilt, steering and joints, ν),   u = τ less the steady motion's,

with :func:`rpctl.linearize`'s A and B, seen from the ground and sampled exactly with efforts that
are held for a period; u = −K x makes Σ xᵀQ x + uᵀR u least. K is made for a table of speeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from rpctl.arrays import Array
from rpctl.control.law import Command, Efforts, Goal, Limit, ReportsNothing, Rest
from rpctl.dynamics.derivatives import linearize
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, UnfitLawError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.robot.leaning import LeaningRobot

SPEEDS = (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)  # m/s, of the table
STEPS, STEP = 30, 1e-6  # of Newton's to a steady motion, and of its differences, rad
STEADY = 1e-9  # of the weight's moment, N·m: what is left over of a steady motion
LEAST_SPEED = 0.5  # m/s: a slower bicycle is not asked to turn
UNCONTROLLED = 1e-6  # of the largest singular value: below it no effort reaches a state


class SteadyMotion(NamedTuple):
    """A motion that goes on as it is, with the arm held."""

    q: Array  # (nq,)
    nu: Array  # (dof,)
    tau: Array  # (n_act,)
    posture: Array  # (1 + n_steered,) tilt and steering, rad


class Posture:
    """The coordinates in which a robot that leans is balanced: tilt, steering, arm.

    Args:
        dynamics: The robot's.

    Raises:
        UnfitLawError: It does not lean, or nothing drives its wheels, its steering or its arm.
    """

    def __init__(self, dynamics: ReducedDynamics) -> None:
        robot = dynamics.robot
        if not isinstance(robot, LeaningRobot):
            raise UnfitLawError(f"{robot.name} does not lean, so there is nothing to balance")
        self.robot, self.dynamics = robot, dynamics
        names = robot.quasi_velocities
        self.first = 1 if robot.rolls_sideways else 2  # index in ν of the tilt's rate
        self.index = np.arange(self.first, len(names))  # of tilt, steering and arm in ν
        self.steered = [swivel.joint for swivel in robot.drive.steered]
        undriven = [name for name in names[self.first + 1 :] if name not in robot.actuators]
        if undriven or not any(wheel.driven for wheel in robot.drive.wheels):
            what = ", ".join(undriven) or "its wheels"
            raise UnfitLawError(
                f"nothing drives {what} of {robot.name}, so no law balances it; give motors, or "
                "hold joints with --lock"
            )
        limits = robot.effort_limits
        self.scale = np.where(np.isfinite(limits), limits, 1.0)

    def of(self, q: Array) -> Array:
        """Return tilt, steering and arm (dof − first,) at q (nq,), rad or m."""
        robot = self.robot
        steering = [robot.joint_position(q, name) for name in self.steered]
        return np.array([robot.tilt(q), *steering, *robot.joint_positions(q)])

    def at(self, own: Array, joints: Array) -> Array:
        """Return q (nq,) with P at the origin, of tilt and steering (1 + n_steered,) and arm."""
        return self.robot.configuration_at(np.zeros(3), joints, own[1:], float(own[0]))

    def steady(
        self, v: float, omega: float, joints: Array, near: Array | None = None
    ) -> SteadyMotion:
        """Return the steady motion of a speed (m/s) and a turning rate (rad/s).

        Args:
            v: Of P.
            omega: Likewise.
            joints: Positions of the arm (n_joints,), rad or m.
            near: Tilt and steering to begin with.

        Raises:
            RpctlError: There is none near.
        """
        own = np.zeros(1 + len(self.steered)) if near is None else near.copy()
        for _ in range(STEPS):
            gap = self._left(v, omega, joints, own)
            if np.abs(gap).max() <= STEADY:
                q, nu = self.at(own, joints), self._speeds(v, omega)
                return SteadyMotion(q, nu, self._efforts(q, nu), own)
            J = np.column_stack([
                (self._left(v, omega, joints, own + STEP * axis) - gap) / STEP
                for axis in np.eye(len(own))
            ])  # fmt: skip
            own = own - np.clip(np.linalg.solve(J, gap), -0.2, 0.2)
        raise RpctlError(
            f"{self.robot.name}: no steady motion has a speed of {v:.3g} m/s and a turning rate of "
            f"{omega:.3g} rad/s; give a wider or a slower turn"
        )

    def _speeds(self, v: float, omega: float) -> Array:
        nu = np.zeros(self.robot.dof)
        nu[0] = v
        if not self.steered:
            nu[1] = omega
        return nu

    def _left(self, v: float, omega: float, joints: Array, own: Array) -> Array:
        """Return what keeps a motion from being steady: what no actuator gives, and its turning."""
        dynamics, q, nu = self.dynamics, self.at(own, joints), self._speeds(v, omega)
        force = dynamics.inverse(q, nu, np.zeros_like(nu))
        U, sizes, _ = np.linalg.svd(dynamics.actuation(q))
        free = U[:, int(np.count_nonzero(sizes > UNCONTROLLED * sizes[0])) :]
        sign = np.sign(free[self.first])
        left = (sign * free).T @ force / (9.81 * self.robot.mass)
        if not self.steered:
            return np.asarray(left)
        return np.array([*left, dynamics.twist(q, nu)[2] - omega])

    def _efforts(self, q: Array, nu: Array) -> Array:
        """Return the least efforts (n_act,), of their limits, that keep a motion up."""
        force = self.dynamics.inverse(q, nu, np.zeros_like(nu))
        B = self.dynamics.actuation(q) * self.scale
        return np.asarray(self.scale * np.linalg.lstsq(B, force, rcond=None)[0])

    def linear(self, steady: SteadyMotion) -> tuple[Array, Array]:
        """Return A (n, n) and B (n, n_act) of x = (tilt, steering, arm, ν) about a motion."""
        model = linearize(self.robot, steady.q, steady.nu, steady.tau)
        nv, dof, count = self.robot.nv, self.robot.dof, len(self.index)
        along = self.dynamics.basis(steady.q)[:, self.index]
        A = np.zeros((count + dof, count + dof))
        A[:count, count + self.index] = np.eye(count)
        A[count:, :count] = model.A[nv:, :nv] @ along
        A[count:, count:] = model.A[nv:, nv:]
        return A, np.vstack([np.zeros((count, model.B.shape[1])), model.B[nv:]])


def sampled(A: Array, B: Array, period: float) -> tuple[Array, Array]:
    """Return the model whose inputs are held for a period (s), exactly."""
    n, m = B.shape
    both = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * period)
    return both[:n, :n], both[:n, n:]


@dataclass(frozen=True)
class Balance(Record):
    """A linear-quadratic regulator about the steady motion of the moment; see this module.

    Each setting is a deviation that costs as much as any other.
    """

    tilt: Annotated[float, POSITIVE, Setting("rad", "Tilt", "Of the steady motion's.")] = 0.1
    speed: Annotated[float, POSITIVE, Setting("m/s", "Speed", "Of the wished one.")] = 0.3
    turn: Annotated[float, POSITIVE, Setting("rad/s", "Turning", "Of the wished one.")] = 0.5
    joint: Annotated[float, POSITIVE, Setting("rad or m", "Joints", "Arm and steering.")] = 0.1
    rate: Annotated[float, POSITIVE, Setting("rad/s", "Rates", "Of tilt and joints.")] = 1.0
    effort: Annotated[
        float, POSITIVE, Setting("", "Effort", "Of the limits; of 1 N·m where there is none.")
    ] = 0.3

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> BalanceController:
        """Return the controller of one run.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            rest: State before the run; its posture is that of the table.

        Raises:
            UnfitLawError: The robot does not lean, or some state of it cannot be balanced.
        """
        return BalanceController(self, Posture(dynamics), period)

    def gain(self, posture: Posture, steady: SteadyMotion, period: float) -> Array:
        """Return K (n_act, n) about a motion.

        Raises:
            UnfitLawError: No efforts bring the robot back to it.
        """
        robot = posture.robot
        rates = np.full(robot.dof, self.rate)
        rates[0] = self.speed
        if not posture.steered:
            rates[1] = self.turn
        places = np.array([self.tilt, *[self.joint] * (len(posture.index) - 1)])
        Q = np.diag(1.0 / np.concatenate([places, rates]) ** 2)
        R = np.diag(1.0 / (self.effort * posture.scale) ** 2)
        F, G = sampled(*posture.linear(steady), period)
        try:
            P = solve_discrete_are(F, G, Q, R)
        except (np.linalg.LinAlgError, ValueError):
            raise UnfitLawError(
                f"{robot.name} cannot be balanced at {steady.nu[0]:.3g} m/s: no efforts bring it "
                "back"
            ) from None
        return np.asarray(np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F))


class BalanceController(ReportsNothing):
    """The regulator of one robot in one run.

    Args:
        law: Its settings.
        posture: The robot's coordinates.
        period: Control period, s.
    """

    def __init__(self, law: Balance, posture: Posture, period: float) -> None:
        self._posture, robot = posture, posture.robot
        home = robot.home
        speeds = [v for v in SPEEDS if not posture.steered or v > 0.0] 
        self._speeds = np.array(speeds)
        steady = [posture.steady(v, 0.0, home) for v in speeds]
        self._gains = np.array([law.gain(posture, each, period) for each in steady])
        self._near: Array | None = None

    def __call__(
        self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command
    ) -> Efforts:
        """Return τ (n_act,) and the limits that bind.

        Args:
            dynamics: The robot's dynamics.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            command: What is wished.

        Raises:
            RpctlError: No steady motion has the wished speed and turning rate.
        """
        posture, goal = self._posture, command.goal
        if goal is None:
            raise RpctlError("the kinematic law tells no goal; take one of rpctl's own")
        v, omega = goal.speed, goal.turn
        steady = posture.steady(v, omega, goal.joints, self._near)
        self._near = steady.posture
        wanted = np.concatenate([steady.posture, goal.joints, command.nu_d])
        x = np.concatenate([posture.of(q), nu]) - wanted
        tau = steady.tau - self._gain(v) @ x
        limits = posture.robot.effort_limits
        cut = np.clip(tau, -limits, limits)
        names = (posture.robot.actuators[i] for i in np.flatnonzero(cut != tau))
        return Efforts(cut, tuple(Limit(name, "effort") for name in names))

    def _gain(self, v: float) -> Array:
        """Return K (n_act, n) at a speed, m/s."""
        speeds = self._speeds
        k = int(np.clip(np.searchsorted(speeds, v) - 1, 0, len(speeds) - 2))
        share = float(np.clip((v - speeds[k]) / (speeds[k + 1] - speeds[k]), 0.0, 1.0))
        return np.asarray((1.0 - share) * self._gains[k] + share * self._gains[k + 1])
