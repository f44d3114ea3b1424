"""Drake as an engine of the referee: its multibody plant, by default and mended."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from logging.handlers import BufferingHandler
from types import SimpleNamespace
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.edited_urdf import SUPPORTS_HOLD, Dialect
from rpctl.engines.engine import (
    EngineFault,
    LinkMotion,
    Mended,
    Switch,
    joint_losses,
)
from rpctl.engines.mujoco.bodies import link_fault
from rpctl.engines.urdf_engine import Point, UrdfEngine, UrdfRun
from rpctl.errors import EngineMissing
from rpctl.libraries import install_command, library
from rpctl.robot.coordinates import read_root
from rpctl.robot.model import Robot

DEFAULT_STEP = 1e-3  # s, of MultibodyPlantConfig
MENDED_STEP = 5e-4  # s
DEFAULT_FRICTION = 1.0  # of a shape without a coefficient
STIFFNESS = 1e7  # N/m of a shape, mended; 1e6 by default
MODULES = (
    *("systems.framework", "systems.analysis", "geometry", "math"),
    *("multibody.plant", "multibody.parsing"),
)
HALF_SPACE = "deformable contact"  # Drake warns of each ground that it has no such contact with
DIALECT = Dialect(
    name="Drake",
    meshes=(".obj", ".vtk", ".gltf"),
    crowned='<drake:ellipsoid a="{radius!r}" b="{radius!r}" c="{half_width!r}"/>',
    proximity="<drake:proximity_properties><drake:mu_static value='0'/>"
    "<drake:mu_dynamic value='0'/></drake:proximity_properties>",
    strict_transmissions=True,
)


def load_drake() -> Any:
    """Return the contents of the modules of Drake that the engine needs, in one namespace.

    Raises:
        EngineMissing: Drake is not installed.
    """
    drake = SimpleNamespace()
    try:
        for name in MODULES:
            vars(drake).update(vars(library(f"pydrake.{name}")))
    except ImportError as error:
        raise EngineMissing(f"Drake: {error}; run {install_command('drake')}") from error
    return drake


@contextmanager
def heard() -> Iterator[list[str]]:
    """Keep Drake's warnings from the terminal; yield the list of their first lines."""
    logger, handler = logging.getLogger("drake"), BufferingHandler(sys.maxsize)
    handlers, passes = list(logger.handlers), logger.propagate
    logger.handlers, logger.propagate = [handler], False
    lines: list[str] = []
    try:
        yield lines
    finally:
        logger.handlers, logger.propagate = handlers, passes
        warned = [record for record in handler.buffer if record.levelno >= logging.WARNING]
        heads = (record.getMessage().partition("\n")[0] for record in warned)
        lines += dict.fromkeys(head.rpartition("warning: ")[2] for head in heads)  # without places


