"""A robot's shapes, placed on its moving joints and ready to be drawn."""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import PurePath

import numpy as np

from rpctl.arrays import Array
from rpctl.description.meshes.jobs import ShadedMesh, shade, simplify
from rpctl.description.meshes.paths import MeshError
from rpctl.description.meshes.reading import Surface
from rpctl.description.meshes.service import ask
from rpctl.description.records import Shape
from rpctl.libraries import library
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.simulation.run.run import Run
from rpctl.view.palette import light, number_of, rgb
from rpctl.view.scene import stand_ins, threejs
from rpctl.view.scene.stage import corners_of
from rpctl.view.scene.stand_ins import (
    MeshCache,
    PlacedSurface,
    StandIn,
    place_shape,
    sticks,
    surface_of,
)

MAX_TRIANGLES = 45_000  # of a whole robot: it stays recognisable, and its report small
MIN_MESH_TRIANGLES = 300  # triangles that even the smallest mesh keeps
DEFAULT_RGBA = (0.74, 0.77, 0.81, 1.0)  # where neither the URDF nor the mesh gives a colour
THINNEST = 0.01  # of a box's longest edge: a thinner one would have no volume
FARTHEST = 10.0  # of a mesh's reach: collapsed edges may leave its box
NOTHING_LEFT = "no triangles remain after simplification"
MARKER_RGBA = (0.45, 0.52, 0.62, 1.0)
DEFAULT_LENGTH_M = 0.5  # m; of a wedge where no contact tells how large the robot is
HEIGHT_RATIO = 0.2  # of the wedge's length
OUTLINE = ((0.6, 0.0), (-0.4, 0.3), (-0.4, -0.3))  # from above, forward along x, of length 1
TRIANGLES = ((0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5))


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A surface that moves with a joint.

    Attributes:
        joint: Index of the joint in the Pinocchio model; 1 is the planar root.
        pose: Matrix (4, 4) from the mesh's coordinates to the joint's frame, scale included.
        surface: Which of ``Bodies.surfaces`` is drawn.
        rgba: Colour, each in [0, 1].
        stands_in: Whether it is hatched, as it stands in for a mesh that is missing.
    """

    joint: int
    pose: Array
    surface: int
    rgba: tuple[float, ...]
    stands_in: bool = False


@dataclass(frozen=True, eq=False)
class Bodies:
    """All that is drawn of a robot.

    Attributes:
        parts: In the order of the URDF.
        surfaces: Each mesh once, however many parts show it.
        notes: Shapes that were left out, why, and what stands in for them.
        stand_ins: The links whose meshes are missing.
        size: Of the robot, m: the hatches are in proportion.
    """

    parts: tuple[BodyPart, ...]
    surfaces: tuple[ShadedMesh, ...]
    notes: tuple[str, ...]
    stand_ins: tuple[StandIn, ...] = ()
    size: float = 1.0


def build_bodies(robot: Robot, triangles: int = MAX_TRIANGLES) -> Bodies:
    """Return what is drawn of a robot.

    The visual shapes are drawn; for a robot without any, the collision shapes. Where a mesh is
    missing, something hatched stands in for it (:mod:`rpctl.view.scene.stand_ins`); where no
    shape is known at all, sticks from joint to joint are drawn.

    Args:
        robot: The robot.
        triangles: About how many the robot may have; large meshes are simplified first.
    """
    links = robot.description.links
    visual = any(link.visuals for link in links)
    cache: MeshCache = {}
    skipped: dict[str, list[tuple[str, str]]] = {}
    placed_surfaces: list[PlacedSurface] = []
    found: list[StandIn] = []
    size = stand_ins.robot_size(robot)
    for link in links:
        whole = True
        for shape in link.visuals if visual else link.collisions:
            try:
                placed_surfaces.extend(place_shape(robot, link, shape, cache))
            except MeshError as error:  # noqa: PERF203 - one bad mesh must not cost the others
                skipped.setdefault(str(error), []).append((_label(shape), link.name))
                whole = False
        if not whole:
            instead, surfaces_instead = stand_ins.stand_in(robot, link, size, cache)
            found.append(instead)
            placed_surfaces += surfaces_instead
    notes = [_note(reason, where) for reason, where in skipped.items()]
    said = [(name, remark) for (name, _), mesh in cache.items() for remark in mesh.remarks]
    notes += [f'mesh "{_file_label(name)}": {remark}' for name, remark in dict.fromkeys(said)]
    if len(placed_surfaces) == sum(each.kind == "marker" for each in found):
        notes.append("rpctl cannot draw any shape of this robot: sticks represent its links")
        placed_surfaces, found = list(sticks(robot)), []
    elif found:
        notes.append(stand_ins.note(found))
    parts, surfaces, more = _shaded(placed_surfaces, triangles)
    return Bodies(parts, surfaces, (*notes, *more), tuple(found), size)


def _label(shape: Shape) -> str:
    """Return what a shape is called in a note."""
    return f"the {shape.kind}" if shape.mesh is None else f'mesh "{_file_label(shape.mesh)}"'


def _file_label(name: str) -> str:
    """Return a mesh's name in the URDF, of an absolute path its file name: reports are shared."""
    outside = PurePath(name).is_absolute() or name.startswith("file:")
    return PurePath(name).name if outside else name


