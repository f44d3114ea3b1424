"""``SymbolicDynamics``: M(q) ν̇ + h(q, ν) = B(q) τ + ℓ(q, ν) as a graph of CasADi's scalars."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import Array
from rpctl.dynamics.projection import Projector
from rpctl.dynamics.rolling import find_rolling
from rpctl.dynamics.symbols.basis import (
    SINGULAR,
    SymbolicBasis,
    SymbolicConfiguration,
    SymbolicProjection,
    integrated,
)
from rpctl.dynamics.symbols.bodies import felt, inertias_of, moving_bodies
from rpctl.dynamics.symbols.numbers import RobotNumbers
from rpctl.dynamics.symbols.rigid_body import (
    PLANAR_ROOT,
    MovingTree,
    crba,
    first_moment,
    joint_motions,
    moving_tree,
    rnea,
)
from rpctl.errors import UnknownNameError
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
    solve_positive,
    times,
    total,
    transposed,
)
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import BASE_NV, Robot
from rpctl.robot.variation import BuiltNumbers


class _AtConfiguration(NamedTuple):
    """What is known at one configuration."""

    configuration: SymbolicConfiguration
    projection: SymbolicProjection
    tree: MovingTree


class SymbolicReaction(NamedTuple):
    """What :class:`rpctl.dynamics.reduced.Reactions` has of a state, but for the multipliers."""

    v: Any  # (nv, 1)
    residual: Any  # (nv, 1)
    wrench: Any  # (6, 1)
    energy: Any  # (1, 1)


class SymbolicDynamics:
    """``ReducedDynamics`` over ``casadi.SX`` columns: the same names, quantities and orders.

    Nothing is raised when a graph is evaluated: where the steering is singular, ``rank_margin`` is
    small, and what depends on the basis is of no use.

    Args:
        robot: The robot.
        others: Robots that the graph is for, too; in what they differ, from each other and from
            more of their kind, there is an entry of ``p`` instead of a constant.
        gliding: Joints of swivels that glide, as of :class:`ReducedDynamics`.

    Attributes:
        varies: Whether there are others.
    """

    def __init__(
        self, robot: Robot, others: BuiltNumbers | None = None, gliding: Collection[str] = ()
    ) -> None:
        self.robot, self.varies = robot, others is not None
        self._projector = Projector(robot, find_rolling(robot, gliding))
        self._bodies = moving_bodies(robot)
        self._numbers = RobotNumbers(robot, self._bodies, others, gliding)
        self._swivels = [robot.entries[swivel.joint] for swivel in robot.drive.swivels]
        self._last: _AtConfiguration | None = None

    def parameters_of(self, variant: Robot) -> Array:
        """Return the numbers (n_p,) that stand for ``p`` in another robot of the same structure.

        Raises:
            RpctlError: It differs in more than what is varied.
        """
        return self._numbers.values(self._numbers.of(variant))

    def parameters(self, others: BuiltNumbers) -> Array:
        """Return the numbers (K, n_p) that stand for ``p`` in K robots.

        Raises:
            RpctlError: They differ in more than what is varied.
        """
        return self._numbers.values(self._numbers.built(others))

    @property
    def varied(self) -> dict[str, bytes]:
        """Which numbers are entries of ``p``, by name: a byte each, 1 of those that are."""
        return {name: mask.tobytes() for name, mask in self._numbers.varied.items()}

    @cached_property
    def p(self) -> Any:
        """The symbols of what is varied, ``casadi.SX`` (n_p, 1)."""
        return self._numbers.symbols

    @cached_property
    def _known(self) -> dict[str, Any]:
        return self._numbers.scalars()

    @property
    def constant(self) -> bool:
        """Whether S is the same at every q."""
        return self._projector.constant is not None

    @property
    def lossy(self) -> bool:
        """Whether joints have damping or friction."""
        varied = self._numbers.varied
        return self.robot.losses is not None or bool(
            varied["damping"].any() or varied["friction"].any()
        )

    def at(self, q: Any) -> SymbolicProjection:
        """Return the projection at q (nq, 1)."""
        return self._at(q).projection

    def _at(self, q: Any) -> _AtConfiguration:
        if self._last is None or self._last.configuration.q is not q:
            at = SymbolicConfiguration(q)
            basis = SymbolicBasis(self._projector, self._known, at, self._swivels)
            projection = SymbolicProjection(self._projector, basis)
            known = self._known["inertia"], self._known["lift"]
            tree = moving_tree(self._bodies, *known, at, PLANAR_ROOT)
            self._last = _AtConfiguration(at, projection, tree)
        return self._last

    def rank_margin(self, q: Any) -> Any:
        """Return how far the steering at q (nq, 1) is from a singular one; 1 where none can be."""
        return self.at(q).margin

    def regular(self, q: Any) -> Any:
        """Return whether the steering at q (nq, 1) fixes one motion, (1, 1)."""
        return self.rank_margin(q) > SINGULAR

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
        return product(projection.columns, rnea(tree, v, a)[0])

    def tree_force(self, q: Any, nu: Any, nu_dot: Any) -> tuple[Any, Any]:
        """Return the tree's force (nv, 1) less its losses, and the ground's wrench (6, 1).

        The wrench is force and moment at the root link's origin, in its axes.

        Args:
            q: Configuration (nq, 1).
            nu: Quasi-velocities (dof, 1).
            nu_dot: Their derivatives (dof, 1).
        """
        _, projection, tree = self._at(q)
        v, drift = product(projection.rows, entries(nu)), projection.drifting(entries(nu))
        a = plus(drift, product(projection.rows, entries(nu_dot)))
        parts = rnea(replace(tree, numbers=self._whole), v, a)
        force, wrench = (column(part) for part in parts)
        return force - self.loss_force(column(v)) if self.lossy else force, wrench

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

    def reaction(self, q: Any, nu: Any, push: Any) -> SymbolicReaction:
        """Return what the ground does to the robot; see :meth:`ReducedDynamics.reaction`.

        Args:
            q: Configuration (nq, 1).
            nu: Quasi-velocities (dof, 1).
            push: Generalised force of the actuators and of what pushes besides (nv, 1).
        """
        _, projection, tree = self._at(q)
        v, drift = product(projection.rows, entries(nu)), projection.drifting(entries(nu))
        given = push + self.loss_force(column(v)) if self.lossy else push
        free = entries(given - column(rnea(tree, v, drift)[0]))
        M = self._inertia(q)
        nu_dot = solve_positive(M, product(projection.columns, free))
        whole = replace(tree, numbers=self._whole)
        force, wrench = rnea(whole, v, plus(drift, product(projection.rows, nu_dot)))
        residual = column(force) - given
        energy = self._energy(whole, M, q, nu)
        return SymbolicReaction(column(v), residual, column(wrench), casadi.SX(energy))

    def energy(self, q: Any, nu: Any) -> Any:
        """Return kinetic plus potential energy (1, 1), J, but for a constant."""
        return casadi.SX(self._energy(self._at(q).tree, self._inertia(q), q, nu))

    def _energy(self, tree: MovingTree, M: list[list[Scalar]], q: Any, nu: Any) -> Scalar:
        mass, moment = first_moment(tree)
        x, y = entries(q)[:2]
        height = (dot(tree.lift, moment), times(mass, dot(self._known["lift"], (x, y, 0.0))))
        return total((0.5 * dot(entries(nu), product(M, entries(nu))), *height))

    @cached_property
    def _whole(self) -> list[list[float]]:
        """The ten numbers of each body of the robot, with those that a planar root hides."""
        return list(cleaned(felt(self._bodies, inertias_of(self.robot), grounded=True)).tolist())

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

    def configuration_rate(self, q: Any, v: Any) -> Any:
        """Return q̇ (nq, 1) at velocities v (nv, 1)."""
        step = casadi.SX.sym("step", self.robot.nv)
        by_step = casadi.jacobian(self.integrate(q, step), step)
        return casadi.substitute(by_step, step, casadi.SX.zeros(self.robot.nv)) @ v

    def configuration(self, pose: Any, joints: Mapping[str, Any]) -> Any:
        """Return q (nq, 1); mimic joints follow, swivels that follow others do not.

        Args:
            pose: Of P (3, 1).
            joints: Positions by name; 0 for those left out.
        """
        robot = self.robot
        q, theta = pin.neutral(robot.model).tolist(), pose[2] - robot.drive.heading
        (px, py), cos, sin = robot.drive.point, casadi.cos(theta), casadi.sin(theta)
        q[:4] = pose[0] - cos * px + sin * py, pose[1] - sin * px - cos * py, cos, sin
        given, known = dict(joints), {**robot.locked, **joints}
        for joint in robot.mimics:
            if joint.mimic is not None:
                followed = known.get(joint.mimic.joint, 0.0)
                given[joint.name] = joint.mimic.multiplier * followed + joint.mimic.offset
        for name, position in given.items():
            entry = robot.entries[name]
            pair = [casadi.cos(position), casadi.sin(position)]
            q[entry.index : entry.index + 1 + entry.is_pair] = pair if entry.is_pair else [position]
        return column(q)

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
        R, p = self._in_root(q, found.parentJoint, found.placement.homogeneous)
        x, y, cos, sin = entries(q)[:4]
        to_world = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]
        R, p = [product(to_world, x) for x in R], plus(product(to_world, p), [x, y, 0.0])
        return matrix(transposed(R), dense=True), column(p)

    def place(self, q: Any, joint: int, point: Array) -> Any:
        """Return where a point (3,) of a joint's frame is (3, 1), in the root link's frame, m.

        Args:
            q: Configuration (nq, 1).
            joint: Pinocchio's index of the joint.
            point: In its frame, m.
        """
        pose = np.eye(4)
        pose[:3, 3] = point
        return column(self._in_root(q, joint, pose)[1])

    def _in_root(self, q: Any, joint: int, pose: Array) -> tuple[list[list[Scalar]], list[Scalar]]:
        """Return the axes, each as a row, and the origin of a pose (4, 4) in a joint's frame."""
        body = joint - ROOT_JOINT
        pose = np.linalg.inv(self._bodies[body].frame) @ pose
        R, p = cleaned(pose[:3, :3].T).tolist(), cleaned(pose[:3, 3]).tolist()
        tree = MovingTree(
            joint_motions(self._bodies, self._at(q).configuration), (), (0.0, 0.0, 0.0), PLANAR_ROOT
        )
        for each in tree.before(tree.joints[body - 1]) if body else ():
            R, p = [each.inwards(x) for x in R], plus(each.inwards(p), each.p)
        return R, p

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
