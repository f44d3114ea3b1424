"""PyBullet as an engine of the referee, by default and mended."""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.engines.edited_urdf import SUPPORTS_HOLD, Dialect
from rpctl.engines.engine import (
    EngineFault,
    LinkMotion,
    Mended,
    Switch,
    joint_losses,
)
from rpctl.engines.urdf_engine import Point, UrdfEngine, UrdfRun
from rpctl.errors import EngineMissing
from rpctl.libraries import install_command, library
from rpctl.robot.coordinates import level_pose
from rpctl.robot.model import Robot

OUT, ERR = 1, 2  # descriptors
DEFAULT_STEP = 1.0 / 240.0  # s
MENDED_STEP = DEFAULT_STEP / 8.0  # s
SOLVER_ITERATIONS = 500  # a step; 50 by default
RESIDUAL = 1e-12  # at which the solver stops
SINK_M = 1e-4  # m: how far a mended contact sinks under its part of the weight
GEAR_ERP = 0.5  # share of a mimic joint's error that a step takes away
GEAR_FORCE = 1e4  # N·m or N: a mimic joint gives way above it
PLANE_FRICTION = 1.0  # of plane.urdf; PyBullet multiplies the coefficients of a pair
DIALECT = Dialect(
    name="PyBullet",
    meshes=(".stl", ".obj", ".dae"),
    crowned='<sphere radius="{radius!r}"/>',
    massless='<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'
    "</inertial>",
)


@contextmanager
def captured() -> Iterator[list[str]]:
    """Capture what is written to the descriptors of stdout and stderr; yield the list of lines.

    Python's own output is flushed before, so that it is neither lost nor reordered.
    """
    lines: list[str] = []
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    kept = {number: os.dup(number) for number in (OUT, ERR)}
    with tempfile.TemporaryFile() as file:
        try:
            for number in kept:
                os.dup2(file.fileno(), number)
            yield lines
        finally:
            for number, old in kept.items():
                os.dup2(old, number)
                os.close(old)
            file.seek(0)
            lines += file.read().decode(errors="replace").splitlines()


def load_pybullet() -> Any:
    """Return a client of PyBullet with a world of its own.

    Raises:
        EngineMissing: PyBullet is not installed.
    """
    try:
        with captured():  # it prints its build time
            return library("pybullet_utils.bullet_client").BulletClient(library("pybullet").DIRECT)
    except ImportError as error:
        raise EngineMissing(f"PyBullet: {error}; run {install_command('bullet')}") from error


