"""MuJoCo as one more engine: its reading of the URDF, its inertia, bias and Jacobians.

Neither ``rpctl.dynamics`` nor Pinocchio takes part. The wheels' rolling is imposed on the free
tree, whose base velocity is in world axes, through MuJoCo's Jacobians J and their rates J̇:

    [A; W] v = [0; ν],   [A; W] S = [0; I],   [A; W] Ṡν = −[Ȧ; Ẇ] v,
    M = Sᵀ M_free S,   h = Sᵀ (h_free + M_free Ṡν),   B = Sᵀ × actuators' columns.

MuJoCo reads the numbers of the user's file, as they are written there. What is added: two slides
and a hinge for the root link, locked joints made fixed, and the principal axes of inertia.
Contacts and limits are left out; so is friction, which MuJoCo makes a constraint and not a force.

MuJoCo (Todorov, Erez, Tassa, IROS 2012) is optional, and imported when an engine is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from lxml import etree

from rpctl.arrays import Array
from rpctl.description.density import inertial_element
from rpctl.drive.drive import Swivel, Wheel
from rpctl.equivalence.contact.mujoco_body import free_inertia, mujoco_library, quaternion
from rpctl.equivalence.file_drive import UPRIGHT_ROUNDING, FileReading, read, rotor_inertias
from rpctl.equivalence.leaning_rows import LeaningRows
from rpctl.equivalence.raw_file import document
from rpctl.equivalence.rolling_rows import COMPLEX_STEP, DOWN, RollingRows, turned, with_rate
from rpctl.equivalence.tree import FLOATS, Tree, cross_columns
from rpctl.errors import RpctlError
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import Robot

NAME_PREFIX = (
    "rpctl/"  # before the names of links: MuJoCo gives one named "world" a meaning of its own
)
GRAVITY = (0.0, 0.0, -9.81)  # m/s², as Pinocchio's default
LAMINA_TOLERANCE = (
    1e-14  # of the largest principal moment: a lamina meets A + B = C to rounding only
)
MIN_INERTIA = 1e-15  # kg and kg·m²; MuJoCo wants more (its mjMINVAL) in a body that moves


class EngineRefused(RpctlError):
    """MuJoCo does not simulate the robot; the links to blame are named."""


@dataclass(frozen=True)
class Inertial:
    """Mass (kg), centre of mass (3,) and inertia (3, 3) about it, in the axes of some link."""

    mass: float
    com: Array
    inertia: Array

    def placed(self, pose: Array) -> Inertial:
        """Return it as seen from a frame in which its own has ``pose`` (4, 4)."""
        R, p = pose[:3, :3], pose[:3, 3]
        return Inertial(self.mass, p + R @ self.com, R @ self.inertia @ R.T)

    def put(self, body: Any) -> None:
        """Give it to an ``MjsBody``, by principal axes: MuJoCo finds them to 1e-12 kg·m² only."""
        moments, axes = np.linalg.eigh(self.inertia)
        axes *= np.sign(np.linalg.det(axes))
        a, b, c = np.maximum(moments, 0.0)
        body.mass, body.ipos, body.iquat = self.mass, self.com, quaternion(axes)
        body.inertia, body.fullinertia = [a, b, min(c, a + b)], np.full(6, np.nan)
        body.explicitinertial = True


def inertia_fault(inertia: Array, tolerance: float = LAMINA_TOLERANCE) -> str:
    """Return why no body has an inertia (3, 3), which MuJoCo then refuses, or nothing.

    Args:
        inertia: About the centre of mass, kg·m².
        tolerance: Of the largest principal moment, to which a lamina meets A + B = C.
    """
    a, b, c = np.linalg.eigvalsh(inertia)
    if a < -tolerance * abs(c):
        return f"inertia is not positive definite ({moments_text(inertia)})"
    if c - a - b > tolerance * abs(c):
        return f"inertia breaks the triangle rule ({moments_text(inertia)})"
    return ""


def moments_text(inertia: Array) -> str:
    """Return the principal moments of an inertia (3, 3) in words."""
    a, b, c = np.linalg.eigvalsh(inertia)
    return f"principal moments {a:.3g}, {b:.3g}, {c:.3g} kg·m²"


MASSLESS = Inertial(0.0, np.zeros(3), np.zeros((3, 3)))


class MujocoModel:
    """MuJoCo's ``MjModel`` of a robot.

    Args:
        reading: Its file; read anew if None.
        release: Gives the root link its freedom, given the ``MjSpec`` and the link's ``MjsBody``;
            None for a planar base.

    Attributes:
        mjm: The ``MjModel``: qpos and qvel of a planar base are x, y, turn of the root link, then
            the joints.
        root: Index of the root link's body.
        joints: Index in qpos and in qvel of every moving joint.
        refused: Links that MuJoCo refuses, each with the reason; they are made one body with the
            links fixed to them.

    Raises:
        EngineRefused: A moving body is unphysical even as a whole; its links are named.
    """

    def __init__(
        self,
        robot: Robot,
        reading: FileReading | None = None,
        release: Callable[[Any, Any], None] | None = None,
    ) -> None:
        self._mujoco = mujoco_library()
        self._robot = robot
        self._raw = (reading or read(robot)).raw
        self.refused: tuple[str, ...] = ()
        spec = self._mujoco.MjSpec.from_string(_bare_urdf(robot))
        for name, position in robot.locked.items():
            joint = self._raw.joint[name]
            body, pose = spec.body(NAME_PREFIX + joint.child), joint.motion(position)
            body.pos, body.quat = pose[:3, 3], quaternion(pose)
        moving = self._raw.moving(robot.locked)
        for head in (self._raw.root, *(joint.child for joint in moving)):
            self._give_inertia(spec, head, self._raw.poses(robot.locked, head, rigid=True))
        (release or self._add_planar_base)(spec, spec.body(NAME_PREFIX + self._raw.root))
        self.mjm = self._compiled(spec)
        self.root = int(self.mjm.body(NAME_PREFIX + self._raw.root).id)
        self.joints = {joint.name: int(self.mjm.joint(joint.name).dofadr[0]) for joint in moving}
        for name, inertia in rotor_inertias(robot, self._raw).items():
            self.mjm.dof_armature[self.joints[name]] = inertia

    def _add_planar_base(self, spec: Any, root: Any) -> None:
        """Let the root link slide along x and y and turn about z."""
        kinds = self._mujoco.mjtJoint
        root.add_joint(name=f"{NAME_PREFIX}x", type=kinds.mjJNT_SLIDE, axis=[1, 0, 0])
        root.add_joint(name=f"{NAME_PREFIX}y", type=kinds.mjJNT_SLIDE, axis=[0, 1, 0])
        root.add_joint(name=f"{NAME_PREFIX}turn", type=kinds.mjJNT_HINGE, axis=[0, 0, 1])

    def _compiled(self, spec: Any) -> Any:
        """Return the model with inertias as they are given."""
        compiler = spec.compiler
        compiler.fusestatic = compiler.balanceinertia = compiler.autolimits = False
        compiler.boundmass = compiler.boundinertia = 0.0
        compiler.inertiafromgeom = self._mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        spec.option.gravity = GRAVITY
        try:
            return spec.compile()
        except ValueError as error:
            reason = " ".join(str(error).replace(NAME_PREFIX, "").split())
            raise EngineRefused(f"{self._robot.name}: MuJoCo rejects it: {reason}") from None

    def _give_inertia(self, spec: Any, head: str, poses: dict[str, Array]) -> None:
        """Set the inertias of the links that move as one body with the link ``head``.

        Where MuJoCo would refuse one of them, the whole body's inertia is given to the head.
        """
        bodies = {link: self._read(spec.body(NAME_PREFIX + link)) for link in poses}
        faults = {link: inertia_fault(body.inertia) for link, body in bodies.items()}
        faults = {link: fault for link, fault in faults.items() if fault}
        if faults:
            lines = self._robot.description.link
            named = tuple(f'link "{k}" (line {lines[k].line}): {why}' for k, why in faults.items())
            whole = combined([body.placed(poses[link]) for link, body in bodies.items()])
            self._require(whole, named, tuple(poses))
            self.refused += named
            bodies = {link: whole if link == head else MASSLESS for link in poses}
        for link, body in bodies.items():
            body.put(spec.body(NAME_PREFIX + link))

    def _require(self, whole: Inertial, named: tuple[str, ...], links: tuple[str, ...]) -> None:
        """Refuse a moving body that is unphysical as a whole."""
        fault = inertia_fault(whole.inertia)
        if not fault and np.linalg.eigvalsh(whole.inertia)[0] < MIN_INERTIA:
            fault = "a principal moment is 0"
        if fault:
            raise EngineRefused(
                f"{self._robot.name}: MuJoCo refuses {'; '.join(named)}; the body of all links "
                f"fixed together there ({', '.join(links)}) has the same fault: {fault}; correct "
                "its <inertia>"
            )

    def _read(self, body: Any) -> Inertial:
        """Return a link's inertia as MuJoCo read it; a link without one weighs nothing."""
        xx, yy, zz, xy, xz, yz = np.nan_to_num(body.fullinertia)
        R = np.zeros(9)
        self._mujoco.mju_quat2Mat(R, body.iquat)
        axes = R.reshape(3, 3)
        inertia = axes @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ axes.T
        return Inertial(float(body.mass), np.nan_to_num(body.ipos), inertia)


