"""``Engine``: another simulator on flat ground, as the referee asks it, and its switches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol, cast

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.equivalence.contact.mujoco_body import planar, tilt
from rpctl.equivalence.contact.plan import DrivenRobot
from rpctl.errors import DivergedError, EngineMissing, RpctlError, require_known
from rpctl.robot.model import Robot

ENGINES = {  # by the name that users give
    "mujoco": "rpctl.engines.mujoco.engine:MujocoSimulator",
    "drake": "rpctl.engines.drake:DrakeEngine",
    "pybullet": "rpctl.engines.bullet:BulletEngine",
}


SWITCHES = {  # what engines do differently by default, and how it is meant when it is mended
    "wheel": "Shape of the wheels where they meet the ground: as drawn, or crowned, so that they"
    " touch at one point and, of a mecanum or omni wheel, hold along the roller only.",
    "caster": "Supports and balls: as drawn and with friction, or sliding without any; those that"
    " the engine does not see are added.",
    "cone": "Friction pyramid, or cone.",
    "friction": "The engine's own coefficients, torsional and rolling ones too; or the referee's.",
    "inertia": "As the engine's loader leaves it (dropped, balanced, guessed from shapes, rotors"
    " left out), or the robot's.",
    "softness": "Compliance of contacts, and how well the solver converges.",
    "timestep": "The engine's own, or one short enough.",
    "mimic": "Mimic joints and tie rods left free, or tied.",
    "losses": "Damping and friction of joints and of free bodies as the loader takes them, or the"
    " robot's.",
    "collisions": "Whether links of the robot collide with each other and, but for wheels and"
    " supports, with the ground.",
}
LEVEL = 1e-9  # cosine of an axle and the direction to the left: less is across it
Mended = frozenset[str]  # names of the switches that are mended; the others are at default
ALL_DEFAULT: Mended = frozenset()  # as the engine takes the URDF of a user who sets nothing
ALL_MENDED: Mended = frozenset(SWITCHES)  # as the reduced model means it


@dataclass(frozen=True)
class Switch:
    """A switch that means something in an engine, for a robot, in that engine's own words.

    Attributes:
        name: One of :data:`SWITCHES`.
        fault: What the engine does by default, a clause: ``"its wheels are 8 cm wide and scrub"``.
        setting: What mends it, an imperative with attribute or option: ``'set <option
            cone="elliptic"/>'``.
    """

    name: str
    fault: str
    setting: str

    def __post_init__(self) -> None:
        """Refuse a name that is none of them."""
        require_known("switch", [self.name], SWITCHES)


def in_order(switches: Iterable[Switch]) -> tuple[Switch, ...]:
    """Return switches in the order of :data:`SWITCHES`."""
    names = [*SWITCHES]
    return tuple(sorted(switches, key=lambda switch: names.index(switch.name)))


class EngineFault(DivergedError):
    """An engine refuses a robot, or its motion diverges; its own words are in the message."""

    exit_code = RpctlError.exit_code


@dataclass(frozen=True, eq=False)
class EngineState:
    """State of a robot in an engine at one instant.

    Attributes:
        pose: Root link's x, y, z (m) and quaternion x, y, z, w (7,), in the world; the ground is
            the plane z = 0.
        joints: Position (rad or m; turns are counted, not taken off) and rate of the moving joints.
        load: Vertical force (N) of each contact, as :attr:`EngineRun.contacts` names them (n,).
        slip: Velocity (m/s) of each drive's wheel's contact point, the point of the wheel below its
            centre, along its rolling direction and to its left (n_wheels, 2).
        energy: Kinetic plus potential energy, J, of the engine's own masses; the zero is free.
    """

    pose: Array
    joints: Mapping[str, tuple[float, float]]
    load: Array
    slip: Array
    energy: float

    @property
    def tilt(self) -> float:
        """How far the root link leans out of the level, rad."""
        return tilt(self.pose)

    @property
    def planar(self) -> Array:
        """The root link's x, y (m) and heading (rad) seen from above (3,)."""
        return planar(self.pose)


@dataclass(frozen=True)
class LinkMotion:
    """Motion of a link's frame: rotation (3, 3), origin (3,) m, its velocity (3,) and ω (3,)."""

    rotation: Array
    origin: Array
    velocity: Array
    omega: Array