class BulletRun(UrdfRun):
    """A client of PyBullet with a plane and one robot.

    Args:
        robot: The robot.
        q: Configuration (nq,).
        mended: The mended switches.
        friction: Coefficient of friction between wheels and ground if ``friction`` is mended.

    Raises:
        EngineFault: PyBullet refuses the robot.
    """

    dialect = DIALECT
    steps = (DEFAULT_STEP, MENDED_STEP)
    forgets = True

    def __init__(self, robot: Robot, q: Array, mended: Mended, friction: float) -> None:
        super().__init__(robot, q, mended)
        self._p = p = load_pybullet()
        p.setTimeStep(self.step)
        p.setGravity(*robot.model.gravity.linear.tolist())
        p.setPhysicsEngineParameter(enableConeFriction=int("cone" not in mended))
        if "softness" in mended:
            p.setPhysicsEngineParameter(
                solverResidualThreshold=RESIDUAL, numSolverIterations=SOLVER_ITERATIONS
            )
        self._plane = p.createMultiBody(0.0, p.createCollisionShape(p.GEOM_PLANE))
        p.changeDynamics(self._plane, -1, lateralFriction=PLANE_FRICTION)
        self._body = self._load(q, mended)
        self._links = {p.getBodyInfo(self._body)[0].decode(): -1}
        self._numbers: dict[str, int] = {}
        for number in range(p.getNumJoints(self._body)):
            info = p.getJointInfo(self._body, number)
            self._links[info[12].decode()] = number
            if info[2] != p.JOINT_FIXED:
                self._numbers[info[1].decode()] = number
        for name in robot.entries:
            p.resetJointState(self._body, self._numbers[name], robot.joint_position(q, name))
        self._mend(mended, friction)

    def _load(self, q: Array, mended: Mended) -> int:
        flags = self._p.URDF_USE_INERTIA_FROM_FILE if "inertia" in mended else 0
        pose, refusal = level_pose(q, -self.robot.drive.ground).tolist(), None
        with self.file(mended) as path, captured() as printed:
            try:
                return int(self._p.loadURDF(path, pose[:3], pose[3:], flags=flags))
            except self._p.error as error:
                refusal = error
        raise EngineFault(f"PyBullet refuses {self.robot.name}: {' '.join(printed) or refusal}")

    def _set(self, links: Iterable[int], **values: float) -> None:
        for link in links:
            self._p.changeDynamics(self._body, link, **values)

    def _mend(self, mended: Mended, friction: float) -> None:
        p, robot, every = self._p, self.robot, (*self._links.values(),)
        none = {"spinningFriction": 0.0, "rollingFriction": 0.0}
        if "friction" in mended:
            self._set(every, lateralFriction=friction / PLANE_FRICTION, **none)
        if "caster" in mended:
            supports = [self._links[link] for link in self._named.supports_of]
            self._set(supports, lateralFriction=0.0, **none)
        if "softness" in mended:
            part = robot.mass / len(self.contacts)
            stiffness = part * float(np.linalg.norm(robot.model.gravity.linear)) / SINK_M
            damping = 2.0 * math.sqrt(stiffness * part)
            self._set(every, contactStiffness=stiffness, contactDamping=damping)
        if "losses" in mended:
            self._set(every, linearDamping=0.0, angularDamping=0.0)
            for name in robot.entries:
                (damping, dry), number = joint_losses(robot, name), self._numbers[name]
                self._set([number], jointDamping=damping)
                p.setJointMotorControl2(
                    self._body, number, p.VELOCITY_CONTROL, targetVelocity=0.0, force=dry
                )
        if "mimic" in mended:
            self._gear()

    def _gear(self) -> None:
        """Tie mimic joints to the joints that they follow."""
        p, numbers, origin = self._p, self._numbers, (0.0, 0.0, 0.0)
        for joint in self.robot.mimics:
            if joint.mimic is None or joint.mimic.joint not in numbers:
                continue
            ends = self._body, numbers[joint.name], self._body, numbers[joint.mimic.joint]
            gear = p.createConstraint(*ends, p.JOINT_GEAR, (0.0, 0.0, 1.0), origin, origin)
            p.changeConstraint(
                gear,
                gearRatio=-joint.mimic.multiplier,
                relativePositionTarget=joint.mimic.offset,
                erp=GEAR_ERP,
                maxForce=GEAR_FORCE,
            )

    def exert(self, efforts: Mapping[str, float]) -> None:
        """Simulate until ``t`` under efforts (N·m or N, by joint)."""
        numbers, forces = [self._numbers[name] for name in efforts], list(efforts.values())
        self._p.setJointMotorControlArray(
            self._body, numbers, self._p.TORQUE_CONTROL, forces=forces
        )
        self._p.stepSimulation()

    def joints(self) -> dict[str, tuple[float, float]]:
        """Return position and rate of the moving joints."""
        names = list(self.robot.entries)
        rows = self._p.getJointStates(self._body, [self._numbers[name] for name in names])
        return {name: (row[0], row[1]) for name, row in zip(names, rows, strict=True)}

    def _inertial(self, number: int) -> tuple[LinkMotion, float, Array, Array, Array]:
        """Return the motion of a link's inertial frame, its mass, moments, place and axes.

        Mass in kg, moments of inertia (3,) in kg·m², the centre of mass (3,) in the link's frame,
        m, and the principal axes (3, 3).
        """
        p = self._p
        if number < 0:
            place, turn = p.getBasePositionAndOrientation(self._body)
            velocity, omega = p.getBaseVelocity(self._body)
        else:
            row = p.getLinkState(self._body, number, 1, 1)
            place, turn, velocity, omega = row[0], row[1], row[6], row[7]
        motion = LinkMotion(_rotation(turn), np.array(place), np.array(velocity), np.array(omega))
        info = p.getDynamicsInfo(self._body, number)
        return motion, float(info[0]), np.array(info[2]), np.array(info[3]), _rotation(info[4])

    def motion(self, link: str) -> LinkMotion:
        """Return the motion of a link's frame, from that of its centre of mass."""
        of, _, _, centre, axes = self._inertial(self._links[link])
        rotation = of.rotation @ axes.T
        arm = -rotation @ centre
        velocity = of.velocity + np.cross(of.omega, arm)
        return LinkMotion(rotation, of.origin + arm, velocity, of.omega)

    def points(self) -> list[Point]:
        """Return the contacts with the ground."""
        names = {number: name for name, number in self._links.items()}
        rows = self._p.getContactPoints(self._body, self._plane)
        return [(names[row[3]], np.array(row[6]), row[9] * row[7][2]) for row in rows]

    def energy(self) -> float:
        """Return kinetic and potential energy, J."""
        gravity, total = self.robot.model.gravity.linear, 0.0
        for number in self._links.values():
            of, mass, moments, _, _ = self._inertial(number)
            turning = moments @ (of.rotation.T @ of.omega) ** 2
            total += 0.5 * (mass * of.velocity @ of.velocity + turning) - mass * gravity @ of.origin
        return float(total)


