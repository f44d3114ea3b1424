"""Efforts and ground reactions along a predicted motion, linear in accelerations and speeds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model
from rpctl.dynamics.ground_reaction import Contacts, stance_at
from rpctl.dynamics.projection import Projection
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.stance import Stance, pressed_loads
from rpctl.robot.coordinates import ROOT_JOINT

ROOT_AT_ORIGIN = (0.0, 0.0, 1.0, 0.0)  # the planar root's part of q at the origin
GRIP_POLYGON_FACES = 8  # of the polygon inside each wheel's circle of grip


class ForceMaps(NamedTuple):
    """What the tree's force means at one configuration, or at K of them."""

    efforts: Array  # (..., n_act, nv)
    horizontal: Array  # (..., n_wheels + n_axles, nv): along the wheels, then across the axles


class Forces(NamedTuple):
    """The whole tree's force and the ground's wrench at a state, with their derivatives.

    Columns: the value, its derivatives by ν̇, then by the ν that move the base; or the value alone.
    At K states all arrays have a leading axis, but for maps that are the same at all of them.
    """

    maps: ForceMaps
    force: Array  # (..., nv, columns)
    wrench: Array  # (..., 6, columns) at the root link's origin, in its axes


class ForceModel:
    """Forces of one robot at measured or predicted states; holds Pinocchio's workspace.

    The prediction does not know the angles of casters that nothing drives: at predicted states they
    glide. Guessed angles would produce rates and forces many times too large.

    Args:
        contacts: Contacts with the ground; None leaves the ground's reactions out.
        tip_margin: Least distance of the zero-moment point to the polygon's edge, m.
        grip: Largest fraction of its grip that a wheel may use.

    Attributes:
        ground: The ground's reactions; None of a robot that is not known to stand.
    """

    def __init__(
        self, model: Model, contacts: Contacts | None, tip_margin: float, grip: float
    ) -> None:
        robot = model.robot
        self._robot, self._data, self._foreseen = robot, robot.model.createData(), model.dynamics
        idle = [swivel.joint for swivel in robot.drive.idle_casters]
        if idle:
            self._foreseen = ReducedDynamics(robot, gliding=idle)
        self._cached_maps: tuple[Projection, ForceMaps] | None = None
        self.ground: GroundMargins | None = None
        if contacts is not None and contacts.balanced:
            q, still = robot.configuration_at(np.zeros(3), robot.home), np.zeros(robot.dof)
            self.ground = GroundMargins(model.dynamics, contacts, q, tip_margin, grip)
            if self.ground(self.at(q, still, still)).min() < 0.0:
                self.ground = None  # it tips at rest: there is no balance to keep
                self._cached_maps = None

    def at(
        self,
        q: Array,
        nu: Array,
        nu_dot: Array,
        accelerations: int = 0,
        speeds: int = 0,
        measured: ReducedDynamics | None = None,
    ) -> Forces:
        """Return the forces at a state and their derivatives by the first of ν̇ and of ν.

        Args:
            accelerations: By how many of ν̇.
            speeds: By how many of ν.
            measured: The robot's own dynamics, at a measured state; None at a predicted one.
        """
        losses = self._robot.losses
        # At the origin the world's axes are the root link's.
        q = np.concatenate([ROOT_AT_ORIGIN, q[len(ROOT_AT_ORIGIN) :]])
        here = (measured or self._foreseen).at(q)
        S, nv = here.S, len(here.S)
        v = S @ nu
        columns = [self._tree(q, v, S @ nu_dot + here.drift(nu))]
        if losses is not None:
            columns[0][:nv] -= losses.force(v)
        if accelerations:
            columns += self._by_acceleration(q, S[:, :accelerations])
        if speeds:
            drift_by_nu = here.drift_by_nu(nu, speeds)
            # But for losses forces are quadratic in v = Sν, linear in Ṡν: differences are exact.
            for step, change in zip(S.T, drift_by_nu.T, strict=False):
                ahead, behind = self._tree(q, v + step, change), self._tree(q, v - step, -change)
                column = 0.5 * (ahead - behind)
                if losses is not None:
                    column[:nv] += losses.slope(v) * step
                columns.append(column)
        whole = np.array(columns).T
        return Forces(self._maps(here), whole[:nv], whole[nv:])

    def _tree(self, q: Array, v: Array, a: Array) -> Array:
        """Return the tree's force, then the ground's wrench (nv + 6,) of a motion."""
        force = pin.rnea(self._robot.model, self._data, q, v, a)
        return np.concatenate([force, self._data.f[ROOT_JOINT].vector])

    def _by_acceleration(self, q: Array, a: Array) -> list[Array]:
        """Return the derivatives (nv + 6,) by accelerations, whose v̇ are the columns of a."""
        model, data = self._robot.model, self._data
        force = pin.crba(model, data, q) @ a
        momentum = pin.computeCentroidalMap(model, data, q) @ a
        momentum[3:] += pin.skew(data.com[0]) @ momentum[:3]
        return list(np.vstack([force, momentum]).T)

    def efforts(self, forces: Forces) -> Array:
        """Return τ (..., n_act, columns)."""
        return np.asarray(forces.maps.efforts @ forces.force)

    def _maps(self, at: Projection) -> ForceMaps:
        """Return the maps from the tree's force to the efforts and to the wheels' forces."""
        if self._cached_maps is None or self._cached_maps[0] is not at:
            allocation = at.allocation @ at.S.T
            columns = at.projector.columns
            horizontal = np.empty((0, len(columns)))
            if self.ground is not None:
                forces = self.ground.by_multipliers @ at.multipliers
                horizontal = forces @ (np.eye(len(columns)) - columns @ allocation)
            self._cached_maps = at, ForceMaps(allocation, horizontal)
        return self._cached_maps[1]


