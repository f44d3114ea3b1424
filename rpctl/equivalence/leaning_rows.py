"""The rows of rolling of two wheels that lean, as the user's file has them: A v = 0, and W v = ν.

Neither Pinocchio nor ``rpctl.dynamics`` is asked, and nothing is differentiated in symbols: how a
wheel's contact moves is written down as rows, from how its axle turns. A row stands as
x + i ε ẋ with a tiny ε, so that sums and products bring their own rates, exact to rounding.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.equivalence.gibbs_appell import GibbsAppell, JointRates, LinkKinematics
from rpctl.equivalence.rolling_rows import COMPLEX_STEP, with_rate
from rpctl.equivalence.tree import Tree, in_rows
from rpctl.robot.leaning import LeaningRobot

FREE = 6  # entries of the root link's velocity
UP = np.array([0.0, 0.0, 1.0])
ROLLS = "roll_rate"  # the quasi-velocity of a bicycle, in the place of a pitch rate


class _Contact(NamedTuple):
    """A wheel's contact: unit directions, and rows (3, nv) of velocities."""

    left: Array  # (3,) its axle
    ahead: Array  # (3,)
    material: Array  # of the point of the wheel that touches the ground
    place: Array  # of the place where it does
    of_left: Array  # of the axle's direction
    of_ahead: Array  # of the direction ahead
    steers: bool


class LeaningRows(ABC):
    """The rows of one robot at a state, of which only names and their indices in v are used.

    Args:
        robot: The robot.
        tree: Its file's tree, with the drive as the file's shapes have it.
        index: Places of the moving joints in v.
    """

    def __init__(self, robot: LeaningRobot, tree: Tree, index: Mapping[str, int]) -> None:
        self._robot, self._tree, self._drive = robot, tree, tree.reading.drive
        self._index, self._unit = index, np.eye(robot.nv)
        self._sides = self._leftwards()

    @abstractmethod
    def wheel(self, wheel: Wheel) -> tuple[Array, Array, Array]:
        """Return a wheel's axle (3,), and rows of its centre's velocity and of its turning."""

    @abstractmethod
    def root(self) -> tuple[Array, Array]:
        """Return the root link's upward axis (3,), and the rows of its turning (3, nv)."""

    def constraints(self) -> Iterator[Array]:
        """Yield the rows of A: speeds that are 0; see :mod:`rpctl.dynamics.leaning`."""
        for joint in self._robot.mimics:
            leader, factor = self._tree.leader(joint.name)
            followed = factor * self._unit[self._index[leader]] if leader in self._index else 0.0
            yield self._unit[self._index[joint.name]] - followed
        contacts = [self._contact(wheel) for wheel in self._drive.wheels]
        beside = [np.cross(UP, each.ahead) @ each.material for each in contacts]
        yield from (each.ahead @ each.material for each in contacts)
        yield from beside if self._rolls else [np.mean(beside, axis=0)]
        yield from (UP @ each.material for each in contacts)

    def speeds(self) -> Iterator[Array]:
        """Yield the rows of W: the base's speeds, then the joints' rates."""
        held = [each for each in map(self._contact, self._drive.wheels) if not each.steers]
        left = np.sum([each.left for each in held], axis=0)
        turning = np.sum([each.of_left for each in held], axis=0)
        level = left[0] * left[0] + left[1] * left[1]
        ahead = np.array([left[1], -left[0], 0.0]) / np.sqrt(level)
        yield ahead @ np.mean([each.place for each in held], axis=0)
        first = held[0]
        if self._rolls:
            yield first.of_left[2] / np.sqrt(1.0 - first.left[2] ** 2)
        else:
            yield (left[0] * turning[1] - left[1] * turning[0]) / level
            yield self._pitching(first)
        for name in (*(each.joint for each in self._drive.steered), *self._robot.joint_names):
            yield self._unit[self._index[name]]

    @property
    def _rolls(self) -> bool:
        return ROLLS in self._drive.base_speeds

    def _pitching(self, first: _Contact) -> Array:
        """Return the row (nv,) of the rate of the root link's pitch about a wheel's axle."""
        upright, of_root = self.root()
        moved = _turned(of_root, upright)
        over = np.cross(first.ahead, first.left)
        of_over = _crossed(first.of_ahead, first.left) - _crossed(first.of_left, first.ahead)
        sine, cosine = upright @ first.ahead, upright @ over
        of_sine = first.ahead @ moved + upright @ first.of_ahead
        of_cosine = over @ moved + upright @ of_over
        return np.asarray((cosine * of_sine - sine * of_cosine) / (sine**2 + cosine**2))

    def _contact(self, wheel: Wheel) -> _Contact:
        axle, centre, turning = self.wheel(wheel)
        left = self._sides[wheel.joint] * axle
        of_left = _turned(turning, left)  # its own spin leaves the axle alone
        across = np.cross(left, UP)
        size = np.sqrt(across @ across)
        ahead = across / size
        of_across = _crossed(of_left, UP)
        of_ahead = (of_across - np.outer(ahead, ahead @ of_across)) / size
        reach = wheel.radius - wheel.tyre
        arm = reach * np.cross(left, ahead) - wheel.tyre * UP
        of_arm = reach * (_crossed(of_left, ahead) - _crossed(of_ahead, left))
        return _Contact(
            left, ahead, centre + _turned(turning, arm), centre + of_arm, of_left, of_ahead,
            wheel.swivel is not None,
        )  # fmt: skip

    def _leftwards(self) -> dict[str, float]:
        """Return 1 of each wheel whose axle points to the robot's left with all joints at 0."""
        raw, heading = self._tree.reading.raw, self._drive.heading
        poses = raw.poses(self._robot.locked)
        left = np.array([-np.sin(heading), np.cos(heading), 0.0])
        axles = {
            wheel.joint: poses[raw.joint[wheel.joint].child][:3, :3] @ raw.joint[wheel.joint].axis
            for wheel in self._drive.wheels
        }
        return {name: float(np.copysign(1.0, axle @ left)) for name, axle in axles.items()}


