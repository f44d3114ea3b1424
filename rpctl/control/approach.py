"""The stage before a law: a base that cannot turn on the spot drives up to its reference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.law import Command, TrackingController
from rpctl.control.smooth_path import SmoothPath, shortest_paths, smooth_path
from rpctl.drive.steering import heading_radius, turning_radius
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.reference.motion import Reference, ReferenceState, direction
from rpctl.reference.paths import smooth_step
from rpctl.robot.model import Robot

LOOK_AHEAD_S = 120.0  # s: a reference that cannot be met by then is not
STRIDE_S = 0.5  # s between the instants at which a meeting is looked at
TRANSITION_RATIO = 0.4  # of the radius: how long a step of the curvature is
ACCELERATION = 0.4  # m/s²: the largest along the way
ACROSS = 0.5  # m/s²: the largest across it, in its arcs
SMOOTH_STEP_SLOPE = 1.875  # largest slope of S(u) = u³ (10 − 15 u + 6 u²)
SPIN_RADIUS = 1e-3  # m: a reference that turns about a point nearer than this spins
RADIUS_RATIO = 1.5  # of the tightest bend: the rest is left for correcting errors
SPEED_FRACTION = 0.8  # of the speed at which the first wheel reaches its limit
RETRY_S = 1.0  # s between two searches for a plan


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
            rise = smooth_step(min(max(u, 0.0), 1.0))
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
    """
    pose, twist = dynamics.robot.base_pose(q), dynamics.twist(q, nu)
    steered = dynamics.twist(q, np.eye(dynamics.robot.dof)[0])[2]  # curvature, of a forward motion
    ahead = np.arange(t + STRIDE_S, t + LOOK_AHEAD_S, STRIDE_S).tolist()
    states = [reference(at) for at in ahead]
    largest = max(_speed(state, limits.radius) for state in states)
    fastest = min(
        limits.haste * largest, limits.fastest, max(math.sqrt(ACROSS * limits.radius), largest)
    )
    ramp = SMOOTH_STEP_SLOPE * fastest / ACCELERATION
    for at, state in zip(ahead, states, strict=True):
        v, _, omega = direction(state)[0]
        sense, bend = (1.0, 0.0) if _spins(v, omega) else (math.copysign(1.0, v), omega / abs(v))
        start, goal = _driven(pose, sense), _driven(state.pose, sense)
        first, last = max(sense * twist[0], 0.0), abs(float(state.twist[0]))
        time = at - t
        change = min(ramp, 0.5 * time)
        changing = 0.5 * change * (first + last)  # m: less than a way has that does not turn back
        longest = changing + fastest * (time - change)
        if not changing < sum(shortest_paths(start, goal, limits.radius)[0].lengths) <= longest:
            continue
        ends = max(min(sense * steered, 1.0 / limits.radius), -1.0 / limits.radius), bend
        path = smooth_path(
            start, goal, ends, limits.radius, TRANSITION_RATIO * limits.radius, longest
        )
        if path is not None:
            cruise = (path.length - changing) / (time - change)
            return ApproachPlan(path, Pace((first, cruise, last), change, time), sense, t)
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


@dataclass(frozen=True)
class Approach(Record):
    """Settings of the approach: what a base with a smallest turning radius does about large errors.

    If the error is large, the feedback of a law asks such a base for turns that its steering cannot
    make, and the base drives back and forth or circles beside its reference. If the error exceeds
    the bounds below, an approach path replaces the reference: it leads from the robot's pose and
    speed, with curvatures that the base can steer, to a point where the reference will be, and
    arrives with the speed and the curvature that the reference will have there. The path is a
    reference with exact derivatives, so every law tracks it with small errors. Where it ends, the
    law gets its own reference again.

    A base whose wheels all steer also uses the approach: in a spin about a distant point its
    steering reduces the error only slowly, because it must avoid singular angles.

    A base that turns on the spot without steering needs no approach.
    """

    distance: Annotated[
        float,
        POSITIVE,
        Setting("m", "", "Position error beyond which the base drives an approach."),
    ] = 0.5
    heading: Annotated[
        float, POSITIVE, Setting("rad", "", "Heading error beyond which it does.")
    ] = 0.8
    haste: Annotated[
        float,
        POSITIVE,
        Setting("", "", "Largest speed of the approach, as a multiple of the reference's largest."),
    ] = 2.0

    def start(self, dynamics: ReducedDynamics, law: TrackingController) -> TrackingController:
        """Return a controller that adds the approach to another; that one if the base needs none.

        Args:
            dynamics: The dynamics of the controller's model.
            law: The controller that tracks the references.
        """
        stage = self.stage(dynamics)
        return law if stage is None else ApproachingLaw(stage, law)

    def stage(self, dynamics: ReducedDynamics) -> ApproachStage | None:
        """Return the approach of one run; None for a base that needs none.

        Args:
            dynamics: The dynamics of the controller's model.
        """
        drive, joints = dynamics.robot.drive, dynamics.robot.description.joint
        find = turning_radius if drive.has_axle else heading_radius
        radius = find(drive, joints)
        if radius == 0.0 or math.isinf(radius):
            return None
        return ApproachStage(self, RADIUS_RATIO * radius)


