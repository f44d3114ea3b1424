"""Random wheeled robots as URDF texts: any drive, any tree, physical inertias, slanted frames.

One builder asks for numbers; Hypothesis (``robots``) or a random generator (``random_robot``)
answers. Numbers are written by ``repr``, so the text holds every double exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests import urdf

Array = NDArray[np.float64]

MAX_JOINTS = 6
JOINT_KINDS = ("revolute", "prismatic", "continuous")
MAX_HEADING_RAD = 1.5  # rad; a forward direction further from +x would be taken for backward
MIN_MOUNT_HEIGHT_M = (
    0.6  # m, the least height of the arm's mounts over the axle: no arm joint is a wheel
)


class NumberSource(Protocol):
    """Who answers the builder."""

    def number(self, low: float, high: float) -> float:
        """Return a number of [low, high]."""

    def integer(self, low: int, high: int) -> int:
        """Return an integer of [low, high]."""


@dataclass(frozen=True)
class WheeledRobot:
    """A URDF and the drive that must be found in it (m, rad, in the root link's frame)."""

    text: str
    radius: float
    track: float
    point: tuple[float, float]
    heading: float
    ground: float
    joints: int
    mimics: int


@dataclass
class RobotBuilder:
    """A robot under construction."""

    choose: NumberSource
    parts: list[str] = field(default_factory=list)
    movable: list[str] = field(default_factory=list)  # links that may carry a joint
    on_base: set[str] = field(default_factory=set)  # links that the root holds rigidly
    leaders: list[str] = field(default_factory=list)  # joints that others may follow
    mimics: int = 0

    def flag(self) -> bool:
        return self.choose.integer(0, 1) == 1

    def vector(self, size: float) -> Array:
        return np.array([self.choose.number(-size, size) for _ in range(3)])

    def angles(self) -> Array:
        return self.vector(math.pi)

    def axis(self) -> Array:
        z, turn = self.choose.number(-1.0, 1.0), self.choose.number(-math.pi, math.pi)
        level = math.sqrt(1.0 - z * z)
        return np.array([level * math.cos(turn), level * math.sin(turn), z])

    def link(self, name: str, mass: tuple[float, float] | None, shape: str = "") -> None:
        """Add a link; its principal moments b + c, c + a, a + b are those of a real body."""
        inertia = ""
        if mass is not None:
            m = self.choose.number(*mass)
            a, b, c = (m * self.choose.number(1e-3, 3e-2) for _ in range(3))
            R = rotation(self.angles())
            I = R @ np.diag([b + c, c + a, a + b]) @ R.T  # noqa: E741 (the field's letter)
            products = I[0, 1], I[0, 2], I[1, 2]
            inertia = urdf.inertial(m, np.diag(I), products, self.vector(0.2), self.angles())
        self.parts.append(urdf.link(name, inertia, shape))

    def joint(
        self,
        name: str,
        kind: str,
        ends: tuple[str, str],
        xyz: Array,
        rpy: Array,
        axis: urdf.Numbers = "",
        more: str = "",
    ) -> None:
        self.parts.append(urdf.joint(name, kind, ends, xyz, axis, more, rpy))


def rotation(rpy: Array) -> Array:
    """Return the rotation (3, 3) of URDF's roll, pitch, yaw (rad)."""
    return np.asarray(Rotation.from_euler("xyz", rpy).as_matrix())


def build(choose: NumberSource, joints: int | None = None) -> WheeledRobot:
    """Return a differential drive with an arm, or several; ``joints`` says how many they have."""
    tree = RobotBuilder(choose)
    height = choose.number(-0.3, 0.3)  # of the axle over the root link's origin
    place, turn = add_base(tree)
    radius, track = choose.number(0.03, 0.3), choose.number(0.3, 1.2)
    point = choose.number(-0.4, 0.4), choose.number(-0.4, 0.4)
    heading, R = choose.number(-MAX_HEADING_RAD, MAX_HEADING_RAD), rotation(turn)
    for name, side in (("left", 1.0), ("right", -1.0)):
        left = np.array([-math.sin(heading), math.cos(heading), 0.0])
        centre = np.array([*point, height]) + 0.5 * side * track * left
        add_wheel(tree, name, radius, "base", R.T @ (centre - place), R, left)
    mount = R.T @ (np.array([0.0, 0.0, height + MIN_MOUNT_HEIGHT_M]) - place)
    count = choose.integer(0, MAX_JOINTS) if joints is None else joints
    for index in range(count):
        add_arm_joint(tree, index, mount)
    if tree.flag():  # a file may name its parts in any order
        tree.parts.reverse()
    text = urdf.robot("random", *tree.parts)
    ground = height - radius
    return WheeledRobot(text, radius, track, point, heading, ground, count, tree.mimics)


def add_base(tree: RobotBuilder) -> tuple[Array, Array]:
    """Add ``base``, or a massless root that holds it; return its origin (3,), m, and angles (3,).

    They are in the root link's frame; the angles are roll, pitch and yaw, rad.
    """
    place, turn = np.zeros(3), np.zeros(3)
    if tree.flag():
        place, turn = tree.vector(0.3), tree.angles()
        tree.link("footprint", None)
        tree.joint("footprint_joint", "fixed", ("footprint", "base"), place, turn)
    tree.link("base", (5.0, 50.0))
    tree.movable.append("base")
    tree.on_base.add("base")
    return place, turn


def add_wheel(
    tree: RobotBuilder,
    name: str,
    radius: float,
    carrier: str,
    centre: Array,
    R: Array,
    left: Array,
    ball: bool = False,
) -> None:
    """Add a wheel of any frame and axle sign; its joint may lie beside its centre.

    Args:
        tree: The robot.
        name: What its link and its joint are called, before ``_wheel`` and ``_joint``.
        radius: m.
        carrier: The link that holds it.
        centre: The wheel's centre (3,) in the carrier's frame, m.
        R: The carrier's rotation (3, 3) in the root link's frame.
        left: The axle (3,) towards the left, in the root link's axes.
        ball: Whether it is a sphere.
    """
    sign = 1.0 if tree.flag() else -1.0
    offset, rpy = tree.choose.number(-0.1, 0.1), tree.angles()
    in_carrier = sign * R.T @ left
    axis = rotation(rpy).T @ in_carrier
    axis = axis / np.linalg.norm(axis)
    upright = np.array([0.0, math.acos(np.clip(axis[2], -1.0, 1.0)), math.atan2(axis[1], axis[0])])
    tyre = "sphere" if ball else 'cylinder length="0.04"'
    shape = urdf.shape(f'{tyre} radius="{radius}"', xyz=offset * axis, rpy=upright)
    tree.link(f"{name}_wheel", (0.2, 3.0), shape)
    ends = carrier, f"{name}_wheel"
    tree.joint(f"{name}_joint", "continuous", ends, centre - offset * in_carrier, rpy, axis)


def add_arm_joint(tree: RobotBuilder, index: int, mount: Array) -> None:
    """Add a joint to any link, perhaps with a fixed link before it and one behind."""
    choose = tree.choose
    parent = tree.movable[choose.integer(0, len(tree.movable) - 1)]
    xyz = tree.vector(0.2) + (mount if parent == "base" else 0.0)
    name = f"{'azm'[choose.integer(0, 2)]}_{index}"  # parsers order the joints by their names
    rigid = parent in tree.on_base
    if tree.flag():
        tree.link(f"{name}_flange", (0.1, 1.0) if tree.flag() else None)
        tree.joint(f"{name}_flange_joint", "fixed", (parent, f"{name}_flange"), xyz, tree.angles())
        parent, xyz = f"{name}_flange", tree.vector(0.1)
    kind = JOINT_KINDS[choose.integer(0, 1 if rigid else 2)]
    axis, more = tree.axis() * choose.number(0.5, 2.0), _limits(tree, kind)
    if tree.leaders and choose.integer(0, 3) == 3:
        more += _mimic(tree)
    else:
        tree.leaders.append(name)
    tree.joint(name, kind, (parent, f"{name}_link"), xyz, tree.angles(), axis, more)
    if bare := choose.integer(0, 3) == 3:
        tree.link(f"{name}_tool", (0.2, 5.0))
        ends = f"{name}_link", f"{name}_tool"
        tree.joint(f"{name}_tool_joint", "fixed", ends, tree.vector(0.1), tree.angles())
    tree.link(f"{name}_link", None if bare else (0.2, 5.0))
    tree.movable.append(f"{name}_link")


def _limits(tree: RobotBuilder, kind: str) -> str:
    if kind == "continuous":
        return ""
    low, high = -tree.choose.number(0.1, 2.5), tree.choose.number(0.1, 2.5)
    return urdf.limit(low, high, 50.0, 2.0)


def _mimic(tree: RobotBuilder) -> str:
    tree.mimics += 1
    leader = tree.leaders[tree.choose.integer(0, len(tree.leaders) - 1)]
    factor = tree.choose.number(0.2, 2.0) * (1.0 if tree.flag() else -1.0)
    shift = tree.choose.number(-0.5, 0.5)
    return f'<mimic joint="{leader}" multiplier="{factor!r}" offset="{shift!r}"/>'


@dataclass(frozen=True)
class _HypothesisSource:
    """Hypothesis answers, and shrinks to the middle of a range or its first integer.

    Left alone it would repeat few numbers; so a generator shifts each, round and round its range,
    until the seed has shrunk to 0.
    """

    draw: Callable[..., float]
    shift: Callable[[], float]

    def number(self, low: float, high: float) -> float:
        fraction = self.draw(st.floats(-1.0, 1.0, allow_subnormal=False)) + self.shift()
        fraction -= 2.0 * round(0.5 * fraction)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        return min(max(middle + half * fraction, low), high)

    def integer(self, low: int, high: int) -> int:
        return int(self.draw(st.integers(low, high)))


@dataclass(frozen=True)
class RandomSource:
    """A random generator answers."""

    rng: np.random.Generator

    def number(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def integer(self, low: int, high: int) -> int:
        return int(self.rng.integers(low, high + 1))


@st.composite
def robots(draw: Callable[..., float]) -> WheeledRobot:
    """Return a strategy of wheeled robots."""
    seed = int(draw(st.integers(0, 2**16)))
    rng = np.random.default_rng(seed)
    return build(_HypothesisSource(draw, lambda: float(rng.uniform(-1.0, 1.0)) if seed else 0.0))


def generate(rng: np.random.Generator, joints: int | None = None) -> WheeledRobot:
    """Return a random wheeled robot with ``joints`` arm joints (None: 0 to 6)."""
    return build(RandomSource(rng), joints)


def random_robot(rng: np.random.Generator, joints: int | None = None) -> str:
    """Return the URDF of :func:`generate`."""
    return generate(rng, joints).text
