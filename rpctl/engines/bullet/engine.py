"""``BulletEngine``: PyBullet as the referee asks it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.bullet.faults import bullet_switches
from rpctl.engines.bullet.world import DEFAULT_STEP, BulletWorld
from rpctl.engines.contact_points import LinkMotion, NamedContacts, wheel_slip
from rpctl.engines.engine import EngineFault, EngineMissing, EngineState
from rpctl.engines.rollers import refuse_rollers
from rpctl.engines.switches import Switch, Switches
from rpctl.engines.tie_rods import TieRodPulls
from rpctl.robot.model import Robot

MAX_SPEED = 1e4  # m/s: faster is no motion


@dataclass(frozen=True)
class BulletEngine:
    """PyBullet, as ``loadURDF`` with its defaults leaves a robot.

    Attributes:
        tick: How long efforts are held, s.

    Raises:
        EngineMissing: It is not installed.
    """

    name: str = "PyBullet"
    tick: float = DEFAULT_STEP

    def __post_init__(self) -> None:
        """Refuse where it is not installed; its library is imported when it starts."""
        if find_spec("pybullet") is None:
            raise EngineMissing("PyBullet is not installed; pip install 'rpctl[bullet]'")

    @property
    def version(self) -> str:
        """The package's version."""
        return version("pybullet")

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that mean something here, of this robot."""
        return bullet_switches(robot)

    def start(self, robot: Robot, q: Array, switches: Switches, friction: float) -> BulletRun:
        """Return the robot at rest at q (nq,), its wheels at the height of the ground.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            switches: What is left as PyBullet's default, and what is mended.
            friction: Coefficient between wheels and ground where ``friction`` is mended.

        Raises:
            EngineFault: PyBullet refuses the robot, or has nothing that rolls like its wheels.
        """
        refuse_rollers(robot, switches, self.name)
        return BulletRun(robot, q, switches, BulletWorld(robot, q, switches, friction))


class BulletRun:
    """A robot in PyBullet, from its start on.

    Args:
        robot: The robot.
        q: Where it starts (nq,).
        switches: What is mended.
        world: PyBullet's.
    """

    def __init__(self, robot: Robot, q: Array, switches: Switches, world: BulletWorld) -> None:
        self._robot, self._world, self._t = robot, world, 0.0
        self._named = NamedContacts(robot)
        self.contacts, self.notes = self._named.names, world.notes
        self._rods = TieRodPulls(robot, q, switches, world.step)

    def advance(self, efforts: Mapping[str, float], dt: float) -> None:
        """Hold the efforts (N·m or N, by joint) for ``dt`` (s).

        Raises:
            EngineFault: The motion diverges.
        """
        world, p = self._world, self._world.p
        for _ in range(round(dt / world.step)):
            given = self._rods.added(efforts, self._joints()) if self._rods else efforts
            p.setJointMotorControlArray(
                world.body,
                [world.joints[name] for name in given],
                p.TORQUE_CONTROL,
                forces=list(given.values()),
                physicsClientId=world.client,
            )
            p.stepSimulation(physicsClientId=world.client)
        self._t += dt
        velocity = p.getBaseVelocity(world.body, physicsClientId=world.client)[0]
        if not np.linalg.norm(velocity) < MAX_SPEED:
            raise EngineFault(f"PyBullet's motion of {self._robot.name} diverges")

    def state(self) -> EngineState:
        """Return the state now; loads are those of the last step."""
        motions = {name: self._motion(name) for name in self._links()}
        root = motions[self._robot.description.root]
        slip = [
            wheel_slip(self._robot, wheel, motions[self._child(wheel.joint)])
            for wheel in self._robot.drive.wheels
        ]
        frames = {name: (one.rotation, one.origin) for name, one in motions.items()}
        return EngineState(
            t=self._t,
            pose=np.array([*root.origin, *self._quaternion(-1)]),
            joints=self._joints(),
            load=self._named.loads(self._points(), frames),
            slip=np.array(slip).reshape(-1, 2),
            energy=self._energy(),
        )

    def _child(self, joint: str) -> str:
        return self._robot.description.joint[joint].child

    def _links(self) -> tuple[str, ...]:
        """Links whose motion the state needs."""
        wheels = {self._child(wheel.joint) for wheel in self._robot.drive.wheels}
        return (self._robot.description.root, *sorted(wheels), *self._named.carriers)

    def _joints(self) -> dict[str, tuple[float, float]]:
        world, names = self._world, list(self._robot.entries)
        numbers = [world.joints[name] for name in names]
        rows = world.p.getJointStates(world.body, numbers, physicsClientId=world.client)
        return {name: (row[0], row[1]) for name, row in zip(names, rows, strict=True)}

    def _com(self, number: int) -> tuple[Array, Array, Array, Array]:
        """Return centre of mass (3,), rotation of the inertial axes (3, 3), velocity, ω (3,)."""
        world, p = self._world, self._world.p
        if number < 0:
            place, turn = p.getBasePositionAndOrientation(world.body, physicsClientId=world.client)
            velocity, omega = p.getBaseVelocity(world.body, physicsClientId=world.client)
        else:
            row = p.getLinkState(world.body, number, 1, 1, physicsClientId=world.client)
            place, turn, velocity, omega = row[0], row[1], row[6], row[7]
        axes = np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3)
        return np.array(place), axes, np.array(velocity), np.array(omega)

    def _dynamics(self, number: int) -> tuple[float, Array, Array, Array]:
        """Return mass, principal moments (3,), centre (3,) and axes (3, 3) in the link's frame."""
        world, p = self._world, self._world.p
        info = p.getDynamicsInfo(world.body, number, physicsClientId=world.client)
        axes = np.array(p.getMatrixFromQuaternion(info[4])).reshape(3, 3)
        return float(info[0]), np.array(info[2]), np.array(info[3]), axes

    def _motion(self, name: str) -> LinkMotion:
        """Return how a link's frame moves; PyBullet tells of its centre of mass."""
        number = self._world.links[name]
        place, axes, velocity, omega = self._com(number)
        _, _, centre, own = self._dynamics(number)
        rotation = axes @ own.T
        arm = -rotation @ centre
        return LinkMotion(rotation, place + arm, velocity + np.cross(omega, arm), omega)

    def _quaternion(self, number: int) -> tuple[float, ...]:
        world, p = self._world, self._world.p
        _, turn = p.getBasePositionAndOrientation(world.body, physicsClientId=world.client)
        _, _, _, _, own = p.getDynamicsInfo(world.body, number, physicsClientId=world.client)[:5]
        _, inverse = p.invertTransform((0.0, 0.0, 0.0), own)
        _, found = p.multiplyTransforms((0.0, 0.0, 0.0), turn, (0.0, 0.0, 0.0), inverse)
        return tuple(found)

    def _points(self) -> list[tuple[str, Array, float]]:
        world, p = self._world, self._world.p
        names = {number: name for name, number in world.links.items()}
        found = p.getContactPoints(world.body, world.plane, physicsClientId=world.client)
        return [(names[row[3]], np.array(row[6]), row[9] * row[7][2]) for row in found]

    def _energy(self) -> float:
        gravity, total = self._robot.model.gravity.linear, 0.0
        for number in self._world.links.values():
            place, axes, velocity, omega = self._com(number)
            mass, moments, _, _ = self._dynamics(number)
            turning = moments @ (axes.T @ omega) ** 2
            total += 0.5 * (mass * velocity @ velocity + turning) - mass * gravity @ place
        return float(total)
