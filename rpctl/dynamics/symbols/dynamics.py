"""``SymbolicDynamics``: M(q) ν̇ + h(q, ν) = B(q) τ + ℓ(q, ν) as a graph of CasADi's scalars."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi
import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.projection import Projector
from rpctl.dynamics.rolling import find_rolling
from rpctl.dynamics.symbols.basis import (
    SymbolicBasis,
    SymbolicConfiguration,
    SymbolicProjection,
    integrated,
)
from rpctl.dynamics.symbols.bodies import moving_bodies
from rpctl.dynamics.symbols.numbers import NOTHING, Parameters, RobotNumbers, Varied
from rpctl.dynamics.symbols.rigid_body import (
    MovingTree,
    crba,
    joint_motions,
    moving_tree,
    rnea,
)
from rpctl.errors import UnknownNameError
from rpctl.kernels.linear import solve_positive
from rpctl.kernels.scalars import (
    Scalar,
    as_scalar,
    cleaned,
    column,
    dot,
    entries,
    matrix,
    plus,
    product,
    times,
    total,
    transposed,
)
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import BASE_NV, Robot

NO_NUMBERS: Mapping[str, Array] = MappingProxyType({})


class _AtConfiguration(NamedTuple):
    """What is known at one configuration."""

    configuration: SymbolicConfiguration
    projection: SymbolicProjection
    tree: MovingTree


class SymbolicDynamics:
    """``ReducedDynamics`` over ``casadi.SX`` columns: the same names, quantities and orders.

    Nothing is raised when a graph is evaluated: where the steering is singular, ``rank_margin`` is
    small, and what depends on the basis is of no use.

    Args:
        robot: The robot.
        varied: What is an entry of ``p`` instead of a constant.

    Attributes:
        p: The symbols of what is varied, ``casadi.SX`` (n_p, 1).
    """

    def __init__(self, robot: Robot, varied: Varied = NOTHING) -> None:
        self.robot, self.varied = robot, varied
        self._projector = Projector(robot, find_rolling(robot))
        self._bodies = moving_bodies(robot)
        self._numbers = RobotNumbers(robot, self._bodies)
        self._parameters = Parameters(self._numbers.nominal, self._numbers.varied(varied))
        self.p = self._parameters.symbols
        self._known = self._parameters.scalars()
        self._swivels = [robot.entries[swivel.joint] for swivel in robot.drive.swivels]
        self._last: _AtConfiguration | None = None

    def parameters_of(self, variant: Robot) -> Array:
        """Return the numbers (n_p,) that stand for ``p`` in another robot of the same structure.

        Raises:
            RpctlError: It differs in more than what is varied.
        """
        return self._parameters.values(self._numbers.of(variant))

    def parameters(
        self, variant: Robot, inertias: Array, numbers: Mapping[str, Array] = NO_NUMBERS
    ) -> Array:
        """Return the numbers (..., n_p) for robots that differ from a variant in inertias.

        Args:
            variant: What they have in common.
            inertias: Pseudo-inertias of the bodies (..., n, 4, 4), as of
                :meth:`rpctl.robot.variation.LinkInertias.bodies`.
            numbers: What else they differ in, in stacks: ``damping`` and ``friction`` (..., nv),
                and what :func:`rolling_numbers` names.

        Raises:
            RpctlError: They differ in more than what is varied.
        """
        return self._parameters.values({**self._numbers.of(variant, inertias), **numbers})

    @property
    def lossy(self) -> bool:
        """Whether joints have damping or friction."""
        return self.robot.losses is not None or bool(self.varied.losses)

    def at(self, q: Any) -> SymbolicProjection:
        """Return the projection at q (nq, 1)."""
        return self._at(q).projection

    def _at(self, q: Any) -> _AtConfiguration:
        if self._last is None or self._last.configuration.q is not q:
            at = SymbolicConfiguration(q)
            basis = SymbolicBasis(self._projector, self._known, at, self._swivels)
            projection = SymbolicProjection(self._projector, basis, self.varied.rolling)
            tree = moving_tree(self._bodies, self._known["inertia"], self._known["lift"], at)
            self._last = _AtConfiguration(at, projection, tree)
        return self._last

    def rank_margin(self, q: Any) -> Any:
        """Return how far the steering at q (nq, 1) is from a singular one; 1 where none can be."""
        return self.at(q).margin

    def basis(self, q: Any) -> Any:
        """Return S (nv, dof) at q (nq, 1)."""
        return self.at(q).S

    def twist(self, q: Any, nu: Any) -> Any:
        """Return the base's twist (3, 1): P's speed forward and left, turning rate."""
        base = product(self.at(q).rows[:BASE_NV], entries(nu))
        return column(product(self.robot.point_velocity.tolist(), base))

    def inertia(self, q: Any) -> Any:
        """Return M (dof, dof) at q (nq, 1), symmetric to the bit."""
        return matrix(self._inertia(q), dense=True)

    def _inertia(self, q: Any) -> list[list[Scalar]]:
        _, projection, tree = self._at(q)
        entries_of = crba(tree)
        beside: dict[int, list[tuple[int, Scalar]]] = {}
        for (i, j), value in entries_of.items():
            beside.setdefault(i, []).append((j, value))
        nv, dof = self.robot.nv, self.robot.dof
        columns = projection.columns
        images = [
            [total(times(value, s[j]) for j, value in beside[i]) for i in range(nv)]
            for s in columns
        ]
        M = [[0.0] * dof for _ in range(dof)]
        for i in range(dof):
            for j in range(i + 1):
                M[i][j] = M[j][i] = dot(columns[j], images[i])
        return M

    def bias(self, q: Any, nu: Any) -> Any:
        """Return h (dof, 1) at q (nq, 1) and ν (dof, 1)."""
        return column(self._force(q, entries(nu), None))

    def inverse(self, q: Any, nu: Any, nu_dot: Any, lossy_nu: Any = None) -> Any:
        """Return the quasi-force M ν̇ + h − ℓ (dof, 1); see :meth:`ReducedDynamics.inverse`.

        Args:
            q: Configuration (nq, 1).
            nu: Quasi-velocities (dof, 1).
            nu_dot: Their derivatives (dof, 1).
            lossy_nu: Quasi-velocities (dof, 1) at which the losses are taken; None: at ν.
        """
        force = column(self._force(q, entries(nu), entries(nu_dot)))
        return force - self.losses(q, nu if lossy_nu is None else lossy_nu)

    def _force(self, q: Any, nu: list[Scalar], nu_dot: list[Scalar] | None) -> list[Scalar]:
        _, projection, tree = self._at(q)
        v, a = product(projection.rows, nu), projection.drifting(nu)
        if nu_dot is not None:
            a = plus(a, product(projection.rows, nu_dot))
        return product(projection.columns, rnea(tree, v, a))

    def lossless(self, q: Any, nu: Any, tau: Any) -> tuple[Any, Any]:
        """Return M (dof, dof) and B τ − h (dof, 1).

        Args:
            q: Configuration (nq, 1).
            nu: Quasi-velocities (dof, 1).
            tau: Actuator efforts (n_act, 1).
        """
        push = product(self.at(q).actuation, entries(tau))
        return self.inertia(q), column(push) - self.bias(q, nu)

    def losses(self, q: Any, nu: Any) -> Any:
        """Return ℓ (dof, 1), the quasi-force of damping and friction."""
        if not self.lossy:
            return casadi.SX.zeros(self.robot.dof, 1)
        S = self.at(q).S
        return S.T @ self.loss_force(S @ nu)

    def forward(self, q: Any, nu: Any, tau: Any) -> Any:
        """Return ν̇ (dof, 1), losses included.

        Args:
            q: Configuration (nq, 1).
            nu: Quasi-velocities (dof, 1).
            tau: Actuator efforts (n_act, 1).
        """
        M, push = self.lossless(q, nu, tau)
        return self.solve_positive(M, push + self.losses(q, nu))

    def solve_positive(self, M: Any, b: Any) -> Any:
        """Return M⁻¹ b (n, 1) of a symmetric positive definite M (n, n), without pivots."""
        n = M.shape[0]
        rows = [[as_scalar(M[i, j]) for j in range(n)] for i in range(n)]
        return column(solve_positive(rows, entries(b)))

    def efforts(self, q: Any, force: Any) -> Any:
        """Return τ (n_act, 1) of least effort relative to the limits with B τ = ``force``."""
        return column(self.at(q).allocated(entries(force)))

    def integrate(self, q: Any, v: Any) -> Any:
        """Return q (nq, 1) moved along v (nv, 1) for a time of 1, as ``pinocchio.integrate``."""
        moving = {body.index: body.entry for body in self._bodies if body.entry is not None}
        return integrated(q, v, moving)

    def base_pose(self, q: Any) -> Any:
        """Return the pose (x, y, θ) (3, 1) of P in the world; m, rad."""
        px, py = self.robot.drive.point
        theta = casadi.atan2(q[3], q[2]) + self.robot.drive.heading
        x, y = q[0] + q[2] * px - q[3] * py, q[1] + q[3] * px + q[2] * py
        return casadi.vertcat(x, y, theta)

    def joint_positions(self, q: Any) -> Any:
        """Return the arm's positions (n_joints, 1); continuous joints in (−π, π]."""
        return column([self.position(q, joint.name) for joint in self.robot.joints])

    def position(self, q: Any, joint: str) -> Any:
        """Return a joint's position (rad or m) at q (nq, 1), or where it is locked."""
        if joint in self.robot.locked:
            return casadi.SX(self.robot.locked[joint])
        return casadi.SX(self._at(q).configuration.position(self.robot.entries[joint]))

    def placement(self, q: Any, frame: str) -> tuple[Any, Any]:
        """Return the axes (3, 3) and the origin (3, 1) of a link's frame in the world."""
        model = self.robot.model
        if not model.existBodyName(frame):
            raise UnknownNameError("link", frame, self.robot.description.link)
        found = model.frames[model.getFrameId(frame, pin.FrameType.BODY)]
        body = found.parentJoint - ROOT_JOINT
        pose = np.linalg.inv(self._bodies[body].frame) @ found.placement.homogeneous
        R, p = cleaned(pose[:3, :3].T).tolist(), cleaned(pose[:3, 3]).tolist()
        tree = MovingTree(
            joint_motions(self._bodies, self._at(q).configuration), (), (0.0, 0.0, 0.0)
        )
        for joint in tree.before(tree.joints[body - 1]) if body else ():
            R, p = [joint.inwards(x) for x in R], plus(joint.inwards(p), joint.p)
        x, y, cos, sin = entries(q)[:4]
        to_world = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
        R, p = [product(to_world, x) for x in R], plus(product(to_world, p), [x, y, 0.0])
        return matrix(transposed(R), dense=True), column(p)

    def loss_force(self, v: Any) -> Any:
        """Return the generalised force (nv, 1) of damping and friction at v (nv, 1)."""
        return -self.loss_secant(v) * v

    def loss_slope(self, v: Any) -> Any:
        """Return −∂force/∂v (nv, 1) at v (nv, 1)."""
        d, f, squares = self._lost
        size = v * v + squares
        return d + f * squares / (size * casadi.sqrt(size))

    def loss_secant(self, v: Any) -> Any:
        """Return −force/v (nv, 1) at v (nv, 1)."""
        d, f, squares = self._lost
        return d + f / casadi.sqrt(v * v + squares)

    @cached_property
    def _lost(self) -> tuple[Any, Any, Any]:
        names = "damping", "friction", "rate"
        d, f, rate = (column(self._known[name]) for name in names)
        return d, f, rate * rate
