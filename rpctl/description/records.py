"""A URDF as immutable records: links, joints and shapes, with their lines in the file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from rpctl.arrays import Array
from rpctl.description.meshes.paths import MeshPaths
from rpctl.description.urdf.document import parse_document
from rpctl.description.urdf.findings import Findings
from rpctl.errors import Finding

Change = Callable[[Any], None]  # of the root element of a document, in place
MOVING_KINDS = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Shape:
    """A visual or collision shape.

    Attributes:
        kind: ``"box"``, ``"cylinder"``, ``"capsule"``, ``"sphere"`` or ``"mesh"``.
        size: Box edges (x, y, z); (radius, length) along z; (radius,); or mesh scale (x, y, z). m.
        origin: Pose in the link's frame (4, 4).
        mesh: The file as the URDF names it, for a mesh.
        rgba: Colour, each in [0, 1], or None where the file gives none.
        line: Line of the file.
    """

    kind: str
    size: tuple[float, ...]
    origin: Array
    mesh: str | None
    rgba: tuple[float, ...] | None
    line: int


@dataclass(frozen=True)
class Link:
    """A link: mass (kg), centre of mass (m) and inertia (kg·m²) in its own frame.

    ``mass`` is None where the file has no ``<inertial>``; ``inertia`` (3, 3) is about the centre
    of mass, with the axes of the link's frame. ``estimated`` means that they are not the file's
    but come from the shapes, at a density that the user gave.
    """

    name: str
    line: int
    mass: float | None
    com: Array
    inertia: Array
    visuals: tuple[Shape, ...]
    collisions: tuple[Shape, ...]
    estimated: bool = False

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Its shapes, those of collision first."""
        return self.collisions + self.visuals


@dataclass(frozen=True)
class Mimic:
    """``position = multiplier * position of joint + offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint: origin (4, 4) in the parent's frame, unit axis (3,) in its own.

    Limits are ±inf, effort (N·m or N) and velocity (rad/s or m/s) inf where the file gives none.
    An effort of 0 says that nothing drives the joint.
    """

    name: str
    line: int
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    lower: float
    upper: float
    effort: float
    velocity: float
    mimic: Mimic | None
    damping: float
    friction: float

    @property
    def moving(self) -> bool:
        """Whether the joint has a degree of freedom."""
        return self.kind in MOVING_KINDS

    @property
    def endless(self) -> bool:
        """Whether it turns without limits."""
        unlimited = self.kind == "revolute" and math.isinf(self.upper - self.lower)
        return self.kind == "continuous" or unlimited

    @property
    def nearest_to_zero(self) -> float:
        """The position nearest to 0 within its limits, rad or m."""
        return min(max(0.0, self.lower), self.upper) + 0.0

    def span(self, reach: float) -> tuple[float, float]:
        """Return the limits (rad or m), those that are infinite ``reach`` beyond 0 or the other."""
        low, high = self.lower, self.upper
        if math.isinf(low):
            low = min(-reach, high - reach)
        if math.isinf(high):
            high = max(reach, low + reach)
        return low, high

    def motion(self, position: float) -> Array:
        """Return the pose (4, 4) of the child frame in the parent's at ``position`` (rad or m)."""
        step = np.eye(4)
        if self.kind == "prismatic":
            step[:3, 3] = position * self.axis
        elif self.moving:
            step[:3, :3] = rotation(self.axis, position)
        return self.origin @ step


@dataclass(frozen=True)
class ReadSettings:
    """How the file of a robot is read.

    Attributes:
        package_dirs: Folders that the user declares: packages, or folders that hold packages.
        xacro_args: Values of the arguments (``<xacro:arg>``) of a .xacro, as texts, by name.
        ignore_missing_packages: Whether includes from packages that are not found are left out.
    """

    package_dirs: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    ignore_missing_packages: bool = False


READ_DEFAULTS = ReadSettings()


def as_xacro(value: object) -> str:
    """Return a value as xacro has it; its truth values are written small."""
    return str(value).lower() if isinstance(value, bool) else str(value)


@dataclass(frozen=True)
class Plugin:
    """A <plugin>: its file, its name, its line, and the texts of its elements by tag.

    Tags are in small letters and without ``_``.
    """

    file: str
    name: str
    line: int
    texts: Mapping[str, tuple[str, ...]]