def wheel_slip(robot: Robot, wheel: Wheel, motion: LinkMotion) -> tuple[float, float]:
    """Return the velocity (m/s) of a wheel's lowest point: along its rolling direction, leftward.

    The rolling direction is level and across the axle; the drive's heading, or its swivel's, with
    all joints at 0, fixes its sign.

    Args:
        robot: The robot.
        wheel: The wheel.
        motion: Of the link that its joint turns.
    """
    heading = robot.drive.heading
    for swivel in robot.drive.swivels:
        if swivel.joint == wheel.swivel:
            heading = swivel.heading
    start = robot.tree.axis(robot.description.joint[wheel.joint])
    ahead = start[1] * math.cos(heading) - start[0] * math.sin(heading)
    axle = motion.rotation @ np.array(wheel.axis)
    down = axle[2] * axle - np.array([0.0, 0.0, 1.0])
    arm = wheel.offset * axle + (wheel.radius - wheel.tyre) * down / np.linalg.norm(down)
    arm[2] -= wheel.tyre
    velocity = motion.velocity + np.cross(motion.omega, arm)
    left = (-1.0 if ahead < -LEVEL else 1.0) * axle[:2] / math.hypot(*axle[:2])
    return float(velocity[0] * left[1] - velocity[1] * left[0]), float(velocity[:2] @ left)


def wheel_slips(robot: Robot, motion: Callable[[str], LinkMotion]) -> Array:
    """Return the velocity of each wheel's lowest point (n_wheels, 2), m/s.

    Args:
        robot: The robot.
        motion: Of a link, by its name.
    """
    children = robot.description.joint
    slips = [wheel_slip(robot, w, motion(children[w.joint].child)) for w in robot.drive.wheels]
    return np.array(slips).reshape(-1, 2)


def joint_losses(robot: Robot, name: str) -> tuple[float, float]:
    """Return a joint's damping (N·m·s/rad or N·s/m) and dry friction (N·m or N) in the model."""
    losses, at = robot.losses, robot.velocity_index(name)
    return (0.0, 0.0) if losses is None else (float(losses.damping[at]), float(losses.friction[at]))


class EngineRun(DrivenRobot, Protocol):
    """A robot in an engine, from its start on; ``dt`` is a multiple of the engine's tick.

    Where the motion diverges, ``advance`` raises a :class:`DivergedError`.

    Attributes:
        contacts: Names of the contacts, those of ``Contacts.names`` in their order: the wheels'
            joints, then the supports.
        notes: What was assumed or left out, in sentences.
    """

    contacts: tuple[str, ...]
    notes: tuple[str, ...]

    def state(self) -> EngineState:
        """Return the state now; loads are those of the last step."""


class Engine(Protocol):
    """A simulator."""

    @property
    def name(self) -> str:
        """As its makers write it: ``"MuJoCo"``, ``"Drake"``, ``"PyBullet"``."""

    @property
    def version(self) -> str:
        """As it gives it."""

    @property
    def tick(self) -> float:
        """How long the referee holds efforts, s: a multiple of its steps, default and mended."""

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that mean something here, of this robot."""

    def start(self, robot: Robot, q: Array, mended: Mended, friction: float) -> EngineRun:
        """Return the robot at rest at q, its wheels at the height of the ground; not yet settled.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            mended: What is mended.
            friction: Coefficient between wheels and ground where ``friction`` is mended.

        Raises:
            EngineFault: The engine refuses the robot.
        """


def installed_engines(names: Sequence[str] = ()) -> tuple[list[Engine], list[str]]:
    """Return the engines that are installed, and a sentence on each that is not.

    Args:
        names: Those that are wanted; empty: all.

    Raises:
        UnknownNameError: There is no engine of such a name.
    """
    found: list[Engine] = []
    missing: list[str] = []
    require_known("engine", names, ENGINES)
    for name in names or tuple(ENGINES):
        module, _, kind = ENGINES[name].partition(":")
        try:
            engine = cast("Engine", getattr(import_module(module), kind)())
        except EngineMissing as error:
            missing.append(str(error))
        else:
            found.append(engine)
    return found, missing
