"""Parametrised base motions for planning: poses along a path, and their derivatives."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline

from rpctl.arrays import Array
from rpctl.reference.paths import Path, PathPoint
from rpctl.reference.pointwise import Numbers, stack_rows, vector
from rpctl.reference.splines import basis, quintic
from rpctl.reference.timed_path import still

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(6)  # exact up to degree 11


class BaseMotion(Protocol):
    """Poses of the base at N points of a path, as functions of ``size`` parameters."""

    size: int

    def poses(self, z: Array) -> tuple[Array, Array]:
        """Return poses (N, 3) and their derivatives by the parameters (N, 3, size)."""

    def path(self, z: Array) -> Path:
        """Return the base's path."""


class GivenBase:
    """A base whose path is given: no parameters."""

    size = 0

    def __init__(self, path: Path, s: Array) -> None:
        self._path = path
        self._poses = path(s).pose

    def poses(self, z: Array) -> tuple[Array, Array]:
        """Return the known poses."""
        return self._poses, np.zeros((len(self._poses), 3, 0))

    def path(self, z: Array) -> Path:
        """Return the known path."""
        return self._path


class StationaryBase:
    """A base that stays at a pose: its three coordinates are the parameters."""

    size = 3

    def __init__(self, s: Array) -> None:
        self._count = len(s)

    def poses(self, z: Array) -> tuple[Array, Array]:
        """Return the pose at every point."""
        return np.tile(z, (self._count, 1)), np.tile(np.eye(3), (self._count, 1, 1))

    def path(self, z: Array) -> Path:
        """Return a path that stays."""
        return still(z)


class DrivingBase:
    """A base whose twist is a spline: a pose to start from, and the spline's coefficients.

    Args:
        s: Points of the path (N,), uniform.
        knots: Knots of the spline (m + 6,).
        columns: Free entries of the twist (forward, left, turning); the others are zero.
    """

    def __init__(self, s: Array, knots: Array, columns: list[int]) -> None:
        self.knots, self._columns, self._s = knots, columns, s
        functions = basis(knots)
        self.count = len(functions.c)
        self.size = 3 + self.count * len(columns)
        step = s[1] - s[0]
        points = (s[:-1, None] + 0.5 * step * (1.0 + GAUSS_NODES)).ravel()
        self._quadrature_weights = np.tile(0.5 * step * GAUSS_WEIGHTS, len(s) - 1)
        whole = functions.antiderivative()
        self._basis, self._angle_basis = functions(points), whole(points) - whole(s[0])  # (Q, m)
        self._angle_basis_at_s = whole(s) - whole(s[0])  # (N, m)

    def twist(self, z: Array) -> Array:
        """Return the coefficients of the twist (m, 3)."""
        coefficients = np.zeros((self.count, 3))
        coefficients[:, self._columns] = z[3:].reshape(len(self._columns), self.count).T
        return coefficients

    def poses(self, z: Array) -> tuple[Array, Array]:
        """Return poses and their derivatives by start and coefficients."""
        c = self.twist(z)
        theta, twist = z[2] + self._angle_basis @ c[:, 2], self._basis @ c[:, :2]
        heading = np.exp(1j * theta)
        velocity = heading * (twist[:, 0] + 1j * twist[:, 1])
        parts = {0: heading[:, None] * self._basis, 1: 1j * heading[:, None] * self._basis}
        parts[2] = 1j * velocity[:, None] * self._angle_basis
        change = np.hstack([(1j * velocity)[:, None], *(parts[i] for i in self._columns)])
        place, moved = self._sum(velocity), self._sum(change)
        poses = np.column_stack(
            [z[0] + place.real, z[1] + place.imag, z[2] + self._angle_basis_at_s @ c[:, 2]]
        )
        jacobian = np.zeros((len(poses), 3, self.size))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = jacobian[:, 2, 2] = 1.0
        jacobian[:, 0, 2:], jacobian[:, 1, 2:] = moved.real, moved.imag
        jacobian[:, 2, 3 + self.count * self._columns.index(2) :] = self._angle_basis_at_s
        return poses, jacobian

    def _sum(self, rates: Array) -> Array:
        """Return the integral of rates at the quadrature's points up to each s (N, ...)."""
        weighted = (rates.T * self._quadrature_weights).T
        pieces = weighted.reshape(len(self._s) - 1, len(GAUSS_NODES), *rates.shape[1:]).sum(axis=1)
        return np.concatenate([np.zeros((1, *pieces.shape[1:])), np.cumsum(pieces, axis=0)])

    def path(self, z: Array) -> Path:
        """Return the path: poses by quadrature from the nearest point before."""
        return _TwistPath(self._s, self.poses(z)[0], quintic(self.knots, self.twist(z)))


class _TwistPath:
    """A path of known twist: its poses are the twist's integral, to rounding."""

    def __init__(self, s: Array, poses: Array, twist: BSpline) -> None:
        self._s, self._poses, self._twist = s, poses, twist
        self._first, self._second = twist.derivative(1), twist.derivative(2)
        self._whole = quintic(twist.t, np.ascontiguousarray(twist.c[:, 2])).antiderivative()

    def __call__(self, s: Numbers) -> PathPoint:
        """Return the point at s, or the points at many."""
        node = np.searchsorted(self._s, s, side="right") - 1
        node = np.clip(node, 0, len(self._s) - 1)
        start, pose = self._s[node], self._poses[node]
        at = start[..., None] + (0.5 * (s - start))[..., None] * (1.0 + GAUSS_NODES)
        turned, end = (self._whole(x) for x in (at, s))
        before = self._whole(start)
        forward = self._twist(at)
        heading = pose[..., 2] - before
        velocity = np.exp(1j * (heading[..., None] + turned)) * (
            forward[..., 0] + 1j * forward[..., 1]
        )
        step = 0.5 * (s - start) * (velocity @ GAUSS_WEIGHTS)
        direction = stack_rows(self._twist(s), self._first(s), self._second(s))
        return PathPoint(pose + vector(s, (step.real, step.imag, end - before)), direction)
