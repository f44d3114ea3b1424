"""The reference ahead, each instant read once, and how fast a robot can go through it.

Successive solves ask about the same instants again: their periods divide the prediction's steps. At
a time rate p (the pace), speeds scale with p and the part of the efforts due to motion with p².
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.settings import Bounds
from rpctl.drive.steering import trailing_positions
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.quasi_velocities import direction, reference_rates, steering, trailing
from rpctl.robot.model import Robot

TIME_DIGITS = 11  # of a time in s: two sums that mean the same instant differ by rounding
MAX_REMEMBERED = 4000  # instants: 20 steps of .1 s at a period of .5 ms
LIMIT_FRACTION = 0.9  # of the margins at rest: the remainder is left for correcting errors
MAX_PACE = 1.5  # largest pace, while a lag is made up


class ReferencePoint(NamedTuple):
    """The reference at one instant, in the robot's quasi-velocities."""

    state: ReferenceState
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)
    angles: Array  # (n_steered,) rad, of the steered joints


class Preview:
    """Reads the reference of one robot, as a function of time.

    Args:
        reference: The reference; None: :meth:`follow` sets it.
    """

    def __init__(self, robot: Robot, reference: Reference | None = None) -> None:
        self._robot, self._reference = robot, reference
        self._points = lru_cache(MAX_REMEMBERED)(self._read)

    def follow(self, reference: Reference) -> bool:
        """Set the reference that is read from now on; return whether it is another."""
        if reference is self._reference:
            return False
        self._reference = reference
        self._points.cache_clear()
        return True

    def __call__(self, t: float) -> ReferencePoint:
        """Return the reference at a time (s), to 1e-11 s.

        Raises:
            ValueError: There is no reference yet.
        """
        return self._points(round(t, TIME_DIGITS))

    def _read(self, t: float) -> ReferencePoint:
        if self._reference is None:
            raise ValueError("no reference to read")
        state = self._reference(t)
        angles = steering(self._robot, state)[0]
        return ReferencePoint(state, *reference_rates(self._robot, state), angles)


class PaceLimit(NamedTuple):
    """What an instant of the reference asks of the robot."""

    pace: float  # the largest at which it can be followed
    speed: float  # of the base, m/s


class PaceLimits:
    """The largest pace at multiples of the prediction's step, each computed once.

    Args:
        forces: Efforts and ground reactions; its contacts become those of the reference's posture.
    """

    def __init__(self, model: Model, forces: ForceModel, bounds: Bounds, preview: Preview) -> None:
        self._model, self._forces, self._preview = model, forces, preview
        self._efforts, self._rates = bounds.efforts(model.robot), bounds.rates(model.robot)
        self._limits = lru_cache(MAX_REMEMBERED)(self._limit)

    def forget(self) -> None:
        """Forget the limits: they were of another reference."""
        self._limits.cache_clear()

    def between(self, first: int, last: int) -> list[PaceLimit]:
        """Return the limits at these multiples of the step, both included."""
        return [self._limits(index) for index in range(first, last + 1)]

    def _limit(self, index: int) -> PaceLimit:
        point, model = self._preview(index * self._model.dt), self._model
        posture = np.concatenate([point.angles, point.state.joints])
        q = model.configuration(posture, casters=trailing(model.robot, point.state))
        if self._forces.ground is not None:
            self._forces.ground.update(self._with_idle_casters(q, point))
        still = np.zeros_like(point.nu)
        rest = self._margins(q, still, still)
        used = rest - self._margins(q, point.nu, point.nu_dot)
        limiting = (rest > 0.0) & (used > 0.0)
        square = (LIMIT_FRACTION * rest[limiting] / used[limiting]).min(initial=MAX_PACE**2)
        B = model.dynamics.actuation(q)
        limited, limit_values = self._rates
        speed = (np.abs(B.T[limited] @ point.nu) / limit_values).max(initial=1.0 / MAX_PACE)
        return PaceLimit(
            min(math.sqrt(square), 1.0 / float(speed)), math.hypot(*point.state.twist[:2])
        )

    def _with_idle_casters(self, q: Array, point: ReferencePoint) -> Array:
        """Return q (nq,) with the casters that nothing drives trailing behind the motion."""
        robot = self._model.robot
        idle = robot.drive.idle_casters
        if not idle:
            return q
        q, twist = q.copy(), robot.root_velocity @ direction(point.state)[0]
        positions = trailing_positions(robot.drive, twist, idle).tolist()
        for swivel, position in zip(idle, positions, strict=True):
            robot.set_joint(q, swivel.joint, position)
        return q

    def _margins(self, q: Array, nu: Array, nu_dot: Array) -> Array:
        """Return the margins of efforts, tipping and slipping, each as a fraction of its limit."""
        forces = self._forces.at(q, nu, nu_dot)
        limited, limit_values = self._efforts
        tau = self._forces.efforts(forces)[limited, 0] / limit_values
        margins = [1.0 - tau, 1.0 + tau]
        if self._forces.ground is not None:
            margins.append(self._forces.ground(forces)[:, 0])
        return np.concatenate(margins)
