"""The reduced dynamics at many states at once, of a robot whose basis S is constant.

Everything is seen in the root link's axes and about its origin: there a body's velocity is the sum
of its joints' screws times their rates, and the inertia of a body with all that it carries is the
sum of theirs ([F08, Ch. 2 and 6]). Sums over a tree are products with its incidence matrix, so no
loop over the bodies is needed but for their places. Numbers of K states stand side by side in the
last axis; six-vectors have the linear part first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import OutsideForce, ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import BASE_NV
from rpctl.robot.placements import AlignedTree, Placements, aligned_tree, placements

BLOCK = 256  # states at once: what is held of them stays in the processor's cache
PLANAR = [0, 1, 5]  # of a six-vector: what the planar root moves along
# Pairs of axes that the six entries of a symmetric matrix stand for.
FIRST, SECOND = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
SYMMETRIC = [[0, 3, 4], [3, 1, 5], [4, 5, 2]]  # and where each entry of the matrix is among them


class Reactions(NamedTuple):
    """What the ground does to a robot at K states, as :meth:`ReducedDynamics.reaction` has it."""

    residual: Array  # (K, nv)
    wrench: Array  # (K, 6)
    energy: Array  # (K,) J, as :meth:`ReducedDynamics.energy`


@dataclass(frozen=True, eq=False)
class Inertias:
    """Inertias of n bodies at K states.

    Attributes:
        mass: kg (n,); the same at all states.
        first: Mass times place of the centre of mass (n, 3, K), kg·m.
        second: About the origin, six entries (n, 6, K), kg·m².
    """

    mass: Array
    first: Array
    second: Array

    def times(self, motion: Array) -> Array:
        """Return inertia times motions (n, 6, K): the momenta of velocities."""
        linear, angular = motion[:, :3], motion[:, 3:]
        found = np.empty(motion.shape)
        np.multiply(self.mass[:, None, None], linear, out=found[:, :3])
        found[:, :3] += cross(angular, self.first)
        found[:, 3:] = cross(self.first, linear)
        for row, columns in enumerate(SYMMETRIC):
            for column, entry in enumerate(columns):
                found[:, 3 + row] += self.second[:, entry] * angular[:, column]
        return found


class _Motion(NamedTuple):
    """K states as the recursions see them."""

    screws: Array  # (n, 6, K) of the joints but the root
    inertias: Inertias  # of the bodies, the root link's first
    velocity: Array  # (n + 1, 6, K) of the bodies
    momentum: Array  # (n + 1, 6, K)


@dataclass(frozen=True, eq=False)
class _Bodies:
    """What does not change of the bodies; the root link's comes first.

    Attributes:
        mass: kg (n + 1,).
        centre: Centres of mass in the turned frames (n + 1, 3), m.
        second: Moments of inertia about them along principal axes (n + 1, 3), kg·m².
        principal: These axes in the turned frames (n + 1, 3, 3), a row each.
    """

    mass: Array
    centre: Array
    second: Array
    principal: Array


class ManyStates:
    """Computes dynamics at many states.

    Args:
        dynamics: The robot's dynamics; its basis is constant.

    Raises:
        RpctlError: The basis turns with the robot's swivels.
    """

    def __init__(self, dynamics: ReducedDynamics) -> None:
        if not dynamics.constant:
            raise RpctlError(f"{dynamics.robot.name}: the basis is not the same at all states")
        robot = dynamics.robot
        self.robot = robot
        self.tree = aligned_tree(robot)
        self._bodies = _bodies(self.tree)
        self._losses = robot.losses
        at = dynamics.at(np.empty(0))  # the same everywhere
        self._S, self._columns = at.S, at.projector.columns
        joints = self.tree.joints
        self._order = [joint.column for joint in joints]  # of the joints' rates in v
        self._slides = np.array([joint.slides for joint in joints])
        n = len(joints) + 1
        self._above = np.zeros((n, n))  # whether a joint (column) moves a body (row)
        for number, joint in enumerate(joints, start=1):
            self._above[number] = self._above[joint.parent]
            self._above[number, number] = 1.0
        self._above[:, 0] = 1.0
        self._ancestors = [np.flatnonzero(row[1:]) for row in self._above[1:]]
        self._gravity = np.array(robot.model.gravity.linear)  # (3,) in the world
        self._mass = float(sum(self._bodies.mass))
        self._armature = np.array(robot.armature)

    def reactions(
        self, q: Array, nu: Array, tau: Array, outside: OutsideForce | None = None
    ) -> Reactions:
        """Return what the ground does to the robot while it moves under τ.

        Args:
            q: Configurations (K, nq).
            nu: Quasi-velocities (K, dof).
            tau: Actuator efforts (K, n_act), N·m or N.
            outside: What pushes the robot besides, (K, nv) and (K, 6); None: nothing.
        """
        robot, count = self.robot, len(q)
        found = Reactions(np.empty((count, robot.nv)), np.empty((count, 6)), np.empty(count))
        for first in range(0, count, BLOCK):
            rows = slice(first, first + BLOCK)
            pushed = None if outside is None else OutsideForce(*(each[rows] for each in outside))
            parts = self._reactions(q[rows], nu[rows], tau[rows], pushed)
            for whole, part in zip(found, parts, strict=True):
                whole[rows] = part.T
        return found

    def _reactions(
        self, q: Array, nu: Array, tau: Array, outside: OutsideForce | None
    ) -> tuple[Array, Array, Array]:
        """Return reactions of one block, the states in the last axis."""
        v = self._S @ nu.T
        motion, potential = self._motion(q, v)
        M, columns = self._inertia(motion)
        bias, wrench = self._bias(motion, v, self._root_gravity(q))
        push = self._columns @ tau.T
        if self._losses is not None:
            push = push + self._losses.force(nu @ self._S.T).T
        if outside is not None:
            push, wrench = push + outside.push.T, wrench - outside.wrench.T
        S = self._S
        acceleration = S @ solve_positive_many(_reduced(S, M), S.T @ (push - bias))
        residual = np.einsum("ijk,jk->ik", M, acceleration) + bias - push
        wrench = wrench + np.einsum("jck,jk->ck", columns, acceleration)
        kinetic = np.einsum("nck,nck->k", motion.velocity, motion.momentum)
        kinetic += self._armature @ (v * v)
        return residual, wrench, 0.5 * kinetic + potential

    def _motion(self, q: Array, v: Array) -> tuple[_Motion, Array]:
        """Return the bodies' velocities and inertias, and their potential energy (K,), J."""
        places = placements(self.tree, q)
        inertias = self._inertias(places)
        axes, screws = places.axes[1:, 2], np.zeros((len(self.tree.joints), 6, len(q)))
        screws[:, :3] = cross(places.origins[1:], axes)
        screws[:, 3:] = axes
        screws[self._slides, :3], screws[self._slides, 3:] = axes[self._slides], 0.0
        steps = np.zeros((len(screws) + 1, 6, len(q)))
        steps[0, PLANAR] = v[:BASE_NV]
        np.multiply(screws, v[self._order][:, None], out=steps[1:])
        velocity = self._sum(self._above, steps)
        potential = -np.einsum("ck,ck->k", self._root_gravity(q), inertias.first.sum(axis=0))
        potential -= self._mass * (q[:, :2] @ self._gravity[:2])
        return _Motion(screws, inertias, velocity, inertias.times(velocity)), potential

    def _root_gravity(self, q: Array) -> Array:
        """Return gravity (3, K) in the root link's axes at q (K, nq), m/s²."""
        (cos, sin), (x, y, z) = q[:, 2:4].T, self._gravity
        return np.stack([cos * x + sin * y, cos * y - sin * x, np.full(len(q), z)])

    def _inertias(self, places: Placements) -> Inertias:
        """Return the bodies' inertias."""
        bodies, (n, _, _, count) = self._bodies, places.axes.shape
        flat = places.axes.reshape(n, 3, 3 * count)
        centre = (bodies.centre[:, None] @ flat).reshape(n, 3, count) + places.origins
        axes = (bodies.principal @ flat).reshape(n, 3, 3, count)
        first = bodies.mass[:, None, None] * centre
        second = np.empty((n, 6, count))
        squares = np.einsum("nck,nck->nk", centre, first)
        weighted = bodies.second[:, :, None, None] * axes
        for entry, (a, b) in enumerate(zip(FIRST, SECOND, strict=True)):
            into = second[:, entry]
            np.multiply(weighted[:, 0, a], axes[:, 0, b], out=into)
            into += weighted[:, 1, a] * axes[:, 1, b]
            into += weighted[:, 2, a] * axes[:, 2, b]
            into -= first[:, a] * centre[:, b]
            if a == b:
                into += squares
        return Inertias(bodies.mass, first, second)

    def _inertia(self, motion: _Motion) -> tuple[Array, Array]:
        """Return M (nv, nv, K) of the tree, and the forces (nv, 6, K) of unit accelerations.

        Those forces act on what a joint moves, seen at the root.
        """
        own, count = motion.inertias, motion.screws.shape[-1]
        carried = self._above.T
        whole = Inertias(
            carried @ own.mass, self._sum(carried, own.first), self._sum(carried, own.second)
        )
        units = np.zeros((BASE_NV, 6, count))
        units[range(BASE_NV), PLANAR] = 1.0
        root = Inertias(*(np.broadcast_to(x[:1], (BASE_NV, *x.shape[1:])) for x in _parts(whole)))
        moved = Inertias(*(x[1:] for x in _parts(whole)))
        forces = np.empty((self.robot.nv, 6, count))
        forces[:BASE_NV] = root.times(units)
        forces[self._order] = moved.times(motion.screws)
        M = np.zeros((len(forces), len(forces), count))
        M[:BASE_NV] = forces[:, PLANAR].swapaxes(0, 1)
        M[:, :BASE_NV] = forces[:, PLANAR]
        for number, above in enumerate(self._ancestors):
            column = self._order[number]
            found = np.einsum("ick,ck->ik", motion.screws[above], forces[column])
            rows = [self._order[each] for each in above]
            M[rows, column] = M[column, rows] = found
        M[range(len(M)), range(len(M))] += self._armature[:, None]
        return M, forces

    def _bias(self, motion: _Motion, v: Array, gravity: Array) -> tuple[Array, Array]:
        """Return h (nv, K) of the tree, and the wrench (6, K) through the root without v̇.

        Args:
            motion: The bodies.
            v: Velocities (nv, K).
            gravity: In the root link's axes (3, K), m/s².
        """
        velocity, momentum, order = motion.velocity, motion.momentum, self._order
        steps = np.zeros(velocity.shape)
        steps[0, :3] = -gravity
        steps[1:] = cross_motion(velocity[1:], motion.screws)
        steps[1:] *= v[order][:, None]
        forces = motion.inertias.times(self._sum(self._above, steps))
        forces += cross_force(velocity, momentum)
        carried = self._sum(self._above.T, forces)
        bias = np.empty(v.shape)
        bias[:BASE_NV] = carried[0, PLANAR]
        bias[order] = np.einsum("nck,nck->nk", motion.screws, carried[1:])
        return bias, carried[0]

    @staticmethod
    def _sum(matrix: Array, values: Array) -> Array:
        """Return sums over bodies (n, c, K) that a matrix (n, n) says."""
        return (matrix @ values.reshape(len(values), -1)).reshape(values.shape)


