"""A robot in PyBullet on its plane: what it loads, and how it is set by default and mended."""

from __future__ import annotations

import math
import tempfile
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.contact_points import NamedContacts
from rpctl.engines.edited_urdf import Dialect, edit_urdf
from rpctl.engines.engine import EngineFault, EngineMissing
from rpctl.engines.silence import captured
from rpctl.engines.switches import Switches
from rpctl.equivalence.contact.shapes import Tyre
from rpctl.libraries import library
from rpctl.robot.coordinates import read_root
from rpctl.robot.model import Robot

DEFAULT_STEP = 1.0 / 240.0  # s
MENDED_STEP = DEFAULT_STEP / 8.0  # s
SOLVER_ITERATIONS = 500  # a step; 50 by default
RESIDUAL = 1e-12  # at which the solver stops
SINK_M = 1e-4  # by which a mended contact yields under its part of the weight
GEAR_ERP = 0.5  # share of a mimic joint's error that a step takes away
GEAR_FORCE = 1e4  # N·m or N: a mimic joint gives way above it
PLANE_FRICTION = 1.0  # of plane.urdf; PyBullet multiplies the coefficients of a pair
DIALECT = Dialect(
    name="PyBullet",
    meshes=(".stl", ".obj", ".dae"),
    crowned=lambda tread: _sphere(tread),
    massless='<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'
    "</inertial>",
)


def load_pybullet() -> Any:
    """Return PyBullet.

    Raises:
        EngineMissing: It is not installed.
    """
    try:
        with captured():  # it prints when it was built
            return library("pybullet")
    except ImportError as error:
        raise EngineMissing(f"PyBullet: {error}; pip install 'rpctl[bullet]'") from error


