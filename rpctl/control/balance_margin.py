"""How well a robot that leans is balanced: its linear model tells whether, a simulation how far.

Where λ is an unstable pole of ẋ = A x + B u, the rank of [A − λ 1, B] tells whether efforts reach
what grows (Popov, Belevitch and Hautus); the smallest singular value tells how nearly they do not,
with B in shares of the efforts' limits and x in rad, m and s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.balance import Balance
from rpctl.control.steady_motion import ERRORS, Posture
from rpctl.control.unified import UnifiedKinematic
from rpctl.dynamics.motion import rk4_step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.robot.leaning import MAX_LEAN, MAX_TILT, LeaningRobot, lies

PERIOD, DURATION = 0.004, 2.0  # s, of a simulation
HALVINGS = 6  # of the interval in which the largest tilt is
HOME = 0.5  # of its tilt in the beginning: it has come back below that


class Margin(NamedTuple):
    """What can be balanced."""

    speed: float  # of P, m/s
    controllability: float  # the smallest singular value; inf: nothing grows
    tilt: float  # rad, to either side of its steady motion: the largest from which it returns


def margin(robot: LeaningRobot) -> Margin:
    """Return what the default laws can balance, at rest, or of a bicycle at its own pace.

    Raises:
        UnfitLawError: Nothing drives its wheels, its steering or its arm, or no efforts balance it.
    """
    dynamics = ReducedDynamics(robot)
    posture = Posture(dynamics)
    speed = robot.balancing_speed(MAX_LEAN) if robot.rolls_sideways else 0.0
    steady = posture.steady(speed, 0.0, robot.home)
    A, B = (each[ERRORS:] for each in posture.linear(steady))
    A, B, still = A[:, ERRORS:], B * posture.scale, np.zeros_like(robot.home)
    unstable = [pole for pole in np.linalg.eigvals(A) if pole.real > 0.0]
    reached = (np.hstack([A - pole * np.eye(len(A)), B]) for pole in unstable)
    least = min((float(np.linalg.svd(each)[1][-1]) for each in reached), default=math.inf)

    def ahead(t: float) -> ReferenceState:
        twist = np.array([speed, 0.0, 0.0])
        pose = np.array([speed * t, 0.0, 0.0])
        return ReferenceState(pose, twist, np.zeros(3), robot.home, still, still)

    def returns(tilt: float) -> bool:
        own = steady.posture + tilt * np.eye(len(steady.posture))[0]
        try:
            after = _run(dynamics, ahead, posture.at(own, robot.home), steady.nu)
        except RpctlError:  # it lies, and its wheels have left the ground
            return False
        return not lies(after) and abs(posture.of(after)[0] - steady.posture[0]) < HOME * abs(tilt)

    return Margin(speed, least, min(_largest(returns, side) for side in (1.0, -1.0)))


def _run(
    dynamics: ReducedDynamics, ahead: Callable[[float], ReferenceState], q: Array, nu: Array
) -> Array:
    """Return q (nq,) after a simulation with the default laws, or where it lies."""
    wish, law = UnifiedKinematic().start(dynamics, PERIOD), Balance().start(dynamics, PERIOD)
    for k in range(round(DURATION / PERIOD)):
        tau = law(dynamics, q, nu, wish(dynamics, ahead, k * PERIOD, q, nu)).tau
        q, nu, *_ = rk4_step(dynamics, q, nu, tau, PERIOD)
        if lies(q):
            break
    return q


def _largest(returns: Callable[[float], bool], side: float) -> float:
    """Return the largest tilt (rad) to a side, 1 or −1, from which it returns."""
    low, high = 0.0, MAX_TILT
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if returns(side * middle) else (low, middle)
    return low