class LeaningFileRows(LeaningRows):
    """The rows by the file's places, for v of a ``JointModelFreeFlyer``, in the root's axes."""

    def __init__(self, robot: LeaningRobot, tree: Tree) -> None:
        index = {name: robot.velocity_index(name) for name in robot.moving_joint_names}
        super().__init__(robot, tree, index)
        self._poses: dict[str, Array] = {}

    def at(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return A (rows, nv), m/s per unit of v, and Ȧ v (rows,) at q (nq,) and v (nv,)."""
        self._place(q, v)
        return with_rate(self.constraints(), v)

    def equations(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return [A; W] (nv, nv) and d/dt[A; W] v (nv,) at q (nq,) and v (nv,)."""
        self._place(q, v)
        return with_rate((*self.constraints(), *self.speeds()), v)

    def _place(self, q: Array, v: Array) -> None:
        """Put all links where they are at q, with their motion as imaginary parts."""
        step, root = 1j * COMPLEX_STEP, np.eye(4, dtype=complex)
        R = attitude(q)
        root[:3, :3] = R + step * (R @ _skew(v[3:FREE]))
        root[:3, 3] = q[:3] + step * (R @ v[:3])
        positions: dict[str, Any] = dict(self._robot.locked)
        positions |= {
            name: self._robot.joint_position(q, name) + step * v[index]
            for name, index in self._index.items()
        }
        poses = self._tree.reading.raw.poses(positions)
        self._poses = {link: root @ pose for link, pose in poses.items()}

    def root(self) -> tuple[Array, Array]:
        """Return the root link's upward axis (3,), and the rows of its turning (3, nv)."""
        R = self._poses[self._tree.reading.raw.root][:3, :3]
        return R @ UP, R @ self._unit[3:FREE]

    def wheel(self, wheel: Wheel) -> tuple[Array, Array, Array]:
        """Return a wheel's axle (3,), and rows of its centre's velocity and of its turning."""
        raw = self._tree.reading.raw
        joint, root = raw.joint[wheel.joint], self._poses[raw.root]
        pose = self._poses[joint.child]
        axle = pose[:3, :3] @ joint.axis
        centre = pose[:3, 3] + wheel.offset * axle
        turning = root[:3, :3] @ self._unit[3:FREE]
        linear = root[:3, :3] @ self._unit[:3] + _turned(turning, centre - root[:3, 3])
        for above in raw.chain(joint.child):
            if above.name not in self._index:
                continue
            row, at = self._unit[self._index[above.name]], self._poses[above.child]
            axis = at[:3, :3] @ above.axis
            if above.type == "prismatic":
                linear = linear + np.outer(axis, row)
            else:
                linear = linear + np.outer(np.cross(axis, centre - at[:3, 3]), row)
                turning = turning + np.outer(axis, row)
        return axle, linear, turning


class LeaningGibbsAppell(GibbsAppell):
    """The derivation for a robot that leans: the walk is the same, from a root in space."""

    robot: LeaningRobot

    def full(self, q: Array, v: Array) -> Any:
        """Return the equations of the free tree, u = v as Pinocchio orders it."""
        R, unit = attitude(q), np.eye(self.robot.nv)
        J_v, J_w = R @ unit[:3], R @ unit[3:FREE]
        omega = np.matvec(J_w, v)
        a = np.cross(omega, np.matvec(J_v, v))
        rows = self.free_rates()
        root = LinkKinematics(R, omega, J_w, J_v, np.zeros_like(omega), a)
        return self.terms(
            self._positions(q), v, root, JointRates(rows, dict.fromkeys(rows, 0.0), R)
        )

    def rolling(self, q: Array, nu: Array) -> tuple[LinkKinematics, JointRates]:
        """Return the root link's motion in ν, and the rates of all joints."""
        rows, nv, dof = LeaningFileRows(self.robot, self.tree), self.robot.nv, self.robot.dof
        n = q.shape[:-1]
        S, drift = np.empty((*n, nv, dof)), np.empty((*n, nv))
        for k in np.ndindex(*n):
            L, _ = rows.equations(q[k], np.zeros(nv))
            S[k] = np.linalg.solve(L, np.eye(nv)[:, nv - dof :])
            S[k] += np.linalg.solve(L, np.eye(nv)[:, nv - dof :] - L @ S[k])
            L, change = rows.equations(q[k], S[k] @ nu[k])
            drift[k] = np.linalg.solve(L, -change)
        R, v = attitude(q), np.matvec(S, nu)
        J_v, J_w = R @ S[..., :3, :], R @ S[..., 3:FREE, :]
        omega = np.matvec(R, v[..., 3:FREE])
        a = np.matvec(R, drift[..., :3]) + np.cross(omega, np.matvec(R, v[..., :3]))
        at = {name: self.robot.velocity_index(name) for name in self.robot.moving_joint_names}
        return (
            LinkKinematics(R, omega, J_w, J_v, np.matvec(R, drift[..., 3:FREE]), a),
            JointRates(
                {name: S[..., index, :] for name, index in at.items()},
                {name: drift[..., index] for name, index in at.items()},
                R,
            ),
        )

    def root_rows(self, root: LinkKinematics) -> Array:
        """Return the root link's velocity in its own axes as rows of u (6, n)."""
        own = [*np.moveaxis(root.R.mT @ root.J_v, -2, 0), *np.moveaxis(root.R.mT @ root.J_w, -2, 0)]
        return in_rows(own)


def attitude(q: Array) -> Array:
    """Return the root link's axes in the world (..., 3, 3) at q (..., nq)."""
    axis, w = q[..., 3:6], q[..., 6:7, None]
    skew = _skew(axis)
    return np.asarray(np.eye(3) + 2.0 * w * skew + 2.0 * skew @ skew)


def _skew(a: Array) -> Array:
    """Return the matrices (..., 3, 3) of a × ."""
    return np.asarray(np.cross(a[..., None, :], np.eye(3))).swapaxes(-1, -2)


def _turned(turning: Array, r: Array) -> Array:
    """Return the rows (3, n) of ω × r, given those of ω."""
    return np.asarray(np.cross(turning, r, axisa=0, axisc=0))


def _crossed(rows: Array, b: Array) -> Array:
    """Return rows (3, n) of a vector, × b (3,)."""
    return np.asarray(np.cross(rows, b, axisa=0, axisc=0))
