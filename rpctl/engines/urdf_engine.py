"""What engines that read a URDF share: the base classes of the Drake and PyBullet engines."""

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

NEAR_M = 0.02  # m: how far outside a support's shape its contact may lie
BANDWIDTH = 200.0  # rad/s: bandwidth of tie rods, with the inertia of the swivels that they turn
MAX_SPEED = 1e4  # m/s: a faster motion counts as diverged
Point = tuple[str, Array, float]  # link that touches the ground, where (3,), upward force N


class NamedContacts:
    """The contacts of a robot by name; assigns an engine's contact points to them.

    Attributes:
        names: The wheels' joints, then the supports, in the order of ``Contacts.names``.
        supports_of: By link, the index, the position (3,) and the reach (m) of its supports.
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
        """Return the load of each contact (n,), N; points that belong to none are ignored."""
        load = np.zeros(len(self.names))
        for link, place, force in points:
            index = self._wheel_of.get(link)
            if index is None:
                index = self._support(link, place, motion)
            if index is not None:
                load[index] += force
        return load

    def _support(self, link: str, place: Array, motion: Callable[[str], LinkMotion]) -> int | None:
        """Return the index of a link's support that is nearest to a point, if one is near."""
        nearest, index = math.inf, None
        for k, centre, reach in self.supports_of.get(link, ()):
            frame = motion(link)
            distance = math.dist((frame.rotation @ centre + frame.origin)[:2], place[:2])
            if distance < min(nearest, reach):
                nearest, index = distance, k
        return index


class UrdfRun(ABC):
    """A robot that runs in an engine; an :class:`~rpctl.engines.engine.EngineRun`.

    Args:
        robot: The robot.
        q: Configuration at the start (nq,).
        mended: The mended switches.

    Attributes:
        dialect: What the engine reads.
        steps: The engine's default and mended time step, s.
        forgets: Whether the engine applies efforts for one step only.
        notes: Sentences on what was left out.
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
        self.rods = follower_inertia(robot, q) if tied else {}  # inertia by swivel

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
        """Simulate until ``t`` under efforts (N·m or N, by joint)."""

    @contextmanager
    def file(self, mended: Mended) -> Iterator[str]:
        """Yield the path of the edited URDF; ``notes`` says what was left out."""
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
            if self.rods:  # their forces are computed in each step
                rods = tie_rod_efforts(self.robot.drive, self.joints(), self.rods, bandwidth)
            self.exert(efforts | {name: efforts.get(name, 0.0) + rods[name] for name in rods})
        if not np.linalg.norm(self.motion(self.robot.description.root).velocity) < MAX_SPEED:
            raise EngineFault(f"{self.dialect.name}'s motion of {self.robot.name} diverges")

    def state(self) -> EngineState:
        """Return the present state; the loads are those of the last step."""
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
    """An engine that reads a URDF; an :class:`rpctl.engines.engine.Engine`.

    Attributes:
        name: The engine's name, as its makers write it.
        tick: How long efforts are held, s.
        module: The module to import.
        distribution: Name of the engine's package.
        extra: The extra of rpctl that installs it.
        run: The class of its runs; takes the robot, q, the mended switches and the friction.
        said: By switch, what the engine does by default and what mends it.

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
        """Refuse to be made if the engine is not installed; a run imports its library."""
        if find_spec(self.module) is None:
            command = install_command(self.extra)
            raise EngineMissing(f"{self.name} is not installed; run {command}")

    @property
    def version(self) -> str:
        """The package's version."""
        return version(self.distribution)

    @abstractmethod
    def own_switches(self, robot: Robot) -> Iterator[Switch]:
        """Yield the switches whose words depend on the robot."""

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that matter for this robot in this engine."""
        matters = {
            "wheel": edged_wheels(robot),
            "caster": bool(find_supports(robot).parts),
            "collisions": other_shapes(robot),
        }
        common = [Switch(n, *words) for n, words in self.said.items() if matters.get(n, True)]
        return in_order([*common, *self.own_switches(robot)])

    def start(self, robot: Robot, q: Array, mended: Mended, friction: float) -> UrdfRun:
        """Return the robot at rest at q (nq,), with its wheels on the ground.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            mended: The mended switches.
            friction: Coefficient of friction between wheels and ground if ``friction`` is mended.

        Raises:
            EngineFault: The engine refuses the robot, or cannot model its wheels because its
                friction is the same in all directions.
        """
        held = [wheel for wheel in robot.drive.wheels if one_directional(robot, wheel)]
        if "wheel" in mended and held:
            sliding = f"wheels that slide sideways, as {held[0].joint} does"
            what = "rollers" if robot.drive.type in ("mecanum", "omni") else sliding
            raise EngineFault(f"{robot.name} cannot run in {self.name}, which has no {what}")
        run: UrdfRun = self.run(robot, q, mended, friction)
        return run


def follower_inertia(robot: Robot, q: Array) -> dict[str, float]:
    """Return the inertia of each follower about its axis at q (nq,), kg·m²."""
    M = pin.crba(robot.model, robot.model.createData(), q)
    index = {swivel.joint: robot.velocity_index(swivel.joint) for swivel in robot.drive.followers}
    return {name: float(M[i, i]) for name, i in index.items()}
