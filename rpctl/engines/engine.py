"""``Engine``: the protocol of another simulator on flat ground, and its switches."""

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


SWITCHES = {  # what engines do by default; what a mended engine does
    "wheel": "Wheels as the file draws them; crowned wheels, which touch the ground at one point"
    " (mecanum and omni wheels have friction along the roller only).",
    "caster": "Supports and balls as the file draws them, with friction; without friction, and"
    " added if the engine does not see them.",
    "cone": "A friction pyramid; a friction cone.",
    "friction": "The engine's coefficients, also torsional and rolling ones; the referee's.",
    "inertia": "Inertias as the loader leaves them (dropped, balanced, guessed from shapes, without"
    " rotors); the robot's.",
    "softness": "The engine's compliant contacts and solver; stiff contacts, a converged solver.",
    "timestep": "The engine's time step; a short one.",
    "mimic": "Mimic joints and tie rods are free; they are tied.",
    "losses": "Damping and friction of joints and bodies as the loader sets them; the robot's.",
    "collisions": "All links collide with each other and with the ground; only wheels and supports"
    " collide, with the ground.",
}
LEVEL = 1e-9  # cosine between an axle and the direction to the left: below, they are perpendicular
Mended = frozenset[str]  # names of the mended switches; the others are at default
ALL_DEFAULT: Mended = frozenset()  # as the engine takes the URDF of a user who sets nothing
ALL_MENDED: Mended = frozenset(SWITCHES)  # as the reduced model means it


@dataclass(frozen=True)
class Switch:
    """A switch that matters for a robot in an engine, in the engine's own terms.

    Attributes:
        name: One of :data:`SWITCHES`.
        fault: A clause that says what the engine does by default: ``"its wheels are 8 cm wide and
            scrub"``.
        setting: An imperative that says what mends it, with the attribute or option: ``'set <option
            cone="elliptic"/>'``.
    """

    name: str
    fault: str
    setting: str

    def __post_init__(self) -> None:
        """Refuse an unknown name."""
        require_known("switch", [self.name], SWITCHES)


def in_order(switches: Iterable[Switch]) -> tuple[Switch, ...]:
    """Return switches in the order of :data:`SWITCHES`."""
    names = [*SWITCHES]
    return tuple(sorted(switches, key=lambda switch: names.index(switch.name)))


class EngineFault(DivergedError):
    """An engine refuses a robot, or its motion diverges; the message quotes the engine."""

    exit_code = RpctlError.exit_code


@dataclass(frozen=True, eq=False)
class EngineState:
    """State of a robot in an engine at one instant.

    Attributes:
        pose: Root link's x, y, z (m) and quaternion x, y, z, w (7,), in the world; the ground is
            the plane z = 0.
        joints: Position (rad or m, full turns included) and rate of the moving joints, by name.
        load: Vertical force (N) of each contact (n,), in the order of :attr:`EngineRun.contacts`.
        slip: Velocity (m/s) of each wheel's contact point, the point of the wheel below its centre,
            along its rolling direction and to its left (n_wheels, 2).
        energy: Kinetic plus potential energy, J, of the engine's masses; the zero is arbitrary.
    """

    pose: Array
    joints: Mapping[str, tuple[float, float]]
    load: Array
    slip: Array
    energy: float

    @property
    def tilt(self) -> float:
        """Angle between the root link's z axis and the vertical, rad."""
        return tilt(self.pose)

    @property
    def planar(self) -> Array:
        """The root link's x, y (m) and heading (rad) seen from above (3,)."""
        return planar(self.pose)


@dataclass(frozen=True)
class LinkMotion:
    """Motion of a link's frame in the world: rotation (3, 3), origin (3,), m, velocity, ω."""

    rotation: Array
    origin: Array
    velocity: Array
    omega: Array


def wheel_slip(robot: Robot, wheel: Wheel, motion: LinkMotion) -> tuple[float, float]:
    """Return the velocity (m/s) of a wheel's lowest point: along its rolling direction, leftward.

    The rolling direction is horizontal and perpendicular to the axle; the heading of the drive
    or of the swivel, with all joints at 0, determines its sign.

    Args:
        robot: The robot.
        wheel: The wheel.
        motion: Motion of the link that the wheel's joint turns.
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
        motion: Returns the motion of a link, by its name.
    """
    children = robot.description.joint
    slips = [wheel_slip(robot, w, motion(children[w.joint].child)) for w in robot.drive.wheels]
    return np.array(slips).reshape(-1, 2)


def joint_losses(robot: Robot, name: str) -> tuple[float, float]:
    """Return a joint's damping (N·m·s/rad or N·s/m) and dry friction (N·m or N) in the model."""
    losses, at = robot.losses, robot.velocity_index(name)
    return (0.0, 0.0) if losses is None else (float(losses.damping[at]), float(losses.friction[at]))


class EngineRun(DrivenRobot, Protocol):
    """A robot that runs in an engine; ``dt`` is a multiple of the engine's tick.

    If the motion diverges, ``advance`` raises a :class:`DivergedError`.

    Attributes:
        contacts: Names of the contacts, in the order of ``Contacts.names``: the wheels' joints,
            then the supports.
        notes: Sentences on what was assumed or left out.
    """

    contacts: tuple[str, ...]
    notes: tuple[str, ...]

    def state(self) -> EngineState:
        """Return the present state; the loads are those of the last step."""


class Engine(Protocol):
    """A simulator."""

    @property
    def name(self) -> str:
        """The name, as its makers write it: ``"MuJoCo"``, ``"Drake"``, ``"PyBullet"``."""

    @property
    def version(self) -> str:
        """The version of the installed package."""

    @property
    def tick(self) -> float:
        """How long the referee holds efforts, s: a multiple of the default and the mended step."""

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that matter for this robot in this engine."""

    def start(self, robot: Robot, q: Array, mended: Mended, friction: float) -> EngineRun:
        """Return the robot at rest at q, with its wheels on the ground, before it settles.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            mended: The mended switches.
            friction: Coefficient of friction between wheels and ground if ``friction`` is mended.

        Raises:
            EngineFault: The engine refuses the robot.
        """


def installed_engines(names: Sequence[str] = ()) -> tuple[list[Engine], list[str]]:
    """Return the engines that are installed, and a sentence on each that is not.

    Args:
        names: The engines to look for; empty: all.

    Raises:
        UnknownNameError: There is no engine with this name.
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
