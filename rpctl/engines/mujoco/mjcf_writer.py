"""A robot's ``MjSpec`` as MJCF: all digits of each number, no defaults.

MuJoCo's writer rounds to six digits, which changes the robot. The number of digits is a setting of
its library that its Python module does not offer; here MuJoCo writes enough digits to restore each
double, and superfluous digits are then removed. An export reads its file back, which reveals a
MuJoCo that rounds nevertheless.
"""

from __future__ import annotations

import ctypes
import hashlib
import re
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from lxml import etree

from rpctl.arrays import Array
from rpctl.description.meshes.paths import MeshError
from rpctl.description.meshes.reading import Surface, read_shape
from rpctl.description.records import Shape
from rpctl.engines.mujoco.bodies import body_name
from rpctl.equivalence.contact.model import geom_size
from rpctl.equivalence.contact.mujoco_body import mujoco_library, quaternion
from rpctl.robot.model import Robot

DIGITS = 17  # enough to restore each double
LONG_NUMBER = re.compile(r"-?\d+\.\d{9,}(e[+-]?\d+)?")
WRITTEN_LAST = ("sensor", "keyframe", "custom")  # sections that follow the model's own


def numbers(values: Iterable[float]) -> str:
    """Return numbers as the text of an attribute, with the fewest digits that restore each."""
    return " ".join(_number(value) for value in values)


def write_model(
    spec: Any, drawn: dict[str, list[Any]], sections: dict[str, list[Any]], comment: str
) -> Any:
    """Return the root element of the MJCF of a compiled spec.

    Args:
        spec: ``MjSpec``.
        drawn: Visual shapes, lights and cameras, by the name of their body.
        sections: Further elements by section: ``"asset"``, ``"sensor"``, ``"custom"`` …
        comment: The comment at the top.
    """
    root = etree.fromstring(_xml(spec))
    root.insert(0, etree.Comment(comment))
    for motor in root.iter("general"):  # MuJoCo calls them so
        motor.tag = "motor"
    bodies = {body.get("name"): body for body in root.iter("body")}
    bodies["world"] = world = root.find("worldbody")
    for name, parts in drawn.items():
        bodies[name].extend(deepcopy(parts))
    for name, parts in sections.items():
        if parts:
            section = etree.Element(name)
            section.extend(deepcopy(parts))
            root.insert(len(root) if name in WRITTEN_LAST else root.index(world), section)
    return root


def to_bytes(root: Any) -> bytes:
    """Return a document as the bytes of a file."""
    etree.indent(root)
    return bytes(etree.tostring(root, encoding="utf-8", xml_declaration=False)) + b"\n"


def _xml(spec: Any) -> str:
    """Return a spec as MuJoCo writes it, with all significant digits."""
    native = ctypes.CDLL(mujoco_library()._functions.__file__)
    usual = native._mjPRIVATE__get_xml_precision()
    native._mjPRIVATE__set_xml_precision(DIGITS)
    try:
        return LONG_NUMBER.sub(lambda found: _number(found[0]), spec.to_xml())
    finally:
        native._mjPRIVATE__set_xml_precision(usual)


def _number(value: Any) -> str:
    """Return a number with the fewest digits that restore it."""
    number = float(value)
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


DRAWN_GROUP = "1"  # that a viewer shows
COLOUR = (0.74, 0.77, 0.81, 1.0)  # where neither the URDF nor the mesh gives one
MAX_TRIANGLES = 1_000_000  # per robot: further meshes are left out
NOTHING = {"contype": "0", "conaffinity": "0", "group": DRAWN_GROUP}


@dataclass(frozen=True)
class Drawn:
    """The visual shapes of a robot.

    Attributes:
        parts: Geoms, by the name of their body.
        assets: The elements of their meshes.
        files: Contents of the mesh files, by name.
        notes: Sentences on what was left out, with reasons.
    """

    parts: dict[str, list[Any]]
    assets: list[Any]
    files: dict[str, bytes]
    notes: tuple[str, ...]