@dataclass(frozen=True, eq=False)
class WayToReference:
    """A reference that begins with the way up to another one.

    Attributes:
        plan: The way.
        reference: What it leads to.
    """

    plan: ApproachPlan
    reference: Reference

    def __call__(self, t: float) -> ReferenceState:
        """Return the state at a time (s)."""
        state = self.reference(t)
        return state if t >= self.plan.joins_at else self.plan(t, state)


class ApproachStage:
    """:class:`Approach` of one robot, with its plan.

    Args:
        radius: Of the plan's arcs, m.

    Attributes:
        searched_at: When a plan was looked for last, s; −inf before.
        approaches: How many plans were found.
    """

    def __init__(self, settings: Approach, radius: float) -> None:
        self._settings, self._radius = settings, radius
        self._way: WayToReference | None = None
        self.searched_at = -math.inf
        self.approaches = 0

    def __call__(
        self,
        dynamics: ReducedDynamics,
        reference: Reference,
        t: float,
        q: Array,
        nu: Array,
        lag: float = 0.0,
    ) -> Reference:
        """Return what a law is to track: the way while it lasts, then the reference.

        It is the same object until there is another way, and the reference itself before the first.

        Args:
            lag: How much later than at its time the law reads what it tracks, s. The way begins,
                and meets the reference, in the law's own time.
        """
        read = self.reading(reference)
        if not self.looks(dynamics.robot, t, read(t - lag).pose, q):
            return read
        self.searched_at = t
        limits = WayLimits(self._radius, self._settings.haste, _full_speed(dynamics, q))
        plan = plan_approach(dynamics, reference, t - lag, q, nu, limits)
        if plan is None:
            return read
        self._way, self.approaches = WayToReference(plan, reference), self.approaches + 1
        return self._way

    def reading(self, reference: Reference) -> Reference:
        """Return what is tracked, wherever the robot is by now."""
        way = self._way
        if way is None:
            return reference
        if way.reference is not reference:
            way = self._way = WayToReference(way.plan, reference)
        return way

    def looks(self, robot: Robot, t: float, wanted: Array, q: Array) -> bool:
        """Return whether a way is looked for at a time (s): the base is far, and it is due.

        Args:
            wanted: Pose of P on what is tracked, first of its numbers.
        """
        if t - self.searched_at < RETRY_S:
            return False
        dx, dy, turned = (wanted[:3] - robot.base_pose(q)).tolist()
        far = math.hypot(dx, dy) > self._settings.distance
        return far or abs(math.remainder(turned, math.tau)) > self._settings.heading


class ApproachingLaw:
    """A law on one robot with :class:`Approach` before it."""

    def __init__(self, stage: ApproachStage, law: TrackingController) -> None:
        self._stage, self._law = stage, law

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the law's command for the reference, or for the way up to it."""
        return self._law(dynamics, self._stage(dynamics, reference, t, q, nu), t, q, nu)

    def row(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Array:
        """Return the row of what is tracked at a time (s): the reference, or the way up to it."""
        followed = self._stage.reading(reference)
        row = self._law.row(dynamics, followed, t, q, nu)
        if self._stage.looks(dynamics.robot, t, row, q):
            followed = self._stage(dynamics, reference, t, q, nu)
            row = self._law.row(dynamics, followed, t, q, nu)
        return row

    def report(self) -> dict[str, float]:
        """Return the law's report, and how many approaches were planned."""
        return {**self._law.report(), "approaches": self._stage.approaches}


def _full_speed(dynamics: ReducedDynamics, q: Array) -> float:
    """Return the speed (m/s) straight on at which the base may drive, with room to correct."""
    limits = dynamics.robot.velocity_limits
    straight = np.abs(dynamics.actuation(q)[0])
    moving = (straight > 0.0) & np.isfinite(limits)
    return SPEED_FRACTION * float((limits[moving] / straight[moving]).min(initial=math.inf))
