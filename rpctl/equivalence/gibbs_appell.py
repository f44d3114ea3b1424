"""The Gibbs-Appell equations of a wheeled robot, derived apart from everything else.

[MS21, Eq. 1-5]: with u the generalised speeds, every link's acceleration is linear in u̇,

    a = J_v u̇ + a₀,    α = J_ω u̇ + α₀,

so the Gibbs function G = Σ ½ m a·a + ½ α·Iα + α·(ω × Iω) is quadratic in u̇, and its gradient is
the equation of motion ∂G/∂u̇ = M u̇ + h = Q. The tree comes from yourdfpy's reading of the user's
file and is walked here with vectors in world axes; neither Pinocchio nor ``rpctl.dynamics`` is
asked. Gravity enters as an upward acceleration of the ground.

The walk is written once for any scalar: floats (the oracle), SymPy symbols (the closed form of a
small robot), CasADi symbols (generated code).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.equivalence.file_reading import FileReading
from rpctl.equivalence.planar import base_motion
from rpctl.equivalence.tree import FLOATS, Body, Scalars, Tree, TreeJoint
from rpctl.robot.model import Robot

Vector = Array | Sequence[Any]
UP = np.array([0, 0, 1])
GRAVITY = 9.81  # m/s², as Pinocchio's default


@dataclass(frozen=True)
class Terms:
    """M u̇ + h = B τ, and the map from u to the joints' rates.

    Attributes:
        M: Hessian of G (n, n).
        h: Gradient of G at u̇ = 0 (n,).
        h_size: Sum of the sizes of the products that make h (n,). Where they cancel, as gravity
            does about an upright axis, h is rounding and only this tells its scale.
        B: Actuation map (n, n_act).
        root: Velocity (x, y, turn) of the root link in its own axes, as rows of u (3, n).
        rates: Rate of every moving joint, by name, as a row of u (n,).
    """

    M: Array
    h: Array
    h_size: Array
    B: Array
    root: Array
    rates: Mapping[str, Array]


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
        centripetal = cross(self.omega, cross(self.omega, offset))
        return self.J_v + cross(self.J_w, offset), self.a + cross(self.alpha, offset) + centripetal


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
        robot: The robot; its names, roles and locked joints are used, not its model.
        scalars: What the numbers are made of.
        reading: Its file; read anew if None.
    """

    def __init__(
        self, robot: Robot, scalars: Scalars = FLOATS, reading: FileReading | None = None
    ) -> None:
        self.robot = robot
        self.scalars = scalars
        self.tree = Tree(robot, scalars, reading)

    def reduced(self, q: Array, nu: Array) -> Terms:
        """Return the equations in the quasi-velocities, u = ν (dof,), wheels rolling."""
        positions = self._positions(q)
        root, rates = self.rolling_root(self._heading(q), positions, nu)
        return self.terms(positions, nu, root, rates)

    def full(self, q: Array, v: Array) -> Terms:
        """Return the equations of the free tree, u = v (nv,) as Pinocchio orders it."""
        n, R = len(v), self._heading(q)
        J_w, J_v = np.zeros((3, n)), np.zeros((3, n))
        J_w[2, 2] = 1.0
        J_v[:, :2] = R[:, :2]
        a = cross(v[2] * UP, R[:, 0] * v[0] + R[:, 1] * v[1])
        rows = self.free_rates()
        root = LinkKinematics(R, J_w @ v, J_w, J_v, np.zeros(3), a)
        rates = JointRates(rows, dict.fromkeys(rows, 0.0), R)
        return self.terms(self._positions(q), v, root, rates)

    def free_rates(self) -> dict[str, Array]:
        """Return the rate of every moving joint of the free tree, by name, as a row of v (nv,)."""
        identity = np.eye(self.robot.nv)
        return {x: identity[self.robot.velocity_index(x)] for x in self.robot.moving_joint_names}

    def gibbs(self, q: Array, nu: Array, nu_dot: Array) -> float:
        """Return the Gibbs function G of a motion, gravity included; [MS21, Eq. 1].

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            nu_dot: Their derivatives (dof,).
        """
        positions = self._positions(q)
        root, rates = self.rolling_root(self._heading(q), positions, nu)
        return float(self.function(positions, nu, nu_dot, root, rates))

    def rolling_root(
        self, R: Array, positions: Mapping[str, Any], nu: Vector
    ) -> tuple[LinkKinematics, JointRates]:
        """Return the root link's motion in ν, and the rates of the arm and of what swivels.

        Args:
            R: Rotation (3, 3) of the root link; G does not depend on it.
            positions: Positions of the joints, by name.
            nu: Quasi-velocities (dof,), of any scalar.
        """
        n, drive, scalars = self.robot.dof, self.tree.reading.drive, self.scalars
        speeds = np.asarray(nu)
        base = base_motion(self.tree, drive, positions, speeds)
        J_w, J_v = scalars.zeros((3, n)), R[:, :2] @ base.J[:2]
        J_w[2] = base.J[2]
        omega, alpha = J_w @ speeds, scalars.zeros(3)
        alpha[2] = base.drift[2]
        a = R[:, :2] @ base.drift[:2] + cross(omega, J_v @ speeds)
        identity = scalars.identity(n)[len(drive.base_speeds) :]
        rows = dict(zip(self.robot.joint_names, identity, strict=True))
        drifts = dict.fromkeys(rows, 0 * nu[0])
        rows |= {name: rate.row for name, rate in base.rates.items()}
        drifts |= {name: rate.drift for name, rate in base.rates.items()}
        return LinkKinematics(R, omega, J_w, J_v, alpha, a), JointRates(rows, drifts, R)

    def terms(
        self, positions: Mapping[str, Any], u: Vector, root: LinkKinematics, rates: JointRates
    ) -> Terms:
        """Return the equations from G's Hessian and gradient, summed over the links.

        Args:
            positions: Positions of the joints by name, rad or m.
            u: Speeds (n,), of any scalar: ν, or v of the free tree.
            root: The root link's motion in u.
            rates: Rates of the joints in u; gains those that are not part of u.
        """
        n = len(u)
        M, h, h_size = self.scalars.zeros((n, n)), self.scalars.zeros(n), np.zeros(n)
        for body, motion in self.links(positions, u, root, rates):
            inertia, J_v, force = self._at_centre(body, motion)
            moment = inertia @ motion.alpha + cross(motion.omega, inertia @ motion.omega)
            M = M + body.mass * (J_v.T @ J_v) + motion.J_w.T @ inertia @ motion.J_w
            h = h + J_v.T @ force + motion.J_w.T @ moment
            if self.scalars is FLOATS:
                h_size += np.linalg.norm(J_v, axis=0) * np.linalg.norm(force)
                h_size += np.linalg.norm(motion.J_w, axis=0) * np.linalg.norm(moment)
        for name, inertia in self.tree.armature.items():  # a rotor that turns with its joint
            row, drift = rates.rows[name], rates.drifts[name]
            M = M + inertia * np.outer(row, row)
            h = h + inertia * drift * row
            if self.scalars is FLOATS:
                h_size += np.abs(inertia * drift * row)
        B = np.array([rates.rows[name] for name in self.robot.actuators]).T.reshape(n, -1)
        base = np.vstack([root.R[:, :2].T @ root.J_v, root.J_w[2]])
        return Terms(M, h, h_size, B, base, rates.rows)

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
            positions: Positions of the joints by name, rad or m.
            u: Speeds (n,), of any scalar.
            u_dot: Their derivatives (n,).
            root: The root link's motion in u.
            rates: Rates of the joints in u; gains those that are not part of u.
        """
        rate, half = np.asarray(u_dot), self.scalars.number(0.5, "number", "")
        G = 0 * rate[0]
        for body, motion in self.links(positions, u, root, rates):
            inertia, J_v, force = self._at_centre(body, motion)
            alpha = motion.J_w @ rate + motion.alpha
            if body.mass != 0:
                a = J_v @ rate + force / body.mass
                G = G + half * body.mass * (a @ a)
            G = G + half * (alpha @ inertia @ alpha)
            G = G + alpha @ cross(motion.omega, inertia @ motion.omega)
        for name, inertia in self.tree.armature.items():
            G = G + half * inertia * (rates.rows[name] @ rate + rates.drifts[name]) ** 2
        return G

    def losses(self, rows: Mapping[str, Array], u: Vector) -> Array:
        """Return ℓ (n,), the generalised force of damping and friction in the joints.

        Args:
            rows: Rate of every joint that moves, by name, as a row of u (n,).
            u: Speeds (n,), of a scalar that has square roots.
        """
        speeds, sqrt = np.asarray(u), self.scalars.sqrt
        force = self.scalars.zeros(len(speeds))
        for name, loss in self.tree.losses.items():
            rate = rows[name] @ speeds
            opposing = loss.damping * rate
            if loss.friction and sqrt is not None:
                opposing = opposing + loss.friction * rate / sqrt(rate * rate + loss.rate**2)
            force = force - opposing * rows[name]
        return force

    def _at_centre(self, body: Body, motion: LinkKinematics) -> tuple[Array, Array, Array]:
        """Return a link's inertia (3, 3), J_v (3, n) and m (a₀ + g) (3,) at its centre of mass."""
        turn = motion.R @ body.R
        J_v, a = motion.at(motion.R @ body.com)
        gravity = self.scalars.number(GRAVITY, "gravity", "gravity") * UP
        return turn @ body.inertia @ turn.T, J_v, body.mass * (a + gravity)

    def links(
        self, positions: Mapping[str, Any], u: Vector, root: LinkKinematics, rates: JointRates
    ) -> Iterator[tuple[Body, LinkKinematics]]:
        """Walk the tree from the root outwards: yield every link with inertia and its motion.

        On the way ``rates`` gains the joints that are not part of u: rolling wheels, mimics.

        Args:
            positions: Positions of the joints by name, rad or m.
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
                offset = motion.R @ joint_part.p
                J_v, a = motion.at(offset)
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
        axis, position = carrier.R @ joint_part.axis, positions[joint_part.name]
        if joint_part.name not in rates.rows and joint_part.name not in self.robot.locked:
            rates.rows[joint_part.name], rates.drifts[joint_part.name] = self._follow(
                joint_part, carrier, axis, u, rates
            )
        row = rates.rows.get(joint_part.name)
        if row is None:
            row, drift = self.scalars.zeros(len(u)), 0 * u[0]
        else:
            drift = rates.drifts[joint_part.name]
        rate = row @ u
        if joint_part.kind == "prismatic":
            J_v, a = carrier.at(position * axis)
            a = a + drift * axis + 2 * cross(carrier.omega, rate * axis)
            J_v = J_v + np.outer(axis, row)
            return LinkKinematics(carrier.R, carrier.omega, carrier.J_w, J_v, carrier.alpha, a)
        return LinkKinematics(
            R=carrier.R @ self.scalars.rotation(joint_part.axis, position),
            omega=carrier.omega + rate * axis,
            J_w=carrier.J_w + np.outer(axis, row),
            J_v=carrier.J_v,
            alpha=carrier.alpha + drift * axis + cross(carrier.omega, rate * axis),
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
        row = rates.rows.get(followed, self.scalars.zeros(len(u)))
        return factor * row, factor * rates.drifts.get(followed, 0 * u[0])

    def _rolling(
        self, joint_part: TreeJoint, carrier: LinkKinematics, axle: Array, u: Array, R: Array
    ) -> tuple[Array, Any]:
        """Return a wheel's rate and drift from its contact, which stands still along d.

        d · (v_c + (ω + φ̇ axle) × (−r ẑ)) = 0 and its time derivative, solved for φ̇ and φ̈.
        """
        wheel = self.tree.wheels[joint_part.name]
        d, down = R @ wheel.direction, -wheel.radius * UP
        lever = d @ cross(axle, down)
        J_c, a_c = carrier.at(wheel.offset * axle + R @ wheel.shift)
        J_contact = J_c + cross(carrier.J_w, down)
        row = -(d @ J_contact) / lever
        spin = (row @ u) * axle
        change = a_c + cross(carrier.alpha + cross(carrier.omega, spin), down)
        turning = cross(carrier.omega, d) @ (J_contact @ u + cross(spin, down))
        return row, -(d @ change + turning) / lever

    def _heading(self, q: Array) -> Array:
        return FLOATS.rotation(UP, math.atan2(q[3], q[2]))

    def _positions(self, q: Array) -> dict[str, float]:
        return {name: self.robot.joint_position(q, name) for name in self.tree.moving}


def cross(a: Array, b: Array) -> Array:
    """Return a × b for vectors (3,), or of the columns of a (3, n) with b (3,)."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
