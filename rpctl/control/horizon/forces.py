"""Efforts and ground reactions along a predicted motion, linear in accelerations and speeds."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model
from rpctl.dynamics.ground_reaction import Contacts, stance_at
from rpctl.dynamics.projection import Projection
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.stance import Stance, loads
from rpctl.robot.coordinates import ROOT_JOINT

ROOT_AT_ORIGIN = (0.0, 0.0, 1.0, 0.0)  # the planar root's part of q at the origin
GRIP_POLYGON_FACES = 8  # of the polygon inside each wheel's circle of grip


class Forces(NamedTuple):
    """The whole tree's force and the ground's wrench at a state, with their derivatives.

    Columns: the value, its derivatives by ν̇ (dof), then by the ν that move the base; or the value
    alone.
    """

    at: Projection  # its rolling wheels
    force: Array  # (nv, columns)
    wrench: Array  # (6, columns) at the root link's origin, in its axes


class ForceModel:
    """Forces of one robot at measured or predicted states; holds Pinocchio's workspace.

    The prediction does not know the angles of casters that nothing drives: at predicted states they
    glide. Guessed angles would produce rates and forces many times too large. The contacts are
    those of the posture last given to :meth:`update_contacts`.

    Args:
        model: The prediction's model.
        contacts: Contacts with the ground; None leaves the ground's reactions out.
        tip_margin: Least distance of the zero-moment point to the polygon's edge, m.
        grip: Largest fraction of its grip that a wheel may use.
    """

    def __init__(
        self, model: Model, contacts: Contacts | None, tip_margin: float, grip: float
    ) -> None:
        robot = model.robot
        self._model, self._data = model, robot.model.createData()
        self._contacts, self._tip_margin, self._grip = contacts, tip_margin, grip
        self._foreseen = model.dynamics
        idle = [swivel.joint for swivel in robot.drive.idle_casters]
        if idle:
            self._foreseen = ReducedDynamics(robot, gliding=idle)
        self._weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        self._faces = 2.0 * math.pi * (np.arange(GRIP_POLYGON_FACES) + 0.5) / GRIP_POLYGON_FACES
        self._stance: Stance | None = None
        self._cached_maps: tuple[Projection, tuple[Array, Array]] | None = None
        if contacts is not None and contacts.balanced:
            q, still = robot.configuration_at(np.zeros(3), robot.home), np.zeros(robot.dof)
            self._stance = stance_at(model.dynamics, contacts, q)
            if self.ground(self.value(q, still, still)).min() < 0.0:
                self._stance = None  # it tips at rest: there is no balance to keep

    @property
    def rows(self) -> int:
        """Number of rows that :meth:`ground` returns."""
        if self._stance is None or self._contacts is None:
            return 0
        return self._edges + self.grip_rows

    @property
    def grip_rows(self) -> int:
        """Number of rows that :meth:`grip_margins` returns."""
        if self._stance is None or self._contacts is None:
            return 0
        return GRIP_POLYGON_FACES * len(self._contacts.along)

    @property
    def _edges(self) -> int:
        """Number of rows about tipping: one a contact if the polygon changes with the posture."""
        if self._contacts is None or self._contacts.stance is None:
            return 0 if self._contacts is None else len(self._contacts.points)
        return len(self._contacts.stance.inward)

    def update_contacts(self, q: Array) -> None:
        """Update the contacts to those at q (nq,)."""
        if self._stance is not None and self._contacts is not None:
            self._stance = stance_at(self._model.dynamics, self._contacts, q)

    def value(self, q: Array, nu: Array, nu_dot: Array) -> Forces:
        """Return the forces at a predicted state, one column.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            nu_dot: Their derivatives (dof,).
        """
        at = self._foreseen.at(q)
        acceleration = at.S @ nu_dot + at.drift(nu)
        force = pin.rnea(self._model.robot.model, self._data, q, at.S @ nu, acceleration)
        wrench = self._data.f[ROOT_JOINT].vector
        return Forces(at, force[:, None].copy(), wrench[:, None].copy())

    def with_derivatives(
        self, q: Array, nu: Array, nu_dot: Array, dynamics: ReducedDynamics | None = None
    ) -> Forces:
        """Return the forces at a state and their derivatives, all columns.

        Both are linear in ν̇, with the inertia and the centroidal momentum's matrix as derivatives,
        and quadratic in ν, so that central differences of any step are exact where S is constant;
        where wheels are steered, the derivatives by ν are those at the motion's Ṡν.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            nu_dot: Their derivatives (dof,).
            dynamics: The robot's own dynamics for a measured state; None for a predicted one.
        """
        model, data = self._model.robot.model, self._data
        # At the origin the world's axes are the root link's.
        q = np.concatenate([ROOT_AT_ORIGIN, q[len(ROOT_AT_ORIGIN) :]])
        here = (dynamics or self._foreseen).at(q)
        S, drift = here.S, here.drift(nu)
        base, dof = self._model.base_columns, S.shape[1]
        force, wrench = np.empty((len(S), 1 + dof + base)), np.empty((6, 1 + dof + base))
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
        return Forces(here, force, wrench)

    def efforts(self, forces: Forces) -> Array:
        """Return τ (n_act, columns)."""
        allocation, _ = self._maps(forces.at)
        return np.asarray(allocation @ forces.force)

    def ground(self, forces: Forces) -> Array:
        """Return the margins (rows, columns), ≥ 0 where the robot neither tips nor slips.

        First one row for each edge of the support polygon (some twice if their number changes): the
        moment about it beyond the margin, divided by the weight (m). Then, for each wheel, one row
        for each face of a polygon inside the circle of its grip: remaining grip, divided by the
        grip under the robot's whole weight.
        """
        return np.vstack(
            [self.tip_margins(forces), self.grip_margins(forces, [self.load_split(forces)])]
        )

    def load_split(self, forces: Forces) -> Array:
        """Return the map (n_contacts, 3) from moments to the contacts' loads at these forces."""
        return _load_split(self._required_stance, self._moments(forces)[:, 0])

    @property
    def _required_stance(self) -> Stance:
        if self._stance is None:
            raise ValueError("no ground reactions are defined")
        return self._stance

    def _moments(self, forces: Forces) -> Array:
        wrench, z = forces.wrench, self._model.robot.drive.ground
        return np.vstack([wrench[2], z * wrench[0] - wrench[4], z * wrench[1] + wrench[3]])

    def tip_margins(self, forces: Forces) -> Array:
        """Return the rows of :meth:`ground` about tipping."""
        stance, moments = self._required_stance, self._moments(forces)
        edges = np.arange(self._edges) % len(stance.inward)
        reduced_offset = stance.offset[edges, None] - self._tip_margin
        return np.asarray(
            (stance.inward[edges] @ moments[1:] + reduced_offset * moments[0]) / self._weight
        )

    def grip_margins(self, forces: Forces, load_splits: Iterable[Array]) -> Array:
        """Return the rows of :meth:`ground` about slipping, for each of these load splits."""
        contacts = self._contacts
        if contacts is None:
            raise ValueError("no ground reactions are defined")
        horizontal = self._maps(forces.at)[1] @ forces.force
        moments = self._moments(forces)
        wheels = len(contacts.along)
        along, lateral = horizontal[:wheels], horizontal[wheels:]
        cos, sin = np.cos(self._faces)[:, None, None], np.sin(self._faces)[:, None, None]
        usable_friction = math.cos(math.pi / GRIP_POLYGON_FACES) * self._grip * contacts.friction
        rows = []
        for load_split in load_splits:
            load = load_split[:wheels] @ moments
            positive_load = np.maximum(load[:, 0], contacts.floor)
            lateral_share = (
                positive_load[:, None] * contacts.incidence / (positive_load @ contacts.incidence)
            )
            slack = usable_friction * load - cos * along - sin * (lateral_share @ lateral)
            rows.append(slack.reshape(-1, slack.shape[2]) / (usable_friction * self._weight))
        return np.vstack(rows)

    def _maps(self, at: Projection) -> tuple[Array, Array]:
        """Return the maps from the tree's force to the efforts and to the wheels' forces."""
        if self._cached_maps is None or self._cached_maps[0] is not at:
            allocation = at.allocation @ at.S.T
            columns = at.projector.columns
            horizontal = np.empty((0, len(columns)))
            if self._contacts is not None:
                forces = np.vstack([self._contacts.along, self._contacts.across]) @ at.multipliers
                horizontal = forces @ (np.eye(len(columns)) - columns @ allocation)
            self._cached_maps = at, (allocation, horizontal)
        return self._cached_maps[1]


def _load_split(stance: Stance, moments: Array) -> Array:
    """Return the map (n, 3) from moments to the loads of the contacts that bear load.

    If all do, or the robot tips, it is the stance's split; contacts that lift off have no load.

    Args:
        stance: The contacts.
        moments: Vertical force (N) and the two tilting moments (N·m) on the ground (3,).
    """
    least = stance.split @ moments
    if least.min() >= 0.0 or len(least) == 3:
        return stance.split
    margin = float((stance.inward @ (moments[1:] / moments[0]) + stance.offset).min())
    bearing = loads(stance, moments, margin) > 0.0
    if margin <= 0.0 or bearing.all():
        return stance.split
    load_split = np.zeros_like(stance.split)
    load_split[bearing] = np.linalg.pinv(stance.statics[:, bearing])
    return load_split
