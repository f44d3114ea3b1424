"""The URDF that an engine reads: the user's, except for locked joints and mended switches.

Lengths m, masses kg, inertias kg·m².
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin
from lxml import etree

from rpctl.arrays import Array
from rpctl.description.density import inertial_element
from rpctl.description.meshes.paths import MeshError
from rpctl.description.records import Shape
from rpctl.dynamics.stance import find_supports
from rpctl.engines.engine import Mended
from rpctl.equivalence.contact.model import support_shapes, tyre
from rpctl.errors import listed
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot

SIZES = {"box": ("size",), "sphere": ("radius",)}  # attributes of a shape; others have these two:
ROUND_SIZES = ("radius", "length")
SUPPORTS_HOLD = (
    "its supports drag on the ground with friction"  # what Drake and PyBullet let them do
)


@dataclass(frozen=True)
class Dialect:
    """What an engine's URDF reader can read.

    Attributes:
        name: The engine.
        meshes: Suffixes of the mesh files that it reads as collision shapes.
        crowned: XML of the shape of a crowned tyre, with fields ``radius`` and ``half_width`` (m).
        proximity: XML of a collision without friction, or empty.
        massless: XML of the inertial of a link that has none.
        strict_transmissions: Whether it refuses a transmission without an actuator.
    """

    name: str
    meshes: tuple[str, ...]
    crowned: str
    proximity: str = ""
    massless: str = ""
    strict_transmissions: bool = False


def edit_urdf(
    robot: Robot,
    mended: Mended,
    dialect: Dialect,
    mesh_file: Callable[[Any], str] | None = None,
) -> tuple[Any, tuple[str, ...]]:
    """Return the root element of a robot's URDF for an engine, and notes.

    Locked joints become fixed ones. Visuals and transmissions are removed (efforts act on joints),
    and so are meshes that are not found or that the engine refuses; the notes name these. Each
    collision is named after its link and its number there. Everything else stays as it is.

    Args:
        robot: The robot.
        mended: The mended switches.
        dialect: The engine's dialect.
        mesh_file: Returns the file of a <mesh>, or raises a MeshError; None: the user's file, if
            the engine reads its kind.
    """

    def own_file(mesh: Any) -> str:
        path = robot.description.mesh_paths.resolve(str(mesh.get("filename")))
        if path.suffix.lower() not in dialect.meshes:
            raise MeshError(f"{dialect.name} does not read {path.suffix} files as collision shapes")
        return str(path)

    root = robot.description.document()
    notes: list[str] = []
    for element in root.xpath("./link/visual"):
        element.getparent().remove(element)
    for link in root.findall("link"):
        for number, element in enumerate(link.findall("collision")):
            element.set("name", collision_name(link.get("name"), number))
    for element in root.findall("transmission"):
        root.remove(element)
        if dialect.strict_transmissions and element.find("actuator") is None:
            notes.append(f"{dialect.name} refuses files with a transmission without <actuator>")
    _lock(root, robot)
    links = {element.get("name"): element for element in root.findall("link")}
    treads = [tyre(robot, wheel) for wheel in robot.drive.wheels]
    if "collisions" in mended:
        for element in _others(root, robot):
            element.getparent().remove(element)
    if "caster" in mended:
        _put_supports(links, robot, dialect)
    if "wheel" in mended:
        for wheel, tread in zip(robot.drive.wheels, treads, strict=True):
            for name, _ in robot.tree.rigid_links(robot.description.joint[wheel.joint].child):
                for element in links[name].findall("collision"):
                    links[name].remove(element)
            crowned = dialect.crowned.format(radius=tread.radius, half_width=tread.half_width)
            links[tread.link].append(_collision(crowned, tread.pose))
            notes += [tread.note] if tread.note else []
    if "inertia" in mended:
        _put_inertias(links, robot, dialect)
    notes += _resolve_meshes(root, mesh_file or own_file)
    return root, tuple(dict.fromkeys(notes))


def collision_name(link: str, number: int) -> str:
    """Return the name of a link's collision shape, given its index in the link."""
    return f"{link}/{number}"


def edged_wheels(robot: Robot) -> bool:
    """Whether the shape of a wheel is no sphere, so that it touches the ground along a line."""
    kinds = [kind for wheel in robot.drive.wheels for kind in drawn_kinds(robot, wheel.joint)]
    return set(kinds) != {"sphere"}


def drawn_kinds(robot: Robot, wheel: str) -> list[str]:
    """Return the kinds of the collision shapes that a wheel's joint carries."""
    links = links_below(robot, robot.description.joint[wheel].child)
    return [shape.kind for name in links for shape in robot.description.link[name].collisions]


