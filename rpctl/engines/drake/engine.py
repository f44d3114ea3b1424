"""``DrakeEngine``: Drake as the referee asks it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.contact_points import LinkMotion, NamedContacts, wheel_slip
from rpctl.engines.drake.faults import drake_switches
from rpctl.engines.drake.world import DEFAULT_STEP, DrakeWorld
from rpctl.engines.engine import EngineFault, EngineMissing, EngineState
from rpctl.engines.rollers import refuse_rollers
from rpctl.engines.switches import Switch, Switches
from rpctl.engines.tie_rods import TieRodPulls
from rpctl.robot.model import Robot

MAX_SPEED = 1e4  # m/s: faster is no motion


@dataclass(frozen=True)
class DrakeEngine:
    """Drake's discrete multibody plant, as its parser and its configuration leave a robot.

    Attributes:
        tick: How long efforts are held, s.

    Raises:
        EngineMissing: It is not installed.
    """

    name: str = "Drake"
    tick: float = DEFAULT_STEP

    def __post_init__(self) -> None:
        """Refuse where it is not installed; its library is imported when it starts."""
        if find_spec("pydrake") is None:
            raise EngineMissing("Drake is not installed; pip install 'rpctl[drake]'")

    @property
    def version(self) -> str:
        """The package's version."""
        return version("drake")

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that mean something here, of this robot."""
        return drake_switches(robot)

    def start(self, robot: Robot, q: Array, switches: Switches, friction: float) -> DrakeRun:
        """Return the robot at rest at q (nq,), its wheels at the height of the ground.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            switches: What is left as Drake's default, and what is mended.
            friction: Coefficient between wheels and ground where ``friction`` is mended.

        Raises:
            EngineFault: Drake refuses the robot, or has nothing that rolls like its wheels.
        """
        refuse_rollers(robot, switches, self.name)
        return DrakeRun(robot, q, switches, DrakeWorld(robot, q, switches, friction))


class DrakeRun:
    """A robot in Drake, from its start on.

    Args:
        robot: The robot.
        q: Where it starts (nq,).
        switches: What is mended.
        world: Drake's.
    """

    def __init__(self, robot: Robot, q: Array, switches: Switches, world: DrakeWorld) -> None:
        self._robot, self._world, self._t = robot, world, 0.0
        self._named = NamedContacts(robot)
        self.contacts, self.notes = self._named.names, world.notes
        self._rods = TieRodPulls(robot, q, switches, world.step)
        self._dry = switches.mended("losses") and robot.losses is not None

    def advance(self, efforts: Mapping[str, float], dt: float) -> None:
        """Hold the efforts (N·m or N, by joint) for ``dt`` (s).

        Raises:
            EngineFault: The motion diverges.
        """
        world = self._world
        each_step = bool(self._rods) or self._dry
        stride = world.step if each_step else dt
        port = world.plant.get_applied_generalized_force_input_port()
        for _ in range(round(dt / stride)):
            self._brake()
            given = self._rods.added(efforts, self._joints()) if self._rods else efforts
            forces = np.zeros(world.plant.num_velocities())
            for name, effort in given.items():
                forces[world.joints[name].velocity_start()] = effort
            port.FixValue(world.context, forces)
            self._t += stride
            try:
                world.simulator.AdvanceTo(self._t)
            except RuntimeError as error:
                raise EngineFault(f"Drake gives up on {self._robot.name}: {error}") from error
        speed = np.linalg.norm(world.plant.GetVelocities(world.context))
        if not speed < MAX_SPEED:
            raise EngineFault(f"Drake's motion of {self._robot.name} diverges")

    def state(self) -> EngineState:
        """Return the state now; loads are those of the last step."""
        robot, plant, context = self._robot, self._world.plant, self._world.context
        root = self._body(robot.description.root).EvalPoseInWorld(context)
        w, x, y, z = root.rotation().ToQuaternion().wxyz()
        slip = [
            wheel_slip(robot, wheel, self._motion(robot.description.joint[wheel.joint].child))
            for wheel in robot.drive.wheels
        ]
        frames = {}
        for name in self._named.carriers:
            motion = self._motion(name)
            frames[name] = (motion.rotation, motion.origin)
        energy = plant.CalcKineticEnergy(context) + plant.CalcPotentialEnergy(context)
        return EngineState(
            t=self._t,
            pose=np.array([*root.translation(), x, y, z, w]),
            joints=self._joints(),
            load=self._named.loads(self._points(), frames),
            slip=np.array(slip).reshape(-1, 2),
            energy=float(energy),
        )

    def _body(self, link: str) -> Any:
        return self._world.plant.GetBodyByName(link, self._world.model)

    def _joints(self) -> dict[str, tuple[float, float]]:
        plant, context = self._world.plant, self._world.context
        positions, rates = plant.GetPositions(context), plant.GetVelocities(context)
        return {
            name: (float(positions[joint.position_start()]), float(rates[joint.velocity_start()]))
            for name, joint in self._world.joints.items()
        }

    def _brake(self) -> None:
        """Let each joint's damping stand for its dry friction, too, at the rate it has now."""
        losses, context = self._robot.losses, self._world.context
        if not self._dry or losses is None:
            return
        v = np.zeros(self._robot.nv)
        index = {name: self._robot.velocity_index(name) for name in self._world.joints}
        for name, (_, rate) in self._joints().items():
            v[index[name]] = rate
        secant = losses.secant(v)
        for name, joint in self._world.joints.items():
            joint.SetDamping(context, float(secant[index[name]]))

    def _motion(self, link: str) -> LinkMotion:
        body = self._body(link)
        pose = body.EvalPoseInWorld(self._world.context)
        velocity = body.EvalSpatialVelocityInWorld(self._world.context)
        return LinkMotion(
            pose.rotation().matrix(),
            pose.translation(),
            velocity.translational(),
            velocity.rotational(),
        )

    def _points(self) -> list[tuple[str, Array, float]]:
        """Return the contacts with the ground."""
        plant = self._world.plant
        results = plant.get_contact_results_output_port().Eval(self._world.context)
        ground, found = plant.world_body().index(), []
        for k in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(k)
            force, place = float(info.contact_force()[2]), np.array(info.contact_point())
            if info.bodyA_index() == ground:
                found.append((plant.get_body(info.bodyB_index()).name(), place, force))
            elif info.bodyB_index() == ground:
                found.append((plant.get_body(info.bodyA_index()).name(), place, -force))
        return found
