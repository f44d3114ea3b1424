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
        drive, joints = dynamics.robot.drive, dynamics.robot.description.joint
        find = turning_radius if drive.has_axle else heading_radius
        radius = find(drive, joints)
        if radius == 0.0 or math.isinf(radius):
            return law
        return ApproachingLaw(self, law, RADIUS_RATIO * radius)


class ApproachingLaw:
    """:class:`Approach` before a law on one robot, with its plan.

    Args:
        settings: When, and how fast.
        law: What tracks the plan and the reference.
        radius: Of the plan's arcs, m.
    """

    def __init__(self, settings: Approach, law: KinematicController, radius: float) -> None:
        self._settings, self._law, self._radius = settings, law, radius
        self._plan: ApproachPlan | None = None
        self._searched_at = -math.inf
        self.approaches = 0

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
        read = self._reading(reference)
        if self._far(dynamics.robot, read(t), q) and t - self._searched_at >= RETRY_S:
            self._searched_at = t
            limits = WayLimits(self._radius, self._settings.haste, _full_speed(dynamics, q))
            plan = plan_approach(dynamics, reference, t, q, nu, limits)
            if plan is not None:
                self._plan, self.approaches = plan, self.approaches + 1
                read = self._reading(reference)
        return self._law(dynamics, read, t, q, nu)

    def report(self) -> dict[str, float]:
        """Return the law's report, and how many approaches were planned."""
        return {**self._law.report(), "approaches": self.approaches}

    def _reading(self, reference: Reference) -> Reference:
        """Return what the law is to track: the plan as long as it lasts, then the reference."""
        plan = self._plan

        def read(t: float) -> ReferenceState:
            state = reference(t)
            return state if plan is None or t >= plan.joins_at else plan(t, state)

        return read

    def _far(self, robot: Robot, state: ReferenceState, q: Array) -> bool:
        x1, x2, x3 = tracking_error(robot, state, q)[:3]
        return bool(
            math.hypot(x1, x2) > self._settings.distance or abs(x3) > self._settings.heading
        )


def _full_speed(dynamics: ReducedDynamics, q: Array) -> float:
    """Return the speed (m/s) straight on at which the base may drive, with room to correct."""
    robot = dynamics.robot
    limits = np.array([robot.description.joint[name].velocity for name in robot.actuators])
    straight = np.abs(dynamics.actuation(q)[0])
    moving = (straight > 0.0) & np.isfinite(limits)
    return SPEED_FRACTION * float((limits[moving] / straight[moving]).min(initial=math.inf))
