"""The way up to a moving reference: a path that the base can steer, timed so that both meet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.dubins import shortest_paths
from rpctl.control.smooth_path import SmoothPath, smooth_path
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.quasi_velocities import direction
from rpctl.reference.smooth_step import smooth_step

LOOK_AHEAD_S = 120.0  # s: a reference that cannot be met by then is not
STRIDE_S = 0.5  # s between the instants at which a meeting is looked at
TRANSITION_RATIO = 0.4  # of the radius: how long a step of the curvature is
ACCELERATION = 0.4  # m/s²: the largest along the way
ACROSS = 0.5  # m/s²: the largest across it, in its arcs
SMOOTH_STEP_SLOPE = 1.875  # largest slope of S(u) = u³ (10 − 15 u + 6 u²)
SPIN_RADIUS = 1e-3  # m: a reference that turns about a point nearer than this spins
ROUNDING = 1e-12  # m/s


class WayLimits(NamedTuple):
    """What the way may ask for."""

    radius: float  # m, of its arcs
    haste: float  # largest speed over the reference's own largest
    fastest: float  # m/s, of the robot


@dataclass(frozen=True)
class Pace:
    """A speed that changes smoothly from one value to a second and at last to a third.

    Attributes:
        speeds: At the start, on the way and at the end, m/s.
        ramp: Duration of each change, s.
        duration: Of all, s.
    """

    speeds: tuple[float, float, float]
    ramp: float
    duration: float

    def __call__(self, t: float) -> tuple[float, float, float]:
        """Return the way done (m), the speed and the acceleration at a time (s)."""
        first, cruise, last = self.speeds
        way, speed, change = first * t, first, 0.0
        for step, begins in ((cruise - first, 0.0), (last - cruise, self.duration - self.ramp)):
            u = (t - begins) / self.ramp
            v = min(max(u, 0.0), 1.0)
            rise = smooth_step(v)
            way += step * self.ramp * (rise.area + max(u - 1.0, 0.0))
            speed += step * rise.value
            change += step * rise.slope / self.ramp
        return way, speed, change


@dataclass(frozen=True, eq=False)
class ApproachPlan:
    """A base's way up to its reference.

    Attributes:
        path: The path of P, in the sense in which it is driven.
        pace: How fast.
        sense: 1 forward, −1 backward: then the robot heads against the path.
        begins_at: s.
    """

    path: SmoothPath
    pace: Pace
    sense: float
    begins_at: float

    @property
    def joins_at(self) -> float:
        """When it ends on the reference, s."""
        return self.begins_at + self.pace.duration

    def __call__(self, t: float, state: ReferenceState) -> ReferenceState:
        """Return the state at time t (s): the base's on its way, the joints' of the reference."""
        way, speed, change = self.pace(t - self.begins_at)
        (x, y, heading), (kappa, slope, bend) = self.path(way)
        if self.sense < 0.0:
            heading += math.pi
        sense, square = self.sense, speed**2
        return state._replace(
            pose=np.array([x, y, heading]),
            twist=speed * np.array([sense, 0.0, kappa]),
            twist_dot=change * np.array([sense, 0.0, kappa]) + np.array([0, 0, slope * square]),
            direction=np.array(
                [
                    [sense, 0.0, kappa],
                    [0.0, 0.0, slope * speed],
                    [0.0, 0.0, bend * square + slope * change],
                ]
            ),
        )


def plan_approach(
    dynamics: ReducedDynamics,
    reference: Reference,
    t: float,
    q: Array,
    nu: Array,
    limits: WayLimits,
) -> ApproachPlan | None:
    """Return the way to the first instant at which the base can meet its reference, or None.

    It ends with the speed and the curvature of the reference; where that spins, at rest.

    Args:
        dynamics: The robot's dynamics.
        reference: The reference.
        t: Time, s.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        limits: What the way may ask for.
    """
    pose, twist = dynamics.robot.base_pose(q), dynamics.twist(q, nu)
    steered = dynamics.twist(q, np.eye(dynamics.robot.dof)[0])[2]  # curvature, of a forward motion
    ahead = np.arange(t + STRIDE_S, t + LOOK_AHEAD_S, STRIDE_S).tolist()
    states = [reference(at) for at in ahead]
    largest = max(_speed(state, limits.radius) for state in states)
    across = math.sqrt(ACROSS * limits.radius)
    fastest = min(limits.haste * largest, limits.fastest, max(across, largest))
    if fastest <= ROUNDING:
        return None
    ramp = SMOOTH_STEP_SLOPE * fastest / ACCELERATION
    for at, state in zip(ahead, states, strict=True):
        v, _, omega = direction(state)[0]
        sense, bend = (1.0, 0.0) if _spins(v, omega) else (math.copysign(1.0, v), omega / abs(v))
        start, goal = _driven(pose, sense), _driven(state.pose, sense)
        first, last = max(sense * twist[0], 0.0), abs(float(state.twist[0]))
        shortest = sum(shortest_paths(start, goal, limits.radius)[0].lengths)
        if _pace(shortest, at - t, first, last, ramp, fastest) is None:
            continue
        ends = max(min(sense * steered, 1.0 / limits.radius), -1.0 / limits.radius), bend
        path = smooth_path(start, goal, ends, limits.radius, TRANSITION_RATIO * limits.radius)
        pace = path and _pace(path.length, at - t, first, last, ramp, fastest)
        if path and pace:
            return ApproachPlan(path, pace, sense, t)
    return None


def _speed(state: ReferenceState, radius: float) -> float:
    """Return the speed (m/s) of a reference; of one that spins, that of a bend of this radius."""
    v, omega = abs(float(state.twist[0])), abs(float(state.twist[2]))
    return radius * omega if _spins(v, omega) else v


def _spins(v: float, omega: float) -> bool:
    return abs(v) <= SPIN_RADIUS * abs(omega)


def _driven(pose: Array, sense: float) -> Array:
    """Return a pose (3,) with the heading in which it is driven through."""
    return pose if sense > 0.0 else pose + np.array([0.0, 0.0, math.pi])


def _pace(
    length: float, time: float, first: float, last: float, ramp: float, fastest: float
) -> Pace | None:
    """Return the pace of a way, or None if it is not done in its time.

    Args:
        length: Of the way, m.
        time: That there is for it, s.
        first: Speed at the start, m/s.
        last: Speed at the end, m/s.
        ramp: Longest duration of a change of speed, s.
        fastest: Largest speed, m/s.
    """
    ramp = min(ramp, 0.5 * time)
    cruise = (length - 0.5 * ramp * (first + last)) / (time - ramp)
    return Pace((first, cruise, last), ramp, time) if 0.0 < cruise <= fastest else None
