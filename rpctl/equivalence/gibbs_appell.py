"""The Gibbs-Appell equations of a wheeled robot, derived apart from everything else.

[MS21, Eq. 1-5]: with u the generalised speeds, every link's acceleration is linear in u̇,

    a = J_v u̇ + a₀,    α = J_ω u̇ + α₀,

so the Gibbs function G = Σ ½ m a·a + ½ α·Iα + α·(ω × Iω) is quadratic in u̇, and its gradient is
the equation of motion ∂G/∂u̇ = M u̇ + h = Q. The tree comes from yourdfpy's reading of the user's
file and is walked here with vectors in world axes; neither Pinocchio nor ``rpctl.dynamics`` is
asked. Gravity enters as an upward acceleration of the ground.

The walk is written once for any scalar: floats (the oracle), SymPy symbols (the closed form of a
small robot), CasADi symbols (generated code); and for one state or many, whose axes come first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.file_drive import FileReading
from rpctl.equivalence.planar import base_motion
from rpctl.equivalence.state import State
from rpctl.equivalence.tree import (
    FLOATS,
    Body,
    Scalars,
    Tree,
    TreeJoint,
    cross_columns,
    dot,
    in_rows,
    lifted,
    outer,
)
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

Vector = Array | Sequence[Any]
UP = np.array([0, 0, 1])
GRAVITY = 9.81  # m/s², as Pinocchio's default
BREAKDOWNS = (RpctlError, np.linalg.LinAlgError)
STATES_AT_ONCE = 128  # more gain nothing, and take memory

Result = TypeVar("Result")


@dataclass(frozen=True)
class Terms:
    """M u̇ + h = B τ, and the map from u to the joints' rates, at one state or many.

    The axes of the states come first, and are left out where nothing depends on the state.

    Attributes:
        M: Hessian of G (n, n).
        h: Gradient of G at u̇ = 0 (n,).
        h_size: Sum of the sizes of the products that make h (n,). Where they cancel, as gravity
            does about an upright axis, h is rounding and only this tells its scale.
        B: Actuation map (n, n_act).
        root: Velocity of the root link in its own axes, as rows of u: (x, y, turn), (3, n), or
            of one that leans linear and angular velocity (6, n).
        rates: Rate of every moving joint, by name, as a row of u (n,).
    """

    M: Array
    h: Array
    h_size: Array
    B: Array
    root: Array
    rates: Mapping[str, Array]

    def of(self, state: int) -> Terms:
        """Return the terms of one of many states."""

        def own(stacked: Array, axes: int) -> Array:
            return stacked[state] if stacked.ndim > axes else stacked

        return Terms(
            own(self.M, 2), own(self.h, 1), own(self.h_size, 1), own(self.B, 2), own(self.root, 2),
            {name: own(row, 1) for name, row in self.rates.items()},
        )  # fmt: skip


@dataclass(frozen=True)
class LinkKinematics:
    """A frame in world axes: its rotation, and its motion as functions of u and u̇."""

    R: Array  # (3, 3)
    omega: Array  # (3,)
    J_w: Array  # (3, n)
    J_v: Array  # (3, n)
    alpha: Array  # (3,) at u̇ = 0
    a: Array  # (3,) at u̇ = 0

    def at(self, offset: Array) -> tuple[Array, Array]:
        """Return J_v (3, n) and a₀ (3,) of a point fixed in the frame, ``offset`` (world) away."""
        centripetal = np.cross(self.omega, np.cross(self.omega, offset))
        J_v = self.J_v + cross_columns(self.J_w, offset)
        return J_v, self.a + np.cross(self.alpha, offset) + centripetal


@dataclass(frozen=True)
class JointRates:
    """The rates of joints as rows of u, and what the motion adds to their accelerations.

    ``R`` (3, 3) is the rotation of the root link, whose axes wheels' directions are given in.
    """

    rows: dict[str, Array]
    drifts: dict[str, Any]
    R: Array


class GibbsAppell:
    """The derivation for one robot.

    Args:
        reading: Its file; read anew if None.
    """

    def __init__(
        self, robot: Robot, scalars: Scalars = FLOATS, reading: FileReading | None = None
    ) -> None:
        self.robot = robot
        self.scalars = scalars
        self.tree = Tree(robot, scalars, reading)

    def reduced(self, q: Array, nu: Array) -> Terms:
        """Return the equations in the quasi-velocities, u = ν, wheels rolling."""
        return self.terms(self._positions(q), nu, *self.rolling(q, nu))

    def full(self, q: Array, v: Array) -> Terms:
        """Return the equations of the free tree, u = v as Pinocchio orders it."""
        R = self._heading(q)
        J_w, J_v = np.zeros((3, self.robot.nv)), np.zeros((*R.shape[:-1], self.robot.nv))
        J_w[2, 2] = 1.0
        J_v[..., :2] = R[..., :2]
        omega = np.matvec(J_w, v)
        a = np.cross(omega, np.matvec(J_v, v))
        rows = self.free_rates()
        root = LinkKinematics(R, omega, J_w, J_v, np.zeros(3), a)
        rates = JointRates(rows, dict.fromkeys(rows, 0.0), R)
        return self.terms(self._positions(q), v, root, rates)

    def free_rates(self) -> dict[str, Array]:
        """Return the rate of every moving joint of the free tree, by name, as a row of v (nv,)."""
        identity = np.eye(self.robot.nv)
        return {x: identity[self.robot.velocity_index(x)] for x in self.robot.moving_joint_names}

    def gibbs(self, q: Array, nu: Array, nu_dot: Array) -> Array:
        """Return the Gibbs function G (...) of motions, gravity included; [MS21, Eq. 1]."""
        return np.asarray(self.function(self._positions(q), nu, nu_dot, *self.rolling(q, nu)))

    def rolling(self, q: Array, nu: Array) -> tuple[LinkKinematics, JointRates]:
        """Return the root link's motion in ν at q (..., nq), and the rates of joints."""
        return self.rolling_root(self._heading(q), self._positions(q), nu)

    def rolling_root(
        self, R: Array, positions: Mapping[str, Any], nu: Vector
    ) -> tuple[LinkKinematics, JointRates]:
        """Return the root link's motion in ν, and the rates of the arm and of what swivels.

        Args:
            R: Rotation (3, 3) of the root link; G does not depend on it.
        """
        n, drive, scalars = self.robot.dof, self.tree.reading.drive, self.scalars
        speeds, across = np.asarray(nu), R[..., :2]
        base, moved = base_motion(self.tree, drive, positions, speeds)
        J_w, J_v = scalars.zeros(base.J.shape), across @ base.J[..., :2, :]
        J_w[..., 2, :] = base.J[..., 2, :]
        omega, alpha = np.matvec(J_w, speeds), scalars.zeros(base.drift.shape)
        alpha[..., 2] = base.drift[..., 2]
        a = np.matvec(across, base.drift[..., :2]) + np.cross(omega, np.matvec(J_v, speeds))
        identity = scalars.identity(n)[len(drive.base_speeds) :]
        rows = dict(zip(self.robot.joint_names, identity, strict=True))
        drifts = dict.fromkeys(rows, 0 * speeds[..., 0])
        rows |= {name: rate.row for name, rate in moved.items()}
        drifts |= {name: rate.drift for name, rate in moved.items()}
        return LinkKinematics(R, omega, J_w, J_v, alpha, a), JointRates(rows, drifts, R)

    def terms(
        self, positions: Mapping[str, Any], u: Vector, root: LinkKinematics, rates: JointRates
    ) -> Terms:
        """Return the equations from G's Hessian and gradient, summed over the links.

        Args:
            u: Speeds (n,), of any scalar: ν, or v of the free tree.
            root: The root link's motion in u.
            rates: Rates of the joints in u; gains those that are not part of u.
        """
        n = np.asarray(u).shape[-1]
        M, h, h_size = self.scalars.zeros((n, n)), self.scalars.zeros(n), np.zeros(n)
        for body, motion in self.links(positions, u, root, rates):
            inertia, J_v, force = self._at_centre(body, motion)
            J_w, omega = motion.J_w, motion.omega
            moment = np.matvec(inertia, motion.alpha) + np.cross(omega, np.matvec(inertia, omega))
            M = M + body.mass * (J_v.mT @ J_v) + J_w.mT @ inertia @ J_w
            h = h + np.matvec(J_v.mT, force) + np.matvec(J_w.mT, moment)
            if self.scalars is FLOATS:
                h_size = h_size + _sizes(J_v, force) + _sizes(J_w, moment)
        for name, inertia in self.tree.armature.items():  # a rotor that turns with its joint
            row, drift = rates.rows[name], rates.drifts[name]
            M = M + inertia * outer(row, row)
            h = h + lifted(inertia * drift) * row
            if self.scalars is FLOATS:
                h_size = h_size + np.abs(lifted(inertia * drift) * row)
        columns = [rates.rows[name] for name in self.robot.actuators]
        B = in_rows(columns).mT if columns else self.scalars.zeros((n, 0))
        return Terms(M, h, h_size, B, self.root_rows(root), rates.rows)

    def root_rows(self, root: LinkKinematics) -> Array:
        """Return the root link's velocity in its own axes as rows of u (3, n)."""
        turn = np.matvec(root.J_w.mT, UP)
        return in_rows([*np.moveaxis(root.R[..., :2].mT @ root.J_v, -2, 0), turn])

    def function(
        self,
        positions: Mapping[str, Any],
        u: Vector,
        u_dot: Vector,
        root: LinkKinematics,
        rates: JointRates,
    ) -> Any:
        """Return G itself, all terms of a link in one frame; [MS21, Eq. 1].

        Args:
            u: Speeds (n,), of any scalar.
            u_dot: Their derivatives (n,), with any more axes before.
            root: The root link's motion in u.
            rates: Rates of the joints in u; gains those that are not part of u.
        """
        rate, half = np.asarray(u_dot), self.scalars.number(0.5, "number", "")
        G = 0 * rate[..., 0]
        for body, motion in self.links(positions, u, root, rates):
            inertia, J_v, force = self._at_centre(body, motion)
            alpha = np.matvec(motion.J_w, rate) + motion.alpha
            if body.mass != 0:
                a = np.matvec(J_v, rate) + force / body.mass
                G = G + half * body.mass * dot(a, a)
            G = G + half * dot(np.matvec(inertia, alpha), alpha)
            G = G + dot(alpha, np.cross(motion.omega, np.matvec(inertia, motion.omega)))
        for name, inertia in self.tree.armature.items():
            G = G + half * inertia * (dot(rates.rows[name], rate) + rates.drifts[name]) ** 2
        return G

    def losses(self, rows: Mapping[str, Array], u: Vector) -> Array:
        """Return ℓ (..., n), the generalised force of damping and friction in the joints.

        Args:
            u: Speeds (n,), of a scalar that has square roots.
        """
        speeds, sqrt = np.asarray(u), self.scalars.sqrt
        force = self.scalars.zeros(speeds.shape[-1])
        for name, loss in self.tree.losses.items():
            rate = dot(rows[name], speeds)
            opposing = loss.damping * rate
            if loss.friction and sqrt is not None:
                opposing = opposing + loss.friction * rate / sqrt(rate * rate + loss.rate**2)
            force = force - lifted(opposing) * rows[name]
        return force

    def _at_centre(self, body: Body, motion: LinkKinematics) -> tuple[Array, Array, Array]:
        """Return a link's inertia (3, 3), J_v (3, n) and m (a₀ + g) (3,) at its centre of mass."""
        turn = motion.R @ body.R
        J_v, a = motion.at(np.matvec(motion.R, body.com))
        gravity = self.scalars.number(GRAVITY, "gravity", "gravity") * UP
        return turn @ body.inertia @ turn.mT, J_v, body.mass * (a + gravity)

    def links(
        self, positions: Mapping[str, Any], u: Vector, root: LinkKinematics, rates: JointRates
    ) -> Iterator[tuple[Body, LinkKinematics]]:
        """Walk the tree from the root outwards: yield every link with inertia and its motion.

        On the way ``rates`` gains the joints that are not part of u: rolling wheels, mimics.

        Args:
            u: Speeds (n,), of any scalar.
            root: The root link's motion in u.
            rates: Rates of the joints in u.
        """
        speeds = np.asarray(u)
        stack = [(self.tree.root, root)]
        while stack:
            name, motion = stack.pop()
            body = self.tree.bodies.get(name)
            if body is not None:
                yield body, motion
            for joint_part in self.tree.below[name]:
                J_v, a = motion.at(np.matvec(motion.R, joint_part.p))
                R = motion.R @ joint_part.R
                carrier = LinkKinematics(R, motion.omega, motion.J_w, J_v, motion.alpha, a)
                stack.append(
                    (joint_part.child, self._moved(joint_part, carrier, positions, speeds, rates))
                )

    def _moved(
        self,
        joint_part: TreeJoint,
        carrier: LinkKinematics,
        positions: Mapping[str, Any],
        u: Array,
        rates: JointRates,
    ) -> LinkKinematics:
        """Return the motion of a joint's child frame."""
        if joint_part.kind == "fixed":
            return carrier
        axis, position = np.matvec(carrier.R, joint_part.axis), positions[joint_part.name]
        if joint_part.name not in rates.rows and joint_part.name not in self.robot.locked:
            rates.rows[joint_part.name], rates.drifts[joint_part.name] = self._follow(
                joint_part, carrier, axis, u, rates
            )
        row = rates.rows.get(joint_part.name)
        if row is None:
            row, drift = self.scalars.zeros(u.shape[-1]), 0 * u[..., 0]
        else:
            drift = rates.drifts[joint_part.name]
        spin, change = lifted(dot(row, u)) * axis, lifted(drift) * axis
        if joint_part.kind == "prismatic":
            J_v, a = carrier.at(lifted(position) * axis)
            a = a + change + 2 * np.cross(carrier.omega, spin)
            J_v = J_v + outer(axis, row)
            return LinkKinematics(carrier.R, carrier.omega, carrier.J_w, J_v, carrier.alpha, a)
        return LinkKinematics(
            R=carrier.R @ self.scalars.rotation(joint_part.axis, position),
            omega=carrier.omega + spin,
            J_w=carrier.J_w + outer(axis, row),
            J_v=carrier.J_v,
            alpha=carrier.alpha + change + np.cross(carrier.omega, spin),
            a=carrier.a,
        )

    def _follow(
        self,
        joint_part: TreeJoint,
        carrier: LinkKinematics,
        axis: Array,
        u: Array,
        rates: JointRates,
    ) -> tuple[Array, Any]:
        """Return the rate of a joint that is not part of u, as a row of u, and its drift."""
        if joint_part.name in self.tree.wheels:
            return self._rolling(joint_part, carrier, axis, u, rates.R)
        followed, factor = joint_part.follows, joint_part.factor
        row = rates.rows.get(followed, self.scalars.zeros(u.shape[-1]))
        return factor * row, factor * rates.drifts.get(followed, 0 * u[..., 0])

    def _rolling(
        self, joint_part: TreeJoint, carrier: LinkKinematics, axle: Array, u: Array, R: Array
    ) -> tuple[Array, Any]:
        """Return a wheel's rate and drift from its contact, which stands still along d.

        d · (v_c + (ω + φ̇ axle) × (−r ẑ)) = 0 and its time derivative, solved for φ̇ and φ̈.
        """
        wheel = self.tree.wheels[joint_part.name]
        d, down = np.matvec(R, wheel.direction), -wheel.radius * UP
        lever = dot(d, np.cross(axle, down))
        J_c, a_c = carrier.at(wheel.offset * axle + np.matvec(R, wheel.shift))
        J_contact = J_c + cross_columns(carrier.J_w, down)
        row = -np.matvec(J_contact.mT, d) / lifted(lever)
        spin = lifted(dot(row, u)) * axle
        change = a_c + np.cross(carrier.alpha + np.cross(carrier.omega, spin), down)
        slip = np.matvec(J_contact, u) + np.cross(spin, down)
        return row, -(dot(d, change) + dot(np.cross(carrier.omega, d), slip)) / lever

    def _heading(self, q: Array) -> Array:
        return FLOATS.rotation(UP, np.arctan2(q[..., 3], q[..., 2]))

    def _positions(self, q: Array) -> dict[str, Any]:
        """Return the positions of the joints by name, for each configuration (..., nq)."""
        if q.ndim == 1:
            return {name: self.robot.joint_position(q, name) for name in self.tree.moving}
        each = [self._positions(row) for row in q]
        return {name: np.array([x[name] for x in each]) for name in self.tree.moving}


