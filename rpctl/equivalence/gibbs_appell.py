"""The Gibbs-Appell equations of a wheeled robot, derived apart from everything else.

[MS21, Eq. 1-5]: with u the generalised speeds, every link's acceleration is linear in u̇,

    a = J_v u̇ + a₀,    α = J_ω u̇ + α₀,

so the Gibbs function G = Σ ½ m a·a + ½ α·Iα + α·(ω × Iω) is quadratic in u̇, and its gradient is
the equation of motion ∂G/∂u̇ = M u̇ + h = Q. The tree comes from yourdfpy's reading of the URDF
and is walked here with vectors in world axes; neither Pinocchio nor ``rpctl.dynamics`` is asked.
Gravity enters as an upward acceleration of the ground.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.robot.description import Array
from rpctl.robot.drive import Wheel
from rpctl.robot.model import Robot

UP = np.array([0.0, 0.0, 1.0])
GRAVITY = 9.81 * UP  # m/s², as Pinocchio's default


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
        rate_drifts: What the motion adds to each joint's acceleration at u̇ = 0.
    """

    M: Array
    h: Array
    h_size: Array
    B: Array
    root: Array
    rates: Mapping[str, Array]
    rate_drifts: Mapping[str, float]


@dataclass(frozen=True)
class _Motion:
    """A frame's pose in the world, and its motion as functions of u and u̇."""

    R: Array  # (3, 3)
    p: Array  # (3,)
    omega: Array  # (3,)
    J_w: Array  # (3, n)
    J_v: Array  # (3, n)
    alpha: Array  # (3,) at u̇ = 0
    a: Array  # (3,) at u̇ = 0

    def at(self, offset: Array) -> tuple[Array, Array]:
        """Return J_v (3, n) and a₀ (3,) of a point fixed in the frame, ``offset`` (world) away."""
        J = self.J_v + np.cross(self.J_w, offset, axisa=0, axisc=0)
        centripetal = np.cross(self.omega, np.cross(self.omega, offset))
        return J, self.a + np.cross(self.alpha, offset) + centripetal


