"""Steady motions of robots that lean: their tilt, steering and efforts, and the model about them.

A motion that goes on as it is, but for its speed, follows from the equations of motion: tilt and
steering are found by Newton's method, efforts are the least, of their limits, that keep it up.
About it the robot is linear,

    ẋ = A x + B u,   x = (P's errors; tilt, steering, legs and arm; ν),   u = τ less the motion's,

with :func:`rpctl.linearize`'s A and B, seen from the ground.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from rpctl.arrays import Array
from rpctl.dynamics.derivatives import linearize
from rpctl.dynamics.reduced import LeaningDynamics, ReducedDynamics
from rpctl.errors import RpctlError, UnfitLawError
from rpctl.reference.motion import ReferenceState
from rpctl.robot.leaning import GRAVITY, LEAST_LEAN, MAX_LEAN

STEPS, STEP = 30, 1e-6  # of Newton's to a steady motion, and of its differences, rad
STRIDE = 0.1  # rad: no step of Newton's is longer
STEADY = 1e-9  # of the weight, at 1 m: what may be left over of a steady motion
ERRORS = 3  # of P: ahead, to the left and in heading


class SteadyMotion(NamedTuple):
    """A motion that goes on as it is, but for its speed, with the arm held; P is at the origin."""

    q: Array  # (nq,)
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,) of the speed alone
    tau: Array  # (n_act,)
    posture: Array  # (1 + n_steered,) tilt and steering, rad
    joints: Array  # (n_joints,) rad or m
    lacking: float  # of the weight, at 1 m: what tilts it and no actuator gives
    turn: float  # rad/s


class Posture:
    """The coordinates in which a robot that leans is balanced: tilt, steering, arm.

    Args:
        dynamics: The robot's.

    Raises:
        UnfitLawError: It does not lean, or nothing drives its wheels, its steering or its arm.
    """

    def __init__(self, dynamics: ReducedDynamics) -> None:
        if not isinstance(dynamics, LeaningDynamics):
            raise UnfitLawError(
                f"{dynamics.robot.name} does not lean, so there is nothing to balance"
            )
        self.robot, self.dynamics = dynamics.robot, dynamics
        robot = self.robot
        names = robot.quasi_velocities
        self.first = 1 if robot.rolls_sideways else 2  # index in ν of the tilt's rate
        self.index = np.arange(self.first, len(names))  # of tilt, steering and arm in ν
        # of x: what can wait while it stays up
        self.outer = [1, 2] if robot.rolls_sideways else [0, 1, 2, ERRORS + len(self.index)]
        self.steered = [swivel.joint for swivel in robot.drive.steered]
        turning = [joint.kind == "continuous" for joint in robot.joints]
        self._turning = 1 + len(self.steered) + np.flatnonzero(turning)  # index in x
        undriven = [name for name in names[self.first + 1 :] if name not in robot.actuators]
        if undriven or not any(wheel.driven for wheel in robot.drive.wheels):
            what = ", ".join(undriven) or "its wheels"
            raise UnfitLawError(
                f"nothing drives {what} of {robot.name}, so no law can balance it; add motors, or "
                "freeze joints with --lock"
            )
        limits = robot.effort_limits
        self._still = np.zeros(robot.dof)
        self.scale = np.where(np.isfinite(limits), limits, 1.0)
        # m/s: a slower bicycle is balanced as if it went so fast
        self.slowest = robot.balancing_speed(LEAST_LEAN) if self.steered else -math.inf

    def of(self, q: Array) -> Array:
        """Return tilt, steering and arm (dof − first,) at q (nq,), rad or m."""
        robot = self.robot
        steering = [robot.joint_position(q, name) for name in self.steered]
        return np.array([robot.tilt(q), *steering, *robot.joint_positions(q)])

    def at(self, own: Array, joints: Array) -> Array:
        """Return q (nq,) with P at the origin, of tilt and steering (1 + n_steered,) and arm."""
        return self.robot.configuration_at(np.zeros(3), joints, own[1:], float(own[0]))

    def possible(self, state: ReferenceState) -> ReferenceState:
        """Return a reference with the nearest speed and turning rate of a steady motion.

        A bicycle goes forward, in bends that its steering and its lean allow.
        """
        if not self.steered:
            return state
        v = max(float(state.twist[0]), self.slowest)
        widest = min(self.robot.sharpest_bend * v, math.tan(MAX_LEAN) * GRAVITY / v)
        omega = min(max(float(state.twist[2]), -widest), widest)
        return state._replace(twist=np.array([v, 0.0, omega]))

    def short(self, x: Array) -> Array:
        """Return a deviation x with those of joints without limits the short way round."""
        for k in self._turning:
            x[k] = math.remainder(x[k], 2.0 * math.pi)
        return x

    def steady(self, v: float, omega: float, joints: Array) -> SteadyMotion:
        """Return the steady motion of a speed (m/s) and a turning rate (rad/s).

        Args:
            v: Of P.
            omega: Likewise.
            joints: Positions of the arm (n_joints,), rad or m.

        Raises:
            RpctlError: There is none near the upright one.
        """
        still = np.zeros_like(joints)
        state = ReferenceState(
            np.zeros(3), np.array([v, 0.0, omega]), np.zeros(3), joints, still, still
        )
        own = np.zeros(1 + len(self.steered))
        for _ in range(STEPS):
            here = self._motion(self.at(own, joints), self._still, state, own)
            gap = self._left(here, omega)
            if np.abs(gap).max() <= STEADY:
                return here
            own = own - np.clip(np.linalg.solve(self.slope(here, joints), gap), -STRIDE, STRIDE)
        raise RpctlError(
            f"{self.robot.name}: no steady motion has a speed of {v:.3g} m/s and a turning rate of "
            f"{omega:.3g} rad/s; give a wider or a slower turn, or freeze joints that "
            "reach far out"
        )

    def follow(self, before: SteadyMotion, state: ReferenceState, slope: Array) -> SteadyMotion:
        """Return a steady motion a step of Newton's nearer to that of what is wished now.

        Args:
            before: The one of the time before.
            state: What is wished.
            slope: Inverse of :meth:`slope` near it.
        """
        here = self.moved(before, state, before.posture)
        step = -np.clip(slope @ self._left(here, float(state.twist[2])), -STRIDE, STRIDE)
        return self.moved(here, state, here.posture + step)

    def moved(self, before: SteadyMotion, state: ReferenceState, own: Array) -> SteadyMotion:
        """Return a motion near another one: of a reference, with a tilt and a steering (own)."""
        way = np.zeros(self.robot.dof)
        way[self.index] = np.concatenate([own - before.posture, state.joints - before.joints])
        return self._motion(before.q, way, state, own)

    def slope(self, steady: SteadyMotion, joints: Array) -> Array:
        """Return how what is left over of a motion changes with tilt and steering."""
        still, (v, _, omega) = np.zeros_like(joints), self.dynamics.twist(steady.q, steady.nu)
        turn = 0.0 if self.steered else omega
        state = ReferenceState(
            np.zeros(3), np.array([v, 0.0, turn]), np.zeros(3), joints, still, still
        )
        gap = self._left(steady, 0.0)
        columns = [
            self._left(self._motion(self.at(own, joints), self._still, state, own), 0.0) - gap
            for own in steady.posture + STEP * np.eye(len(steady.posture))
        ]
        return np.column_stack(columns) / STEP

    def _motion(self, q: Array, way: Array, state: ReferenceState, own: Array) -> SteadyMotion:
        """Return a motion with the least efforts, of their limits, that keep it up.

        Args:
            q: A configuration (nq,) near it.
            way: Quasi-velocities (dof,) that lead from there to it in 1 s.
            state: What is wished.
            own: Its tilt and steering.
        """
        nu, nu_dot = np.zeros((2, self.robot.dof))
        for into, base, arm in (
            (nu, state.twist, state.joint_rates), (nu_dot, state.twist_dot,
             state.joint_accelerations),
        ):  # fmt: skip
            into[0], into[len(into) - len(arm) :] = base[0], arm
            if not self.steered:
                into[1] = base[2]
        q, force, B, twist = self.dynamics.required(q, way, nu, nu_dot)
        tau = self.scale * np.linalg.lstsq(B * self.scale, force, rcond=None)[0]
        lacking = (force - B @ tau)[self.first] / (GRAVITY * self.robot.mass)
        turn = float(twist[2])
        return SteadyMotion(q, nu, nu_dot, tau, own, state.joints, float(lacking), turn)

    def _left(self, motion: SteadyMotion, omega: float) -> Array:
        """Return what no actuator gives, of the weight's moment, and what turns too much."""
        if not self.steered:
            return np.array([motion.lacking])
        return np.array([motion.lacking, motion.turn - omega])

    def linear(self, steady: SteadyMotion, way: float = 0.0) -> tuple[Array, Array]:
        """Return A (n, n) and B (n, n_act) of x about a motion.

        Args:
            steady: The motion.
            way: Speed with which a heading leads aside, m/s; 0: the motion's own.
        """
        q, nu, dynamics = steady.q, steady.nu, self.dynamics
        model = linearize(self.robot, q, nu, steady.tau)
        nv, dof, count = self.robot.nv, self.robot.dof, len(self.index)
        along, rates = dynamics.basis(q)[:, self.index], ERRORS + count
        A = np.zeros((rates + dof, rates + dof))
        twist = dynamics.twist(q, nu)
        A[0, 1], A[1, 0], A[1, 2] = twist[2], -twist[2], way or twist[0]
        A[:ERRORS, rates:] = dynamics.at(q).twist
        for k, each in enumerate(along.T, start=ERRORS):
            beside = dynamics.twist(dynamics.integrate(q, STEP * each), nu)
            A[:ERRORS, k] = (beside - twist) / STEP
        A[ERRORS:rates, rates + self.index] = np.eye(count)
        A[rates:, ERRORS:rates] = model.A[nv:, :nv] @ along
        A[rates:, rates:] = model.A[nv:, nv:]
        return A, np.vstack([np.zeros((rates, model.B.shape[1])), model.B[nv:]])


def sampled(A: Array, B: Array, period: float) -> tuple[Array, Array]:
    """Return the model whose inputs are held for a period (s), exactly."""
    n, m = B.shape
    both = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * period)
    return both[:n, :n], both[:n, n:]