def _rotation(turn: Sequence[float]) -> Array:
    """Return the rotation (3, 3) of a quaternion (4,) x, y, z, w."""
    return np.asarray(pin.Quaternion(np.array(turn)).matrix())


SAID = {
    "wheel": (
        "its wheels meet the plane with their width, and scrub",
        "give the wheels <sphere> as <collision>, of the wheels' radius",
    ),
    "caster": (SUPPORTS_HOLD, "call changeDynamics(body, support, lateralFriction=0)"),
    # The pyramid that approximates the cone lies along the world's axes: it is exact while nothing
    # slips, and turns slip towards these axes.
    "cone": (
        "its implicit friction cone lets the wheels of an axle push against each other until"
        " they slip",
        "call setPhysicsEngineParameter(enableConeFriction=0)",
    ),
    "friction": (
        "its coefficient of friction is 0.5",
        "call changeDynamics(body, wheel, lateralFriction=MU)",
    ),
    "softness": (
        "its solver stops after 50 iterations",
        f"call setPhysicsEngineParameter(numSolverIterations={SOLVER_ITERATIONS},"
        " solverResidualThreshold=1e-12)",
    ),
    "timestep": (
        f"its step is {1e3 * DEFAULT_STEP:.2g} ms",
        f"call setTimeStep(1/{round(1.0 / MENDED_STEP)})",
    ),
    "losses": (
        "a velocity motor holds each joint still, and damping of 0.04 brakes the bodies of all "
        "links",
        "call setJointMotorControl2(body, joint, VELOCITY_CONTROL, force=0) and"
        " changeDynamics(body, link, linearDamping=0, angularDamping=0)",
    ),
    "collisions": (
        "shapes besides wheels and supports can touch the plane",
        "call setCollisionFilterPair(body, plane, link, -1, 0) for them",
    ),
}


class BulletEngine(UrdfEngine):
    """PyBullet, with a robot as ``loadURDF`` loads it by default."""

    name, tick, run, said = "PyBullet", DEFAULT_STEP, BulletRun, SAID
    module, distribution, extra = "pybullet", "pybullet", "bullet"

    def own_switches(self, robot: Robot) -> Iterator[Switch]:
        """Yield the switches whose words depend on the robot."""
        massless = [link.name for link in robot.description.links if link.mass is None]
        root = robot.description.link[robot.description.root]
        guess = "it guesses inertias from collision shapes"
        if massless:
            guess += f", gives {massless[0]}, which has no <inertial>, a mass of 1 kg"
        if root.mass == 0.0:
            guess += f", fixes the robot to the world because {root.name} has no mass"
        setting = "load it with flags=URDF_USE_INERTIA_FROM_FILE"
        if massless or root.mass == 0.0:
            setting += ", give the root link a mass in <inertial>, and massless fixed links mass 0"
        yield Switch("inertia", guess, setting)
        if robot.mimics or robot.drive.followers:
            yield Switch(
                "mimic",
                "it ignores mimic joints and tie rods",
                "call createConstraint(…, jointType=JOINT_GEAR) and changeConstraint(gearRatio=…)",
            )
