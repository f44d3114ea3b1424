"""The whole tree of a robot on the ground, without the rolling constraint.

    M(q) v̇ + nle(q, v) = U τ + ℓ(v) + Gᵀ f + Σ Jᵀ w + Cᵀ λ

The wheels' forces f act at the contact points, whose velocities are G v. What stays are the rows
C(q) v = 0 of joints that others carry along: mimic joints, and swivels that follow others by a tie
rod or by their own controllers, as in the reduced model. They are eliminated: v = E(q) y, where y
are the other entries of v, and all here is written in y.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.steering import follower_positions
from rpctl.dynamics.ground_reaction import Contacts, contact_points
from rpctl.dynamics.reduced import ReducedDynamics, outside_at
from rpctl.dynamics.rolling import basis, square_inverse
from rpctl.dynamics.stance import LoadSplit, make_split
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import BASE_NV
from rpctl.simulation.plants.settings import Wrench
from rpctl.simulation.plants.tyres import contact_velocities

NO_CONTACTS = LoadSplit(np.zeros((1, 0)), np.zeros((0, 3)), np.zeros((0, 0)), np.eye(3)[:1])


@dataclass(frozen=True, eq=False)
class Posture:
    """What one configuration makes of the tree.

    Attributes:
        q: The configuration (nq,).
        M: Inertia (ny, ny).
        E: Map (nv, ny) from y to v; None: y is v.
        tied: Cosines and sines of the swivels, C, and the inverse of [C; W], for the drift; None
            where E does not change.
        G: Map (3 n_wheels, ny) to the velocities of the contact points.
        K: Map (3, ny) from ẏ to the ground's load and its moments, N, N·m.
        split: How the contacts share them.
    """

    q: Array
    M: Array
    E: Array | None
    tied: tuple[Array, Array] | None
    G: Array
    K: Array
    split: LoadSplit

    def velocity(self, y: Array) -> Array:
        """Return v (nv,) at y (ny,)."""
        return y if self.E is None else np.asarray(self.E.dot(y))

    def reduced(self, force: Array) -> Array:
        """Return a generalised force (nv,) as one on y (ny,)."""
        return force if self.E is None else np.asarray(force.dot(self.E))


class FreeTree:
    """The dynamics of a robot's whole tree.

    Args:
        dynamics: The robot's reduced dynamics, whose rolling constraints are left out here.
        contacts: How it stands; None for a fixed base.
    """

    def __init__(self, dynamics: ReducedDynamics, contacts: Contacts | None) -> None:
        robot, rolling = dynamics.robot, dynamics.rolling
        self.robot, self._dynamics, self._contacts = robot, dynamics, contacts
        self._model, self._data = robot.model, robot.model.createData()
        self._still = np.zeros(robot.nv)
        self.contact_velocities = contact_velocities(robot, rolling)
        slips = {*rolling.along, *(row for row, _ in rolling.across)}
        self._ties = [row for row in range(len(rolling.matrix.constant)) if row not in slips]
        led = {joint.name for joint in robot.mimics} | {s.joint for s in robot.drive.followers}
        base = 0 if robot.drive.wheels else BASE_NV
        gone = {*range(base), *(robot.velocity_index(name) for name in led)}
        self.free = np.array([i for i in range(robot.nv) if i not in gone], dtype=np.intp)
        self._W = np.eye(robot.nv)[self.free]
        self._turns = bool(rolling.matrix.harmonics[:, self._ties].any())
        self._E = None
        if self._ties and not self._turns:
            self._E = basis(rolling.matrix.constant[self._ties], self._W)
        self._split = NO_CONTACTS if contacts is None else contacts.stance

    def at(self, q: Array) -> Posture:
        """Return what q (nq,) makes of the tree.

        Raises:
            SingularBasisError: At q the followers do not know where to turn.
        """
        rolling = self._dynamics.rolling
        u = rolling.turn(q)
        M, G = pin.crba(self._model, self._data, q), self.contact_velocities.matrix.at(u)
        K = self._load_rows(q)
        E, tied = self._E, None
        if self._turns:
            C = rolling.matrix.at(u)[self._ties]
            E, tied = basis(C, self._W), (u, square_inverse(np.vstack([C, self._W])))
        if E is not None:
            M, G, K = E.T.dot(M).dot(E), G.dot(E), K.dot(E)
        else:
            M = M.copy()
        return Posture(q, M, E, tied, G, K, self._split or self._split_at(q))

    def integrate(self, q: Array, slide: Array) -> Array:
        """Return q (nq,) moved by ``slide`` (nv,), with the followers where they belong.

        Rows of velocities alone would let them drift off.
        """
        robot, end = self.robot, np.asarray(pin.integrate(self._model, q, slide))
        steered = {s.joint: robot.joint_position(end, s.joint) for s in robot.drive.steered}
        for name, position in follower_positions(robot.drive, steered).items():
            now = robot.joint_position(end, name)
            robot.set_joint(end, name, now + math.remainder(position - now, math.pi))
        return end

    def fall(self, q: Array, end: Array) -> float:
        """Return the potential energy at q (nq,) less that at ``end`` (nq,), J."""
        there, here = (pin.computePotentialEnergy(self._model, self._data, x) for x in (end, q))
        return float(here - there)

    def _split_at(self, q: Array) -> LoadSplit:
        """Return how contacts that move share loads at q (nq,)."""
        if self._contacts is None:
            return NO_CONTACTS
        return make_split(contact_points(self._dynamics, self._contacts.supports, q))

    def push(self, at: Posture, y: Array, given: Array, pressed: Array) -> tuple[Array, Array]:
        """Return the force on y (ny,) without tyres and losses, and the load and moments (3,).

        The load and its moments are those at ẏ = 0; K ẏ adds to them.

        Args:
            at: The posture.
            y: Velocities (ny,).
            given: Generalised force (nv,) of actuators and pushes.
            pressed: Load and moments (3,) of the pushes, as of :meth:`pushes`.
        """
        v = at.velocity(y)
        drift = self._still
        if at.tied is not None:
            u, inverse = at.tied
            drift = -inverse[:, : len(self._ties)].dot(
                self._dynamics.rolling.drift(u, v)[self._ties]
            )
        force = pin.rnea(self._model, self._data, at.q, v, drift)
        moments = self._moments(self._data.f[ROOT_JOINT].vector) - pressed
        return at.reduced(given - force), moments

    def pushes(self, q: Array, wrenches: Sequence[Wrench]) -> tuple[Array, Array]:
        """Return the generalised force (nv,) of pushes, and their load and moments (3,).

        Raises:
            UnknownNameError: There is no such link.
        """
        if not wrenches:
            return np.zeros(self.robot.nv), np.zeros(3)
        outside = outside_at(self._dynamics, q, wrenches)
        return outside.push, self._moments(outside.wrench)

    def _moments(self, wrench: Array) -> Array:
        """Return the load (N) and its moments (N·m) that a wrench (6,) at the root link has."""
        (fx, fy, fz, nx, ny, _), z = wrench, self.robot.drive.ground
        return np.array([fz, z * fx - ny, z * fy + nx])

    def _load_rows(self, q: Array) -> Array:
        """Return the map (3, nv) from v̇ to the ground's load and moments at q (nq,).

        They are rows of the rate of the momentum, which Pinocchio has about the centre of mass.
        """
        momentum = pin.computeCentroidalMap(self._model, self._data, q)
        x, y, z = self._data.com[0] - np.array([q[0], q[1], self.robot.drive.ground])
        cos, sin = q[2], q[3]
        fx, fy, fz, nx, ny, _ = momentum
        px, py = x * fz - z * fx - ny, y * fz - z * fy + nx
        return np.array([fz, cos * px + sin * py, cos * py - sin * px])