class DrakeRun(UrdfRun):
    """A multibody plant with a ground and one robot.

    Args:
        robot: The robot.
        q: Configuration (nq,).
        mended: The mended switches.
        friction: Coefficient of friction between wheels and ground if ``friction`` is mended.

    Raises:
        EngineFault: Drake refuses the robot.
    """

    dialect = DIALECT
    steps = (DEFAULT_STEP, MENDED_STEP)

    def __init__(self, robot: Robot, q: Array, mended: Mended, friction: float) -> None:
        super().__init__(robot, q, mended)
        drake = load_drake()
        self.forgets = "losses" in mended and robot.losses is not None  # friction changes
        builder = drake.DiagramBuilder()
        plant, scene = drake.AddMultibodyPlantSceneGraph(builder, time_step=self.step)
        if "softness" in mended:
            _harden(scene)
        self._plant: Any = plant
        with heard() as warnings:
            try:
                self._add(drake, mended)
                self._ground(drake, mended, friction)
                plant.mutable_gravity_field().set_gravity_vector(robot.model.gravity.linear)
                self._mend(mended)
                plant.Finalize()
                diagram = builder.Build()
            except (RuntimeError, ValueError) as error:
                raise EngineFault(f"Drake refuses {robot.name}: {error}") from error
            if "collisions" in mended:
                self._let_pass(drake, scene)
            root = diagram.CreateDefaultContext()
            self._context = plant.GetMyMutableContextFromRoot(root)
            self._simulator = drake.Simulator(diagram, root)
            self._place(drake, q)
            self._simulator.Initialize()
        said = [line for line in warnings if HALF_SPACE not in line]
        self.notes = (*self.notes, *(f"Drake warns: {line}" for line in said))

    def _add(self, drake: Any, mended: Mended) -> None:
        with self.file(mended) as path:
            (self._instance,) = drake.Parser(self._plant).AddModels(path)
        self._drake_joints = {
            name: self._plant.GetJointByName(name, self._instance) for name in self.robot.entries
        }

    def _ground(self, drake: Any, mended: Mended, friction: float) -> None:
        """Register a half space; Drake takes the harmonic mean of a pair's coefficients."""
        own = DEFAULT_FRICTION
        if "friction" in mended:
            own = friction / (2.0 - friction / DEFAULT_FRICTION)
        self._plant.RegisterCollisionGeometry(
            self._plant.world_body(),
            drake.RigidTransform(),
            drake.HalfSpace(),
            "ground",
            drake.CoulombFriction(own, own),
        )

    def _mend(self, mended: Mended) -> None:
        robot = self.robot
        for name, joint in self._drake_joints.items():
            index = robot.velocity_index(name)
            if "losses" in mended:
                joint.set_default_damping(joint_losses(robot, name)[0])
            if "inertia" in mended and robot.armature[index] > 0.0:
                rotor = self._plant.AddJointActuator(f"rotor of {name}", joint)
                rotor.set_default_gear_ratio(1.0)
                rotor.set_default_rotor_inertia(float(robot.armature[index]))

    def _let_pass(self, drake: Any, scene: Any) -> None:
        """Exclude collisions between the robot's own shapes."""
        bodies = [self._plant.get_body(i) for i in self._plant.GetBodyIndices(self._instance)]
        shapes = [g for body in bodies for g in self._plant.GetCollisionGeometriesForBody(body)]
        declared = drake.CollisionFilterDeclaration()
        declared.ExcludeWithin(drake.GeometrySet(shapes))
        scene.collision_filter_manager().Apply(declared)

    def _place(self, drake: Any, q: Array) -> None:
        (x, y, theta), plant = read_root(q), self._plant
        turn = drake.RotationMatrix.MakeZRotation(theta)
        pose = drake.RigidTransform(turn, np.array([x, y, -self.robot.drive.ground]))
        plant.SetFreeBodyPose(self._context, self._body(self.robot.description.root), pose)
        positions = np.array(plant.GetPositions(self._context))
        for name, joint in self._drake_joints.items():
            positions[joint.position_start()] = self.robot.joint_position(q, name)
        plant.SetPositions(self._context, positions)

    def _body(self, link: str) -> Any:
        return self._plant.GetBodyByName(link, self._instance)

    def exert(self, efforts: Mapping[str, float]) -> None:
        """Simulate until ``t`` under efforts (N·m or N, by joint)."""
        self._brake()
        forces = np.zeros(self._plant.num_velocities())
        for name, effort in efforts.items():
            forces[self._drake_joints[name].velocity_start()] = effort
        port = self._plant.get_applied_generalized_force_input_port()
        port.FixValue(self._context, forces)
        try:
            self._simulator.AdvanceTo(self.t)
        except RuntimeError as error:
            raise EngineFault(f"Drake gives up on {self.robot.name}: {error}") from error

    def _brake(self) -> None:
        """Add dry friction to each joint's damping, as friction over the present rate."""
        losses, v = self.robot.losses, np.zeros(self.robot.nv)
        if not self.forgets or losses is None:
            return
        for name, (_, rate) in self.joints().items():
            v[self.robot.velocity_index(name)] = rate
        secant = losses.secant(v)
        for name, joint in self._drake_joints.items():
            joint.SetDamping(self._context, float(secant[self.robot.velocity_index(name)]))

    def joints(self) -> dict[str, tuple[float, float]]:
        """Return position and rate of the moving joints."""
        positions = self._plant.GetPositions(self._context)
        rates = self._plant.GetVelocities(self._context)
        return {
            name: (float(positions[joint.position_start()]), float(rates[joint.velocity_start()]))
            for name, joint in self._drake_joints.items()
        }

    def motion(self, link: str) -> LinkMotion:
        """Return the motion of a link's frame."""
        pose = self._body(link).EvalPoseInWorld(self._context)
        twist = self._body(link).EvalSpatialVelocityInWorld(self._context)
        R, place = pose.rotation().matrix(), pose.translation()
        return LinkMotion(R, place, twist.translational(), twist.rotational())

    def points(self) -> list[Point]:
        """Return the contacts with the ground."""
        plant, points = self._plant, []
        results = plant.get_contact_results_output_port().Eval(self._context)
        for k in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(k)
            ends = [
                plant.get_body(index).name() for index in (info.bodyA_index(), info.bodyB_index())
            ]
            force, place = float(info.contact_force()[2]), np.array(info.contact_point())
            world = plant.world_body().index()
            if info.bodyA_index() == world:
                points.append((ends[1], place, force))
            elif info.bodyB_index() == world:
                points.append((ends[0], place, -force))
        return points

    def energy(self) -> float:
        """Return kinetic and potential energy, J."""
        context = self._context
        return float(
            self._plant.CalcKineticEnergy(context) + self._plant.CalcPotentialEnergy(context)
        )


