"""A URDF in MuJoCo as a user loads it: ``MjSpec.from_string``, a free joint, a plane, defaults.

What no user can avoid is done as users do it: meshes that MuJoCo cannot read become the convex
hulls that it would make of them, and what its compiler refuses is set as its message says.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from lxml import etree

from rpctl.description.meshes import reading as mesh_files
from rpctl.description.meshes.paths import MeshError
from rpctl.description.meshes.reading import Surface, convex_hull
from rpctl.description.records import Joint, Shape
from rpctl.engines.edited_urdf import urdf_inertial, urdf_numbers, urdf_origin
from rpctl.engines.engine import EngineFault
from rpctl.equivalence.contact.mujoco_body import mujoco_library
from rpctl.robot.model import Robot

PREFIX = "rpctl/"  # before the names of links: MuJoCo has a body called "world"
GROUND = "rpctl ground"
LEAST_MASS, LEAST_INERTIA = 1e-6, 1e-9  # boundmass and boundinertia, once MuJoCo asks for them


@dataclass(frozen=True, eq=False)
class UserLoad:
    """A robot in MuJoCo, as it is loaded and before it is compiled.

    Attributes:
        spec: The ``MjSpec``: root link free, ground there. Geoms of a link are named
            :func:`geom_name`, bodies :data:`PREFIX` + link; fixed links are fused when compiled.
        notes: What had to be done to the file, in sentences.
    """

    spec: Any
    notes: tuple[str, ...]


def load_as_user(robot: Robot) -> UserLoad:
    """Return a robot as MuJoCo takes its file.

    Args:
        robot: The robot: links, joints and shapes of its file; locked joints are fixed.

    Raises:
        EngineFault: MuJoCo cannot read it.
    """
    mujoco = mujoco_library()
    text, assets, notes = _urdf(robot)
    try:
        spec = mujoco.MjSpec.from_string(text, assets=assets)
    except ValueError as error:
        raise EngineFault(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    spec.option.gravity = robot.model.gravity.linear
    spec.body(PREFIX + robot.description.root).add_freejoint()
    kind = mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(name=GROUND, type=kind, size=[0.0, 0.0, 1.0])
    return UserLoad(spec, notes)


def compiled(spec: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the ``MjModel`` of a spec, and what MuJoCo's compiler had to be told.

    Raises:
        EngineFault: It refuses the robot all the same.
    """
    notes: tuple[str, ...] = ()
    refusal = _refusal(spec)
    while refusal:
        notes += (_told(spec, refusal),)
        refusal = _refusal(spec)
    return spec.compile(), notes


def _refusal(spec: Any) -> str:
    """Return why MuJoCo does not compile a spec, or nothing."""
    try:
        spec.compile()
    except ValueError as error:
        return " ".join(str(error).replace(PREFIX, "").split())
    return ""


def _told(spec: Any, reason: str) -> str:
    """Tell the compiler what its refusal asks for, and return that."""
    compiler = spec.compiler
    if "balanceinertia" in reason and not compiler.balanceinertia:
        compiler.balanceinertia = True
        return 'it refuses an inertia unless <compiler balanceinertia="true"/>'
    if "mjMINVAL" in reason and not compiler.boundmass:
        compiler.boundmass, compiler.boundinertia = LEAST_MASS, LEAST_INERTIA
        bounds = f'boundmass="{LEAST_MASS:g}" boundinertia="{LEAST_INERTIA:g}"'
        return f"it refuses links without mass unless <compiler {bounds}/>"
    if "positive eigenvalues" in reason and _made_ball(spec, reason):
        return f"it refuses the inertia of {_named(reason)}, which becomes a ball's of its trace"
    raise EngineFault(f"MuJoCo refuses it: {reason}")


def _named(reason: str) -> str:
    """Return the element that a message of MuJoCo's compiler names, or nothing."""
    return reason.partition("name '")[2].partition("'")[0]


def _made_ball(spec: Any, reason: str) -> bool:
    """Give the body that a message names the inertia of a ball; return whether it had another."""
    body = spec.body(PREFIX + _named(reason))
    if body is None or np.isnan(body.fullinertia).any():
        return False
    moment = max(abs(float(body.fullinertia[:3].sum())) / 3.0, LEAST_INERTIA)
    body.fullinertia, body.inertia = np.full(6, np.nan), np.full(3, moment)
    return True


