"""All the numbers of a robot that its dynamics are made of, and which of them may differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import UnknownNameError
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.losses import SLIDING_RATE, TURNING_RATE, Losses
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.bodies import MovingBody, moving_bodies
from rpctl.simulation.compiled.inertias import NUMBERS, ZZ, felt, inertial_numbers, ten_of
from rpctl.simulation.compiled.parameters import Varied
from rpctl.simulation.compiled.rolling_numbers import rolling_numbers, varied_rolling
from rpctl.simulation.compiled.scalars import cleaned


class RobotNumbers:
    """Reads the numbers of a robot and of others of the same structure.

    Args:
        robot: The robot.
        bodies: Its bodies.

    Attributes:
        nominal: The robot's own, by name.
    """

    def __init__(self, robot: Robot, bodies: Sequence[MovingBody]) -> None:
        self.robot, self.bodies = robot, bodies
        inertia = cleaned(felt(bodies, inertial_numbers(robot)))
        unlike = np.count_nonzero(np.delete(inertia, ZZ, axis=1), axis=1)
        carriers = {body.parent for body in bodies}
        self._round = np.array(
            [
                not (unlike[i] or body.slides or i in carriers or body.entry is None)
                for i, body in enumerate(bodies)
            ]
        )
        self.nominal = self.of(robot)

    def of(self, robot: Robot, inertias: Array | None = None) -> dict[str, Array]:
        """Return the numbers of a robot, by name.

        Args:
            robot: The robot.
            inertias: Ten numbers of each body (..., n, 10) in the axes of Pinocchio's joints, in
                stacks; None: the robot's own.
        """
        bodies = self.bodies if robot.model is self.robot.model else moving_bodies(robot)
        own = inertial_numbers(robot) if inertias is None else inertias
        joints = list(robot.model.jointPlacements)[ROOT_JOINT:]
        places = np.array([placement.homogeneous for placement in joints])
        places[self._round] = 0.0  # where a round wheel is, its carrier's inertia has
        still, losses = np.zeros(self.robot.nv), robot.losses
        if losses is None:
            rate = np.full(self.robot.nv, TURNING_RATE)
            rate[[body.index for body in self.bodies if body.slides]] = SLIDING_RATE
            losses = Losses(still, still, rate)
        found = {"inertia": cleaned(felt(bodies, own)), "place": places}
        found |= {"damping": losses.damping, "friction": losses.friction, "rate": losses.rate}
        found["armature"] = robot.armature
        return found | rolling_numbers(robot, self.robot)

    def varied(self, varied: Varied) -> dict[str, NDArray[np.bool_]]:
        """Return which of the numbers are not the same in all robots, by name.

        Raises:
            UnknownNameError: No joint has such a name.
        """
        for name in (*varied.bodies, *varied.losses):
            if name not in (body.joint for body in self.bodies):
                raise UnknownNameError("joint", name, [body.joint for body in self.bodies])
        lossy = np.zeros(self.robot.nv, bool)
        lossy[[self.robot.velocity_index(name) for name in varied.losses]] = True
        found = {"damping": lossy, "friction": lossy, "inertia": self._varied_inertias(varied)}
        return found | (varied_rolling(self.robot) if varied.rolling else {})

    def _varied_inertias(self, varied: Varied) -> NDArray[np.bool_]:
        """Return which of the felt numbers (n, 10) change with those of some bodies."""
        changes = []
        for i, body in enumerate(self.bodies):
            if body.joint not in varied.bodies:
                continue
            kinds = round_about(body) if self._round[i] else np.eye(NUMBERS)
            for kind in kinds:
                change = np.zeros((len(self.bodies), NUMBERS))
                change[i] = kind
                changes.append(felt(self.bodies, change))
        pattern = np.abs(changes).max(axis=0, initial=0.0) if changes else 0.0
        return np.broadcast_to(pattern > 1e-12, (len(self.bodies), NUMBERS))


def round_about(body: MovingBody) -> Array:
    """Return the ten numbers (4, 10) of which those of a body, round about its joint, are sums."""
    axis, still = body.frame[:3, 2], np.zeros(3)
    along, none = np.outer(axis, axis), np.zeros((3, 3))
    return np.array(
        [
            ten_of(1.0, still, none),
            ten_of(0.0, axis, none),
            ten_of(0.0, still, along),
            ten_of(0.0, still, np.eye(3) - along),
        ]
    )