def _bare_urdf(robot: Robot) -> str:
    """Return the file's links with their inertias, and its joints; locked joints are fixed.

    An axis that the file leaves out is URDF's, (1, 0, 0): MuJoCo has another. An inertia that it
    leaves out may be the robot's estimate.
    """
    source = document(robot.description.raw)
    bare = etree.Element("robot", name="robot")
    estimated = robot.description.estimated_links
    for link in source.findall("link"):
        name = link.get("name")
        copy = etree.SubElement(bare, "link", name=NAME_PREFIX + name)
        copy.extend(deepcopy(link.findall("inertial")[:1]))
        if name in estimated:
            copy.append(inertial_element(robot.description.link[name]))
    for joint in source.findall("joint"):
        name = joint.get("name")
        kind = "fixed" if name in robot.locked else joint.get("type")
        copy = etree.SubElement(bare, "joint", name=name, type=kind)
        for end in ("parent", "child"):
            etree.SubElement(copy, end, link=NAME_PREFIX + joint.find(end).get("link"))
        dynamics = joint.find("dynamics")
        if dynamics is not None and robot.loaded_with.losses:
            damping = str(max(0.0, float(dynamics.get("damping") or 0.0)))
            etree.SubElement(copy, "dynamics", damping=damping)
        for tag in ("origin", "axis"):
            copy.extend(deepcopy(joint.findall(tag)[:1]))
        if joint.find("axis") is None:
            etree.SubElement(copy, "axis", xyz="1 0 0")
    return str(etree.tostring(bare, encoding="unicode"))


