"""The user's file as the proof reads it: its bytes, by few rules, and nothing of ``description``.

The strict reader gives every other room its numbers, so a fault of it would reach them all. This
one shares no line with it: names, numbers, frames and shapes, in the order of the file. Its records
have the attribute names of yourdfpy's, so that either can be walked.
"""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from lxml import etree

from rpctl.arrays import Array

MARKS = (  # the longer before the shorter that it begins with
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (codecs.BOM_UTF8, "utf-8-sig"),
)
DECLARATION = re.compile(r"\s*<\?xml.*?\?>", re.DOTALL)
TURNING = ("revolute", "continuous")
SHAPES = ("box", "cylinder", "capsule", "sphere", "mesh")


@dataclass(frozen=True)
class RawShape:
    """A shape: ``role`` is its tag, ``size`` its numbers in the file's order, m."""

    role: str
    kind: str
    size: tuple[float, ...]
    origin: Array  # (4, 4) in the link's frame
    mesh: str


@dataclass(frozen=True)
class RawInertial:
    """An <inertial>: mass (kg), frame (4, 4) in the link's, inertia (3, 3) in it (kg·m²)."""

    mass: float
    origin: Array
    inertia: Array


@dataclass(frozen=True)
class RawLink:
    """A link."""

    name: str
    inertial: RawInertial | None
    shapes: tuple[RawShape, ...]


@dataclass(frozen=True)
class RawMimic:
    """What a joint follows, and how many times its rate."""

    joint: str
    multiplier: float


