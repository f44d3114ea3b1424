"""The rows of rolling as the user's file has them: A v = 0, and W v = ν.

Neither Pinocchio nor ``rpctl.dynamics`` is asked. Which speeds are 0, and which are ν, stands here
once; how fast a place moves, each derivation says for itself: by the file's places here, by its
Jacobians in :mod:`rpctl.equivalence.mujoco_engine`.

Each number x of a row stands as x + i ε ẋ with a tiny ε, so that sums and products bring their own
rates, exact to rounding.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Swivel, Wheel
from rpctl.equivalence.tree import Tree
from rpctl.robot.model import Robot

COMPLEX_STEP = 1e-30  # s, ε: its square vanishes against 1, and nothing is subtracted
DOWN = np.array([0.0, 0.0, -1.0])
LEFT = 0.5 * math.pi  # from forward
PLANAR = 3  # entries of a twist


class RollingRows(ABC):
    """The rows of one robot at a state, of which only names and their indices in v are used.

    A row is (nv,): entries of the base's twist (x, y, turn), then joints' rates.

    Args:
        tree: Its file's tree, with the drive as the file's shapes have it.
        index: Places of the moving joints in v.

    Attributes:
        course: Angle of the root link in the axes of the twist, rad, at the state.
        positions: Of the moving joints there, rad or m.
    """

    course: complex = 0.0

    def __init__(self, robot: Robot, tree: Tree, index: Mapping[str, int]) -> None:
        self._robot, self._tree, self._drive = robot, tree, tree.reading.drive
        self._index, self._unit = index, np.eye(robot.nv)
        self.positions: Mapping[str, complex] = {}

    @abstractmethod
    def place(self, at: tuple[float, float]) -> Array:
        """Return the rows (2, nv) of the velocity of a place of the root link, m there."""

    @abstractmethod
    def pivot(self, swivel: Swivel) -> Array:
        """Return the rows (2, nv) of the velocity of a place on a swivel's axis."""

    @abstractmethod
    def held(self, wheel: Wheel) -> Array:
        """Return the row (nv,) of the contact of a wheel on the root link, as the ground holds."""

    def turned(self, swivel: Swivel) -> tuple[complex, Array]:
        """Return a swivel's heading, rad, and the row (nv,) of the rate at which that turns."""
        angle, swing = self.course + swivel.heading, self._unit[2]
        for each in self._drive.chain(swivel):
            angle += each.sign * self.positions[each.joint]
            swing = swing + each.sign * self._unit[self._index[each.joint]]
        return angle, swing

    def contact(self, swivel: Swivel, place: tuple[float, float], aside: float = 0.0) -> Array:
        """Return the row (nv,) of the velocity of a place that turns with a swivel.

        Args:
            place: Distances (m) ahead of the swivel's axis and to its left, along its heading.
            aside: Angle (rad) from its heading to the direction of the velocity.
        """
        angle, swing = self.turned(swivel)
        d = turned((1.0, 0.0), angle + aside)
        return np.asarray(d @ self.pivot(swivel) + _moment(turned(place, angle), d) * swing)

    def constraints(self) -> Iterator[Array]:
        """Yield the rows of A: speeds that are 0.

        A wheel's is that of its contact along the direction in which it stands still, a swivel's
        that of its contact to the left, an axle's that of P. Swivels may share one.
        """
        drive, unit, index = self._drive, self._unit, self._index
        for joint in self._robot.mimics:
            leader, factor = self._tree.leader(joint.name)
            followed = factor * unit[index[leader]] if leader in index else 0.0
            yield unit[index[joint.name]] - followed
        if drive.type == "fixed":
            yield from unit[:PLANAR]
        if drive.has_axle:
            yield self._axle()
        yield from (self.held(wheel) for wheel in drive.wheels if wheel.swivel is None)
        lateral = dict[str, Array]()
        for swivel in drive.swivels:
            for at in drive.carried(swivel):
                wheel = drive.wheels[at]
                rolled = self._tree.wheels[wheel.joint].lever * unit[index[wheel.joint]]
                yield self.contact(swivel, (swivel.trail, wheel.lateral)) - rolled
            if swivel.role == "follower":
                yield self._concurrence(swivel)
            else:
                name = swivel.shares or swivel.joint
                row = self.contact(swivel, (swivel.trail, 0.0), LEFT)
                lateral[name] = lateral.get(name, 0.0) + row
        yield from lateral.values()

    def speeds(self) -> Iterator[Array]:
        """Yield the rows of W: the base's speeds, steered joints' rates, the arm's."""
        drive = self._drive
        if drive.has_axle:
            yield self._along(drive.heading)
        elif drive.steered:
            first = drive.steered[0]
            laterals = [drive.wheels[at].lateral for at in drive.carried(first)]
            yield np.mean([self.contact(first, (0.0, lateral)) for lateral in laterals], axis=0)
        elif drive.wheels:
            yield self._along(0.0)
            yield self._along(LEFT)
        if drive.base_speeds and not drive.steered:
            yield self._unit[2]
        for name in (*(swivel.joint for swivel in drive.steered), *self._robot.joint_names):
            yield self._unit[self._index[name]]

    def _concurrence(self, follower: Swivel) -> Array:
        """Return the row that keeps three axles on one centre: their lateral rows are dependent.

        It is the gradient of those rows' determinant; by its own angle, l changes by −k.
        """
        meeting = [*self._drive.steered, follower]
        row = np.zeros(self._robot.nv, dtype=complex)
        for turning in meeting:
            a, b, c = [
                *([self._axle()[:PLANAR]] if self._drive.has_axle else []),
                *(
                    self.contact(each, (0.0, 0.0), LEFT * (each is not turning))[:PLANAR]
                    for each in meeting
                ),
            ]
            row[self._index[turning.joint]] = -turning.sign * (np.cross(a, b) @ c)
        return row

    def _axle(self) -> Array:
        """Return the row (nv,) of P's velocity to the left."""
        return self._along(self._drive.heading + LEFT)

    def _along(self, angle: float) -> Array:
        """Return the row (nv,) of P's velocity at an angle from the root link's x axis, rad."""
        return np.asarray(turned((1.0, 0.0), self.course + angle) @ self.place(self._drive.point))


