"""Whose an engine's contact points are, and how a wheel's moves over the ground."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.drive.wheels import mostly_left
from rpctl.dynamics.supports import find_supports
from rpctl.equivalence.contact.shapes import support_shapes
from rpctl.robot.model import Robot

NEAR_M = 0.02  # m: how far off the edge of a support's shape its contact may lie

Point = tuple[str, Array, float]  # link that touches the ground, where (3,), upward force N


@dataclass(frozen=True)
class LinkMotion:
    """Motion of a link's frame: rotation (3, 3), origin (3,) m, its velocity (3,) and ω (3,)."""

    rotation: Array
    origin: Array
    velocity: Array
    omega: Array


class NamedContacts:
    """The contacts of a robot by name, and which of them an engine's point belongs to.

    Args:
        robot: The robot.

    Attributes:
        names: The wheels' joints, then the supports, as ``Contacts.names``.
    """

    def __init__(self, robot: Robot) -> None:
        wheels = [wheel.joint for wheel in robot.drive.wheels]
        supports = find_supports(robot)
        self.names = (*wheels, *(part.name for part in supports.parts))
        self._wheel_of = {
            link: wheels.index(joint)
            for joint in wheels
            for link, _ in robot.tree.rigid_links(robot.description.joint[joint].child)
        }
        self._supports_of: dict[str, list[tuple[int, Array, float]]] = {}
        for name, link, shape in support_shapes(robot, supports):
            row = (self.names.index(name), shape.origin[:3, 3], max(shape.size) + NEAR_M)
            self._supports_of.setdefault(link, []).append(row)

    @property
    def carriers(self) -> tuple[str, ...]:
        """Links that carry supports."""
        return tuple(self._supports_of)

    def loads(self, points: Iterable[Point], frames: dict[str, tuple[Array, Array]]) -> Array:
        """Return the load of each contact (n,), N; what touches elsewhere is nobody's.

        Args:
            points: Contact points with the ground.
            frames: Rotation (3, 3) and origin (3,), m, of the links in :attr:`carriers`.
        """
        load = np.zeros(len(self.names))
        for link, place, force in points:
            index = self._wheel_of.get(link)
            if index is None:
                index = self._support(link, place, frames)
            if index is not None:
                load[index] += force
        load.setflags(write=False)
        return load

    def _support(
        self, link: str, place: Array, frames: dict[str, tuple[Array, Array]]
    ) -> int | None:
        """Return the support of a link that is nearest to a point, if one is near."""
        nearest, found = math.inf, None
        for index, centre, reach in self._supports_of.get(link, ()):
            rotation, origin = frames[link]
            distance = math.dist((rotation @ centre + origin)[:2], place[:2])
            if distance < min(nearest, reach):
                nearest, found = distance, index
        return found


def wheel_slip(robot: Robot, wheel: Wheel, motion: LinkMotion) -> tuple[float, float]:
    """Return the velocity (m/s) of a wheel's lowest point: along its rolling direction, leftward.

    The rolling direction is level and across the axle; with all joints at 0 the axle
    that points left fixes its sign.

    Args:
        robot: The robot.
        wheel: The wheel.
        motion: Of the link that its joint turns.
    """
    axle = motion.rotation @ np.array(wheel.axis)
    arm = wheel.offset * axle - np.array([0.0, 0.0, wheel.radius])
    velocity = motion.velocity + np.cross(motion.omega, arm)
    left = _leftward(robot, wheel) * axle[:2] / math.hypot(*axle[:2])
    return float(velocity[0] * left[1] - velocity[1] * left[0]), float(velocity[:2] @ left)


def _leftward(robot: Robot, wheel: Wheel) -> float:
    """Return the sign that turns a wheel's axle to the left, with all joints at 0."""
    return math.copysign(1.0, mostly_left(robot.tree.axis(robot.description.joint[wheel.joint])))