def draw(robot: Robot, meshes: bool) -> Drawn:
    """Return the visual shapes of a robot, or its collision shapes if it has no visual ones."""
    links = robot.description.links
    visual = any(link.visuals for link in links)
    drawing = _Drawing(robot, meshes)
    heads = [robot.description.root]
    heads += [robot.description.joint[name].child for name in robot.moving_joint_names]
    for head in heads:
        for name, pose in robot.tree.rigid_links(head):
            link = robot.description.link[name]
            for number, shape in enumerate(link.visuals if visual else link.collisions):
                drawing.add(head, f"{name}_visual_{number}", pose @ shape.origin, shape)
    return drawing.drawn()


class _Drawing:
    """Collects geoms and meshes."""

    def __init__(self, robot: Robot, meshes: bool) -> None:
        self._robot, self._meshes = robot, meshes
        self._parts: dict[str, list[Any]] = {}
        self._assets: dict[str, Any] = {}
        self._files: dict[str, bytes] = {}
        self._faults: dict[str, list[str]] = {}
        self._triangles = 0

    def add(self, head: str, name: str, pose: Array, shape: Shape) -> None:
        """Add a shape of a link, placed in the body of its head."""
        if shape.rgba is not None and shape.rgba[3] <= 0.0:
            return
        if shape.mesh is None:
            kept = {"sphere": 1, "box": 3}.get(shape.kind, 2)
            size = numbers(geom_size(shape)[:kept])
            self._place(head, name, pose, shape.rgba, type=shape.kind, size=size)
        elif self._meshes:
            try:
                self._add_mesh(head, name, pose, shape)
            except MeshError as fault:
                self._faults.setdefault(str(fault), []).append(name.rpartition("_visual_")[0])

    def _add_mesh(self, head: str, name: str, pose: Array, shape: Shape) -> None:
        paths = self._robot.description.mesh_paths
        surfaces = read_shape(str(shape.mesh), shape.size, paths).surfaces
        for number, surface in enumerate(surfaces):
            data = _obj(surface, np.array(shape.size))
            asset = _asset_name(str(shape.mesh), data)
            if asset not in self._assets:
                self._triangles += len(surface.faces)
                if self._triangles > MAX_TRIANGLES:
                    raise MeshError(f"more than {MAX_TRIANGLES} triangles in total")
                file = f"{asset}.obj"
                self._assets[asset] = etree.Element(
                    "mesh", {"name": asset, "file": file, "inertia": "shell"}
                )
                self._files[file] = data
            each = name if len(surfaces) == 1 else f"{name}_{number}"
            self._place(head, each, pose, shape.rgba or surface.rgba, type="mesh", mesh=asset)

    def _place(
        self,
        head: str,
        name: str,
        pose: Array,
        rgba: tuple[float, ...] | None,
        **shape: str,
    ) -> None:
        attributes = {"name": name, **shape, **NOTHING, "rgba": numbers(rgba or COLOUR)}
        attributes |= {"pos": numbers(pose[:3, 3]), "quat": numbers(quaternion(pose))}
        self._parts.setdefault(body_name(head), []).append(etree.Element("geom", attributes))

    def drawn(self) -> Drawn:
        """Return the collected shapes."""
        notes = [
            f"meshes of {', '.join(dict.fromkeys(links))} are not drawn: {fault}"
            for fault, links in self._faults.items()
        ]
        return Drawn(self._parts, list(self._assets.values()), self._files, tuple(notes))


def _obj(surface: Surface, scale: Array) -> bytes:
    """Return a surface at its scale (3,) as the bytes of an OBJ file."""
    vertices = surface.vertices * scale
    faces = surface.faces[:, ::-1] if np.prod(scale) < 0.0 else surface.faces  # mirrored
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


def _asset_name(mesh: str, data: bytes) -> str:
    """Return a name that depends on a mesh's content, so that equal names mean equal files."""
    stem = re.sub(r"[^\w-]", "_", PurePath(mesh).stem)[:40] or "mesh"
    return f"{stem}-{hashlib.sha256(data).hexdigest()[:10]}"
