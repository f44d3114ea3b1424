"""What engines that read a URDF share: one shell, of which Drake and PyBullet are backends."""

from __future__ import annotations

import math
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from lxml import etree

from rpctl.arrays import Array
from rpctl.dynamics.stance import find_supports
from rpctl.engines.edited_urdf import Dialect, edged_wheels, edit_urdf, other_shapes
from rpctl.engines.engine import (
    EngineFault,
    EngineState,
    LinkMotion,
    Mended,
    Switch,
    in_order,
    wheel_slips,
)
from rpctl.equivalence.contact.model import support_shapes
from rpctl.equivalence.contact.mujoco_body import STABLE, one_directional, tie_rod_efforts
from rpctl.errors import EngineMissing
from rpctl.libraries import install_command
from rpctl.robot.model import Robot

NEAR_M = 0.02  # m: how far off the edge of a support's shape its contact may lie
BANDWIDTH = 200.0  # rad/s of tie rods, against the inertia of the swivel that each turns
MAX_SPEED = 1e4  # m/s: faster is no motion
Point = tuple[str, Array, float]  # link that touches the ground, where (3,), upward force N


class NamedContacts:
    """The contacts of a robot by name, and which of them an engine's point belongs to.

    Attributes:
        names: The wheels' joints, then the supports, as ``Contacts.names``.
        supports_of: Of each link that carries some: the index, the place (3,) and the reach (m) of
            its supports.
    """

    def __init__(self, robot: Robot) -> None:
        wheels = [wheel.joint for wheel in robot.drive.wheels]
        supports = find_supports(robot)
        self.names = (*wheels, *(part.name for part in supports.parts))
        self._wheel_of = {
            link: wheels.index(joint)
            for joint in wheels
            for link, _ in robot.tree.rigid_links(robot.description.joint[joint].child)
        }
        self.supports_of: dict[str, list[tuple[int, Array, float]]] = {}
        for name, link, shape in support_shapes(robot, supports):
            row = (self.names.index(name), shape.origin[:3, 3], max(shape.size) + NEAR_M)
            self.supports_of.setdefault(link, []).append(row)

    def loads(self, points: Iterable[Point], motion: Callable[[str], LinkMotion]) -> Array:
        """Return the load of each contact (n,), N; what touches elsewhere is nobody's."""
        load = np.zeros(len(self.names))
        for link, place, force in points:
            index = self._wheel_of.get(link)
            if index is None:
                index = self._support(link, place, motion)
            if index is not None:
                load[index] += force
        return load

    def _support(self, link: str, place: Array, motion: Callable[[str], LinkMotion]) -> int | None:
        """Return the support of a link that is nearest to a point, if one is near."""
        nearest, index = math.inf, None
        for k, centre, reach in self.supports_of.get(link, ()):
            frame = motion(link)
            distance = math.dist((frame.rotation @ centre + frame.origin)[:2], place[:2])
            if distance < min(nearest, reach):
                nearest, index = distance, k
        return index