def geom_name(link: str, index: int) -> str:
    """Return the name of the geom of a link's collision shape.

    Args:
        link: The link.
        index: Of the shape among the link's collisions.
    """
    return f"{PREFIX}{link}/{index}"


def _urdf(robot: Robot) -> tuple[str, Mapping[str, bytes], tuple[str, ...]]:
    """Return the file without what it draws, its meshes as files of hulls, and what was done."""
    root, lost = etree.Element("robot", name="robot"), []
    assets: dict[str, bytes] = {}
    for link in robot.description.links:
        element = etree.SubElement(root, "link", name=PREFIX + link.name)
        if link.mass is not None:
            element.append(urdf_inertial(link.mass, link.com, link.inertia))
        for k, shape in enumerate(link.collisions):
            if not _add_collision(element, robot, geom_name(link.name, k), shape, assets):
                lost.append(link.name)
    for joint in robot.description.joints:
        _add_joint(root, robot, joint)
    notes = [f"meshes of {', '.join(lost)} cannot be read, and are left out"] if lost else []
    return str(etree.tostring(root, encoding="unicode")), assets, tuple(notes)


def _add_collision(
    element: Any, robot: Robot, name: str, shape: Shape, assets: dict[str, bytes]
) -> bool:
    """Add a shape, and return whether it could be read."""
    geometry: dict[str, str]
    if shape.kind == "mesh":
        content = _hull_file(robot, shape)
        if content is None:
            return False
        file = f"mesh{len(assets)}.stl"
        assets[file], geometry = content, {"filename": file}
    elif shape.kind == "box":
        geometry = {"size": urdf_numbers(shape.size)}
    else:
        geometry = dict(zip(("radius", "length"), map(repr, shape.size), strict=False))
    collision = etree.SubElement(element, "collision", name=name)
    collision.append(urdf_origin(shape.origin))
    etree.SubElement(etree.SubElement(collision, "geometry"), shape.kind, geometry)
    return True


def _add_joint(root: Any, robot: Robot, joint: Joint) -> None:
    """Add a joint; a locked one is fixed where it is."""
    locked = joint.moving and joint.name in robot.locked
    moving = joint.moving and not locked
    kind = joint.kind if moving else "fixed"
    element = etree.SubElement(root, "joint", name=joint.name, type=kind)
    etree.SubElement(element, "parent", link=PREFIX + joint.parent)
    etree.SubElement(element, "child", link=PREFIX + joint.child)
    element.append(urdf_origin(joint.motion(robot.locked[joint.name]) if locked else joint.origin))
    if not moving:
        return
    etree.SubElement(element, "axis", xyz=urdf_numbers(joint.axis))
    etree.SubElement(
        element, "dynamics", damping=repr(joint.damping), friction=repr(joint.friction)
    )
    limits = {"lower": joint.lower, "upper": joint.upper}
    if kind != "continuous" and np.isfinite(list(limits.values())).all():
        etree.SubElement(element, "limit", {name: repr(v) for name, v in limits.items()})
    if joint.mimic is not None and joint.mimic.joint not in robot.locked:
        numbers = {"multiplier": joint.mimic.multiplier, "offset": joint.mimic.offset}
        words = {name: repr(v) for name, v in numbers.items()}
        etree.SubElement(element, "mimic", {"joint": joint.mimic.joint, **words})


def _hull_file(robot: Robot, shape: Shape) -> bytes | None:
    """Return the convex hull of a mesh as an STL file, or None where it cannot be read."""
    try:
        mesh = mesh_files.read_shape(str(shape.mesh), shape.size, robot.description.mesh_paths)
        return _stl(convex_hull(mesh.surfaces, shape.size))
    except MeshError:
        return None


def _stl(hull: Surface) -> bytes:
    """Return a hull as a binary STL file."""
    corners = hull.vertices[hull.faces]  # (k, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = ((corners.mean(axis=1) - hull.vertices.mean(axis=0)) * normals).sum(axis=1) > 0.0
    corners = np.where(outward[:, None, None], corners, corners[:, ::-1])
    rows = b"".join(struct.pack("<12fH", 0.0, 0.0, 0.0, *face.ravel(), 0) for face in corners)
    return b"\0" * 80 + struct.pack("<I", len(corners)) + rows