def combined(bodies: list[Inertial]) -> Inertial:
    """Return several bodies as one, by the parallel-axis rule; negative masses are taken out."""
    mass = sum(body.mass for body in bodies)
    com = sum((body.mass * body.com for body in bodies), np.zeros(3)) / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for body in bodies:
        d = body.com - com
        inertia += body.inertia + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return Inertial(mass, com, inertia)


OLDEST_MUJOCO = (3, 14)  # before it MuJoCo turned an inertia read from a URDF to its principal axes
CONTRADICTION_TOLERANCE = 1e-9  # of the solution: rows that no motion meets; rounding leaves 1e-13


@dataclass(frozen=True)
class EngineTerms:
    """M ν̇ + h = B τ + ℓ at one state.

    Attributes:
        M: Reduced inertia (dof, dof).
        h: Reduced bias (dof,).
        B: Actuation map (dof, n_act).
        damping: The viscous part of ℓ (dof,); friction is no force in MuJoCo but a constraint.
    """

    M: Array
    h: Array
    B: Array
    damping: Array


def installed() -> bool:
    """Return whether a MuJoCo that is new enough can be imported, without importing it."""
    if find_spec("mujoco") is None:
        return False
    major, minor = metadata.version("mujoco").split(".")[:2]
    return (int(major), int(minor)) >= OLDEST_MUJOCO


class ReducedEngine(Protocol):
    """The equations of one robot by MuJoCo, in ν.

    Attributes:
        refused: Links that MuJoCo refuses, each with the reason.
    """

    refused: tuple[str, ...]

    def reduced(self, q: Array, nu: Array) -> EngineTerms:
        """Return the equations in the quasi-velocities ν (dof,) at q (nq,), wheels rolling."""


def engine_of(robot: Robot, reading: FileReading) -> ReducedEngine:
    """Return MuJoCo's view of a robot.

    Raises:
        EngineRefused: MuJoCo does not simulate it.
    """
    if isinstance(robot, LeaningRobot):
        return LeaningMujocoEngine(robot, reading)
    return MujocoEngine(robot, reading)


