"""Efforts and ground reactions along a predicted motion, linear in accelerations and speeds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.control.horizon_model import Model
from rpctl.description.records import Array
from rpctl.dynamics.contact import Contacts
from rpctl.dynamics.rolling import ROOT_JOINT
from rpctl.dynamics.stance import Stance, loads, make_stance

FACES = 8  # of the polygon inside each wheel's circle of grip
RANK_MARGIN = 1e-9  # of the largest singular value of A: below it rows are redundant


class Forces(NamedTuple):
    """The whole tree's force and the ground's wrench at a state, with their derivatives.

    Columns: the value, then by ν̇ (dof), then by the base's ν; or the value alone.
    """

    force: Array  # (nv, columns)
    wrench: Array  # (6, columns) at the root link's origin, in its axes


class ForceModel:
    """Forces of one robot at predicted states; owns a workspace.

    Args:
        model: The prediction's model.
        contacts: How the robot stands, or None where nothing is to be said of the ground.
        tip_margin: Least distance of the zero-moment point to the polygon's edge, m.
        grip: Largest share of the grip that a wheel may use.
    """

    def __init__(
        self, model: Model, contacts: Contacts | None, tip_margin: float, grip: float
    ) -> None:
        robot = model.robot
        self._model, self._data = model, robot.model.createData()
        self._contacts, self._tip_margin, self._grip = contacts, tip_margin, grip
        self._columns = np.zeros((robot.nv, len(robot.actuators)))
        for column, name in enumerate(robot.actuators):
            self._columns[robot.velocity_index(name), column] = 1.0
        self._weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        self._faces = 2.0 * math.pi * (np.arange(FACES) + 0.5) / FACES
        self._stance: Stance | None = None
        self._fixed_maps: tuple[Array, Array] | None = None
        if contacts is not None and contacts.balanced:
            # Where contacts move with the posture, those of the joints at zero stand for them.
            self._stance = contacts.stance or make_stance(contacts.points)
            still = np.zeros(robot.dof)
            if self.ground(robot.home, self.value(robot.home, still, still)).min() < 0.0:
                self._stance = None  # it tips where it stands: there is no balance to keep

    @property
    def rows(self) -> int:
        """Number of rows that :meth:`ground` returns."""
        if self._stance is None or self._contacts is None:
            return 0
        return len(self._stance.inward) + FACES * len(self._contacts.along)

    def value(self, joints: Array, nu: Array, nu_dot: Array) -> Forces:
        """Return the forces at a posture (n_joints,), ν (dof,) and ν̇ (dof,), one column."""
        dynamics = self._model.dynamics
        q = self._model.configuration(joints)
        S, drift = dynamics.basis(q), dynamics.basis_drift(q, nu)
        force = pin.rnea(self._model.robot.model, self._data, q, S @ nu, S @ nu_dot + drift)
        return Forces(force[:, None].copy(), self._data.f[ROOT_JOINT].vector[:, None].copy())

    def at(self, joints: Array, nu: Array, nu_dot: Array) -> Forces:
        """Return the forces at a posture (n_joints,), ν (dof,) and ν̇ (dof,), all columns.

        Both are linear in ν̇, with the inertia and the centroidal momentum's matrix as slopes, and
        quadratic in ν, so that central differences of any step are exact where S is constant.
        """
        model, data, dynamics = self._model.robot.model, self._data, self._model.dynamics
        q = self._model.configuration(joints)
        S, base = dynamics.basis(q), self._model.base
        dof = S.shape[1]
        force, wrench = np.empty((len(S), 1 + dof + base)), np.empty((6, 1 + dof + base))
        drift = dynamics.basis_drift(q, nu)
        for column in range(base):
            v, step = S @ nu, S[:, column]
            ahead = pin.rnea(model, data, q, v + step, drift).copy()
            wrench_ahead = data.f[ROOT_JOINT].vector.copy()
            force[:, 1 + dof + column] = 0.5 * (ahead - pin.rnea(model, data, q, v - step, drift))
            wrench[:, 1 + dof + column] = 0.5 * (wrench_ahead - data.f[ROOT_JOINT].vector)
        force[:, 0] = pin.rnea(model, data, q, S @ nu, S @ nu_dot + drift)
        wrench[:, 0] = data.f[ROOT_JOINT].vector
        force[:, 1 : 1 + dof] = pin.crba(model, data, q) @ S
        momentum = pin.computeCentroidalMap(model, data, q) @ S
        wrench[:, 1 : 1 + dof] = momentum
        x, y, z = data.com[0]
        arm = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        wrench[3:, 1 : 1 + dof] += arm @ momentum[:3]
        return Forces(force, wrench)

    def efforts(self, joints: Array, forces: Forces) -> Array:
        """Return τ (n_act, columns)."""
        allocation, _ = self._maps(joints)
        return np.asarray(allocation @ forces.force)

    def ground(self, joints: Array, forces: Forces) -> Array:
        """Return rows (rows, columns) that are ≥ 0 where the robot neither tips nor slips.

        One row an edge of the support polygon: the moment about it beyond the margin, over the
        weight (m). Then, for each wheel, one row a face of a polygon inside the circle of its
        grip: grip left, over the grip at its whole weight.
        """
        contacts, stance = self._contacts, self._stance
        if contacts is None or stance is None:
            raise ValueError("no ground reactions are defined")
        wrench, z = forces.wrench, self._model.robot.drive.ground
        moments = np.vstack([wrench[2], z * wrench[0] - wrench[4], z * wrench[1] + wrench[3]])
        reach = stance.offset[:, None] - self._tip_margin
        tipping = (stance.inward @ moments[1:] + reach * moments[0]) / self._weight
        horizontal = self._maps(joints)[1] @ forces.force
        wheels = len(contacts.along)
        along, lateral = horizontal[:wheels], horizontal[wheels:]
        load = _shares(stance, moments[:, 0])[:wheels] @ moments
        borne = np.maximum(load[:, 0], contacts.floor)
        share = borne[:, None] * contacts.share / (borne @ contacts.share)
        across = share @ lateral
        cos, sin = np.cos(self._faces)[:, None, None], np.sin(self._faces)[:, None, None]
        inside = math.cos(math.pi / FACES) * self._grip * contacts.friction
        slipping = (inside * load - cos * along - sin * across) / (inside * self._weight)
        return np.vstack([tipping, slipping.reshape(-1, slipping.shape[2])])

    def _maps(self, joints: Array) -> tuple[Array, Array]:
        """Return the maps from the tree's force to the efforts, and to the wheels' forces."""
        if self._fixed_maps is not None:
            return self._fixed_maps
        dynamics = self._model.dynamics
        q = self._model.configuration(joints)
        allocation = dynamics.efforts(q, np.eye(self._model.robot.dof)) @ dynamics.basis(q).T
        horizontal = np.empty((0, len(self._columns)))
        if self._contacts is not None:
            multipliers = np.linalg.pinv(dynamics.constraint(q).T, rcond=RANK_MARGIN)
            forces = np.vstack([self._contacts.along, self._contacts.across]) @ multipliers
            horizontal = forces @ (np.eye(len(self._columns)) - self._columns @ allocation)
        maps = allocation, horizontal
        if dynamics.constant:
            self._fixed_maps = maps
        return maps


def _shares(stance: Stance, moments: Array) -> Array:
    """Return the map (n, 3) from moments to loads, of the contacts that bear some at ``moments``.

    Where all do, or the robot tips, it is the stance's split; a contact that lets go has no share.
    """
    least = stance.split @ moments
    if least.min() >= 0.0 or len(least) == 3:
        return stance.split
    margin = float((stance.inward @ (moments[1:] / moments[0]) + stance.offset).min())
    pressed = loads(stance, moments, margin) > 0.0
    if margin <= 0.0 or pressed.all():
        return stance.split
    shares = np.zeros_like(stance.split)
    shares[pressed] = np.linalg.pinv(stance.statics[:, pressed])
    return shares
