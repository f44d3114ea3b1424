"""A URDF's shapes as triangles on the joints that move them, and what stands in for meshes.

Of a link whose mesh is missing its collision shapes are drawn, or a box of its inertia.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.description.meshes.paths import MeshError
from rpctl.description.meshes.reading import Mesh, Surface, primitive, read_shape, require_extent
from rpctl.description.records import Link, Shape
from rpctl.errors import listed
from rpctl.libraries import library
from rpctl.robot.model import Robot

STICK_RGBA = (0.45, 0.52, 0.62, 1.0)

MeshCache = dict[tuple[str, tuple[float, ...]], Mesh]  # by name and scale
MIN_EDGE_RATIO = 0.02  # of the robot's size: a thinner box would not be seen
MAX_EDGE_RATIO = 1.2  # of the robot's size: no body is so large, its inertia is not in earnest
MARKER_RATIO = 0.03  # of the robot's size: radius of the marker of a link without inertia
MIN_SIZE_M = 0.05  # m: size of a robot that is a point
ALIGNED = 1e-3  # of the largest moment: products below it leave the axes as they are
NAMED_LINKS = 4  # in a note; more are counted

Kind = Literal["collision", "inertia", "scaled inertia", "marker"]
SENTENCES: dict[Kind, tuple[str, str]] = {  # for one link, and for several
    "collision": ("the collision shape of {}", "the collision shapes of {}"),
    "inertia": ("a box of the inertia of {}", "boxes of the inertias of {}"),
    "scaled inertia": (
        "a scaled-down box of the inertia of {}, which is too large for its mass",
        "scaled-down boxes of the inertias of {}, which are too large for their masses",
    ),
    "marker": (
        "a small marker for {}, which has neither collision shape nor inertia",
        "small markers for {}, which have neither collision shapes nor inertias",
    ),
}


@dataclass(frozen=True, eq=False)
class PlacedSurface:
    """A surface of a shape, as read.

    Attributes:
        joint: Index of the joint in the Pinocchio model that moves it.
        pose: Matrix (4, 4) from the surface's coordinates to the joint's frame, scale included.
        surface: The triangles.
        rgba: Colour, each in [0, 1]; None where neither the URDF nor the mesh gives one.
        stands_in: Whether it is drawn in the place of a mesh that is missing.
        mesh: Name of the mesh file that gives its triangles; empty where none does.
    """

    joint: int
    pose: Array
    surface: Surface
    rgba: tuple[float, ...] | None = None
    stands_in: bool = False
    mesh: str = ""


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
        yield PlacedSurface(joint, pose, surface, shape.rgba)
        return
    read = (shape.mesh, shape.size)
    if read not in cache:
        cache[read] = read_shape(shape.mesh, shape.size, robot.description.mesh_paths)
    pose = pose @ np.diag([*shape.size, 1.0])
    require_extent(cache[read].surfaces, pose, "")
    for surface in cache[read].surfaces:
        yield PlacedSurface(joint, pose, surface, shape.rgba or surface.rgba, mesh=shape.mesh)


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
        yield PlacedSurface(joint, pose, ball, STICK_RGBA)
        for end in (below_joint.origin[:3, 3] for below_joint in below[link.name]):
            if np.linalg.norm(end) > thickness:
                stick = surface_of(creation.cylinder(0.5 * thickness, segment=[np.zeros(3), end]))
                yield PlacedSurface(joint, pose, stick, STICK_RGBA)


@dataclass(frozen=True)
class StandIn:
    """That something else is drawn in the place of a link's mesh.

    Attributes:
        link: Name of the link.
        kind: What is drawn: its collision shapes, a box that has its mass and inertia (scaled
            down where no body of the robot could be as large), or a marker.
    """

    link: str
    kind: Kind


def stand_in(
    robot: Robot, link: Link, size: float, cache: MeshCache
) -> tuple[StandIn, list[PlacedSurface]]:
    """Return what is drawn of a link whose mesh is missing.

    Args:
        robot: The robot.
        link: The link.
        size: Of the robot, m (:func:`robot_size`).
        cache: Meshes that were read already, by name; what is read is added.
    """
    found = []
    for shape in link.collisions:
        try:
            found += [_metric(placed) for placed in place_shape(robot, link, shape, cache)]
        except MeshError:  # noqa: PERF203 - the collision's mesh is missing, too
            continue
    if found:
        return StandIn(link.name, "collision"), found
    joint, frame = link_frame(robot, link)
    if not link.mass or link.mass < 0.0:
        ball = library("trimesh.creation").icosphere(subdivisions=2, radius=MARKER_RATIO * size)
        marker = PlacedSurface(joint, frame, surface_of(ball), stands_in=True)
        return StandIn(link.name, "marker"), [marker]
    edges, axes = inertia_box(link.mass, link.inertia)
    scale = min(1.0, MAX_EDGE_RATIO * size / max(edges.max(), MIN_EDGE_RATIO * size))
    edges = np.maximum(scale * edges, MIN_EDGE_RATIO * size)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = axes, link.com
    unit = float(edges.max())  # trimesh drops triangles that are tiny in its own unit
    box = surface_of(library("trimesh.creation").box(edges / unit), unit)
    kind: Kind = "scaled inertia" if scale < 1.0 else "inertia"
    return StandIn(link.name, kind), [PlacedSurface(joint, frame @ pose, box, stands_in=True)]


def inertia_box(mass: float, inertia: Array) -> tuple[Array, Array]:
    """Return the box of even density that has a mass and an inertia.

    A box with edges (a, b, c) has the principal moments m (b² + c²) / 12 and so on; hence
    a² = 6 (I_b + I_c - I_a) / m. Where the moments break the triangle inequality, an edge is 0.

    Args:
        mass: kg, positive.
        inertia: About the centre of mass (3, 3), kg m².

    Returns:
        The edges (3,), m, and a rotation (3, 3) from the box's axes to those of the inertia.
    """
    moments, axes = np.diag(inertia), np.eye(3)
    if np.abs(inertia - np.diag(moments)).max() > ALIGNED * np.abs(moments).max():
        moments, axes = np.linalg.eigh(0.5 * (inertia + inertia.T))
        axes[:, 2] *= np.sign(np.linalg.det(axes))  # no mirror image
    return np.sqrt(np.maximum(6.0 * (moments.sum() - 2.0 * moments) / mass, 0.0)), axes


def robot_size(robot: Robot) -> float:
    """Return the size of a robot as its links' frames span it at its home, m."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration_at(np.zeros(3), robot.home))
    places = np.array([placement.translation for placement in data.oMf])
    return max(float(np.linalg.norm(np.ptp(places, axis=0))), MIN_SIZE_M)