class UrdfRun(ABC):
    """A robot in an engine, from its start on; an :class:`~rpctl.engines.engine.EngineRun`.

    Args:
        robot: The robot.
        q: Where it starts (nq,).
        mended: What is mended.

    Attributes:
        dialect: What the engine reads.
        steps: Its step by default and mended, s.
        forgets: Whether efforts hold for a step only.
        notes: What was left out, in sentences.
    """

    dialect: ClassVar[Dialect]
    steps: ClassVar[tuple[float, float]]
    forgets = False
    notes: tuple[str, ...] = ()

    def __init__(self, robot: Robot, q: Array, mended: Mended) -> None:
        self.robot, self.t = robot, 0.0
        self.step = self.steps["timestep" in mended]
        self._named = NamedContacts(robot)
        self.contacts = self._named.names
        tied = "mimic" in mended and robot.drive.followers
        self.rods = follower_inertia(robot, q) if tied else {}  # of tie rods: what they turn

    @abstractmethod
    def joints(self) -> dict[str, tuple[float, float]]:
        """Return position and rate of the moving joints."""

    @abstractmethod
    def motion(self, link: str) -> LinkMotion:
        """Return how a link's frame moves."""

    @abstractmethod
    def points(self) -> list[Point]:
        """Return the contacts with the ground."""

    @abstractmethod
    def energy(self) -> float:
        """Return kinetic and potential energy, J."""

    @abstractmethod
    def exert(self, efforts: Mapping[str, float]) -> None:
        """Go on to ``t`` under efforts (N·m or N, by joint)."""

    @contextmanager
    def file(self, mended: Mended) -> Iterator[str]:
        """Have the robot's file, mended, for the engine to read; what was left out is noted."""
        root, self.notes = edit_urdf(self.robot, mended, self.dialect)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_bytes(etree.tostring(root, encoding="utf-8"))
            yield str(path)

    def measured(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return positions (n,), rad or m, and rates (n,) of joints."""
        joints = self.joints()
        both = np.array([joints[name] for name in names]).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s).

        Raises:
            EngineFault: The motion diverges.
        """
        efforts = dict(zip(self.robot.actuators, tau.tolist(), strict=True))
        stride = self.step if self.rods or self.forgets else dt
        bandwidth = min(BANDWIDTH, STABLE / self.step)
        for _ in range(round(dt / stride)):
            self.t += stride
            rods = {}
            if self.rods:  # they pull anew in each step
                rods = tie_rod_efforts(self.robot.drive, self.joints(), self.rods, bandwidth)
            self.exert(efforts | {name: efforts.get(name, 0.0) + rods[name] for name in rods})
        if not np.linalg.norm(self.motion(self.robot.description.root).velocity) < MAX_SPEED:
            raise EngineFault(f"{self.dialect.name}'s motion of {self.robot.name} diverges")

    def state(self) -> EngineState:
        """Return the state now; loads are those of the last step."""
        root = self.motion(self.robot.description.root)
        return EngineState(
            pose=np.array([*root.origin, *pin.Quaternion(root.rotation).coeffs()]),
            joints=self.joints(),
            load=self._named.loads(self.points(), self.motion),
            slip=wheel_slips(self.robot, self.motion),
            energy=self.energy(),
        )


@dataclass(frozen=True)
class UrdfEngine(ABC):
    """An engine that reads a URDF; :class:`rpctl.engines.engine.Engine` has the methods.

    Attributes:
        name: As its makers write it.
        tick: How long efforts are held, s.
        module: What is imported of it, when it starts.
        distribution: The name of its package.
        extra: What installs it.
        run: The class of its runs, made of a robot, q, what is mended, and the friction.
        said: What it does by default and what mends it, by switch: those of any robot, and those of
            wheels, supports and other shapes where they matter.

    Raises:
        EngineMissing: It is not installed.
    """

    name: ClassVar[str]
    tick: ClassVar[float]
    module: ClassVar[str]
    distribution: ClassVar[str]
    extra: ClassVar[str]
    run: ClassVar[Any]
    said: ClassVar[Mapping[str, tuple[str, str]]]

    def __post_init__(self) -> None:
        """Refuse where it is not installed; its library is imported when it starts."""
        if find_spec(self.module) is None:
            command = install_command(self.extra)
            raise EngineMissing(f"{self.name} is not installed; run {command}")

    @property
    def version(self) -> str:
        """The package's version."""
        return version(self.distribution)

    @abstractmethod
    def own_switches(self, robot: Robot) -> Iterator[Switch]:
        """Yield the switches that the robot has words for."""

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that mean something here, of this robot."""
        matters = {
            "wheel": edged_wheels(robot),
            "caster": bool(find_supports(robot).parts),
            "collisions": other_shapes(robot),
        }
        common = [Switch(n, *words) for n, words in self.said.items() if matters.get(n, True)]
        return in_order([*common, *self.own_switches(robot)])

    def start(self, robot: Robot, q: Array, mended: Mended, friction: float) -> UrdfRun:
        """Return the robot at rest at q (nq,), its wheels at the height of the ground.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            mended: What is mended.
            friction: Coefficient between wheels and ground where ``friction`` is mended.

        Raises:
            EngineFault: The engine refuses the robot, or has nothing that rolls like its wheels:
                its friction is the same in all directions.
        """
        held = [wheel for wheel in robot.drive.wheels if one_directional(robot, wheel)]
        if "wheel" in mended and held:
            sliding = f"wheel that slides sideways, as {held[0].joint} does"
            what = "rollers" if robot.drive.type in ("mecanum", "omni") else sliding
            raise EngineFault(f"{robot.name} is not compared in {self.name}: it has no {what}")
        run: UrdfRun = self.run(robot, q, mended, friction)
        return run


def follower_inertia(robot: Robot, q: Array) -> dict[str, float]:
    """Return the inertia of each follower about its axis at q (nq,), kg·m²."""
    M = pin.crba(robot.model, robot.model.createData(), q)
    index = {swivel.joint: robot.velocity_index(swivel.joint) for swivel in robot.drive.followers}
    return {name: float(M[i, i]) for name, i in index.items()}
