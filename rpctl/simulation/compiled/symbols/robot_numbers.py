"""All the numbers of a robot that its dynamics are made of, and which of them may differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.losses import SLIDING_RATE, TURNING_RATE, Losses
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.symbols.bodies import MovingBody, moving_bodies
from rpctl.simulation.compiled.symbols.inertias import NUMBERS, ZZ, felt, inertias_of
from rpctl.simulation.compiled.symbols.parameters import Varied
from rpctl.simulation.compiled.symbols.rolling_numbers import (
    rolling_numbers,
    solved_rows,
    varied_rolling,
)
from rpctl.simulation.compiled.symbols.scalars import cleaned


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
        self._places, self._rows = _places(robot), solved_rows(robot)
        inertia = cleaned(felt(bodies, inertias_of(robot)))
        unlike = np.count_nonzero(np.delete(inertia, ZZ, axis=1), axis=1)
        carriers = {body.parent for body in bodies}
        self._round = np.array(
            [
                not (unlike[i] or body.slides or i in carriers or body.entry is None)
                for i, body in enumerate(bodies)
            ]
        )
        self.nominal = {name: cleaned(array) for name, array in self.of(robot).items()}

    def of(self, robot: Robot, inertias: Array | None = None) -> dict[str, Array]:
        """Return the numbers of a robot, by name.

        Args:
            robot: The robot.
            inertias: Pseudo-inertias of the bodies (..., n, 4, 4) in the axes of Pinocchio's
                joints, in stacks; None: the robot's own.

        Raises:
            RpctlError: It has other joints.
        """
        if list(robot.model.names) != list(self.robot.model.names):
            raise RpctlError(f"{robot.name} is no variant of {self.robot.name}: its joints differ")
        places = _places(robot)
        moved = not np.array_equal(places, self._places)
        bodies = moving_bodies(robot) if moved else self.bodies
        own = inertias_of(robot) if inertias is None else inertias
        places[self._round] = 0.0  # where a round wheel is, its carrier's inertia has
        still, losses = np.zeros(self.robot.nv), robot.losses
        if losses is None:
            rate = np.full(self.robot.nv, TURNING_RATE)
            rate[[body.index for body in self.bodies if body.slides]] = SLIDING_RATE
            losses = Losses(still, still, rate)
        found = {"inertia": felt(bodies, own), "place": places}
        found |= {"damping": losses.damping, "friction": losses.friction, "rate": losses.rate}
        found |= {
            "armature": robot.armature,
            "lift": -np.array(robot.model.gravity.linear),
            "point": np.array([*robot.drive.point, robot.drive.heading]),
        }
        return found | rolling_numbers(robot, self._rows)

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
        found["lift"] = np.full(3, varied.slope)
        return found | (varied_rolling(self.robot) if varied.rolling else {})

    def _varied_inertias(self, varied: Varied) -> NDArray[np.bool_]:
        """Return which of the felt numbers (n, 10) change with those of some bodies."""
        changes = []
        for i, body in enumerate(self.bodies):
            if body.joint not in varied.bodies:
                continue
            for kind in _round_inertias(body) if self._round[i] else INERTIAS:
                change = np.zeros((len(self.bodies), 4, 4))
                change[i] = kind
                changes.append(felt(self.bodies, change))
        pattern = np.abs(changes).max(axis=0, initial=0.0) if changes else 0.0
        return np.broadcast_to(pattern > 1e-12, (len(self.bodies), NUMBERS))


def _places(robot: Robot) -> Array:
    """Return the poses (n, 4, 4) of the joints in the axes of those before them."""
    joints = list(robot.model.jointPlacements)[ROOT_JOINT:]
    return np.array([placement.homogeneous for placement in joints])


def _round_inertias(body: MovingBody) -> list[Array]:
    """Return the pseudo-inertias of which that of a body, round about its joint, is a sum."""
    axis = np.append(body.frame[:3, 2], 0.0)
    origin = np.array([0.0, 0.0, 0.0, 1.0])
    along, all_round = np.outer(axis, axis), np.diag([1.0, 1.0, 1.0, 0.0])
    return [np.outer(origin, origin), _mixed(axis, origin), along, all_round - along]


def _mixed(a: Array, b: Array) -> Array:
    return np.outer(a, b) + np.outer(b, a)


INERTIAS = [_mixed(np.eye(4)[i], np.eye(4)[j]) for i in range(4) for j in range(i + 1)]
