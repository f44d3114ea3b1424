"""Efforts and ground reactions at the states of a predicted motion, as rows within their bounds."""

from __future__ import annotations

import math as numbers
from collections import deque
from typing import Any

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.settings import Bounds
from rpctl.dynamics.ground_reaction import Contacts, stance_at
from rpctl.dynamics.projection import Projection
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.stance import Stance, pressed_loads
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.sheet import Evaluator

ROOT_AT_ORIGIN = (0.0, 0.0, 1.0, 0.0)  # the planar root's part of q at the origin
GRIP_POLYGON_FACES = 8  # of the polygon inside each wheel's circle of grip
KEPT_LOAD_SPLITS = 3  # last load splits that bound the first step


class Ground:
    """What keeps a robot from tipping and slipping, in scalars; and the numbers of a posture.

    Rows are ≤ 0 where it does neither. First one for each edge of the support polygon (some twice
    if their number changes): what the moment about it lacks of the margin, divided by the weight
    (m). Then, for each wheel and split of the load, one for each face of a polygon inside the
    circle of its grip: grip that is missing, divided by the grip under the robot's whole weight.
    The contacts are those of the posture last given to :meth:`update`.

    Args:
        q: The first posture (nq,).

    Attributes:
        edges: Number of rows about tipping.
    """

    def __init__(
        self, dynamics: ReducedDynamics, contacts: Contacts, q: Array, bounds: Bounds
    ) -> None:
        self._dynamics, self._contacts, self._tip_margin = dynamics, contacts, bounds.tip_margin
        robot, self._friction = dynamics.robot, bounds.grip * contacts.friction
        self._friction *= numbers.cos(numbers.pi / GRIP_POLYGON_FACES)
        self._weight = robot.mass * float(np.linalg.norm(robot.model.gravity.linear))
        z = robot.drive.ground  # Σ N, Σ N x, Σ N y of the loads N at points (x, y) of the ground
        self._moments_by_wrench = np.zeros((3, 6))
        self._moments_by_wrench[[0, 1, 1, 2, 2], [2, 0, 4, 1, 3]] = 1.0, z, -1.0, z, 1.0
        self._by_multipliers = np.vstack([contacts.along, contacts.across])
        self._cached: tuple[Projection, Array] | None = None
        self.update(q)
        # One row a contact about tipping if the polygon changes with the posture.
        steady = contacts.stance is not None
        self.edges = len(self.stance.inward) if steady else len(contacts.points)

    def update(self, q: Array) -> None:
        """Update the contacts to those at q (nq,)."""
        self.stance: Stance = stance_at(self._dynamics, self._contacts, q)

    def moments(self, wrench: Any) -> Any:
        """Return Σ N (1, x, y) of the loads (3, 1) that make up a wrench (6, 1)."""
        return math.DM(self._moments_by_wrench) @ wrench

    def symbols(self, splits: int) -> list[Any]:
        """Return the symbols that stand for :meth:`numbers` of so many splits of the load."""
        wheels, nv = len(self._contacts.along), self._dynamics.robot.nv
        shapes = (self.edges, 3), (len(self._by_multipliers), nv), (wheels, 3 * splits)
        return [math.SX.sym(f"ground{k}", *shape) for k, shape in enumerate(shapes)]

    def numbers(self, at: Projection, splits: list[Array]) -> list[Array]:
        """Return the maps to tipping, to the wheels' forces and to their loads, as columns.

        Args:
            at: The projection at the state.
            splits: Maps from moments to the contacts' loads (n_contacts, 3) that apply.
        """
        if self._cached is None or self._cached[0] is not at:
            self._cached = at, (self._by_multipliers @ at.multipliers).T.ravel()
        stance, wheels = self.stance, len(self._contacts.along)
        edges = np.arange(self.edges) % len(stance.inward)
        tips = np.column_stack([stance.offset - self._tip_margin, stance.inward])[edges]
        loads = np.concatenate([split[:wheels].T.ravel() for split in splits])
        return [tips.T.ravel(), self._cached[1], loads]

    def rows(self, force: Any, wrench: Any, symbols: list[Any]) -> Any:
        """Return the rows.

        Args:
            force: The constraints' generalised force (nv, 1).
            wrench: The ground's (6, 1).
            symbols: Those of :meth:`symbols`.
        """
        contacts, (tips, horizontal, splits) = self._contacts, symbols
        wheels, usable, moments = len(contacts.along), self._friction, self.moments(wrench)
        along, lateral = math.vertsplit(horizontal @ force, [0, wheels, horizontal.shape[0]])
        found, incidence = [-(tips @ moments) / self._weight], math.DM(contacts.incidence)
        for split in math.horzsplit(splits, 3):
            load = split @ moments
            # Wheels share their axle's force in proportion to their loads.
            bearing = math.fmax(load, contacts.floor)
            across = bearing * (incidence @ (lateral / (incidence.T @ bearing)))
            for face in range(GRIP_POLYGON_FACES):
                angle = 2.0 * numbers.pi * (face + 0.5) / GRIP_POLYGON_FACES
                pull = numbers.cos(angle) * along + numbers.sin(angle) * across
                found.append((pull - usable * load) / (usable * self._weight))
        return math.vertcat(*found)

    def load_split(self, moments: Array) -> Array:
        """Return the map (n_contacts, 3) from moments to the contacts' loads at moments (3,).

        If all bear load, or the robot tips, it is the stance's; contacts that lift off have none.
        """
        stance = self.stance
        least = stance.split @ moments
        if least.min() >= 0.0 or len(least) == 3:
            return stance.split
        margin = float((stance.inward @ (moments[1:] / moments[0]) + stance.offset).min())
        found = pressed_loads(stance, moments, least) if margin > 0.0 else None
        return stance.split if found is None else found.slope