@dataclass(frozen=True)
class RawJoint:
    """A joint: its frame (4, 4) in the parent's, its unit axis (3,) in its own."""

    name: str
    type: str
    parent: str
    child: str
    origin: Array
    axis: Array
    mimic: RawMimic | None
    damping: float = 0.0  # N·m·s/rad or N·s/m
    friction: float = 0.0  # N·m or N

    def motion(self, position: complex) -> Array:
        """Return the pose (4, 4) of the child in the parent at a position (rad or m)."""
        if self.type == "prismatic":
            step = np.eye(4, dtype=np.asarray(position).dtype)
            step[:3, 3] = position * self.axis
        elif self.type in TURNING:
            along, across, skew = self._turning
            step = along + np.cos(position) * across + np.sin(position) * skew
        else:
            return self.origin
        return self.origin @ step

    @cached_property
    def _turning(self) -> tuple[Array, Array, Array]:
        """What stays of a turn (4, 4), what its cosine multiplies, and what its sine."""
        (x, y, z), along = self.axis, np.eye(4)
        along[:3, :3] = np.outer(self.axis, self.axis)
        skew = np.zeros((4, 4))
        skew[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
        return along, np.eye(4) - along, skew


@dataclass(frozen=True)
class RawFile:
    """Links and joints in file order."""

    links: tuple[RawLink, ...]
    joints: tuple[RawJoint, ...]
    rotors: Mapping[str, float] = field(default_factory=dict)  # I n² by joint, kg·m² or kg

    @cached_property
    def link(self) -> dict[str, RawLink]:
        """Links by name."""
        return {link.name: link for link in self.links}

    @cached_property
    def joint(self) -> dict[str, RawJoint]:
        """Joints by name."""
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def root(self) -> str:
        """The link that no joint carries."""
        (root,) = self.link.keys() - {joint.child for joint in self.joints}
        return root

    @cached_property
    def below(self) -> dict[str, tuple[RawJoint, ...]]:
        """The joints that each link carries."""
        found: dict[str, list[RawJoint]] = {link.name: [] for link in self.links}
        for joint in self.joints:
            found[joint.parent].append(joint)
        return {name: tuple(joints) for name, joints in found.items()}

    @cached_property
    def above(self) -> dict[str, RawJoint]:
        """The joint that carries each link but the root."""
        return {joint.child: joint for joint in self.joints}

    def chain(self, link: str) -> tuple[RawJoint, ...]:
        """Return the joints from the root link to a link."""
        joints: list[RawJoint] = []
        while link in self.above:
            joints.append(self.above[link])
            link = joints[-1].parent
        return tuple(reversed(joints))

    def moving(self, locked: Collection[str]) -> list[RawJoint]:
        """Return the joints that move, but for those that are locked."""
        return [j for j in self.joints if j.type != "fixed" and j.name not in locked]

    def poses(
        self, positions: Mapping[str, Any], start: str | None = None, rigid: bool = False
    ) -> dict[str, Array]:
        """Return the poses (4, 4) of a link (None: the root) and those below it, in its frame.

        Args:
            positions: Of joints, rad or m; others are at 0.
            rigid: Whether only links that do not move on it count: joints with a position are
                locked there.
        """
        found = {start or self.root: np.eye(4)}
        stack = list(found)
        while stack:
            link = stack.pop()
            for joint in self.below[link]:
                if rigid and joint.type != "fixed" and joint.name not in positions:
                    continue
                found[joint.child] = found[link] @ joint.motion(positions.get(joint.name, 0.0))
                stack.append(joint.child)
        return found


def document(data: bytes) -> Any:
    """Return the root element of a file's bytes, names without namespaces."""
    text = DECLARATION.sub("", _text(data), count=1)
    parser = etree.XMLParser(
        recover=True, resolve_entities=False, no_network=True, remove_comments=True,
        remove_pis=True, huge_tree=True,
    )  # fmt: skip
    root = etree.fromstring(text.strip().encode("utf-8"), parser)
    own = etree.QName(root).namespace
    for element in [] if own is None else root.iter(f"{{{own}}}*"):
        element.tag = etree.QName(element).localname
    return root


@lru_cache(maxsize=4)
def read_file(data: bytes) -> RawFile:
    """Return the links and joints in a file's bytes."""
    root = document(data)
    links = tuple(_link(element) for element in root.findall("link"))
    joints = tuple(_joint(element) for element in root.findall("joint"))
    return RawFile(links, joints, _rotors(root))


def _text(data: bytes) -> str:
    """Return bytes as text: by their mark, as UTF-8, or as Latin-1.

    The parser knows wide characters without a mark by the zeros among the first.
    """
    for mark, codec in MARKS:
        if data.startswith(mark):
            return data.decode(codec)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _link(element: Any) -> RawLink:
    shapes = tuple(
        shape
        for role in ("collision", "visual")
        for each in element.findall(role)
        if (shape := _shape(each, role)) is not None
    )
    inertial = element.find("inertial")
    return RawLink(element.get("name"), None if inertial is None else _inertial(inertial), shapes)


def _inertial(element: Any) -> RawInertial:
    moments = element.find("inertia")
    xx, xy, xz, yy, yz, zz = (
        float(moments.get(f"i{axes}", "0")) for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
    )
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return RawInertial(float(element.find("mass").get("value", "0")), _origin(element), inertia)


def _shape(element: Any, role: str) -> RawShape | None:
    """Return a <visual> or <collision>, or None where no shape can be read in it."""
    geometry = element.find("geometry")
    solid = None if geometry is None else next((each for each in geometry), None)
    if solid is None or solid.tag not in SHAPES:
        return None
    keys = {"box": ("size",), "sphere": ("radius",), "mesh": ("scale",)}
    texts = [solid.get(key, "") for key in keys.get(solid.tag, ("radius", "length"))]
    try:
        size = tuple(float(word) for word in " ".join(texts).split())
    except ValueError:
        return None
    if solid.tag == "mesh":
        size = size if len(size) == 3 else (1.0, 1.0, 1.0)
    if not size:
        return None
    return RawShape(role, solid.tag, size, _origin(element), solid.get("filename", ""))


def _joint(element: Any) -> RawJoint:
    axis, mimic = element.find("axis"), element.find("mimic")
    direction = _numbers(None if axis is None else axis.get("xyz"), "1 0 0")
    length = float(np.linalg.norm(direction))
    followed = None
    if mimic is not None:
        followed = RawMimic(mimic.get("joint"), float(mimic.get("multiplier", "1")))
    dynamics = element.find("dynamics")
    damping, friction = (
        0.0 if dynamics is None else max(0.0, float(dynamics.get(key) or 0.0))
        for key in ("damping", "friction")
    )
    return RawJoint(
        name=element.get("name"),
        type=element.get("type"),
        parent=element.find("parent").get("link"),
        child=element.find("child").get("link"),
        origin=_origin(element),
        axis=direction / (length or 1.0),
        mimic=followed,
        damping=damping,
        friction=friction,
    )


def _rotors(root: Any) -> dict[str, float]:
    """Return what the transmissions of one joint say of its rotors: Σ I n²."""
    found: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joints = [joint.get("name") for joint in transmission.findall("joint")]
        for actuator in transmission.findall("actuator"):
            said: dict[str, str] = {}
            for each in actuator:
                word = str(each.tag).replace("}", ":").split(":")[-1]
                said.setdefault(word, each.get("value") or each.text or "")
            if "rotor_inertia" in said and len(joints) == 1:
                ratio = float(said.get("gear_ratio", said.get("mechanicalReduction", "1")))
                inertia = max(0.0, float(said["rotor_inertia"])) * ratio**2
                found[joints[0]] = found.get(joints[0], 0.0) + inertia
    return found


def _origin(element: Any) -> Array:
    """Return the pose (4, 4) of an element's <origin>; the identity without one."""
    origin, pose = element.find("origin"), np.eye(4)
    if origin is None:
        return pose
    roll, pitch, yaw = _numbers(origin.get("rpy"), "0 0 0")
    pose[:3, :3] = _about(2, yaw) @ _about(1, pitch) @ _about(0, roll)
    pose[:3, 3] = _numbers(origin.get("xyz"), "0 0 0")
    return pose


def _about(axis: int, angle: float) -> Array:
    """Return the rotation (3, 3) about a coordinate axis (0, 1, 2) by an angle (rad)."""
    turn, (i, j) = np.eye(3), ((axis + 1) % 3, (axis + 2) % 3)
    turn[i, i] = turn[j, j] = math.cos(angle)
    turn[j, i] = math.sin(angle)
    turn[i, j] = -turn[j, i]
    return turn


def _numbers(text: str | None, default: str) -> Array:
    return np.array([float(word) for word in (text or default).split()])
