"""A robot as a free body in MuJoCo, on a plane: wheels that roll because friction lets them.

No equation says that a wheel rolls. The root link has six degrees of freedom; each wheel is a
crowned tyre of the file's radius and width, and meets the plane in a contact with friction:
MuJoCo's convex model (E. Todorov, "Convex and analytically-invertible dynamics with contacts and
constraints", ICRA 2014) with an elliptic cone, stiff enough that sinking and creeping stay below
the bands of the trial. Supports slide without friction. Nothing else collides.

What the reduced model ties together is tied here, too: mimic joints by MuJoCo's equality, swivels
that keep to the centre of rotation by tie rods, which are springs. A roller, and a wheel that
slides sideways, has friction along one direction only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.supports import find_supports
from rpctl.equivalence.contact.shapes import support_shapes, tyre
from rpctl.equivalence.contact.ties import Rollers, TieRods
from rpctl.equivalence.mujoco_model import NAME_PREFIX, MujocoModel
from rpctl.robot.model import Robot

STEP_S = 5e-4  # s: below the contacts' time constant
SOLREF = (2e-3, 1.0)  # time constant (s), least that STEP allows with a margin, and damping ratio
SOLIMP = (0.99, 0.999, 1e-4, 0.5, 2.0)  # impedance near 1: hard contacts, which sink by microns
IMPRATIO = 0.1  # friction softer than the load: axles a hair apart creep, they do not fight
FRICTION = 0.7  # of rubber on a dry indoor floor, as the margins of the reduced model assume
MIN_LOAD_N = 1e-9  # N: below it nothing bears a load
MUJOCO_SHAPES = {"sphere": "SPHERE", "capsule": "CAPSULE", "cylinder": "CYLINDER", "box": "BOX"}


@dataclass(frozen=True)
class Contact:
    """The ground's action at one instant: load (n,) by contact, total force (3,), both N.

    ``zmp`` (2,) is where the loads balance, world, m.
    """

    load: Array
    force: Array
    zmp: Array


class ContactModel:
    """MuJoCo's model of a robot on the ground, and its state.

    Args:
        robot: The robot; its file's numbers and shapes are used, not its Pinocchio model. Of the
            drive: which joints carry wheels, and how a roller lies on its wheel.
        friction: Coefficient between wheels and ground.

    Attributes:
        names: The contacts: the wheels' joints, then the supports, as ``Contacts.names``.
        rollers: The wheels that are held in one direction only.
        rods: The tie rods.
        notes: What the file does not say of them.
    """

    def __init__(self, robot: Robot, friction: float = FRICTION) -> None:
        self._mujoco: Any = import_module("mujoco")  # optional, so not with this module's import
        self._robot, self._friction = robot, friction
        self._contacts: dict[str, str] = {}  # geoms, and what they are called
        self.notes: tuple[str, ...] = ()
        tree = MujocoModel(robot, release=self._release)
        self._model, self._dofs, self._root = tree.mjm, tree.joints, tree.root
        self._data = self._mujoco.MjData(self._model)
        self.names = tuple(self._contacts.values())
        self._index = {self._model.geom(geom).id: k for k, geom in enumerate(self._contacts)}
        ids = {w.joint: self._model.geom(NAME_PREFIX + w.joint).id for w in robot.drive.wheels}
        self.rollers = Rollers(robot, self._model, self._data, ids, friction)
        self.rods = TieRods(robot, self._model, self._data, self._dofs)

    def start(self, q: Array) -> None:
        """Put the robot at q (nq,), at rest, its wheels at the height of the ground."""
        cos, sin = float(q[2]), float(q[3])
        half = 0.5 * math.atan2(sin, cos)
        self._data.qpos[:3] = q[0], q[1], -self._robot.drive.ground
        self._data.qpos[3:7] = math.cos(half), 0.0, 0.0, math.sin(half)
        for name, dof in self._dofs.items():
            self._data.qpos[dof + 1] = self._robot.joint_position(q, name)
        self._data.qvel[:] = 0.0
        self._mujoco.mj_forward(self._model, self._data)
        self.rods.measure()

    def advance(self, efforts: Mapping[str, float], steps: int) -> Contact:
        """Apply joints' efforts (N·m or N) for some steps; return the contacts at the first."""
        self._data.qfrc_applied[:] = 0.0
        for name, effort in efforts.items():
            self._data.qfrc_applied[self._dofs[name]] = effort
        given = self._data.qfrc_applied.copy()
        for step in range(steps):
            self._data.qfrc_applied[:] = given
            self.rods.pull()
            self._step()
            if step == 0:
                first = self._contact()
        return first

    def joint(self, name: str) -> tuple[float, float]:
        """Return a joint's position (rad or m) and its rate."""
        dof = self._dofs[name]
        return float(self._data.qpos[dof + 1]), float(self._data.qvel[dof])

    @property
    def pose(self) -> Array:
        """The root link's x, y (m) and turn (rad) seen from above."""
        w, x, y, z = self._data.qpos[3:7]
        turn = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return np.array([*self._data.qpos[:2], turn])

    @property
    def tilt(self) -> float:
        """How far the root link leans out of the level, rad."""
        up = self._data.xmat[self._root].reshape(3, 3)[2, 2]
        return math.acos(min(1.0, float(up)))

    def _step(self) -> None:
        mujoco, model, data = self._mujoco, self._model, self._data
        mujoco.mj_step1(model, data)
        if self.rollers.geoms:
            self.rollers.turn()
            mujoco.mj_makeConstraint(model, data)
            mujoco.mj_projectConstraint(model, data)
            mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_step2(model, data)

    def _contact(self) -> Contact:
        contacts, wrench = self._data.contact, np.zeros(6)
        load, total, moment = np.zeros(len(self.names)), np.zeros(3), np.zeros(2)
        rows = (contacts.geom2, contacts.frame.reshape(-1, 3, 3), contacts.pos)
        for k, (geom, frame, place) in enumerate(zip(*rows, strict=True)):
            self._mujoco.mj_contactForce(self._model, self._data, k, wrench)
            load[self._index[int(geom)]] += wrench[0]
            total += frame.T @ wrench[:3]
            moment += wrench[0] * place[:2]
        return Contact(load, total, moment / max(float(load.sum()), MIN_LOAD_N))

    def _release(self, spec: Any, root: Any) -> None:
        """Give the root link six degrees of freedom, and the robot a ground to stand on."""
        mujoco, option = self._mujoco, spec.option
        root.add_freejoint()
        option.timestep, option.cone = STEP_S, mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = IMPRATIO
        option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)  # contacts are edited
        plane = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
        plane.contype, plane.conaffinity = 2, 0
        for wheel in self._robot.drive.wheels:
            tread = tyre(self._robot, wheel)
            axes = (tread.radius, tread.radius, tread.half_width)
            self._touch(spec, tread.link, wheel.joint, "ELLIPSOID", axes, tread.pose, 3)
            self.notes += (tread.note,) if tread.note else ()
        for name, link, shape in support_shapes(self._robot, find_supports(self._robot)):
            size = _halved(shape.kind, shape.size)
            self._touch(spec, link, name, MUJOCO_SHAPES[shape.kind], size, shape.origin, 1)
        for joint in self._robot.mimics:
            if joint.mimic is not None and joint.mimic.joint not in self._robot.locked:
                equal = spec.add_equality(name1=joint.name, name2=joint.mimic.joint)
                equal.type, equal.objtype = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
                equal.data[:2] = joint.mimic.offset, joint.mimic.multiplier
                equal.solref, equal.solimp = SOLREF, SOLIMP

    def _touch(
        self,
        spec: Any,
        link: str,
        name: str,
        kind: str,
        size: Sequence[float],
        pose: Array,
        directions: int,
    ) -> None:
        """Let a shape of a link meet the plane, with friction where ``directions`` are 3."""
        quaternion = np.zeros(4)
        self._mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(pose[:3, :3]).ravel())
        geom = spec.body(NAME_PREFIX + link).add_geom(
            name=f"{NAME_PREFIX}{name}", pos=pose[:3, 3], quat=quaternion
        )
        geom.type = getattr(self._mujoco.mjtGeom, f"mjGEOM_{kind}")
        geom.size[: len(size)] = size
        geom.contype, geom.conaffinity, geom.condim, geom.priority = 0, 2, directions, 1
        geom.friction[0] = self._friction
        geom.solref, geom.solimp = SOLREF, SOLIMP
        self._contacts[geom.name] = name


def _halved(kind: str, size: Sequence[float]) -> tuple[float, ...]:
    """Return a URDF shape's size as MuJoCo counts it: half edges, half lengths."""
    if kind == "box":
        return tuple(0.5 * edge for edge in size)
    return (size[0],) if kind == "sphere" else (size[0], 0.5 * size[1])