class ForceRows:
    """Rows of efforts, then of the ground, of one model of a robot; with derivatives.

    Efforts τ are within their limits where τ/limit − 1 and −τ/limit − 1 are ≤ 0.

    Args:
        dynamics: The model.
        symbols: It in scalars.
        bounds: Those of the efforts.
        ground: The ground; None leaves it out.
        splits: Number of splits of the load.
        by: By how many ν̇, and by how many ν, there are derivatives.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        symbols: SymbolicDynamics,
        bounds: Bounds,
        ground: Ground | None,
        splits: int,
        by: tuple[int, int],
    ) -> None:
        robot, dof, given = dynamics.robot, dynamics.robot.dof, list[Any]()
        self._dynamics, self._ground, self._splits = dynamics, ground, splits
        joints = math.SX.sym("q", robot.nq - len(ROOT_AT_ORIGIN))
        nu, nu_dot = math.SX.sym("nu", dof), math.SX.sym("nu_dot", dof)
        state, q = [joints, nu, nu_dot], math.vertcat(math.SX(math.DM(ROOT_AT_ORIGIN)), joints)
        force, wrench = symbols.tree_force(q, nu, nu_dot)
        tau = symbols.efforts(q, symbols.at(q).S.T @ force)
        limited, limits = bounds.efforts(robot)
        share = tau[limited.tolist()] / math.DM(limits)
        rows = math.vertcat(share - 1.0, -share - 1.0)
        if ground is not None:
            given = ground.symbols(splits)
            moments = math.densify(ground.moments(wrench))
            self._moments = Evaluator(math.Function("moments", state, [moments]))
            for column, name in enumerate(robot.actuators):
                force[robot.velocity_index(name)] -= tau[column]
            rows = math.vertcat(rows, ground.rows(force, wrench, given))
        jacobian = math.jacobian(rows, math.vertcat(nu_dot[: by[0]], nu[: by[1]]))
        found = math.densify(math.horzcat(rows, jacobian).T)
        self._shape = found.shape[::-1]
        self._run = Evaluator(math.Function("rows", [*state, *given], [found]))

    def __call__(
        self, q: Array, nu: Array, nu_dot: Array, splits: deque[Array] | None = None
    ) -> Array:
        """Return the rows (rows, 1 + columns): values, derivatives by ν̇, then by ν.

        Args:
            splits: The last splits of the load, to which the present one is added if it is another
                one; it stands for all of those that are missing. None: it applies alone.

        Raises:
            SingularBasisError: The steering at q is singular.
        """
        state, given = (q[len(ROOT_AT_ORIGIN) :], nu, nu_dot), list[Array]()
        at = self._dynamics.at(q)
        if self._ground is not None:
            split, count = self._ground.load_split(self._moments(*state)[0]), self._splits
            splits = deque(maxlen=count) if splits is None else splits
            if not splits:
                splits.extend([split] * count)
            elif not np.array_equal(split, splits[-1]):
                splits.append(split)
            given = self._ground.numbers(at, list(splits))
        return self._run(*state, *given)[0].reshape(self._shape)


class ForceModel:
    """Forces of one robot at measured and at predicted states.

    The prediction does not know the angles of casters that nothing drives: at predicted states they
    glide. Guessed angles would produce rates and forces many times too large.

    Args:
        contacts: Contacts with the ground; None leaves the ground's reactions out.

    Attributes:
        ground: The ground; None of a robot that is not known to stand.
        efforts: Number of rows of the efforts.
        measured: Rows at a measured state, by all of ν̇.
        foreseen: Rows at a predicted one, by the ν̇ and ν that move the base.
    """

    def __init__(self, model: Model, contacts: Contacts | None, bounds: Bounds) -> None:
        robot, own = model.robot, model.dynamics
        idle = [swivel.joint for swivel in robot.drive.idle_casters]
        foreseen, ahead = own, model.symbolic
        if idle:
            foreseen = ReducedDynamics(robot, gliding=idle)
            ahead = SymbolicDynamics(robot, gliding=idle)
        q, still = robot.configuration_at(np.zeros(3), robot.home), np.zeros(robot.dof)
        self.ground: Ground | None = None
        if contacts is not None and contacts.balanced:
            self.ground = Ground(own, contacts, q, bounds)
        self.efforts, moving = 2 * len(bounds.efforts(robot)[0]), (model.base_columns,) * 2
        self.foreseen = ForceRows(foreseen, ahead, bounds, self.ground, 1, moving)
        if self.ground and self.foreseen(q, still, still)[self.efforts :, 0].max() > 0.0:
            self.ground = None  # it tips at rest: there is no balance to keep
            self.foreseen = ForceRows(foreseen, ahead, bounds, None, 1, moving)
        splits, whole = KEPT_LOAD_SPLITS, (robot.dof, 0)
        self.measured = ForceRows(own, model.symbolic, bounds, self.ground, splits, whole)

    def update(self, q: Array) -> None:
        """Update the contacts to those at q (nq,)."""
        if self.ground is not None:
            self.ground.update(q)
