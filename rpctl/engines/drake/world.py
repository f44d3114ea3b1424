"""A robot in Drake on a half space: what its parser makes of it, by default and mended."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.drake.library import DrakeModules, heard, load_drake
from rpctl.engines.edited_urdf import Dialect, edit_urdf
from rpctl.engines.engine import EngineFault
from rpctl.engines.switches import Switches
from rpctl.equivalence.contact.shapes import Tyre
from rpctl.robot.coordinates import read_root
from rpctl.robot.model import Robot

DEFAULT_STEP = 1e-3  # s, of MultibodyPlantConfig
MENDED_STEP = 5e-4  # s
DEFAULT_FRICTION = 1.0  # of a shape that says nothing of it
STIFFNESS = 1e7  # N/m of a shape, mended; 1e6 by default
HALF_SPACE = "deformable contact"  # Drake warns of each ground that it has no such contact with
DIALECT = Dialect(
    name="Drake",
    meshes=(".obj", ".vtk", ".gltf"),
    crowned=lambda tread: _ellipsoid(tread),
    proximity="<drake:proximity_properties><drake:mu_static value='0'/>"
    "<drake:mu_dynamic value='0'/></drake:proximity_properties>",
    strict_transmissions=True,
)


class DrakeWorld:
    """A multibody plant with a ground and one robot.

    Args:
        robot: The robot.
        q: Configuration (nq,).
        switches: What is mended.
        friction: Between wheels and ground, where ``friction`` is mended.

    Attributes:
        plant: Drake's.
        simulator: Drake's.
        context: The plant's.
        joints: The plant's joints, by name.
        step: s.
        notes: What was left out, and what Drake warned of, in sentences.

    Raises:
        EngineFault: Drake refuses the robot.
    """

    def __init__(self, robot: Robot, q: Array, switches: Switches, friction: float) -> None:
        drake = load_drake()
        self.step = MENDED_STEP if switches.mended("timestep") else DEFAULT_STEP
        builder = drake.framework.DiagramBuilder()
        plant, scene = drake.plant.AddMultibodyPlantSceneGraph(builder, time_step=self.step)
        if switches.mended("softness"):
            _harden(scene)
        self.plant: Any = plant
        with heard() as warnings:
            try:
                left_out = self._add(drake, robot, switches)
                self._ground(drake, switches, friction)
                plant.mutable_gravity_field().set_gravity_vector(robot.model.gravity.linear)
                self._mend(robot, switches)
                plant.Finalize()
                diagram = builder.Build()
            except (RuntimeError, ValueError) as error:
                raise EngineFault(f"Drake refuses {robot.name}: {error}") from error
            if switches.mended("collisions"):
                self._let_pass(drake, scene)
            root = diagram.CreateDefaultContext()
            self.context = plant.GetMyMutableContextFromRoot(root)
            self.simulator = drake.analysis.Simulator(diagram, root)
            self._place(drake, robot, q)
            self.simulator.Initialize()
        said = [line for line in warnings if HALF_SPACE not in line]
        self.notes = (*left_out, *(f"Drake warns: {line}" for line in said))

    def _add(self, drake: DrakeModules, robot: Robot, switches: Switches) -> tuple[str, ...]:
        edited = edit_urdf(robot, switches, DIALECT)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(edited.text, encoding="utf-8")
            (self.model,) = drake.parsing.Parser(self.plant).AddModels(str(path))
        self.joints = {name: self.plant.GetJointByName(name, self.model) for name in robot.entries}
        return edited.notes

    def _ground(self, drake: DrakeModules, switches: Switches, friction: float) -> None:
        """Register a half space; Drake takes the harmonic mean of two coefficients."""
        own = DEFAULT_FRICTION
        if switches.mended("friction"):
            own = friction / (2.0 - friction / DEFAULT_FRICTION)
        self.plant.RegisterCollisionGeometry(
            self.plant.world_body(),
            drake.math.RigidTransform(),
            drake.geometry.HalfSpace(),
            "ground",
            drake.plant.CoulombFriction(own, own),
        )

    def _mend(self, robot: Robot, switches: Switches) -> None:
        for name, joint in self.joints.items():
            index = robot.velocity_index(name)
            if switches.mended("losses"):
                damping = 0.0 if robot.losses is None else robot.losses.damping[index]
                joint.set_default_damping(float(damping))
            if switches.mended("inertia") and robot.armature[index] > 0.0:
                rotor = self.plant.AddJointActuator(f"rotor of {name}", joint)
                rotor.set_default_gear_ratio(1.0)
                rotor.set_default_rotor_inertia(float(robot.armature[index]))

    def _let_pass(self, drake: DrakeModules, scene: Any) -> None:
        """Let the robot's own shapes pass through each other."""
        bodies = [self.plant.get_body(i) for i in self.plant.GetBodyIndices(self.model)]
        shapes = [g for body in bodies for g in self.plant.GetCollisionGeometriesForBody(body)]
        declared = drake.geometry.CollisionFilterDeclaration()
        declared.ExcludeWithin(drake.geometry.GeometrySet(shapes))
        scene.collision_filter_manager().Apply(declared)

    def _place(self, drake: DrakeModules, robot: Robot, q: Array) -> None:
        x, y, theta = read_root(q)
        turn = drake.math.RotationMatrix.MakeZRotation(theta)
        pose = drake.math.RigidTransform(turn, np.array([x, y, -robot.drive.ground]))
        root = self.plant.GetBodyByName(robot.description.root, self.model)
        self.plant.SetFreeBodyPose(self.context, root, pose)
        for name, joint in self.joints.items():
            self.plant.SetPositions(
                self.context, _entry(self.plant, self.context, joint, robot.joint_position(q, name))
            )


def _harden(scene: Any) -> None:
    """Make contacts stiffer than by default."""
    config = scene.get_config()
    properties = config.default_proximity_properties
    properties.point_stiffness = STIFFNESS
    config.default_proximity_properties = properties
    scene.set_config(config)


def _entry(plant: Any, context: Any, joint: Any, position: float) -> Array:
    """Return the plant's positions with one joint's changed."""
    positions = np.array(plant.GetPositions(context))
    positions[joint.position_start()] = position
    return positions


def _ellipsoid(tread: Tyre) -> str:
    return f'<drake:ellipsoid a="{tread.radius!r}" b="{tread.radius!r}" c="{tread.half_width!r}"/>'