@dataclass(frozen=True)
class Description:
    """A URDF: its links and joints in file order, and the findings about it.

    Attributes:
        path: The file.
        name: The robot's name.
        xml: The document as every engine downstream reads it: inertias and joints, no shapes.
        sha256: Digest of the URDF: of the file's bytes, or of the text that a .xacro became.
        root: Name of the root link.
        findings: Warnings and remarks (errors raise instead).
        read_with: How its file was read.
        expanded: Whether the file holds xacro and was expanded.
        raw: The file's bytes as the user wrote them, or the text that a .xacro became; the proof
            reads these, not ``xml``.
        urdf: The URDF of which ``sha256`` is the digest: ``raw`` before a payload was put on it.
        file_sha256: Digest of the file's bytes; None where no file was read.
        rotors: Inertia of the rotors that transmissions tell of, seen from their joints: I n² by
            the joint's name, kg·m² or kg.
        plugins: Plugins of simulators, wherever they stand.
        actuated: Joints with a transmission, or a command interface of ros2_control.
        sprung: Lines of the springs that the file gives joints, by the joint's name.
    """

    path: Path
    name: str
    xml: str = field(repr=False)
    sha256: str
    root: str
    links: tuple[Link, ...] = field(repr=False)
    joints: tuple[Joint, ...] = field(repr=False)
    findings: tuple[Finding, ...]
    read_with: ReadSettings = field(default_factory=ReadSettings)
    expanded: bool = False
    raw: bytes = field(default=b"", repr=False)
    urdf: bytes = field(default=b"", repr=False)
    file_sha256: str | None = None
    rotors: Mapping[str, float] = field(default_factory=dict, repr=False)
    plugins: tuple[Plugin, ...] = field(default=(), repr=False)
    actuated: frozenset[str] = field(default=frozenset(), repr=False)
    sprung: Mapping[str, int] = field(default_factory=dict, repr=False)

    @cached_property
    def link(self) -> dict[str, Link]:
        """Links by name."""
        return {link.name: link for link in self.links}

    @cached_property
    def joint(self) -> dict[str, Joint]:
        """Joints by name."""
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def parent_joint(self) -> dict[str, Joint]:
        """The joint above each link but the root, by the link's name."""
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def child_joints(self) -> dict[str, tuple[Joint, ...]]:
        """The joints below each link, in file order."""
        below: dict[str, list[Joint]] = {link.name: [] for link in self.links}
        for joint in self.joints:
            below[joint.parent].append(joint)
        return {name: tuple(joints) for name, joints in below.items()}

    @cached_property
    def mesh_paths(self) -> MeshPaths:
        """Finds the mesh files that the URDF names."""
        return MeshPaths(self.path, self.read_with.package_dirs)

    def document(self) -> Any:
        """Return a copy of the tree of ``raw``, each tag at its line, for whoever edits it."""
        return deepcopy(self._document)

    def edited(self, xml: Change | None, raw: Change | None, **records: Any) -> Description:
        """Return a description with other records, and its two texts changed likewise.

        Args:
            xml: Changes the document that engines read, in place; None leaves it.
            raw: Likewise the user's text, which the proof reads.
        """
        if xml is not None:
            root = etree.fromstring(self.xml)
            xml(root)
            records["xml"] = str(etree.tostring(root, encoding="unicode"))
        if raw is not None:
            root = self.document()
            raw(root)
            records["raw"] = bytes(etree.tostring(root))
        return replace(self, **records)

    @cached_property
    def _document(self) -> Any:
        return parse_document(self.raw, Findings())

    def __getstate__(self) -> Mapping[str, Any]:
        """Return what another process needs: lxml's tree cannot be sent, and is read again."""
        return {name: value for name, value in vars(self).items() if name != "_document"}

    @cached_property
    def mesh_lines(self) -> dict[str, int]:
        """The first line of each mesh that the URDF names, by its name there."""
        lines: dict[str, int] = {}
        for link in self.links:
            for shape in (*link.visuals, *link.collisions):
                if shape.mesh is not None:
                    lines.setdefault(shape.mesh, shape.line)
        return lines

    @property
    def estimated_links(self) -> tuple[str, ...]:
        """Names of the links whose mass and inertia are estimates."""
        return tuple(link.name for link in self.links if link.estimated)

    def chain(self, link: str) -> tuple[Joint, ...]:
        """Return the joints from the root down to ``link``."""
        joints: list[Joint] = []
        while link in self.parent_joint:
            joints.append(self.parent_joint[link])
            link = joints[-1].parent
        return tuple(reversed(joints))

    def below(self, joint: Joint) -> list[Joint]:
        """Return a joint and all that it carries, in the order of the tree."""
        joints, stack = [], [joint]
        while stack:
            joints.append(stack.pop())
            stack += reversed(self.child_joints[joints[-1].child])
        return joints


def rotation(axis: Array, angle: float) -> Array:
    """Return the rotation matrix (3, 3) about a unit axis by ``angle`` (rad), after Rodrigues."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew


def rotation_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation matrix (3, 3) of URDF's angles.

    Args:
        roll: About the fixed x axis, first, rad.
        pitch: About the fixed y axis, second, rad.
        yaw: About the fixed z axis, last, rad.
    """
    ex, ey, ez = np.eye(3)
    return rotation(ez, yaw) @ rotation(ey, pitch) @ rotation(ex, roll)