class GroundMargins:
    """Margins (..., rows, columns) of a robot's forces, ≥ 0 where it neither tips nor slips.

    First one row for each edge of the support polygon (some twice if their number changes): the
    moment about it beyond the margin, divided by the weight (m). Then, for each wheel, one row
    for each face of a polygon inside the circle of its grip: remaining grip, divided by the
    grip under the robot's whole weight. The contacts are those of the posture last given to
    :meth:`update`.

    Args:
        q: The first posture (nq,).
        tip_margin: As of :class:`ForceModel`.
        grip: Likewise.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        contacts: Contacts,
        q: Array,
        tip_margin: float,
        grip: float,
    ) -> None:
        self._dynamics, self._contacts, self._tip_margin = dynamics, contacts, tip_margin
        robot = dynamics.robot
        self._weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        faces = 2.0 * math.pi * (np.arange(GRIP_POLYGON_FACES) + 0.5) / GRIP_POLYGON_FACES
        self._cos, self._sin = np.cos(faces)[:, None, None], np.sin(faces)[:, None, None]
        self._usable_friction = grip * math.cos(math.pi / GRIP_POLYGON_FACES) * contacts.friction
        z = robot.drive.ground  # Σ N, Σ N x, Σ N y of the loads N at points (x, y) of the ground
        self._moments_by_wrench = np.zeros((3, 6))
        self._moments_by_wrench[[0, 1, 1, 2, 2], [2, 0, 4, 1, 3]] = 1.0, z, -1.0, z, 1.0
        self.by_multipliers = np.vstack([contacts.along, contacts.across])
        self.update(q)
        # One row a contact about tipping if the polygon changes with the posture.
        steady = contacts.stance is not None
        self.edges = len(self._stance.inward) if steady else len(contacts.points)
        self.grip_rows = GRIP_POLYGON_FACES * len(contacts.along)
        self.rows = self.edges + self.grip_rows

    def update(self, q: Array) -> None:
        """Update the contacts to those at q (nq,)."""
        self._stance = stance_at(self._dynamics, self._contacts, q)

    def __call__(self, forces: Forces) -> Array:
        """Return the margins."""
        grips = self.grip(forces, self.load_split(forces))
        return np.concatenate([self.tip(forces), grips], axis=-2)

    def load_split(self, forces: Forces) -> Array:
        """Return the map (..., n_contacts, 3) from moments to the contacts' loads there."""
        stance, moments = self._stance, self._moments(forces)[..., 0]
        least = moments @ stance.split.T
        if least.min() >= 0.0:
            return stance.split
        found = np.array([_load_split(stance, each) for each in moments.reshape(-1, 3)])
        return found.reshape(*moments.shape[:-1], *stance.split.shape)

    def _moments(self, forces: Forces) -> Array:
        return np.asarray(self._moments_by_wrench @ forces.wrench)

    def tip(self, forces: Forces) -> Array:
        """Return the rows about tipping."""
        stance = self._stance
        edges = np.arange(self.edges) % len(stance.inward)
        by_moments = np.column_stack([stance.offset - self._tip_margin, stance.inward])[edges]
        return np.asarray((by_moments @ self._moments_by_wrench / self._weight) @ forces.wrench)

    def grip(self, forces: Forces, load_split: Array) -> Array:
        """Return the rows about slipping.

        Args:
            load_split: Map from moments to loads (..., n_contacts, 3) that applies.
        """
        wheels, usable = len(self._contacts.along), self._usable_friction
        horizontal = forces.maps.horizontal @ forces.force
        along, lateral = horizontal[..., :wheels, :], horizontal[..., wheels:, :]
        load = load_split[..., :wheels, :] @ self._moments(forces)
        across = _across(self._contacts, lateral, load)
        along, across, load = (part[..., None, :, :] for part in (along, across, usable * load))
        slack = (load - self._cos * along - self._sin * across) / (usable * self._weight)
        return slack.reshape(*slack.shape[:-3], -1, slack.shape[-1])