def links_below(robot: Robot, link: str) -> Iterator[str]:
    """Yield a link and all that it carries."""
    yield link
    for joint in robot.description.child_joints[link]:
        yield from links_below(robot, joint.child)


def other_shapes(robot: Robot) -> bool:
    """Whether a link has a collision shape that is neither a wheel nor a support."""
    return bool(_others(robot.description.document(), robot))


def _lock(root: Any, robot: Robot) -> None:
    """Fix the joints that the robot's model does not move."""
    for element in root.findall("joint"):
        joint = robot.description.joint.get(element.get("name"))
        if joint is None or not joint.moving or joint.name in robot.entries:
            continue
        placement = joint.motion(robot.locked.get(joint.name, 0.0))
        for tag in ("axis", "limit", "mimic", "dynamics", "origin", "safety_controller"):
            for found in element.findall(tag):
                element.remove(found)
        element.set("type", "fixed")
        element.append(_origin(placement))


def _others(root: Any, robot: Robot) -> list[Any]:
    """Return the collision elements that are neither a wheel's nor a support."""
    wheels = {
        name
        for wheel in robot.drive.wheels
        for name, _ in robot.tree.rigid_links(robot.description.joint[wheel.joint].child)
    }
    supports = support_shapes(robot, find_supports(robot))
    lines = {(link, shape.line) for _, link, shape in supports}
    return [
        element
        for link in root.findall("link")
        if link.get("name") not in wheels
        for element in link.findall("collision")
        if (link.get("name"), element.find("geometry")[0].sourceline) not in lines
    ]


def _put_supports(links: dict[str, Any], robot: Robot, dialect: Dialect) -> None:
    """Remove the friction of supports; add collisions to those that have only visuals."""
    for _, link, shape in support_shapes(robot, find_supports(robot)):
        for element in links[link].findall("collision"):
            if element.find("geometry")[0].sourceline == shape.line:
                links[link].remove(element)
        made = _collision(_shape_xml(shape), shape.origin)
        if dialect.proximity:
            made.append(_drake_tags(dialect.proximity))
        links[link].append(made)


def _put_inertias(links: dict[str, Any], robot: Robot, dialect: Dialect) -> None:
    """Give each moving link the inertia of all links fixed to it, and the others none.

    A link with an unphysical inertia is often part of a physical rigid body.
    """
    carriers = {robot.description.root: ROOT_JOINT}
    for name in robot.entries:
        carriers[robot.description.joint[name].child] = robot.model.getJointId(name)
    for name, element in links.items():
        for found in element.findall("inertial"):
            element.remove(found)
        if name in carriers:
            body = robot.model.inertias[carriers[name]]
            own = {"mass": body.mass, "com": body.lever, "inertia": body.inertia}
            element.append(inertial_element(replace(robot.description.link[name], **own)))
        elif dialect.massless:
            element.append(etree.fromstring(dialect.massless))


def _resolve_meshes(root: Any, file: Callable[[Any], str]) -> list[str]:
    """Set the files of meshes; remove meshes that are not found or cannot be read."""
    refused: dict[str, list[str]] = {}
    for element in root.xpath("./link/collision[geometry/mesh]"):
        mesh = element.find("geometry/mesh")
        try:
            mesh.set("filename", file(mesh))
        except MeshError as error:
            refused.setdefault(str(error), []).append(element.getparent().get("name"))
            element.getparent().remove(element)
    return [
        f"{why}: left out of {listed(dict.fromkeys(names), 1)}" for why, names in refused.items()
    ]


def _collision(geometry: str, pose: Array) -> Any:
    element = etree.Element("collision")
    element.append(_origin(pose))
    element.append(_drake_tags(f"<geometry>{geometry}</geometry>"))
    return element


def _drake_tags(text: str) -> Any:
    """Return an element that declares the namespace of Drake's tags."""
    return etree.fromstring(f'<x xmlns:drake="http://drake.mit.edu">{text}</x>')[0]


def _origin(pose: Array) -> Any:
    """Return the <origin> element of a pose (4, 4)."""
    rpy = pin.rpy.matrixToRpy(np.ascontiguousarray(pose[:3, :3]))
    return etree.Element("origin", xyz=_numbers(pose[:3, 3]), rpy=_numbers(rpy))


def _shape_xml(shape: Shape) -> str:
    """Return the element of a shape that is not a mesh."""
    names = SIZES.get(shape.kind, ROUND_SIZES)
    values = (_numbers(shape.size),) if shape.kind == "box" else tuple(map(repr, shape.size))
    sizes = " ".join(f'{name}="{value}"' for name, value in zip(names, values, strict=True))
    return f"<{shape.kind} {sizes}/>"


def _numbers(numbers: Iterable[float]) -> str:
    """Return numbers as the text of an attribute, without rounding."""
    return " ".join(repr(float(number)) for number in numbers)
