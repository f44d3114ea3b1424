"""The regulator of robots that lean: it follows a reference by leaning before it goes or turns.

What the reference asks at a time, for ever, is a steady motion, about which the robot is linear
(:mod:`rpctl.control.steady_motion`): ẋ = A x + B u, sampled exactly with efforts that are held for
a period. P's errors are bounded by the kinematic law's leash. u = −K x makes
Σ xᵀQ x + aᵀR a a least, a the accelerations that u gives wheels, steering and joints: of light legs
and heavy frames alike it asks what both can do; what each motor gives alone costs a little, too, or
the optimum has them work against each other. K = K↑ + K→: K↑ keeps the robot up wherever it is, and
what K→ adds to bring it back to its place is bounded. Changes of tilt and steering that the
reference will ask for in the next two seconds add what the same cost makes of them. K is made for a
table of speeds. Efforts come late; x is foretold by the linear model for as long as that is told,
or taken to be.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

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
from rpctl.control.steady_motion import ERRORS, Posture, SteadyMotion, sampled
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import UnfitLawError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.reference.motion import Reference

SPEEDS = (-4.0, -2.0, -1.0, -0.5, -0.1, 0.1, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)  # m/s, of the table
SLACK = 100.0  # times: a robot that only stays up may be so much further off its place
UNHURRIED = 1.0  # m/s: up to there no turn throws it
MENDING, MENDING_LEAN = 2.0, 0.3  # of the limits, and rad: no more to bring it back to its place
ALONE = 0.03  # of what an effort costs: as if others did not work with it
LATENESS_S = 0.01  # s: what nobody tells, and is foretold
AHEAD, AHEAD_STEP = 50, 0.04  # how far ahead the reference is looked at: steps, and their length, s


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
        together = driven.T @ driven
        return Q, together + ALONE * np.diag(np.diag(together))

    def design(self, posture: Posture, steady: SteadyMotion, period: float) -> Design:
        """Return the regulator about a motion.

        Raises:
            UnfitLawError: No efforts bring the robot back to it.
        """
        A, B = posture.linear(steady)
        F, G = sampled(A, B, period)
        Q, R = self.costs(posture, B)
        up = np.ones(len(F))
        up[posture.outer] = SLACK**-2
        to_go = [cost_to_go(posture, steady, F, G, each, R) for each in (Q * up, Q)]
        lefts = [np.linalg.solve(R + G.T @ P @ G, G.T) for P in to_go]
        upright, K = (left @ P @ F for left, P in zip(lefts, to_go, strict=True))
        left, P = lefts[-1], to_go[-1]
        loop = (F - G @ K).T
        own = slice(ERRORS, ERRORS + 1 + len(posture.steered))
        far, sums = P[:, own], np.zeros_like(F)
        for _ in range(steps := round(AHEAD_STEP / period)):
            sums = np.eye(len(F)) + loop @ sums
        far, stride = left @ sums / steps, np.linalg.matrix_power(loop, steps)
        ahead = np.empty((AHEAD, *(far @ P[:, own]).shape))
        for k in range(AHEAD):
            ahead[k], far = far @ P[:, own], far @ stride
        return Design(F, G, upright, K - upright, ahead)


class Design(NamedTuple):
    """A regulator about a steady motion, and the model that it is made of."""

    F: Array  # (n, n)
    G: Array  # (n, n_act)
    upright: Array  # (n_act, n) gains that keep it up
    mending: Array  # (n_act, n) gains that bring it back to its place and speed besides
    ahead: Array  # (AHEAD, n_act, 1 + n_steered) by how tilt and steering change in a step ahead


def mended(upright: Array, efforts: Array, limits: Array) -> Array:
    """Return the efforts (n_act,) that bring a robot back to its place where staying up is first.

    They become less together until none is beyond twice its limit, since what keeps the robot up
    works against them, and they lean it by no more than MENDING_LEAN.

    Args:
        upright: Gains that keep the robot up (n_act, n).
        efforts: What the optimum asks beyond those (n_act,).
        limits: Of the efforts (n_act,).
    """
    lean = math.hypot(*efforts) / (MENDING_LEAN * math.hypot(*upright[:, ERRORS]))
    return efforts / max(1.0, lean, np.abs(efforts / limits).max() / MENDING)


def foretelling(F: Array, G: Array, periods: int) -> Array:
    """Return the map (n, n + periods m) from x, and from what is sent in each period, to x then."""
    found = np.eye(len(F))
    for _ in range(periods):
        found = np.hstack([F @ found, G])
    return found


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
        designs = [law.design(posture, each, period) for each in steady]
        late = LATENESS_S if law.lateness is None else law.lateness
        self._sent = deque([np.zeros(len(robot.actuators))] * round(late / period))
        self._foretold = [foretelling(each.F, each.G, len(self._sent)) for each in designs]
        self._upright = np.array([each.upright for each in designs])
        self._mending = np.array([each.mending for each in designs])
        self._steady: SteadyMotion | None = None
        slopes = [np.asarray(np.linalg.inv(posture.slope(each, robot.home))) for each in steady]
        self._look_ahead = LookAhead(posture, self._speeds, slopes, designs)

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
        own, of_changes = self._look_ahead(goal)
        state = posture.possible(goal.state)
        before = self._steady or self._look_ahead.first
        self._steady = steady = posture.moved(before, state, own)
        wanted = np.concatenate([steady.posture, steady.joints, command.nu_d])
        error, turns = -goal.error, self._turns(float(nu[0]), float(state.twist[0]))
        error[1:] *= turns
        if not posture.steered:
            wanted[1 - len(nu)] *= turns
        x = posture.short(np.concatenate([posture.of(q), nu]) - wanted)
        k, part = self._near(float(nu[0]))
        both, weights = slice(k, k + 2), np.array([1.0 - part, part])
        x = self._foretold[k + round(part)] @ np.concatenate([error, x, *self._sent])
        upright = np.tensordot(weights, self._upright[both], 1)
        mends = mended(upright, weights @ (self._mending[both] @ x), limits)
        asked = steady.tau + weights @ of_changes[both] - upright @ x - mends
        tau = np.minimum(np.maximum(asked, -limits), limits)
        if self._sent:
            self._sent.append(tau - steady.tau)
            self._sent.popleft()
        names = (posture.robot.actuators[i] for i in np.flatnonzero(tau != asked))
        return Efforts(tau, tuple(Limit(name, "effort") for name in names))

    @staticmethod
    def _turns(v: float, wanted: float) -> float:
        """Return by how much less a robot turns that is faster (m/s) than is wanted.

        A push has made it so; turning as before would throw it on its side.
        """
        return min(1.0, max(abs(wanted), UNHURRIED) / max(abs(v), UNHURRIED)) ** 2

    def _near(self, v: float) -> tuple[int, float]:
        """Return the entry of the table below a speed (m/s), and how far it is to the next."""
        k = entry_below(self._speeds, v)
        low, high = self._speeds[k : k + 2]
        return k, min(max((v - low) / (high - low), 0.0), 1.0)


class LookAhead:
    """The postures of a reference from now on, and what their changes add to the efforts.

    They stand at steps of time itself, so that each is found once.

    Args:
        posture: The robot's coordinates.
        speeds: Those of the tables that follow (n,), m/s, ascending.
        slopes: What :meth:`Posture.follow` takes, one a speed.
        designs: The regulators, one a speed.
    """

    def __init__(
        self,
        posture: Posture,
        speeds: Sequence[float],
        slopes: Sequence[Array],
        designs: Sequence[Design],
    ) -> None:
        self._posture, self._speeds, self._slopes = posture, speeds, slopes
        self._by_changes = np.array([np.hstack(list(each.ahead)) for each in designs])
        self._followed: Reference | None = None
        self._motions: deque[SteadyMotion] = deque(maxlen=AHEAD + 2)
        self._last = 0  # step of the last of these
        self._looked: int | None = None  # step of the first when the rest was found

    @property
    def first(self) -> SteadyMotion:
        """The motion at the last step before now."""
        return self._motions[0]

    def __call__(self, goal: Goal) -> tuple[Array, Array]:
        """Return tilt and steering now (1 + n_steered,), and what their changes ahead add.

        What they add to the efforts is that of each design, (len(designs), n_act).
        """
        step, share = divmod(goal.t / AHEAD_STEP, 1.0)
        first = int(step)
        known = 0 <= first - (self._last + 1 - len(self._motions)) <= len(self._motions)
        if not known or goal.reference is not self._followed:
            self._motions.clear()
            self._followed = goal.reference
        if not self._motions:
            self._looked, self._last = None, first
            self._motions.append(self._steady(goal.reference, first))
        while self._last < first + AHEAD + 1:
            self._last += 1
            self._motions.append(self._following(goal.reference, self._last))
        if first != self._looked:
            self._looked, postures = first, np.array([each.posture for each in self._motions])
            changes = np.diff(postures, axis=0)
            ends = np.array([changes[:-1].ravel(), changes[1:].ravel()])
            self._own, self._of_changes = postures[:2], self._by_changes @ ends.T
        weights = np.array([1.0 - share, share])
        return weights @ self._own, self._of_changes @ weights

    def _steady(self, reference: Reference, step: int) -> SteadyMotion:
        state = self._posture.possible(reference(step * AHEAD_STEP))
        v, _, omega = state.twist.tolist()
        return self._posture.steady(v, omega, state.joints)

    def _following(self, reference: Reference, step: int) -> SteadyMotion:
        state = self._posture.possible(reference(step * AHEAD_STEP))
        slope = self._slopes[entry_below(self._speeds, float(state.twist[0]))]
        return self._posture.follow(self._motions[-1], state, slope)


def entry_below(speeds: Sequence[float], v: float) -> int:
    """Return the entry of a table of speeds below one (m/s), not the last."""
    return min(max(bisect_left(speeds, v) - 1, 0), len(speeds) - 2)