def stack(forces: Sequence[Forces]) -> Forces:
    """Return the forces at several states as one record."""
    maps = forces[0].maps
    if any(each.maps is not maps for each in forces):
        maps = ForceMaps(*(np.array(part) for part in zip(*(f.maps for f in forces), strict=True)))
    return Forces(
        maps, np.array([each.force for each in forces]), np.array([each.wrench for each in forces])
    )


def _across(contacts: Contacts, lateral: Array, load: Array) -> Array:
    """Return the wheels' lateral forces (..., n_wheels, columns), columns as those of ``Forces``.

    Wheels share their axle's force F in proportion to their loads N: F_w = N_w F / Σ N. So with
    f = F / Σ N the derivative is that of N_w f + N_w (F′ − f Σ N′) / Σ N, f held in the first term.

    Args:
        contacts: Contacts with the ground.
        lateral: The axles' lateral forces (..., n_axles, columns).
        load: The wheels' loads (..., n_wheels, columns).
    """
    bearing = np.maximum(load[..., 0], contacts.floor)
    on_axle = bearing @ contacts.incidence
    share = bearing[..., None] * contacts.incidence / on_axle[..., None, :]
    across: Array = share @ lateral
    change = load[..., 1:] * (load[..., :1] > contacts.floor)
    ratio = lateral[..., 0] / on_axle
    across[..., 1:] += (ratio @ contacts.incidence.T)[..., None] * change
    across[..., 1:] -= share @ (ratio[..., None] * (contacts.incidence.T @ change))
    return across


def _load_split(stance: Stance, moments: Array) -> Array:
    """Return the map (n, 3) from moments to the loads of the contacts that bear load.

    If all do, or the robot tips, it is the stance's split; contacts that lift off have no load.

    Args:
        moments: Vertical force (N) and the two tilting moments (N·m) on the ground (3,).
    """
    least = stance.split @ moments
    if least.min() >= 0.0 or len(least) == 3:
        return stance.split
    margin = float((stance.inward @ (moments[1:] / moments[0]) + stance.offset).min())
    found = pressed_loads(stance, moments, least) if margin > 0.0 else None
    return stance.split if found is None else found.slope
