"""The stage before a law: a base that cannot turn on the spot drives up to its reference."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.control.approach_plan import ApproachPlan, WayLimits, plan_approach
from rpctl.control.error import tracking_error
from rpctl.control.law import Command, KinematicController
from rpctl.drive.steering import heading_radius, turning_radius
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import require_positive
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.model import Robot

RADIUS_RATIO = 1.5  # of the tightest bend: the rest is left for correcting errors
SPEED_FRACTION = 0.8  # of the speed at which the first wheel reaches its limit
RETRY_S = 1.0  # s between two searches for a plan


@dataclass(frozen=True)
class Approach:
    """A stage of its own for large errors of a base that has a tightest bend.

    From far off, a law's feedback asks such a base for turns that its steering does not have, and
    it drives to and fro, or round beside its reference. Where the error exceeds the bounds below,
    the law is given another reference instead: from the robot's own pose and speed along a path
    that the base can steer, up to where the reference itself will be, with the speed and the
    curvature that the reference will have there. That path is a reference like any other, with its
    exact derivatives, so every law tracks it with small errors. Once it joins, the law is given its
    reference again.

    A base whose wheels all steer has the stage, too: from a spin about a far place its steering
    leads home only slowly, because it must keep clear of singular angles. It drives there first.

    A base that turns on the spot without steering needs no such stage.

    Attributes:
        distance: Position error from which on the base drives up to its reference, m.
        heading: Heading error, likewise, rad.
        haste: Largest speed on the way, over the reference's own largest.
    """

    distance: float = 0.5
    heading: float = 0.8
    haste: float = 2.0

    def __post_init__(self) -> None:
        """Refuse bounds that no error keeps."""
        for name in ("distance", "heading", "haste"):
            require_positive(name, getattr(self, name))

    def start(self, dynamics: ReducedDynamics, law: KinematicController) -> KinematicController:
        """Return a law with this stage before it; the law itself for a base that needs none.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            law: What tracks the references.
        """
        stage = self.stage(dynamics)
        return law if stage is None else ApproachingLaw(stage, law)

    def stage(self, dynamics: ReducedDynamics) -> ApproachStage | None:
        """Return the stage of one run; None for a base that needs none.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
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
        settings: When, and how fast.
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
            dynamics: The robot's dynamics.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
            lag: How much later than at its time the law reads what it tracks, s. The way begins,
                and meets the reference, in the law's own time.
        """
        read = self.reading(reference)
        if t - self.searched_at < RETRY_S or not self._far(dynamics.robot, read(t - lag), q):
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

    def _far(self, robot: Robot, state: ReferenceState, q: Array) -> bool:
        x1, x2, x3 = tracking_error(robot, state, q)[:3]
        return bool(
            math.hypot(x1, x2) > self._settings.distance or abs(x3) > self._settings.heading
        )


class ApproachingLaw:
    """A law on one robot with :class:`Approach` before it.

    Args:
        stage: Says what the law tracks.
        law: What tracks it.
    """

    def __init__(self, stage: ApproachStage, law: KinematicController) -> None:
        self._stage, self._law = stage, law

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the law's command for the reference, or for the way up to it.

        Args:
            dynamics: The robot's dynamics.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """
        return self._law(dynamics, self._stage(dynamics, reference, t, q, nu), t, q, nu)

    def report(self) -> dict[str, float]:
        """Return the law's report, and how many approaches were planned."""
        return {**self._law.report(), "approaches": self._stage.approaches}


def _full_speed(dynamics: ReducedDynamics, q: Array) -> float:
    """Return the speed (m/s) straight on at which the base may drive, with room to correct."""
    limits = dynamics.robot.velocity_limits
    straight = np.abs(dynamics.actuation(q)[0])
    moving = (straight > 0.0) & np.isfinite(limits)
    return SPEED_FRACTION * float((limits[moving] / straight[moving]).min(initial=math.inf))
