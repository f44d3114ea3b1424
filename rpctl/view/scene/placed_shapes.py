"""A URDF's shapes as triangles, placed on the joints that move their links."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.description.mesh_files import Mesh, Surface, primitive, read_shape, require_extent
from rpctl.description.records import Link, Shape
from rpctl.libraries import library
from rpctl.robot.model import Robot

STICK_RGBA = (0.45, 0.52, 0.62, 1.0)

Key = tuple[object, ...]
MeshCache = dict[tuple[str, tuple[float, ...]], Mesh]  # by name and scale


@dataclass(frozen=True, eq=False)
class PlacedSurface:
    """A surface of a shape, as read.

    Attributes:
        joint: Index of the joint in the Pinocchio model that moves it.
        pose: Matrix (4, 4) from the surface's coordinates to the joint's frame, scale included.
        key: What tells surfaces apart.
        surface: The triangles.
        rgba: Colour, each in [0, 1]; None where neither the URDF nor the mesh gives one.
        stands_in: Whether it is drawn in the place of a mesh that is missing.
        foreign: Whether a mesh file gives its triangles.
    """

    joint: int
    pose: Array
    key: Key
    surface: Surface
    rgba: tuple[float, ...] | None
    stands_in: bool = False
    foreign: bool = False


def place_shape(
    robot: Robot, link: Link, shape: Shape, cache: MeshCache
) -> Iterator[PlacedSurface]:
    """Return the surfaces of a shape, placed on the joint that moves its link.

    Args:
        robot: The robot.
        link: The link of the shape.
        shape: The shape; one that is fully transparent has no surface.
        cache: Meshes that were read already; what is read is added.

    Raises:
        MeshError: Its mesh is missing, refused, or cannot be read; or it is of no sensible size.
    """
    if shape.rgba is not None and shape.rgba[3] <= 0.0:
        return
    joint, frame = link_frame(robot, link)
    pose = frame @ shape.origin
    if shape.mesh is None:
        surface = primitive(shape.kind, shape.size)
        require_extent([surface], pose, "")
        yield PlacedSurface(joint, pose, (shape.kind, shape.size), surface, shape.rgba)
        return
    read = (shape.mesh, shape.size)
    if read not in cache:
        cache[read] = read_shape(shape.mesh, shape.size, robot.description.mesh_paths)
    pose = pose @ np.diag([*shape.size, 1.0])
    require_extent(cache[read].surfaces, pose, "")
    for number, surface in enumerate(cache[read].surfaces):
        key, rgba = ("mesh", shape.mesh, number), shape.rgba or surface.rgba
        yield PlacedSurface(joint, pose, key, surface, rgba, foreign=True)


def link_frame(robot: Robot, link: Link) -> tuple[int, Array]:
    """Return the joint that moves a link, and the link's pose (4, 4) in that joint's frame."""
    frame = robot.model.frames[robot.model.getFrameId(link.name, pin.FrameType.BODY)]
    return frame.parentJoint, frame.placement.homogeneous


def surface_of(mesh: Any, unit: float = 1.0) -> Surface:
    """Return a mesh of trimesh, whose unit is ``unit`` m, as a surface without a colour."""
    return Surface(unit * np.asarray(mesh.vertices, float), np.asarray(mesh.faces), None)


def sticks(robot: Robot) -> Iterator[PlacedSurface]:
    """Return a ball at every link's origin and a stick from it to each joint below."""
    creation = library("trimesh.creation")

    below = robot.description.child_joints
    lengths = [float(np.linalg.norm(j.origin[:3, 3])) for j in robot.description.joints]
    thickness = 0.06 * max([0.3, *lengths])
    ball = surface_of(creation.icosphere(subdivisions=2, radius=thickness))
    for link in robot.description.links:
        joint, pose = link_frame(robot, link)
        yield PlacedSurface(joint, pose, ("ball",), ball, STICK_RGBA)
        for end in (below_joint.origin[:3, 3] for below_joint in below[link.name]):
            if np.linalg.norm(end) > thickness:
                stick = surface_of(creation.cylinder(0.5 * thickness, segment=[np.zeros(3), end]))
                yield PlacedSurface(joint, pose, ("stick", *end.tolist()), stick, STICK_RGBA)
