"""A URDF in MuJoCo as a user loads it: ``MjSpec.from_string``, a free joint, a plane, defaults.

What every user must change is changed: convex hulls replace meshes that MuJoCo cannot read, and
settings without which its compiler refuses the model are set as its message says.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from lxml import etree

from rpctl.description.density import inertial_element
from rpctl.description.meshes import reading as mesh_files
from rpctl.description.meshes.reading import Surface, convex_hull
from rpctl.engines.edited_urdf import Dialect, edit_urdf
from rpctl.engines.engine import ALL_DEFAULT, EngineFault
from rpctl.equivalence.contact.mujoco_body import mujoco_library
from rpctl.robot.model import Robot

PREFIX = "rpctl/"  # before the names of links: MuJoCo has a body called "world"
GROUND = "rpctl ground"
DIALECT = Dialect("MuJoCo", meshes=(), crowned="")
LEAST_MASS, LEAST_INERTIA = 1e-6, 1e-9  # boundmass and boundinertia, if MuJoCo asks for them


def load_as_user(robot: Robot) -> tuple[Any, tuple[str, ...]]:
    """Return the ``MjSpec`` of a robot as MuJoCo reads its file, and sentences on what was changed.

    A free joint and a ground are added. Bodies are named :data:`PREFIX` + link, geoms
    :data:`PREFIX` + :func:`rpctl.engines.edited_urdf.collision_name`; the compiler fuses fixed
    links.

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
    spec.worldbody.add_geom(name=GROUND, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    return spec, notes


def compiled(spec: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the ``MjModel`` of a spec, and sentences on the settings that its compiler needed.

    Raises:
        EngineFault: MuJoCo refuses the robot nevertheless.
    """
    try:
        return spec.compile(), ()
    except ValueError as error:
        told = _told(spec, " ".join(str(error).replace(PREFIX, "").split()))
    model, notes = compiled(spec)
    return model, (told, *notes)


def _told(spec: Any, reason: str) -> str:
    """Set the compiler's option that its refusal asks for; return a sentence on it."""
    compiler = spec.compiler
    if "balanceinertia" in reason and not compiler.balanceinertia:
        compiler.balanceinertia = True
        return 'it refuses an inertia unless <compiler balanceinertia="true"/>'
    if "mjMINVAL" in reason and not compiler.boundmass:
        compiler.boundmass, compiler.boundinertia = LEAST_MASS, LEAST_INERTIA
        bounds = f'boundmass="{LEAST_MASS:g}" boundinertia="{LEAST_INERTIA:g}"'
        return f"it refuses links without mass unless <compiler {bounds}/>"
    if "positive eigenvalues" in reason and _made_ball(spec, reason):
        return f"it refuses the inertia of {_named(reason)}; that of a ball with its trace is used"
    raise EngineFault(f"MuJoCo rejects it: {reason}")


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


def _urdf(robot: Robot) -> tuple[str, Mapping[str, bytes], tuple[str, ...]]:
    """Return the URDF without visuals, the hulls of its meshes as files, and sentences on changes.

    A missing axis is set to URDF's default (1, 0, 0): MuJoCo has another default.
    """
    assets: dict[str, bytes] = {}

    def hull_file(mesh: Any) -> str:
        scale = tuple(map(float, mesh.attrib.pop("scale", "1 1 1").split()))
        paths, name = robot.description.mesh_paths, f"mesh{len(assets)}.stl"
        read = mesh_files.read_shape(mesh.get("filename"), scale, paths)
        assets[name] = _stl(convex_hull(read.surfaces, scale))
        return name

    root, notes = edit_urdf(robot, ALL_DEFAULT, DIALECT, hull_file)
    for element in [each for each in root if each.tag not in ("link", "joint")]:
        root.remove(element)
    for link in robot.description.estimated_links:
        (element,) = root.xpath("./link[@name=$name]", name=link)
        element.append(inertial_element(robot.description.link[link]))
    for element in root.xpath("./link | ./link/collision"):
        element.set("name", PREFIX + element.get("name"))
    for joint in root.findall("joint"):
        for end in ("parent", "child"):
            joint.find(end).set("link", PREFIX + joint.find(end).get("link"))
        if joint.find("axis") is None:
            etree.SubElement(joint, "axis", xyz="1 0 0")
    return str(etree.tostring(root, encoding="unicode")), assets, notes


def _stl(hull: Surface) -> bytes:
    """Return a hull as a binary STL file."""
    corners = hull.vertices[hull.faces]  # (k, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = ((corners.mean(axis=1) - hull.vertices.mean(axis=0)) * normals).sum(axis=1) > 0.0
    corners = np.where(outward[:, None, None], corners, corners[:, ::-1])
    rows = b"".join(struct.pack("<12fH", 0.0, 0.0, 0.0, *face.ravel(), 0) for face in corners)
    return b"\0" * 80 + struct.pack("<I", len(corners)) + rows