def _note(reason: str, where: list[tuple[str, str]]) -> str:
    """Return the note on shapes that share a fault, from their names and links."""
    (mesh, link), more = where[0], len(where) - 1
    others = f" and {more} more are" if more else " is"
    return f'{mesh} of link "{link}"{others} not drawn: {reason}'


def _shaded(
    placed_surfaces: list[PlacedSurface], triangles: int
) -> tuple[tuple[BodyPart, ...], tuple[ShadedMesh, ...], tuple[str, ...]]:
    """Return the parts, their surfaces, simplified to a budget that each enters once, and notes."""
    found = [item.surface for item in placed_surfaces]
    digests = [sha256(each.faces.tobytes() + each.vertices.tobytes()).digest() for each in found]
    unique = dict(zip(digests, placed_surfaces, strict=True))  # two files may hold one mesh
    cap = _cap([len(item.surface.faces) for item in unique.values()], triangles)
    surfaces, notes = [], []
    for item in unique.values():
        mesh, fault = shade_surface(item.surface, cap, bool(item.mesh))
        surfaces.append(mesh)
        if fault:
            notes.append(f'mesh "{_file_label(item.mesh)}" is drawn as a box: {fault}')
    index = {digest: number for number, digest in enumerate(unique)}
    parts = tuple(
        BodyPart(item.joint, item.pose, index[digest], item.rgba or DEFAULT_RGBA, item.stands_in)
        for item, digest in zip(placed_surfaces, digests, strict=True)
    )
    return parts, tuple(surfaces), tuple(notes)


