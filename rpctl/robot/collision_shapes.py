"""The shapes of a robot that can collide: its URDF's, on the joints of the model that move them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.description.mesh_files import Surface, read_shape
from rpctl.description.mesh_hulls import Hull, convex_hull
from rpctl.description.mesh_paths import MeshError
from rpctl.description.mesh_service import start_hulls, start_reader
from rpctl.description.records import Shape
from rpctl.errors import listed
from rpctl.robot.boxes import mass_box
from rpctl.robot.model import Robot

WORLD = 0  # Pinocchio's index of what stands still
THINNEST_M = 1e-3  # m: edge of a box that stands in for a mesh
MOST_NEIGHBOURS = 250  # of a corner: coal takes 255
MOST_CORNERS = 250  # of a hull with a corner of more neighbours
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))  # rad: it spreads directions evenly over a sphere
NAMED = 4  # links in a note; more are counted


@dataclass(frozen=True, eq=False)
class CollisionShape:
    """A convex body that a joint moves, or that stands in the world.

    Attributes:
        link: The link's name; of what stands in the world what it is.
        joint: Index of the joint in the Pinocchio model; ``WORLD`` for what stands still.
        pose: Its pose (4, 4) in the joint's frame.
        geometry: The body as coal has it.
        centre: Centre (3,) of a ball about it, in the joint's frame, m.
        radius: Of that ball, m; inf for a half-space.
    """

    link: str
    joint: int
    pose: Array = field(repr=False)
    geometry: Any = field(repr=False)
    centre: Array = field(repr=False)
    radius: float


def read_collision_shapes(robot: Robot) -> tuple[tuple[CollisionShape, ...], tuple[str, ...]]:
    """Return the shapes of a robot and what there is to say of them.

    Boxes, cylinders, capsules and spheres are exact; of a mesh the convex hull is taken. For a
    mesh that is missing the box of its link's inertia stands in. A robot without any <collision>
    has its <visual> shapes taken.

    Args:
        robot: The robot; its meshes are read confined, as for the viewer.
    """
    links = robot.description.links
    drawn = not any(link.collisions for link in links)
    shapes_of = {link.name: link.visuals if drawn else link.collisions for link in links}
    if any(shape.mesh for shapes in shapes_of.values() for shape in shapes):
        start_hulls()
        start_reader()
    found: list[CollisionShape] = []
    faults: dict[str, list[str]] = {}
    for link in links:
        for shape in shapes_of[link.name]:
            try:
                found.append(_placed(robot, link.name, shape.origin, _geometry(robot, shape)))
            except MeshError as fault:  # noqa: PERF203 - one bad mesh must not cost the others
                faults.setdefault(str(fault), []).append(link.name)
        if any(link.name in names for names in faults.values()) and link.mass:
            pose, half = mass_box(robot.description, link.name)
            edges = np.maximum(2.0 * half, THINNEST_M)
            found.append(_placed(robot, link.name, pose, coal.Box(*edges.tolist())))
    notes = [
        f"the collision mesh of {_listed(names)} is not there ({fault}); "
        "a box of the link's inertia stands in"
        for fault, names in faults.items()
    ]
    if drawn and found:
        notes.append("the robot has no <collision>; its <visual> shapes are checked for collisions")
    return tuple(found), tuple(notes)


def standing(what: str, pose: Array, geometry: Any) -> CollisionShape:
    """Return a shape that stands in the world.

    Args:
        what: Its name.
        pose: In the world (4, 4), m.
        geometry: As coal has it.
    """
    return _shape(what, WORLD, pose, geometry)


def _placed(robot: Robot, link: str, origin: Array, geometry: Any) -> CollisionShape:
    """Return a shape that stands at ``origin`` (4, 4) in a link's frame."""
    frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
    pose = np.asarray(frame.placement.homogeneous @ origin)
    return _shape(link, int(frame.parentJoint), pose, geometry)


def _shape(name: str, joint: int, pose: Array, geometry: Any) -> CollisionShape:
    geometry.computeLocalAABB()
    centre = pose[:3, :3] @ geometry.aabb_center + pose[:3, 3]
    radius = float(geometry.aabb_radius)
    if isinstance(geometry, coal.Halfspace):
        centre, radius = np.zeros(3), np.inf
    for array in (pose, centre):
        array.setflags(write=False)
    return CollisionShape(name, joint, pose, geometry, centre, radius)


def _geometry(robot: Robot, shape: Shape) -> Any:
    """Return a shape as coal has it.

    Raises:
        MeshError: Its mesh is missing, refused, flat, or of no sensible size.
    """
    if shape.mesh is not None:
        mesh = read_shape(shape.mesh, shape.size, robot.description.mesh_paths)
        return _convex(*_hull(mesh.surfaces, shape.size))
    if shape.kind == "box":
        return coal.Box(*shape.size)
    if shape.kind == "sphere":
        return coal.Sphere(*shape.size)
    return {"cylinder": coal.Cylinder, "capsule": coal.Capsule}[shape.kind](*shape.size)


def _hull(surfaces: Sequence[Surface], scale: Sequence[float]) -> Hull:
    """Return the convex hull of the surfaces of a mesh, with as many corners as coal can take.

    coal counts the neighbours of a corner in eight bits, and a disc may have one corner that all
    triangles share. Then the corners farthest out along ``MOST_CORNERS`` directions stay: of a disc
    of radius r, all but 0.1 % of r.

    Args:
        surfaces: Of the mesh.
        scale: By which each axis is multiplied (3,).

    Raises:
        MeshError: It is flat, or there is no process to compute it.
    """
    hull = convex_hull(surfaces, scale)
    if np.bincount(hull.faces.ravel()).max() <= MOST_NEIGHBOURS:
        return hull
    heights = 1.0 - (2.0 * np.arange(MOST_CORNERS) + 1.0) / MOST_CORNERS
    turns, wide = GOLDEN_ANGLE * np.arange(MOST_CORNERS), np.sqrt(1.0 - heights**2)
    outward = np.array([wide * np.cos(turns), wide * np.sin(turns), heights])
    far = np.unique((hull.vertices @ outward).argmax(axis=0))
    return convex_hull([Surface(hull.vertices[far], hull.faces[:0], None)], (1.0, 1.0, 1.0))


def _convex(vertices: Array, faces: NDArray[np.int64]) -> Any:
    """Return a convex body of vertices (n, 3), m, and corners (k, 3)."""
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in vertices:
        points.append(vertex)
    for corners in faces.tolist():
        triangles.append(coal.Triangle(*corners))
    return coal.Convex(points, triangles)


def _listed(names: list[str]) -> str:
    """Return names in words, each once; more than ``NAMED`` are counted."""
    return listed(dict.fromkeys(names), NAMED)