def _sizes(J: Array, force: Array) -> Array:
    """Return |column of J| |force| (..., n)."""
    return np.sqrt((J * J).sum(axis=-2)) * np.sqrt((force * force).sum(axis=-1, keepdims=True))


@dataclass(frozen=True)
class Broken:
    """What stands in place of a result at a state where a derivation broke down."""

    reason: Exception


@dataclass(frozen=True)
class RollingTerms:
    """The equations in ν at one state, and what G itself says there.

    Attributes:
        terms: The equations.
        rise: G(ν̇ + ν) − G(ν̇ − ν), half of it the power of ∂G/∂ν̇ at ν; W.
        rise_size: What it is the difference of, |G| + |G|; W.
    """

    terms: Terms
    rise: float
    rise_size: float


def free_terms(oracle: GibbsAppell, states: Sequence[State]) -> list[Terms | Broken]:
    """Return the free tree's equations at each state."""

    def computed(states: Sequence[State]) -> list[Terms]:
        terms = oracle.full(np.array([s.q for s in states]), np.array([s.v for s in states]))
        return [terms.of(k) for k in range(len(states))]

    return _at_each(computed, states)


def rolling_terms(oracle: GibbsAppell, states: Sequence[State]) -> list[RollingTerms | Broken]:
    """Return the equations in ν at each state, wheels rolling."""

    def computed(states: Sequence[State]) -> list[RollingTerms]:
        q, nu = np.array([s.q for s in states]), np.array([s.nu for s in states])
        nu_dot, terms = np.array([s.nu_dot for s in states]), oracle.reduced(q, nu)
        # G is quadratic in ν̇, so this difference over a whole step is its derivative, not near it.
        after, before = oracle.gibbs(q, nu, np.array([nu_dot + nu, nu_dot - nu]))
        rise, size = after - before, np.abs(after) + np.abs(before)
        return [
            RollingTerms(terms.of(k), float(rise[k]), float(size[k])) for k in range(len(states))
        ]

    return _at_each(computed, states)


def _at_each(
    compute: Callable[[Sequence[State]], list[Result]], states: Sequence[State]
) -> list[Result | Broken]:
    """Compute something at all states together; where that breaks down, at each alone."""
    try:
        return [*compute(states)]
    except BREAKDOWNS as reason:
        if len(states) == 1:
            return [Broken(reason)]
        return [found for state in states for found in _at_each(compute, [state])]