def note(stand_ins: Iterable[StandIn], most: int = NAMED_LINKS) -> str:
    """Return what stands in for missing meshes as a sentence; empty where nothing does.

    Of each kind, ``most`` links are named; more are counted.
    """
    links: dict[Kind, list[str]] = {}
    for each in stand_ins:
        links.setdefault(each.kind, []).append(each.link)
    parts = [
        SENTENCES[kind][len(names) > 1].format(listed(names, most)) for kind, names in links.items()
    ]
    return f"hatched, in place of missing meshes: {'; '.join(parts)}" if parts else ""


def label(stand_ins: Iterable[StandIn]) -> str:
    """Return the badge of a scene's stand-ins."""
    count = len(set(stand_ins))
    return f"Mesh missing: {count} link{'s' if count > 1 else ''}, hatched"


def _metric(placed: PlacedSurface) -> PlacedSurface:
    """Return a surface as a stand-in, in metres, so that all hatches are equally wide."""
    scale = np.linalg.norm(placed.pose[:3, :3], axis=0)
    surface = Surface(placed.surface.vertices * scale, placed.surface.faces, None)
    pose = placed.pose @ np.diag([*(1.0 / scale), 1.0])
    return replace(placed, pose=pose, surface=surface, rgba=None, stands_in=True)