class FileRows(RollingRows):
    """The rows as the file's places have them, in the axes of the root link and of ``robot``'s v.

    The velocity of a contact is walked to through however many upright joints lie on the way,

        v_c = v + ω ẑ × p + Σ s_i q̇_i ẑ × (p − o_i).
    """

    def __init__(self, robot: Robot, tree: Tree) -> None:
        index = {name: robot.velocity_index(name) for name in robot.moving_joint_names}
        super().__init__(robot, tree, index)
        self._poses = tree.reading.raw.poses(robot.locked)
        self._swivels = {swivel.joint: swivel for swivel in self._drive.swivels}

    def at(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return A (rows, nv), m/s per unit of v, and Ȧ v (rows,) at q (nq,) and v (nv,)."""
        self.positions = {
            name: self._robot.joint_position(q, name) + 1j * COMPLEX_STEP * v[self._index[name]]
            for name in self._swivels
        }
        return with_rate(self.constraints(), v)

    def place(self, at: tuple[float, float]) -> Array:
        """Return the rows (2, nv) of the velocity of a place of the root link, m there."""
        return self._unit[:2] + np.outer([-at[1], at[0]], self._unit[2])

    def pivot(self, swivel: Swivel) -> Array:
        """Return the rows (2, nv) of the velocity of a swivel's pivot."""
        if swivel.parent is None:
            return self.place(swivel.pivot)
        carrier = self._swivels[swivel.parent]
        angle, swing = self.turned(carrier)
        x, y = turned(np.subtract(swivel.pivot, carrier.pivot), angle - carrier.heading)
        return self.pivot(carrier) + np.outer([-y, x], swing)

    def held(self, wheel: Wheel) -> Array:
        """Return the row (nv,) of the contact of a wheel on the root link, as the ground holds."""
        joint, part = self._tree.reading.raw.joint[wheel.joint], self._tree.wheels[wheel.joint]
        pose, d = self._poses[joint.child], part.direction
        axle = pose[:3, :3] @ joint.axis
        x, y, _ = pose[:3, 3] + part.offset * axle + part.shift
        rolled = (d @ np.cross(axle, part.radius * DOWN)) * self._unit[self._index[wheel.joint]]
        return np.asarray(d[:2] @ self.place((x, y)) + rolled)


def with_rate(rows: Iterable[Array], v: Array) -> tuple[Array, Array]:
    """Return rows (n, nv) without their rates, and these times v (n,)."""
    both = np.array([*rows]).reshape(-1, len(v))
    return both.real, both.imag @ v / COMPLEX_STEP


def turned(vector: Any, angle: Any) -> Array:
    """Return a vector (2,) turned to the left by an angle, rad."""
    (x, y), cos, sin = vector, np.cos(angle), np.sin(angle)
    return np.array([x * cos - y * sin, x * sin + y * cos])


def _moment(place: Any, d: Array) -> Any:
    """Return d · (ẑ × p): the speed along d of a place p that turns at 1 rad/s, m/s."""
    return d[1] * place[0] - d[0] * place[1]
