"""How fast a robot can go through its reference: the largest pace at instants ahead.

At a time rate p (the pace), speeds scale with p and the part of the efforts due to motion with p².
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.preview import Memory, Preview, ReferencePoint
from rpctl.control.horizon.settings import Bounds
from rpctl.drive.steering import trailing_positions
from rpctl.reference.quasi_velocities import direction, trailing

LIMIT_FRACTION = 0.9  # of the margins at rest: the remainder is left for correcting errors
MAX_PACE = 1.5  # largest pace, while a lag is made up


class PaceLimit(NamedTuple):
    """What an instant of the reference asks of the robot."""

    pace: float  # the largest at which it can be followed
    speed: float  # of the base, m/s


class PaceLimits:
    """The largest pace at multiples of the prediction's step, each computed once.

    Args:
        model: The prediction's model.
        forces: Efforts and ground reactions; its contacts become those of the reference's posture.
        bounds: Bounds of the motion.
        preview: Reads the reference.
    """

    def __init__(self, model: Model, forces: ForceModel, bounds: Bounds, preview: Preview) -> None:
        self._model, self._forces, self._preview = model, forces, preview
        self._efforts, self._rates = bounds.efforts(model.robot), bounds.rates(model.robot)
        self._limits = Memory[int, PaceLimit]()

    def forget(self) -> None:
        """Forget the limits: they were of another reference."""
        self._limits.forget()

    def between(self, first: int, last: int) -> list[PaceLimit]:
        """Return the limits at these multiples of the step, both included."""
        return [self._limits(index, self._limit) for index in range(first, last + 1)]

    def _limit(self, index: int) -> PaceLimit:
        point, model = self._preview(index * self._model.dt), self._model
        posture = np.concatenate([point.angles, point.state.joints])
        q = model.configuration(posture, casters=trailing(model.robot, point.state))
        self._forces.update_contacts(self._with_idle_casters(q, point))
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
        forces = self._forces.value(q, nu, nu_dot)
        limited, limit_values = self._efforts
        tau = self._forces.efforts(forces)[limited, 0] / limit_values
        margins = [1.0 - tau, 1.0 + tau]
        if self._forces.rows:
            margins.append(self._forces.ground(forces)[:, 0])
        return np.concatenate(margins)