def _parts(inertias: Inertias) -> tuple[Array, Array, Array]:
    return inertias.mass, inertias.first, inertias.second


def _bodies(tree: AlignedTree) -> _Bodies:
    """Return what does not change of a robot's bodies."""
    model = tree.robot.model
    turned = [np.eye(3), *(joint.turned for joint in tree.joints)]
    mass, centre, second, principal = [], [], [], []
    for rotation, inertia in zip(turned, list(model.inertias)[ROOT_JOINT:], strict=True):
        moments, axes = np.linalg.eigh(rotation.T @ inertia.inertia @ rotation)
        mass.append(inertia.mass)
        centre.append(inertia.lever @ rotation)
        second.append(moments)
        principal.append(axes.T)
    return _Bodies(*(np.array(each) for each in (mass, centre, second, principal)))


def _reduced(S: Array, M: Array) -> Array:
    """Return Sᵀ M S (dof, dof, K) of M (nv, nv, K)."""
    (nv, dof), count = S.shape, M.shape[-1]
    half = (S.T @ M.reshape(nv, nv * count)).reshape(dof, nv, count)
    return S.T @ half


def solve_positive_many(M: Array, right: Array) -> Array:
    """Return x (n, K) with M x = right, by LDLᵀ without pivots.

    Args:
        M: Positive definite matrices (n, n, K); overwritten.
        right: Right sides (n, K).

    Raises:
        RpctlError: A matrix is not positive definite.
    """
    x, n = right.copy(), len(M)
    for k in range(n):
        if (M[k, k] <= 0.0).any():
            raise RpctlError("a matrix is not positive definite")
        row = M[k, k + 1 :] / M[k, k]
        M[k + 1 :, k + 1 :] -= M[k + 1 :, k, None] * row
        x[k + 1 :] -= row * x[k]
        M[k, k + 1 :] = row
    x /= np.einsum("iik->ik", M)
    for k in range(n - 1, 0, -1):
        x[:k] -= M[:k, k] * x[k]
    return x


def cross(a: Array, b: Array) -> Array:
    """Return a × b of vectors (..., 3, K)."""
    found = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[..., j, :], b[..., k, :], out=found[..., i, :])
        found[..., i, :] -= a[..., k, :] * b[..., j, :]
    return found


def cross_motion(velocity: Array, motion: Array) -> Array:
    """Return how motions (n, 6, K) change that move along with velocities (n, 6, K)."""
    linear, angular = velocity[:, :3], velocity[:, 3:]
    found = np.empty(motion.shape)
    found[:, :3] = cross(angular, motion[:, :3])
    found[:, :3] += cross(linear, motion[:, 3:])
    found[:, 3:] = cross(angular, motion[:, 3:])
    return found


def cross_force(velocity: Array, force: Array) -> Array:
    """Return how momenta (n, 6, K) change that move along with velocities (n, 6, K)."""
    linear, angular = velocity[:, :3], velocity[:, 3:]
    found = np.empty(force.shape)
    found[:, :3] = cross(angular, force[:, :3])
    found[:, 3:] = cross(angular, force[:, 3:])
    found[:, 3:] += cross(linear, force[:, :3])
    return found