def _harden(scene: Any) -> None:
    """Make contacts stiffer than by default."""
    config = scene.get_config()
    properties = config.default_proximity_properties
    properties.point_stiffness = STIFFNESS
    config.default_proximity_properties = properties
    scene.set_config(config)


SAID = {
    "wheel": (
        "a cylinder touches the ground at one point, which jumps from edge to edge",
        "give the wheels <drake:ellipsoid> as <collision>",
    ),
    "caster": (
        SUPPORTS_HOLD,
        "write <drake:mu_static value='0'/> and <drake:mu_dynamic value='0'/> into their"
        " <collision>",
    ),
    "friction": (
        f"its coefficient of friction is {DEFAULT_FRICTION:g}",
        "register the ground with CoulombFriction(MU/(2 − MU), MU/(2 − MU)): of a pair's"
        " coefficients Drake takes the harmonic mean",
    ),
    "softness": (
        "its contacts are springs of 1e6 N/m",
        f"set SceneGraphConfig.default_proximity_properties.point_stiffness={STIFFNESS:g}",
    ),
    "timestep": (
        f"its step is {1e3 * DEFAULT_STEP:g} ms",
        f"set MultibodyPlantConfig.time_step={MENDED_STEP:g}",
    ),
    "collisions": (
        "shapes besides wheels and supports collide with the ground and with each other",
        "exclude them with CollisionFilterDeclaration().ExcludeWithin(…)",
    ),
}


class DrakeEngine(UrdfEngine):
    """Drake's discrete multibody plant, as its parser loads a robot by default."""

    name, tick, run, said = "Drake", DEFAULT_STEP, DrakeRun, SAID
    module, distribution, extra = "pydrake", "drake", "drake"

    def own_switches(self, robot: Robot) -> Iterator[Switch]:
        """Yield the switches whose words depend on the robot."""
        wrong = [link.name for link in robot.description.links if link_fault(link)]
        faults = {}
        if wrong:
            fault = f"it replaces the inertia of {wrong[0]} by that of a ball of water"
            faults[fault] = "write inertias that fulfil the triangle inequality"
        if robot.description.estimated_links:
            fault = f"{robot.description.estimated_links[0]} has no mass"
            faults[fault] = "write <inertial> for each link"
        if robot.armature.any():
            faults["it ignores rotors"] = "call JointActuator.set_default_rotor_inertia"
        if faults:
            yield Switch("inertia", " and ".join(faults), " and ".join(faults.values()))
        if robot.drive.followers:
            fault = "it ignores the rod that connects the steered swivels"
            yield Switch("mimic", fault, "add a constraint between them")
        joints = robot.description.joints
        dry = [joint.name for joint in joints if joint.friction]
        damped = [joint.name for joint in joints if joint.damping]
        if dry:
            fault = f"it ignores the dry friction of {dry[0]}"
            setting = "call joint.SetDamping(context, d + f/|rate|) at each step"
            yield Switch("losses", fault, setting)
        elif damped:
            fault = f"it damps {damped[0]} as its file says; the robot was loaded without losses"
            yield Switch("losses", fault, "call joint.set_default_damping(0)")