class GibbsAppell:
    """The derivation for one robot.

    Args:
        robot: The robot; its drive, locked joints and names are used, not its model.
    """

    def __init__(self, robot: Robot) -> None:
        import yourdfpy  # here, for its import takes longer than loading and inspecting a robot

        self.robot = robot
        parsed = yourdfpy.URDF.load(
            io.BytesIO(robot.description.xml.encode()), build_scene_graph=False, load_meshes=False
        ).robot
        self._links = {link.name: link for link in parsed.links}
        self._below: dict[str, list[Any]] = {name: [] for name in self._links}
        for joint in parsed.joints:
            self._below[joint.parent].append(joint)
        children = {joint.child for joint in parsed.joints}
        self._root = next(name for name in self._links if name not in children)
        self._wheels = {wheel.joint: wheel for wheel in robot.drive.wheels}

    def reduced(self, q: Array, nu: Array) -> Terms:
        """Return the equations in the quasi-velocities, u = ν (dof,), wheels rolling."""
        n, drive = self.robot.dof, self.robot.drive
        J_w, J_v, a = np.zeros((3, n)), np.zeros((3, n)), np.zeros(3)
        R = _about(UP, math.atan2(q[3], q[2]))
        base = len(drive.base_speeds)
        if drive.type == "differential":
            forward = R @ np.array([math.cos(drive.heading), math.sin(drive.heading), 0.0])
            P = R @ np.array([*drive.point, 0.0])  # from the root link's origin
            v, turn = nu[0], nu[1]
            J_w[2, 1] = 1.0
            J_v[:, 0], J_v[:, 1] = forward, -np.cross(UP, P)
            a = v * turn * np.cross(UP, forward) - turn**2 * np.cross(UP, np.cross(UP, P))
        rates = dict(zip((j.name for j in self.robot.joints), np.eye(n)[base:], strict=True))
        return self._walk(q, nu, _root_motion(q, R, nu, J_w, J_v, a), rates)

    def full(self, q: Array, v: Array) -> Terms:
        """Return the equations of the free tree, u = v (nv,) as Pinocchio orders it."""
        n = len(v)
        R = _about(UP, math.atan2(q[3], q[2]))
        J_w, J_v = np.zeros((3, n)), np.zeros((3, n))
        J_w[2, 2] = 1.0
        J_v[:, :2] = R[:, :2]
        a = np.cross(v[2] * UP, R[:, 0] * v[0] + R[:, 1] * v[1])
        names = self.robot.model.names[2:]
        rates = {name: np.eye(n)[self.robot.velocity_index(name)] for name in names}
        return self._walk(q, v, _root_motion(q, R, v, J_w, J_v, a), rates)

    def _walk(self, q: Array, u: Array, root: _Motion, known: dict[str, Array]) -> Terms:
        """Sum G's Hessian and gradient over the tree, from the root outwards."""
        n = len(u)
        M, h, h_size = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        rates, drifts = dict(known), dict.fromkeys(known, 0.0)
        edge = [(self._root, root)]
        while edge:
            name, motion = edge.pop()
            self._add_link(name, motion, M, h, h_size)
            for joint in self._below[name]:
                carrier = _carried(motion, joint)
                if joint.type != "fixed":
                    axis = carrier.R @ _unit(joint.axis)
                    if joint.name not in self.robot.locked:
                        self._find_rate(joint, carrier, axis, u, rates, drifts)
                    carrier = self._moved(joint, carrier, axis, q, u, rates, drifts)
                edge.append((joint.child, carrier))
        B = np.array([rates[name] for name in self.robot.actuators]).T.reshape(n, -1)
        base = np.vstack([root.R[:, :2].T @ root.J_v, root.J_w[2]])
        return Terms(M, h, h_size, B, base, rates, drifts)

    def _add_link(self, name: str, motion: _Motion, M: Array, h: Array, h_size: Array) -> None:
        inertial = self._links[name].inertial
        if inertial is None or not inertial.mass:
            return
        origin = np.eye(4) if inertial.origin is None else inertial.origin
        turn = motion.R @ origin[:3, :3]
        inertia = turn @ inertial.inertia @ turn.T
        J_v, a = motion.at(motion.R @ origin[:3, 3])
        J_w, omega = motion.J_w, motion.omega
        M += inertial.mass * J_v.T @ J_v + J_w.T @ inertia @ J_w
        force = inertial.mass * (a + GRAVITY)
        moment = inertia @ motion.alpha + np.cross(omega, inertia @ omega)
        h += J_v.T @ force + J_w.T @ moment
        h_size += np.linalg.norm(J_v, axis=0) * np.linalg.norm(force)
        h_size += np.linalg.norm(J_w, axis=0) * np.linalg.norm(moment)

    def _find_rate(
        self,
        joint: Any,
        carrier: _Motion,
        axis: Array,
        u: Array,
        rates: dict[str, Array],
        drifts: dict[str, float],
    ) -> None:
        """Find the rate of a joint that is not itself one of u: a rolling wheel, a mimic."""
        if joint.name in rates:
            return
        if joint.name in self._wheels:
            rates[joint.name], drifts[joint.name] = _rolling(
                self._wheels[joint.name], carrier, axis, u
            )
        else:
            factor = 1.0 if joint.mimic.multiplier is None else joint.mimic.multiplier
            still = np.zeros(len(u))
            rates[joint.name] = factor * rates.get(joint.mimic.joint, still)
            drifts[joint.name] = factor * drifts.get(joint.mimic.joint, 0.0)

    def _moved(
        self,
        joint: Any,
        carrier: _Motion,
        axis: Array,
        q: Array,
        u: Array,
        rates: Mapping[str, Array],
        drifts: Mapping[str, float],
    ) -> _Motion:
        """Return the motion of a joint's child frame."""
        position = self.robot.joint_position(q, joint.name)
        row = rates.get(joint.name, np.zeros(len(u)))
        rate, drift = float(row @ u), drifts.get(joint.name, 0.0)
        if joint.type == "prismatic":
            J_v, a = carrier.at(position * axis)
            return _Motion(
                R=carrier.R,
                p=carrier.p + position * axis,
                omega=carrier.omega,
                J_w=carrier.J_w,
                J_v=J_v + np.outer(axis, row),
                alpha=carrier.alpha,
                a=a + drift * axis + 2.0 * np.cross(carrier.omega, rate * axis),
            )
        return _Motion(
            R=carrier.R @ _about(_unit(joint.axis), position),
            p=carrier.p,
            omega=carrier.omega + rate * axis,
            J_w=carrier.J_w + np.outer(axis, row),
            J_v=carrier.J_v,
            alpha=carrier.alpha + drift * axis + np.cross(carrier.omega, rate * axis),
            a=carrier.a,
        )


def _root_motion(q: Array, R: Array, u: Array, J_w: Array, J_v: Array, a: Array) -> _Motion:
    p = np.array([q[0], q[1], 0.0])
    return _Motion(R, p, J_w @ u, J_w, J_v, np.zeros(3), a)


def _carried(motion: _Motion, joint: Any) -> _Motion:
    """Return the motion of a joint's frame before the joint itself moves."""
    origin = np.eye(4) if joint.origin is None else joint.origin
    offset = motion.R @ origin[:3, 3]
    J_v, a = motion.at(offset)
    R = motion.R @ origin[:3, :3]
    return _Motion(R, motion.p + offset, motion.omega, motion.J_w, J_v, motion.alpha, a)


def _rolling(wheel: Wheel, carrier: _Motion, axle: Array, u: Array) -> tuple[Array, float]:
    """Return a wheel's rate as a row of u, and its drift, from rolling along t = axle × ẑ.

    t · (v_c + (ω + φ̇ axle) × (−r ẑ)) = 0 and its time derivative, solved for φ̇ and φ̈.
    """
    down = -wheel.radius * UP
    t = np.cross(axle, UP)
    t = t / np.linalg.norm(t)
    lever = float(t @ np.cross(axle, down))
    J_c, a_c = carrier.at(wheel.offset * axle)
    row = -(t @ (J_c + np.cross(carrier.J_w, down, axisa=0, axisc=0))) / lever
    turning = carrier.alpha + np.cross(carrier.omega, float(row @ u) * axle)
    drift = -float(t @ (a_c + np.cross(turning, down))) / lever
    return row, drift


def _unit(axis: Array) -> Array:
    return np.asarray(axis, dtype=float) / np.linalg.norm(axis)


def _about(axis: Array, angle: float) -> Array:
    """Return the rotation (3, 3) about a unit axis by an angle (rad)."""
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * np.eye(3) + sin * np.cross(np.eye(3), axis) + (1.0 - cos) * np.outer(axis, axis)