class MujocoEngine(RollingRows):
    """The equations of one robot by MuJoCo, rolling by its Jacobians; v is as MuJoCo orders it.

    Args:
        reading: Its file; read anew if None.

    Attributes:
        refused: Links that MuJoCo refuses, each with the reason; they are made one body with the
            links fixed to them.

    Raises:
        EngineRefused: A moving body is unphysical even as a whole; its links are named.
    """

    def __init__(self, robot: Robot, reading: FileReading | None = None) -> None:
        tree = Tree(robot, FLOATS, reading)
        made = MujocoModel(robot, tree.reading)
        super().__init__(robot, tree, made.joints)
        self._mujoco, self._model, self._root = mujoco_library(), made.mjm, made.root
        self.refused = made.refused
        self._data = self._mujoco.MjData(self._model)
        self._drives = [self._index[name] for name in robot.actuators]

    def reduced(self, q: Array, nu: Array) -> EngineTerms:
        """Return the equations in the quasi-velocities ν (dof,) at q (nq,), wheels rolling.

        Raises:
            RpctlError: The constraints and ν do not determine one motion.
        """
        return _reduced(self._rows, self._model, self._data, q, nu, self._drives)

    def _rows(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return [A; W] and [Ȧ; Ẇ] v at q (nq,) and v (nv,)."""
        data, heading = self._data, math.atan2(q[3], q[2])
        data.qpos[:3], data.qvel[:] = (q[0], q[1], heading), v
        for name, index in self._index.items():
            data.qpos[index] = self._robot.joint_position(q, name)
        self._mujoco.mj_fwdPosition(self._model, data)
        self._mujoco.mj_fwdVelocity(self._model, data)
        moving = data.qpos + 1j * COMPLEX_STEP * v
        self.course = complex(moving[2])
        self.positions = {name: moving[index] for name, index in self._index.items()}
        return with_rate((*self.constraints(), *self.speeds()), v)

    def place(self, at: tuple[float, float]) -> Array:
        """Return the rows (2, nv) of the velocity of a place of the root link, m there."""
        R = self._data.xmat[self._root].reshape(3, 3)
        return self._jacobian(self._data.xpos[self._root] + R @ [*at, 0.0], self._root)[0, :2]

    def pivot(self, swivel: Swivel) -> Array:
        """Return the rows (2, nv) of a place on a swivel's axis; of a leaning one its pivot."""
        joint = self._model.joint(swivel.joint).id
        if swivel.parent is None and math.hypot(*self._data.xaxis[joint][:2]) > UPRIGHT_ROUNDING:
            return self.place(swivel.pivot)
        return self._jacobian(self._data.xanchor[joint], self._model.jnt_bodyid[joint])[0, :2]

    def held(self, wheel: Wheel) -> Array:
        """Return the row (nv,) of the contact of a wheel on the root link, as the ground holds."""
        joint, data = self._model.joint(wheel.joint).id, self._data
        centre = data.xanchor[joint] + wheel.offset * data.xaxis[joint]
        linear, angular = self._jacobian(centre, self._model.jnt_bodyid[joint])
        contact = linear + cross_columns(angular, wheel.radius * DOWN)
        x, y = turned((0.0, wheel.shift), self._drive.heading)
        shift = self.place((x, y)) - self.place((0.0, 0.0))
        return np.asarray(turned(wheel.direction, self.course) @ (contact[:2] + shift))

    def _jacobian(self, point: Array, body: int) -> Array:
        """Return the Jacobians (2, 3, nv), linear and angular, of a point (world) of a body."""
        return _jacobian(self._mujoco, self._model, self._data, point, body)


class LeaningMujocoEngine(LeaningRows):
    """The equations of a robot that leans by MuJoCo; its root is a free joint of MuJoCo's.

    Args:
        reading: Its file.

    Raises:
        EngineRefused: A moving body is unphysical even as a whole; its links are named.
    """

    def __init__(self, robot: LeaningRobot, reading: FileReading) -> None:
        tree = Tree(robot, FLOATS, reading)
        made = MujocoModel(robot, reading, release=lambda _, root: root.add_freejoint())
        super().__init__(robot, tree, made.joints)
        self._mujoco, self._model, self._root = mujoco_library(), made.mjm, made.root
        self.refused, self._data = made.refused, self._mujoco.MjData(self._model)
        self._drives = [self._index[name] for name in robot.actuators]

    def reduced(self, q: Array, nu: Array) -> EngineTerms:
        """Return the equations in the quasi-velocities ν (dof,) at q (nq,), wheels rolling.

        Raises:
            RpctlError: The constraints and ν do not determine one motion.
        """
        return _reduced(self._rows, self._model, self._data, q, nu, self._drives)

    def _rows(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return [A; W] and [Ȧ; Ẇ] v at q (nq,) and v (nv,), of MuJoCo's order."""
        data = self._data
        data.qpos[:7], data.qvel[:] = [*q[:3], q[6], *q[3:6]], v
        for name, index in self._index.items():
            data.qpos[index + 1] = self._robot.joint_position(q, name)
        self._mujoco.mj_fwdPosition(self._model, data)
        self._mujoco.mj_fwdVelocity(self._model, data)
        return with_rate((*self.constraints(), *self.speeds()), v)

    def root(self) -> tuple[Array, Array]:
        """Return the root link's upward axis (3,), and the rows of its turning (3, nv)."""
        upright = self._data.xmat[self._root].reshape(3, 3)[:, 2]
        _, turning = self._jacobian(self._data.xpos[self._root], self._root)
        return self._moved(upright, turning), turning

    def wheel(self, wheel: Wheel) -> tuple[Array, Array, Array]:
        """Return a wheel's axle (3,), and rows of its centre's velocity and of its turning."""
        joint, data = self._model.joint(wheel.joint).id, self._data
        axle = data.xaxis[joint].copy()
        linear, turning = self._jacobian(
            data.xanchor[joint] + wheel.offset * axle, self._model.jnt_bodyid[joint]
        )
        return self._moved(axle, turning), linear, turning

    def _moved(self, axis: Array, turning: Array) -> Array:
        """Return a direction with its rate as it turns."""
        omega = turning.real @ self._data.qvel
        return np.asarray(axis + 1j * COMPLEX_STEP * np.cross(omega, axis))

    def _jacobian(self, point: Array, body: int) -> Array:
        """Return the Jacobians (2, 3, nv), linear and angular, of a point (world) of a body."""
        return _jacobian(self._mujoco, self._model, self._data, point, body)


def _reduced(
    rows_at: Callable[[Array, Array], tuple[Array, Array]],
    model: Any,
    data: Any,
    q: Array,
    nu: Array,
    drives: list[int],
) -> EngineTerms:
    """Return the equations in ν (dof,) at q (nq,).

    Args:
        rows_at: Gives [A; W] and [Ȧ; Ẇ] v at q and v, and puts ``data`` there.
        drives: Indices in v of the actuators' joints.
    """
    rows, _ = rows_at(q, np.zeros(model.nv))
    S = _solve(rows, np.eye(len(rows), len(nu), len(nu) - len(rows)))  # [0; I]
    rows, change = rows_at(q, S @ nu)
    drift = _solve(rows, -change)
    M = free_inertia(model, data)
    h = S.T @ (data.qfrc_bias + M @ drift)
    return EngineTerms(S.T @ M @ S, h, S[drives].T, S.T @ data.qfrc_passive)


def _jacobian(mujoco: Any, model: Any, data: Any, point: Array, body: int) -> Array:
    """Return the Jacobians (2, 3, nv), linear and angular, of a point (world) of a body."""
    J, J_dot = np.zeros((2, 2, 3, model.nv))
    mujoco.mj_jac(model, data, *J, point, body)
    mujoco.mj_jacDot(model, data, *J_dot, point, body)
    return J + 1j * COMPLEX_STEP * J_dot


def _solve(rows: Array, wanted: Array) -> Array:
    """Solve [A; W] X = ``wanted``, which has one solution if the robot has one motion.

    A second pass on what is left brings 1e-13, the singular value decomposition's, to rounding.

    Raises:
        RpctlError: It has none, or many.
    """
    solution, _, rank, _ = np.linalg.lstsq(rows, wanted, rcond=CONTRADICTION_TOLERANCE)
    solution += np.linalg.lstsq(rows, wanted - rows @ solution, rcond=CONTRADICTION_TOLERANCE)[0]
    gap, size = np.abs(rows @ solution - wanted).max(), float(np.abs(solution).max())
    if rank < rows.shape[1] or gap > CONTRADICTION_TOLERANCE * max(1.0, size):
        raise RpctlError("rolling wheels and quasi-velocities do not determine the motion")
    return np.asarray(solution)