class BulletWorld:
    """A client of PyBullet with a plane and one robot.

    Args:
        robot: The robot.
        q: Configuration (nq,).
        switches: What is mended.
        friction: Between wheels and ground, where ``friction`` is mended.

    Attributes:
        p: PyBullet.
        body: The robot's number.
        joints: Numbers of the moving joints, by name.
        links: Numbers of the links, by name; the root's is −1.
        step: s.
        notes: What was left out, in sentences.

    Raises:
        EngineFault: PyBullet refuses the robot.
    """

    def __init__(self, robot: Robot, q: Array, switches: Switches, friction: float) -> None:
        self.p = p = load_pybullet()
        self.client = p.connect(p.DIRECT)
        weakref.finalize(self, p.disconnect, self.client)
        self.step = MENDED_STEP if switches.mended("timestep") else DEFAULT_STEP
        p.setTimeStep(self.step, physicsClientId=self.client)
        gravity = robot.model.gravity.linear
        p.setGravity(*map(float, gravity), physicsClientId=self.client)
        solver = {"enableConeFriction": int(not switches.mended("cone"))}
        if switches.mended("softness"):
            solver |= {"numSolverIterations": SOLVER_ITERATIONS}
            p.setPhysicsEngineParameter(
                solverResidualThreshold=RESIDUAL, physicsClientId=self.client
            )
        p.setPhysicsEngineParameter(**solver, physicsClientId=self.client)
        plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=self.client)
        self.plane = p.createMultiBody(0.0, plane, physicsClientId=self.client)
        self.set(self.plane, -1, lateralFriction=PLANE_FRICTION)
        self.body, self.notes = self._load(robot, q, switches)
        self._name()
        self._place(robot, q)
        self._mend(robot, switches, friction)

    def set(self, body: int, link: int, **values: float) -> None:
        """Set values of a link with PyBullet's ``changeDynamics``."""
        self.p.changeDynamics(body, link, **values, physicsClientId=self.client)

    def _load(self, robot: Robot, q: Array, switches: Switches) -> tuple[int, tuple[str, ...]]:
        edited = edit_urdf(robot, switches, DIALECT)
        flags = self.p.URDF_USE_INERTIA_FROM_FILE if switches.mended("inertia") else 0
        x, y, theta = read_root(q)
        turn = self.p.getQuaternionFromEuler((0.0, 0.0, theta))
        place = (x, y, -robot.drive.ground)
        with tempfile.TemporaryDirectory() as folder, captured() as printed:
            path = Path(folder) / "robot.urdf"
            path.write_text(edited.text, encoding="utf-8")
            try:
                body = self.p.loadURDF(
                    str(path), place, turn, flags=flags, physicsClientId=self.client
                )
            except self.p.error as error:
                refusal = error
            else:
                refusal = None
        if refusal is not None:
            raise EngineFault(f"PyBullet refuses {robot.name}: {' '.join(printed) or refusal}")
        return int(body), edited.notes

    def _name(self) -> None:
        """Keep the numbers of joints and links."""
        self.joints: dict[str, int] = {}
        self.links: dict[str, int] = {
            self.p.getBodyInfo(self.body, physicsClientId=self.client)[0].decode(): -1
        }
        for number in range(self.p.getNumJoints(self.body, physicsClientId=self.client)):
            info = self.p.getJointInfo(self.body, number, physicsClientId=self.client)
            self.links[info[12].decode()] = number
            if info[2] != self.p.JOINT_FIXED:
                self.joints[info[1].decode()] = number

    def _place(self, robot: Robot, q: Array) -> None:
        for name in robot.entries:
            position = robot.joint_position(q, name)
            self.p.resetJointState(
                self.body, self.joints[name], position, physicsClientId=self.client
            )

    def _mend(self, robot: Robot, switches: Switches, friction: float) -> None:
        every = (-1, *range(self.p.getNumJoints(self.body, physicsClientId=self.client)))
        if switches.mended("friction"):
            for number in every:
                self.set(
                    self.body,
                    number,
                    lateralFriction=friction / PLANE_FRICTION,
                    spinningFriction=0.0,
                    rollingFriction=0.0,
                )
        if switches.mended("caster"):
            for link in NamedContacts(robot).carriers:
                self.set(
                    self.body,
                    self.links[link],
                    lateralFriction=0.0,
                    spinningFriction=0.0,
                    rollingFriction=0.0,
                )
        if switches.mended("softness"):
            part = robot.mass / len(NamedContacts(robot).names)
            stiffness = part * float(np.linalg.norm(robot.model.gravity.linear)) / SINK_M
            damping = 2.0 * math.sqrt(stiffness * part)
            for number in every:
                self.set(self.body, number, contactStiffness=stiffness, contactDamping=damping)
        if switches.mended("losses"):
            for number in every:
                self.set(self.body, number, linearDamping=0.0, angularDamping=0.0)
            for name, (damping, dry) in joint_losses(robot).items():
                self.set(self.body, self.joints[name], jointDamping=damping)
                self.p.setJointMotorControl2(
                    self.body,
                    self.joints[name],
                    self.p.VELOCITY_CONTROL,
                    targetVelocity=0.0,
                    force=dry,
                    physicsClientId=self.client,
                )
        if switches.mended("mimic"):
            self._gear(robot)

    def _gear(self, robot: Robot) -> None:
        """Tie mimic joints to those that they follow."""
        for joint in robot.mimics:
            if joint.mimic is None or joint.mimic.joint not in self.joints:
                continue
            gear = self.p.createConstraint(
                self.body,
                self.joints[joint.name],
                self.body,
                self.joints[joint.mimic.joint],
                self.p.JOINT_GEAR,
                (0.0, 0.0, 1.0),
                (0.0, 0.0, 0.0),
                (0.0, 0.0, 0.0),
                physicsClientId=self.client,
            )
            self.p.changeConstraint(
                gear,
                gearRatio=-joint.mimic.multiplier,
                relativePositionTarget=joint.mimic.offset,
                erp=GEAR_ERP,
                maxForce=GEAR_FORCE,
                physicsClientId=self.client,
            )


def joint_losses(robot: Robot) -> Mapping[str, tuple[float, float]]:
    """Return damping (N·m·s/rad or N·s/m) and dry friction (N·m or N) of the moving joints."""
    if robot.losses is None:
        return dict.fromkeys(robot.entries, (0.0, 0.0))
    index = {name: robot.velocity_index(name) for name in robot.entries}
    damping, dry = robot.losses.damping, robot.losses.friction
    return {name: (float(damping[i]), float(dry[i])) for name, i in index.items()}


def _sphere(tread: Tyre) -> str:
    return f'<sphere radius="{tread.radius!r}"/>'