def _cap(counts: list[int], total: int) -> int:
    """Return the largest limit of triangles per mesh that keeps the sum within ``total``."""
    left, remaining = total, len(counts)
    for count in sorted(counts):
        if count * remaining > left:
            return max(MIN_MESH_TRIANGLES, left // remaining)
        left, remaining = left - count, remaining - 1
    return max(counts, default=MIN_MESH_TRIANGLES)


def bounding_corners(bodies: Bodies, joint: int) -> Array:
    """Return the corners (8, 3) of the box around a joint's parts in its frame, m; (0, 3): bare."""
    points = [np.empty((0, 3))]
    for part in (part for part in bodies.parts if part.joint == joint):
        points.append(bodies.surfaces[part.surface].vertices @ part.pose[:3, :3].T)
        points[-1] += part.pose[:3, 3]
    cloud = np.concatenate(points)
    return corners_of(cloud.min(axis=0), cloud.max(axis=0)) if len(cloud) else cloud


def shade_surface(surface: Surface, triangles: int, foreign: bool) -> tuple[ShadedMesh, str]:
    """Return a surface as it is drawn, and why it is its box instead, if it is.

    Args:
        surface: The triangles.
        triangles: About how many may be left.
        foreign: Whether a mesh file gives them: then the process that read it works on them.
    """
    if not foreign:
        return _shade(surface, triangles), ""
    try:
        shaded, fault = _shade_confined(surface, triangles), NOTHING_LEFT
    except MeshError as error:
        shaded, fault = None, str(error)
    if shaded is not None and len(shaded.faces):
        return shaded, ""
    return _shade(_box(surface), triangles), fault


def _shade(surface: Surface, triangles: int) -> ShadedMesh:
    return shade(*simplify(surface.vertices, surface.faces, triangles))


def _shade_confined(surface: Surface, triangles: int) -> ShadedMesh:
    """Return a surface as the confined process shades it.

    Raises:
        MeshError: It does not, or answers with what is no mesh.
    """
    arrays = [surface.vertices, surface.faces.astype("<u4")]
    answer = ask("shade", {"triangles": triangles}, arrays)[1]
    kinds = [(each.dtype, each.shape[1:]) for each in answer]
    if kinds != [(np.float32, (3,)), (np.int8, (3,)), (np.uint32, (3,))]:
        raise MeshError("its reader answered with no mesh")
    vertices, normals, faces = answer
    bound = float(np.abs(surface.vertices).max()) * FARTHEST
    inside = bool((np.abs(vertices) <= bound).all())
    if not inside or len(normals) != len(vertices) or (faces >= len(vertices)).any():
        raise MeshError("its reader answered with no mesh")
    return ShadedMesh(vertices, normals, faces)


def _box(surface: Surface) -> Surface:
    """Return the box around a surface."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    edges = np.maximum(high - low, THINNEST * (high - low).max())
    unit = float(edges.max())  # trimesh drops triangles that are tiny in its own unit
    box = surface_of(library("trimesh.creation").box(edges / unit), unit)
    return Surface(box.vertices + 0.5 * (low + high), box.faces, None)


def base_marker(run: Run, reason: str) -> Bodies:
    """Return a wedge on the ground, as long as the run's contacts lie apart.

    Args:
        run: The run.
        reason: Why its robot cannot be had.
    """
    drive = run.robot.drive
    points = np.array(run.ground.points).reshape(-1, 2)
    length = float(np.ptp(points, axis=0).max(initial=0.0)) or DEFAULT_LENGTH_M
    cos, sin = np.cos(drive.heading), np.sin(drive.heading)
    outline = np.array(OUTLINE) @ np.array([[cos, sin], [-sin, cos]])
    centre = points.mean(axis=0) if len(points) else np.zeros(2)
    heights = np.repeat([drive.ground, drive.ground + HEIGHT_RATIO * length], 3)
    corners = np.column_stack([np.tile(centre + length * outline, (2, 1)), heights])
    surface = shade(corners, np.array(TRIANGLES))
    part = BodyPart(ROOT_JOINT, np.eye(4), 0, MARKER_RGBA)
    note = f"rpctl cannot draw the robot; a wedge represents its base: {reason}"
    return Bodies((part,), (surface,), (note,), size=length)


GHOST_OPACITY = 0.3
ROBOT_STENCIL = 1  # stencil of the robot's pixels: the ghost leaves them alone
STAND_IN = "stand-in"  # names of the nodes that are hatched: stand-in-1, ...
REPLACE, NOT_EQUAL = 7681, 517  # three.js: ReplaceStencilOp, NotEqualStencilFunc
STRIPE_RATIO = 0.025  # of the robot's size: from one stripe to the next
DARK_RATIO = 0.3  # of the distance between two stripes: how wide a stripe is
TEXELS = 64  # of a stripe and the gap beside it
SMOOTH_TEXELS = 2.0  # of a stripe's edge
REPEAT, LINEAR = 1000, 1006  # three.js: RepeatWrapping, LinearFilter
RGBA_FORMAT, UNSIGNED_BYTES = 1023, 1009  # three.js: RGBAFormat, UnsignedByteType
BEHIND = {  # of the ghost, which stays behind the robot, so that it never tints the robot
    "transparent": True,
    "side": 2,
    "stencilWrite": True,
    "stencilRef": ROBOT_STENCIL,
    "stencilFunc": NOT_EQUAL,
}


@dataclass(frozen=True)
class JointNodes:
    """What moves with a joint: as it is, and as a ghost.

    A ghost is drawn twice, first its depth and then one tint, so that only its nearest face shows.
    """

    solid: list[threejs.Json] = field(default_factory=list)
    ghost: list[threejs.Json] = field(default_factory=list)


def robot_nodes(
    bodies: Bodies, prefix: str = "", opacity: float = GHOST_OPACITY
) -> dict[int, JointNodes]:
    """Return the parts of each joint, each with a fixed matrix, mirrored or scaled as it may be.

    Args:
        bodies: What is drawn of the robot.
        prefix: What the names of its nodes begin with.
        opacity: Of its ghost.
    """
    hatched = {part.surface for part in bodies.parts if part.stands_in}
    meshes = [_mesh(each, bodies.size * (k in hatched)) for k, each in enumerate(bodies.surfaces)]
    veil: threejs.Json = {"type": "MeshBasicMaterial", "colorWrite": False, **BEHIND}
    tint: threejs.Json = {
        "name": f"{prefix}tint",  # keeps it apart from others, as pages recolour each
        "type": "MeshLambertMaterial",
        "color": number_of("ghost"),
        "emissive": 0x202428,
        "opacity": opacity,
        "depthWrite": False,
        **BEHIND,
    }
    found = {part.joint: JointNodes() for part in bodies.parts}
    for k, part in enumerate(bodies.parts):
        nodes, mesh = found[part.joint], meshes[part.surface]
        name, paint = (STAND_IN, _hatch()) if part.stands_in else ("part", _paint(part.rgba))
        looks: list[tuple[list[threejs.Json], str, threejs.Json]] = [
            (nodes.solid, name, {"material": paint, "castShadow": True}),
            (nodes.ghost, "veil", {"material": veil, "renderOrder": 4}),
            (nodes.ghost, "tint", {"material": tint, "renderOrder": 5}),
        ]
        for group, kind, look in looks:
            named = f"{prefix}{kind}-{k}"
            group.append(threejs.node("Mesh", named, part.pose, geometry=mesh, **look))
    return found


def _mesh(surface: ShadedMesh, hatch: float) -> threejs.Json:
    """Return the geometry of a surface.

    Args:
        surface: The triangles.
        hatch: Size of the robot to which its stripes are in proportion, m; 0: it has none.
    """
    attributes = {
        "position": threejs.attribute(surface.vertices),
        "normal": threejs.attribute(surface.normals, normalized=True),
    }
    if hatch:
        along = surface.vertices.sum(axis=1, dtype=float) / (np.sqrt(3.0) * STRIPE_RATIO * hatch)
        place = np.column_stack([along, np.zeros(len(along))])  # in the stripes
        attributes["uv"] = threejs.attribute(place.astype(np.float32))
    return threejs.geometry(attributes, surface.faces)


def _paint(rgba: tuple[float, ...]) -> threejs.Json:
    return {
        "type": "MeshPhongMaterial",
        "color": threejs.colour(rgba),
        "specular": 0x1C1C1C,
        "shininess": 24,
        "side": 2,
        "opacity": rgba[3],
        "transparent": rgba[3] < 1.0,
        "stencilWrite": True,
        "stencilRef": ROBOT_STENCIL,
        "stencilZPass": REPLACE,
    }


def _hatch() -> threejs.Json:
    """Return the material of what stands in: one stripe and the gap beside it, repeated."""
    place = np.arange(TEXELS) + 0.5
    edge = np.minimum(place, TEXELS - place) - 0.5 * (1.0 - DARK_RATIO) * TEXELS
    share = np.clip(0.5 + edge / SMOOTH_TEXELS, 0.0, 1.0)[:, None]
    ground, stripe = (np.array(rgb(light(name))) for name in ("hatch-back", "hatch"))
    colours = np.rint((1.0 - share) * ground + share * stripe)
    pixels = np.column_stack([colours, np.full(TEXELS, 255)]).astype(np.uint8)
    data = {"type": "Uint8Array", "data": threejs.typed(pixels), "width": TEXELS, "height": 1}
    texture = {
        "image": {"url": data},
        "wrap": [REPEAT, REPEAT],
        "minFilter": LINEAR,
        "magFilter": LINEAR,
        "format": RGBA_FORMAT,
        "type": UNSIGNED_BYTES,
    }
    return {**_paint((1.0, 1.0, 1.0, 1.0)), "map": texture}
