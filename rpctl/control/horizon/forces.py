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
from rpctl.dynamics.stance import Stance, loads
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
    glide. Guessed angles would produce rates and forces many times too large. The contacts are
    those of the posture last given to :meth:`update_contacts`.

    Args:
        contacts: Contacts with the ground; None leaves the ground's reactions out.
        tip_margin: Least distance of the zero-moment point to the polygon's edge, m.
        grip: Largest fraction of its grip that a wheel may use.
    """

    def __init__(
        self, model: Model, contacts: Contacts | None, tip_margin: float, grip: float
    ) -> None:
        robot = model.robot
        self._model, self._data = model, robot.model.createData()
        self._contacts, self._tip_margin = contacts, tip_margin
        self._foreseen = model.dynamics
        idle = [swivel.joint for swivel in robot.drive.idle_casters]
        if idle:
            self._foreseen = ReducedDynamics(robot, gliding=idle)
        self._weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        faces = 2.0 * math.pi * (np.arange(GRIP_POLYGON_FACES) + 0.5) / GRIP_POLYGON_FACES
        self._cos, self._sin = np.cos(faces)[:, None, None], np.sin(faces)[:, None, None]
        self._usable_friction = grip * math.cos(math.pi / GRIP_POLYGON_FACES)
        self._usable_friction *= contacts.friction if contacts else 0.0
        z = robot.drive.ground  # Σ N, Σ N x, Σ N y of the loads N at points (x, y) of the ground
        self._moments_by_wrench = np.zeros((3, 6))
        self._moments_by_wrench[[0, 1, 1, 2, 2], [2, 0, 4, 1, 3]] = 1.0, z, -1.0, z, 1.0
        self._stance: Stance | None = None
        self._cached_maps: tuple[Projection, ForceMaps] | None = None
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
        """Return the forces at a predicted state, one column."""
        at = self._foreseen.at(q)
        acceleration = at.S @ nu_dot + at.drift(nu)
        v, losses = at.S @ nu, self._model.robot.losses
        force = pin.rnea(self._model.robot.model, self._data, q, v, acceleration).copy()
        wrench = self._data.f[ROOT_JOINT].vector
        if losses is not None:
            force -= losses.force(v)
        return Forces(self._maps(at), force[:, None], wrench[:, None].copy())

    def with_derivatives(
        self,
        q: Array,
        nu: Array,
        nu_dot: Array,
        dynamics: ReducedDynamics | None = None,
        accelerations: int | None = None,
        speeds: int | None = None,
    ) -> Forces:
        """Return the forces at a state and their derivatives, all columns.

        They are by the first ``accelerations`` of ν̇ (all) and ``speeds`` of ν (the base's). A
        measured state has the robot's own dynamics.
        """
        model, data = self._model.robot.model, self._data
        # At the origin the world's axes are the root link's.
        q = np.concatenate([ROOT_AT_ORIGIN, q[len(ROOT_AT_ORIGIN) :]])
        here = (dynamics or self._foreseen).at(q)
        S, drift = here.S, here.drift(nu)
        base = self._model.base_columns if speeds is None else speeds
        count = accelerations or S.shape[1]
        force, wrench = np.empty((len(S), 1 + count + base)), np.empty((6, 1 + count + base))
        v, by_nu_dot = S @ nu, S[:, :count]
        drift_by_nu = here.drift_by_nu(nu, base) if base else S[:, :0]
        # But for losses the forces are quadratic in v = Sν and linear in Ṡν: differences are exact.
        for column in range(base):
            step, change = S[:, column], drift_by_nu[:, column]
            ahead = pin.rnea(model, data, q, v + step, change).copy()
            wrench_ahead = data.f[ROOT_JOINT].vector.copy()
            behind = pin.rnea(model, data, q, v - step, -change)
            force[:, 1 + count + column] = 0.5 * (ahead - behind)
            wrench[:, 1 + count + column] = 0.5 * (wrench_ahead - data.f[ROOT_JOINT].vector)
        force[:, 0] = pin.rnea(model, data, q, v, S @ nu_dot + drift)
        wrench[:, 0] = data.f[ROOT_JOINT].vector
        if (losses := self._model.robot.losses) is not None:
            force[:, 0] -= losses.force(v)
            force[:, 1 + count :] += losses.slope(v)[:, None] * S[:, :base]
        force[:, 1 : 1 + count] = pin.crba(model, data, q) @ by_nu_dot
        momentum = pin.computeCentroidalMap(model, data, q) @ by_nu_dot
        wrench[:, 1 : 1 + count] = momentum
        x, y, z = data.com[0]
        arm = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        wrench[3:, 1 : 1 + count] += arm @ momentum[:3]
        return Forces(self._maps(here), force, wrench)

    def efforts(self, forces: Forces) -> Array:
        """Return τ (..., n_act, columns)."""
        return np.asarray(forces.maps.efforts @ forces.force)

    def ground(self, forces: Forces) -> Array:
        """Return the margins (..., rows, columns), ≥ 0 where the robot neither tips nor slips.

        First one row for each edge of the support polygon (some twice if their number changes): the
        moment about it beyond the margin, divided by the weight (m). Then, for each wheel, one row
        for each face of a polygon inside the circle of its grip: remaining grip, divided by the
        grip under the robot's whole weight.
        """
        grips = self.grip_margins(forces, self.load_split(forces))
        return np.concatenate([self.tip_margins(forces), grips], axis=-2)

    def load_split(self, forces: Forces) -> Array:
        """Return the map (..., n_contacts, 3) from moments to the contacts' loads there."""
        stance, moments = self._required_stance, self._moments(forces)[..., 0]
        least = moments @ stance.split.T
        if least.min() >= 0.0:
            return stance.split
        found = np.array([_load_split(stance, each) for each in moments.reshape(-1, 3)])
        return found.reshape(*moments.shape[:-1], *stance.split.shape)

    @property
    def _required_stance(self) -> Stance:
        if self._stance is None:
            raise ValueError("no ground reactions are defined")
        return self._stance

    def _moments(self, forces: Forces) -> Array:
        return np.asarray(self._moments_by_wrench @ forces.wrench)

    def tip_margins(self, forces: Forces) -> Array:
        """Return the rows of :meth:`ground` about tipping."""
        stance = self._required_stance
        edges = np.arange(self._edges) % len(stance.inward)
        by_moments = np.column_stack([stance.offset - self._tip_margin, stance.inward])[edges]
        return np.asarray((by_moments @ self._moments_by_wrench / self._weight) @ forces.wrench)

    def grip_margins(self, forces: Forces, load_split: Array) -> Array:
        """Return the rows of :meth:`ground` about slipping.

        Args:
            load_split: Map from moments to loads (..., n_contacts, 3) that applies.
        """
        contacts = self._contacts
        if contacts is None:
            raise ValueError("no ground reactions are defined")
        wheels, usable = len(contacts.along), self._usable_friction
        horizontal = forces.maps.horizontal @ forces.force
        along, lateral = horizontal[..., :wheels, :], horizontal[..., wheels:, :]
        load = load_split[..., :wheels, :] @ self._moments(forces)
        across = _across(contacts, lateral, load)
        along, across, load = (part[..., None, :, :] for part in (along, across, usable * load))
        slack = (load - self._cos * along - self._sin * across) / (usable * self._weight)
        return slack.reshape(*slack.shape[:-3], -1, slack.shape[-1])

    def _maps(self, at: Projection) -> ForceMaps:
        """Return the maps from the tree's force to the efforts and to the wheels' forces."""
        if self._cached_maps is None or self._cached_maps[0] is not at:
            allocation = at.allocation @ at.S.T
            columns = at.projector.columns
            horizontal = np.empty((0, len(columns)))
            if self._contacts is not None:
                forces = np.vstack([self._contacts.along, self._contacts.across]) @ at.multipliers
                horizontal = forces @ (np.eye(len(columns)) - columns @ allocation)
            self._cached_maps = at, ForceMaps(allocation, horizontal)
        return self._cached_maps[1]


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
    bearing = loads(stance, moments, margin) > 0.0
    if margin <= 0.0 or bearing.all():
        return stance.split
    load_split = np.zeros_like(stance.split)
    load_split[bearing] = np.linalg.pinv(stance.statics[:, bearing])
    return load_split
