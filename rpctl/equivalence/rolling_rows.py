"""The rows of rolling as the user's file has them: A(q) v = 0 of the multipliers' path.

Neither Pinocchio nor ``rpctl.dynamics`` is asked. What a wheel asks is the velocity of its contact,
walked to from the root link through however many upright joints lie on the way,

    v_c = v + ω ẑ × p + Σ s_i q̇_i ẑ × (p − o_i),

linear in the base's twist (x, y, turn, in the root link's axes) and the joints' rates. The place p,
the joints' own o_i and the heading turn with the joints, and nothing else moves. So A is analytic
in their positions, and Ȧ v is Im A(q + i ε q̇) v / ε, exact to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Swivel
from rpctl.equivalence.tree import Tree, cross
from rpctl.robot.model import Robot

COMPLEX_STEP = 1e-30  # s: its square vanishes against 1, and nothing is subtracted
DOWN = np.array([0.0, 0.0, -1.0])
LEFT = 0.5 * math.pi  # from forward
PLANAR = 3  # entries of a twist


class RollingRows:
    """The rows of one robot, of which only names and their indices in q and v are used.

    Args:
        tree: Its file's tree, with the drive as the file's shapes have it.
    """

    def __init__(self, robot: Robot, tree: Tree) -> None:
        self._robot, self._tree, self._drive = robot, tree, tree.reading.drive
        self._index = {name: robot.velocity_index(name) for name in robot.moving_joint_names}
        swivels = {swivel.joint: swivel for swivel in self._drive.swivels}
        raw = tree.reading.raw
        self._chains = {
            name: [swivels[j.name] for j in raw.chain(raw.joint[name].child) if j.name in swivels]
            for name in swivels
        }
        self._still = list(self._constant())

    def at(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return A (rows, nv), m/s per unit of v, and Ȧ v (rows,) at q (nq,) and v (nv,)."""
        positions = {
            name: self._robot.joint_position(q, name) + 1j * COMPLEX_STEP * v[self._index[name]]
            for name in self._chains
        }
        A = np.array([*self._still, *self._turning(positions)]).reshape(-1, len(v))
        return A.real, A.imag @ v / COMPLEX_STEP

    def contact(
        self,
        swivel: Swivel,
        positions: Mapping[str, Any],
        place: tuple[float, float],
        aside: float = 0.0,
    ) -> Array:
        """Return the row (nv,) of the velocity of a place that turns with a swivel.

        Args:
            positions: Of the swivels, rad.
            place: Distances (m) ahead of the swivel's axis and to its left, along its heading.
            aside: Angle (rad) from its heading to the direction of the velocity.
        """
        angle, row = swivel.heading, np.zeros(self._robot.nv, dtype=complex)
        point, axes = np.array(swivel.pivot) + _turned(place, angle), list[tuple[Swivel, Array]]()
        for each in reversed(self._chains[swivel.joint]):
            turn, pivot = each.sign * positions[each.joint], np.array(each.pivot)
            point = pivot + _turned(point - pivot, turn)
            axes = [(one, pivot + _turned(at - pivot, turn)) for one, at in (*axes, (each, pivot))]
            angle = angle + turn
        d = _turned((1.0, 0.0), angle + aside)
        row[:PLANAR] = *d, _moment(point, d)
        for each, at in axes:
            row[self._index[each.joint]] = each.sign * _moment(point - at, d)
        return row

    def _turning(self, positions: Mapping[str, Any]) -> Iterator[Array]:
        """Yield the rows of what swivels: each wheel's, each follower's, each lateral force's."""
        lateral = dict[str, Array]()
        for swivel in self._drive.swivels:
            for at in self._drive.carried(swivel):
                wheel = self._drive.wheels[at]
                row = self.contact(swivel, positions, (swivel.trail, wheel.lateral))
                row[self._index[wheel.joint]] = -self._tree.wheels[wheel.joint].lever
                yield row
            if swivel.role == "follower":
                yield self._concurrence(swivel, positions)
            else:
                name = swivel.shares or swivel.joint
                row = self.contact(swivel, positions, (swivel.trail, 0.0), LEFT)
                lateral[name] = lateral.get(name, 0.0) + row
        yield from lateral.values()

    def _concurrence(self, follower: Swivel, positions: Mapping[str, Any]) -> Array:
        """Return the row that keeps three axles on one centre: their lateral rows are dependent.

        It is the gradient of those rows' determinant; by its own angle, l changes by −k.
        """
        meeting = [*self._drive.steered, follower]
        row = np.zeros(self._robot.nv, dtype=complex)
        for turning in meeting:
            a, b, c = [
                *([self._axle()[:PLANAR]] if self._drive.has_axle else []),
                *(
                    self.contact(each, positions, (0.0, 0.0), LEFT * (each is not turning))[:PLANAR]
                    for each in meeting
                ),
            ]
            row[self._index[turning.joint]] = -turning.sign * (cross(a, b) @ c)
        return row

    def _constant(self) -> Iterator[Array]:
        """Yield the rows that nothing turns: of mimics, a fixed base, and wheels it holds."""
        drive, raw, unit = self._drive, self._tree.reading.raw, np.eye(self._robot.nv)
        for joint in self._robot.mimics:
            leader, factor = self._tree.leader(joint.name)
            followed = factor * unit[self._index[leader]] if leader in self._index else 0.0
            yield unit[self._index[joint.name]] - followed
        if drive.type == "fixed":
            yield from unit[:PLANAR]
        if drive.has_axle:
            yield self._axle()
        poses = raw.poses(self._robot.locked)
        for name in (wheel.joint for wheel in drive.wheels if wheel.swivel is None):
            wheel = self._tree.wheels[name]
            pose, d = poses[raw.joint[name].child], wheel.direction
            axle, row = pose[:3, :3] @ raw.joint[name].axis, np.zeros(self._robot.nv)
            place = pose[:3, 3] + wheel.offset * axle + wheel.shift
            row[:PLANAR] = *d[:2], _moment(place, d)
            row[self._index[name]] = d @ cross(axle, wheel.radius * DOWN)
            yield row

    def _axle(self) -> Array:
        """Return the row (nv,) of P's velocity to the left."""
        row, left = np.zeros(self._robot.nv), _turned((0.0, 1.0), self._drive.heading)
        row[:PLANAR] = *left, _moment(self._drive.point, left)
        return row


def _turned(vector: Any, angle: Any) -> Array:
    """Return a vector (2,) turned to the left by an angle, rad."""
    (x, y), cos, sin = vector, np.cos(angle), np.sin(angle)
    return np.array([x * cos - y * sin, x * sin + y * cos])


def _moment(place: Any, d: Array) -> Any:
    """Return d · (ẑ × p): the speed along d of a place p that turns at 1 rad/s, m/s."""
    return d[1] * place[0] - d[0] * place[1]
