"""The regulator of robots that lean: it follows a reference by leaning before it goes or turns.

What the reference asks at a time, for ever, is a steady motion: its tilt, its steering and its
efforts follow from the equations of motion. About it the robot is linear,

    ẋ = A x + B u,   x = (P's errors; tilt, steering, legs and arm; ν),   u = τ less the motion's,

with :func:`rpctl.linearize`'s A and B, seen from the ground and sampled exactly with efforts that
are held for a period. P's errors are bounded by the kinematic law's leash. u = −K x makes
Σ xᵀQ x + aᵀR a a least, a the accelerations that u gives wheels, steering and joints: of light legs
and heavy frames alike it asks what both can do. Changes of tilt and steering that the reference
will ask for in the next two seconds add what the same cost makes of them. K is made for a table of
speeds. Efforts come late; x is foretold by the linear model for as long as that is told, or taken
to be.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from rpctl.arrays import Array
from rpctl.control.law import (
    Command,
    Efforts,
    Goal,
    LeaningCommand,
    Limit,
    ReportsNothing,
    Rest,
)
from rpctl.control.output_groups import DEAD_TIME
from rpctl.dynamics.derivatives import linearize
from rpctl.dynamics.reduced import LeaningDynamics, ReducedDynamics
from rpctl.errors import RpctlError, UnfitLawError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.reference.motion import ReferenceState
from rpctl.robot.leaning import GRAVITY, LEAST_LEAN, MAX_LEAN

SPEEDS = (-4.0, -2.0, -1.0, -0.5, -0.1, 0.1, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)  # m/s, of the table
STEPS, STEP = 30, 1e-6  # of Newton's to a steady motion, and of its differences, rad
STRIDE = 0.1  # rad: no step of Newton's is longer
STEADY = 1e-9  # of the weight, at 1 m: what may be left over of a steady motion
MENDING_LEAN, TINY = 0.3, 1e-12  # rad: it leans by no more to mend its speed and its place
REDUNDANT = 1e-6  # of the largest cost: that of efforts which work against each other
LATENESS_S = 0.01  # s: what nobody tells, and is foretold
AHEAD, AHEAD_STEP = 50, 0.04  # how far ahead the reference is looked at: steps, and their length, s
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
        # of x: what it leans for, a bicycle for its place to the side and its heading
        self.outer = [1, 2] if robot.rolls_sideways else [0, ERRORS + len(self.index)]
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
            here = self._motion(self.at(own, joints), state, own)
            gap = self._left(here, omega)
            if np.abs(gap).max() <= STEADY:
                return here
            own = own - np.clip(np.linalg.solve(self.slope(here, joints), gap), -STRIDE, STRIDE)
        raise RpctlError(
            f"{self.robot.name}: no steady motion has a speed of {v:.3g} m/s and a turning rate "
            f"of {omega:.3g} rad/s; give a wider or a slower turn, or freeze joints that reach "
            "far out"
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
        far = max(way.max(), -way.min()) > STEADY
        return self._motion(self.dynamics.moved(before.q, way) if far else before.q, state, own)

    def slope(self, steady: SteadyMotion, joints: Array) -> Array:
        """Return how what is left over of a motion changes with tilt and steering."""
        still, (v, _, omega) = np.zeros_like(joints), self.dynamics.twist(steady.q, steady.nu)
        turn = 0.0 if self.steered else omega
        state = ReferenceState(
            np.zeros(3), np.array([v, 0.0, turn]), np.zeros(3), joints, still, still
        )
        gap = self._left(steady, 0.0)
        columns = [
            self._left(self._motion(self.at(own, joints), state, own), 0.0) - gap
            for own in steady.posture + STEP * np.eye(len(steady.posture))
        ]
        return np.column_stack(columns) / STEP

    def _motion(self, q: Array, state: ReferenceState, own: Array) -> SteadyMotion:
        """Return a motion with the least efforts, of their limits, that keep it up."""
        nu, nu_dot = np.zeros((2, self.robot.dof))
        for into, base, arm in (
            (nu, state.twist, state.joint_rates), (nu_dot, state.twist_dot,
             state.joint_accelerations),
        ):  # fmt: skip
            into[0], into[len(into) - len(arm) :] = base[0], arm
            if not self.steered:
                into[1] = base[2]
        force, B, twist = self.dynamics.required(q, nu, nu_dot)
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


def cost_to_go(
    posture: Posture, steady: SteadyMotion, F: Array, G: Array, Q: Array, R: Array
) -> Array:
    """Return the P (n, n) of ½ xᵀP x, the least cost of going on for ever about a motion.

    Raises:
        UnfitLawError: No efforts bring the robot back to it.
    """
    try:
        return np.asarray(solve_discrete_are(F, G, Q, R))
    except (np.linalg.LinAlgError, ValueError):
        raise UnfitLawError(
            f"{posture.robot.name} cannot be balanced at {steady.nu[0]:.3g} m/s: no efforts bring "
            "it back"
        ) from None


@dataclass(frozen=True)
class Balance(Record):
    """A linear-quadratic regulator about the steady motion of the moment; see this module.

    Each setting but the last is a deviation, or an acceleration, that costs as much as any other.
    """

    place: Annotated[float, POSITIVE, Setting("m", "Place", "Off the reference.")] = 0.1
    heading: Annotated[float, POSITIVE, Setting("rad", "Heading", "Off the reference's.")] = 0.3
    tilt: Annotated[float, POSITIVE, Setting("rad", "Tilt", "Off the steady motion's.")] = 0.1
    speed: Annotated[float, POSITIVE, Setting("m/s", "Speed", "Off the reference's.")] = 0.3
    turn: Annotated[float, POSITIVE, Setting("rad/s", "Turning", "Off the reference's.")] = 1.0
    steering: Annotated[float, POSITIVE, Setting("rad", "Steering", "Off the steady motion's.")] = (
        0.1
    )
    # On the ground, legs that part hold the robot to its heading, which the model does not know.
    joint: Annotated[float, POSITIVE, Setting("rad or m", "Joints", "Legs and arm.")] = 0.03
    rate: Annotated[float, POSITIVE, Setting("rad/s", "Rates", "Of tilt and joints.")] = 1.0
    acceleration: Annotated[
        float, POSITIVE, Setting("m/s²", "Acceleration", "Of the wheels along the ground.")
    ] = 3.0
    turning: Annotated[float, POSITIVE, Setting("rad/s²", "Turning", "Acceleration.")] = 5.0
    joints: Annotated[
        float, POSITIVE, Setting("rad/s²", "Joints", "Accelerations of arm and steering.")
    ] = 40.0
    lateness: Annotated[
        float | None,
        DEAD_TIME,
        Setting(
            "s", "Lateness", "From a measurement to its efforts; 10 ms if neither it nor a delay "
            "is given, which withstands 0 to 20.",
        ),
    ] = None  # fmt: skip

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> BalanceController:
        """Return the controller of one run.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
            rest: State before the run; not used.

        Raises:
            UnfitLawError: The robot does not lean, or some state of it cannot be balanced.
        """
        return BalanceController(self, Posture(ReducedDynamics(dynamics.robot)), period)

    def costs(self, posture: Posture, B: Array) -> tuple[Array, Array]:
        """Return Q (n, n) and R (n_act, n_act) of a model whose inputs act through B (n, n_act)."""
        robot, count = posture.robot, len(posture.index)
        rates, accelerations = np.full(robot.dof, self.rate), np.full(robot.dof, self.joints)
        rates[0], accelerations[0] = self.speed, self.acceleration
        if not posture.steered:
            rates[1], accelerations[1] = self.turn, self.turning
        own = [self.tilt, *[self.steering] * len(posture.steered)]
        own += [self.joint] * (count - len(own))
        places = [self.place, self.place, self.heading, *own]
        Q = np.diag(1.0 / np.concatenate([places, rates]) ** 2)
        driven = np.delete(B[ERRORS + count :] / accelerations[:, None], posture.first, axis=0)
        R = driven.T @ driven
        R += REDUNDANT * np.diag(np.diag(R).max() / posture.scale**2 * posture.scale.min() ** 2)
        return Q, R

    def design(self, posture: Posture, steady: SteadyMotion, period: float) -> Design:
        """Return the regulator about a motion.

        Raises:
            UnfitLawError: No efforts bring the robot back to it.
        """
        A, B = posture.linear(steady)
        F, G = sampled(A, B, period)
        Q, R = self.costs(posture, B)
        P = cost_to_go(posture, steady, F, G, Q, R)
        left = np.linalg.solve(R + G.T @ P @ G, G.T)
        K = left @ P @ F
        loop = (F - G @ K).T
        own = slice(ERRORS, ERRORS + 1 + len(posture.steered))
        far, sums = P[:, own], np.zeros_like(F)
        for _ in range(steps := round(AHEAD_STEP / period)):
            sums = np.eye(len(F)) + loop @ sums
        far, stride = left @ sums / steps, np.linalg.matrix_power(loop, steps)
        ahead = np.empty((AHEAD, *(far @ P[:, own]).shape))
        for k in range(AHEAD):
            ahead[k], far = far @ P[:, own], far @ stride
        return Design(F, G, K, ahead)


class Design(NamedTuple):
    """A regulator about a steady motion, and the model that it is made of."""

    F: Array  # (n, n)
    G: Array  # (n, n_act)
    K: Array  # (n_act, n)
    ahead: Array  # (AHEAD, n_act, 1 + n_steered) by how tilt and steering change in a step ahead

    def leans_less(self, x: Array, outer: list[int]) -> float:
        """Return the share of some deviations for which it leans by no more than MENDING_LEAN."""
        asked, by_lean = math.hypot(*(self.K[:, outer] @ x[outer])), math.hypot(*self.K[:, ERRORS])
        return min(1.0, MENDING_LEAN * by_lean / max(asked, TINY))

    def foretold(self, x: Array, sent: Sequence[Array]) -> Array:
        """Return x (n,) when what is sent now acts, given what was sent before that, in order."""
        for u in sent:
            x = self.F @ x + self.G @ u
        return x


class BalanceController(ReportsNothing):
    """The regulator of one robot in one run.

    Args:
        law: Its settings.
        posture: The robot's coordinates.
        period: Control period, s.
    """

    def __init__(self, law: Balance, posture: Posture, period: float) -> None:
        self._posture, robot = posture, posture.robot
        self._speeds = [v for v in SPEEDS if v > 0.5 * posture.slowest]
        steady = [posture.steady(v, 0.0, robot.home) for v in self._speeds]
        self._designs = [law.design(posture, each, period) for each in steady]
        slopes = [posture.slope(each, robot.home) for each in steady]
        self._slopes: list[Array] = [np.asarray(np.linalg.inv(each)) for each in slopes]
        late = LATENESS_S if law.lateness is None else law.lateness
        self._sent = deque([np.zeros(len(robot.actuators))] * round(late / period))
        self._steady: SteadyMotion | None = None
        self._ahead: deque[SteadyMotion] = deque(maxlen=AHEAD + 2)
        self._last = 0  # step of the last of these

    def __call__(self, dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        """Return τ (n_act,) and the limits that bind.

        Args:
            dynamics: The robot's dynamics.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            command: What is wished.

        Raises:
            RpctlError: The kinematic law tells no goal, or its goal is no motion of the robot.
        """
        posture, limits = self._posture, self._posture.robot.effort_limits
        if not isinstance(command, LeaningCommand):
            raise UnfitLawError("the kinematic law gives no goal to balance for; use unified")
        goal = command.goal
        postures, share = self._look(goal)
        own = (1.0 - share) * postures[0] + share * postures[1]
        state = posture.possible(goal.reference(goal.t))
        self._steady = steady = posture.moved(self._steady or self._ahead[0], state, own)
        wanted = np.concatenate([steady.posture, steady.joints, command.nu_d])
        x = posture.short(np.concatenate([posture.of(q), nu]) - wanted)
        x = np.concatenate([-goal.error, x])
        (low, high), part = self._near(float(state.twist[0]))
        x = (high if part > 0.5 else low).foretold(x, self._sent)
        x[posture.outer] *= min(design.leans_less(x, posture.outer) for design in (low, high))
        changes = np.diff(postures, axis=0)
        changes = (1.0 - share) * changes[:-1] + share * changes[1:]
        asked = steady.tau.copy()
        for design, weight in ((low, 1.0 - part), (high, part)):
            asked += weight * (np.einsum("kij,kj->i", design.ahead, changes) - design.K @ x)
        tau = np.clip(asked, -limits, limits)
        if self._sent:
            self._sent.append(tau - steady.tau)
            self._sent.popleft()
        names = (posture.robot.actuators[i] for i in np.flatnonzero(tau != asked))
        return Efforts(tau, tuple(Limit(name, "effort") for name in names))

    def _look(self, goal: Goal) -> tuple[Array, float]:
        """Return tilt and steering (AHEAD + 2, ·) of steps ahead, and how far the first is gone.

        The steps are those of time itself, so that each is looked at once.
        """
        posture, (step, share) = self._posture, divmod(goal.t / AHEAD_STEP, 1.0)
        first = int(step)
        if not 0 <= first - (self._last + 1 - len(self._ahead)) <= len(self._ahead):
            self._ahead.clear()
        if not self._ahead:
            self._last, state = first, posture.possible(goal.reference(first * AHEAD_STEP))
            v, _, omega = state.twist.tolist()
            self._ahead.append(posture.steady(v, omega, state.joints))
        while self._last < first + AHEAD + 1:
            self._last += 1
            state = posture.possible(goal.reference(self._last * AHEAD_STEP))
            slope = self._slopes[self._index(float(state.twist[0]))]
            self._ahead.append(posture.follow(self._ahead[-1], state, slope))
        return np.array([each.posture for each in self._ahead]), share

    def _index(self, v: float) -> int:
        """Return the entry of the table below a speed (m/s)."""
        return min(max(bisect_left(self._speeds, v) - 1, 0), len(self._speeds) - 2)

    def _near(self, v: float) -> tuple[list[Design], float]:
        """Return the two designs next to a speed (m/s), and how far it is to the second."""
        k = self._index(v)
        low, high = self._speeds[k : k + 2]
        return self._designs[k : k + 2], min(max((v - low) / (high - low), 0.0), 1.0)
