"""The whole tree of a robot on the ground, without the rolling constraint.

    M(q) v̇ + nle(q, v) = U τ + ℓ(v) + Gᵀ f + Σ Jᵀ w + Cᵀ λ

The wheels' forces f act at the contact points, whose velocities are G v. What stays are the rows
C(q) v = 0 of joints that others carry along: mimic joints, and swivels that follow others by a tie
rod or by their own controllers, as in the reduced model. They are eliminated: v = E(q) y, where y
are the other entries of v, and all here is written in y.

How the contacts of a robot share its load, as a function of its moments: pushes only.

Contacts are equal springs under a rigid robot, N = max(0, a + b x + c y): by statics alone for
three of them, and one split of many for more. It is that of :func:`rpctl.dynamics.stance.loads`,
together with its derivatives, and with an answer where there is none: a robot that tips.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy  # loads scipy.optimize, which takes long, at its first use

from rpctl.arrays import Array
from rpctl.drive.steering import follower_positions
from rpctl.dynamics.ground_reaction import Contacts, contact_points
from rpctl.dynamics.pushes import outside_at
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import basis, square_inverse
from rpctl.dynamics.stance import LOAD_RESOLUTION, MIN_STANCE_WIDTH_M
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import BASE_NV
from rpctl.simulation.plants.settings import Wrench
from rpctl.simulation.plants.tyres import contact_velocities


class LoadSplit(NamedTuple):
    """How contacts at given places share any load.

    Attributes:
        directions: The moments (k, 3) of the sum and the moments about x and y that they determine.
        statics: Map (k, n) from the loads to those.
        free: Changes of the loads that statics do not see (n - k, n), orthonormal.
        split: Map (n, 3) from the sum and both moments to the loads of least norm.
    """

    directions: Array
    statics: Array
    free: Array
    split: Array


NO_CONTACTS = LoadSplit(np.eye(3)[:1], np.zeros((1, 0)), np.zeros((0, 0)), np.zeros((0, 3)))


class ContactLoads(NamedTuple):
    """Loads of n contacts.

    Attributes:
        load: (n,) N, none negative.
        slope: Derivatives (n, 3) by the sum and the moments.
        tips: Whether no loads that only push have these moments.
    """

    load: Array
    slope: Array
    tips: bool


def make_split(points: Array) -> LoadSplit:
    """Return how contacts share loads.

    Contacts on one line determine the moment along it only; the other is left out.

    Args:
        points: Their places (n, 2), root link's axes, m.
    """
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0))
    known = np.flatnonzero(spread > MIN_STANCE_WIDTH_M)
    directions = np.zeros((1 + len(known), 3))
    directions[0, 0] = 1.0
    directions[1:, 1:] = axes[known]
    statics = directions @ np.vstack([np.ones(len(points)), points.T])
    U, singular, Vt = np.linalg.svd(statics)
    count = len(directions)
    split = (Vt[:count].T / singular) @ U.T @ directions
    return LoadSplit(directions, statics, Vt[count:], split)


def share_load(split: LoadSplit, moments: Array) -> ContactLoads:
    """Return the loads that contacts share.

    Where a + b x + c y dips below the ground, contacts let go until those that are left only push.
    Where none can have such moments, the robot tips: then each contact that would push has its part
    of the whole load.

    Args:
        split: How they share loads.
        moments: Their sum, N, and Σ N_i (x_i, y_i), N·m (3,).
    """
    load = split.split @ moments
    if load.min(initial=0.0) >= 0.0:
        return ContactLoads(load, split.split, False)
    if moments[0] <= 0.0:
        return ContactLoads(np.zeros(len(load)), np.zeros((len(load), 3)), True)
    return _pressed(split, moments, load) or _tipping(split, moments, load)


def _pressed(split: LoadSplit, moments: Array, load: Array) -> ContactLoads | None:
    """Return the least loads that only push, or None where there are none: [LH74, Ch. 23].

    Args:
        split: How the contacts share loads.
        moments: Their sum and moments (3,).
        load: Loads of least norm (n,), not all pushing.
    """
    share = load / moments[0]
    left, target = np.vstack([split.free, -share]), np.zeros(len(split.free) + 1)
    target[-1] = 1.0
    residual = left @ scipy.optimize.nnls(left, target)[0] - target
    if residual[-1] > -LOAD_RESOLUTION:
        return None
    share = share - split.free.T @ residual[:-1] / residual[-1]
    held = split.statics * (share > LOAD_RESOLUTION)
    slope = np.linalg.pinv(held) @ split.directions
    return ContactLoads(np.maximum(slope @ moments, 0.0), slope, False)


def _tipping(split: LoadSplit, moments: Array, load: Array) -> ContactLoads:
    """Return each pushing contact's part of the whole load, of a robot that tips.

    Args:
        split: How the contacts share loads.
        moments: Their sum and moments (3,).
        load: Loads of least norm (n,), pushing or not.
    """
    pushing = np.maximum(load, 0.0)
    total = pushing.sum()
    change = split.split * (load > 0.0)[:, None] / total
    part = pushing / total
    slope = moments[0] * (change - part[:, None] * change.sum(axis=0))
    slope[:, 0] += part
    return ContactLoads(moments[0] * part, slope, True)


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
        self._split: LoadSplit | None = NO_CONTACTS
        if contacts is not None:
            self._split = make_split(contacts.points) if contacts.stance is not None else None

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
