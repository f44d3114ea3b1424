"""How large a wheel is: the shapes that turn with its joint, and which of them rolls."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.meshes.paths import MeshError, MeshPaths
from rpctl.description.meshes.reading import read_shape
from rpctl.description.records import Joint, Shape

SHAPE_ROLES = ("collision", "visual")  # simulators roll on the collision, so it comes first
MAX_ECCENTRICITY = 0.1  # of its radius; a tyre on a link of its own is no further off the axle
RADIUS_ROUNDING_M = 1e-9  # m: cylinders of radii nearer than this are one wheel's two tyres
MIN_EXTENT_RATIO = 0.8  # of a wheel's extents across its axle; a tread's lugs make it 0.95
MIN_ROLLERS = 3  # endless joints on one wheel that are its rollers


class WheelShape(NamedTuple):
    """A shape that turns with a wheel's joint."""

    shape: Shape  # its origin is in the frame of the joint's child link
    role: str  # one of SHAPE_ROLES
    own: bool  # of that link itself, not of one fixed to it


class WheelSize(NamedTuple):
    """Size of a wheel from its shapes. Without a radius, ``source`` says why no mesh gave one."""

    radius: float | None  # m
    source: str
    offset: float  # of its centre from the joint's origin along the axle, m
    uneven: str = ""  # the two extents of its mesh across the axle, if they differ too much
    unread: str = ""  # a mesh of the same kind that cannot be read, and why
    aside: float = 0.0  # distance of its middle from the axle, m
    width: float = 0.0  # along the axle, m; of a sphere 0


def wheel_parts(tree: FrozenTree, joint: Joint) -> list[WheelShape]:
    """Return the shapes of a joint's child link and of the links fixed to it, collision first.

    A joint that is locked holds as a fixed one does.
    """
    links = [(tree.description.link[name], pose) for name, pose in tree.rigid_links(joint.child)]
    return [
        WheelShape(replace(shape, origin=pose @ shape.origin), role, link.name == joint.child)
        for role in SHAPE_ROLES
        for link, pose in links
        for shape in (link.collisions if role == "collision" else link.visuals)
    ]


def round_parts(tree: FrozenTree, joint: Joint) -> list[WheelShape]:
    """Return the parts of a wheel that are round about its axle, collision before visual.

    Spheres are, and cylinders and capsules along the axle; those of another link than the joint's
    own have to be centred on the axle, too, as motors and weights beside it are not.
    """
    return [part for part in wheel_parts(tree, joint) if is_round(part, joint.axis)]


def wheel_size(tree: FrozenTree, joint: Joint) -> WheelSize:
    """Return the size of a wheel, from its widest round shape or its widest mesh.

    Radius and offset come from the first of these kinds that there is: round collision shapes,
    round visual ones, collision meshes, visual meshes. The widest of a kind is the tyre; if there
    are several of its radius, the wheel's centre is in the middle between them.
    """
    reasons: list[str] = []
    sizes = (size for _, size in shape_sizes(tree, joint, reasons))
    size = _rollers_size(tree, joint) or next(sizes, None)
    return size or WheelSize(None, reasons[-1] if reasons else "", 0.0)


def _rollers_size(tree: FrozenTree, joint: Joint) -> WheelSize | None:
    """Return the size from a wheel's locked rollers: how far they reach, about their middle."""
    reaches, places = [], []
    links = dict(tree.rigid_links(joint.child))
    for roller in rollers_of(tree, joint):
        shapes = [each.shape for each in round_parts(tree, roller)]
        if roller.child in links and shapes:
            centre = (links[roller.child] @ shapes[0].origin)[:3, 3]
            reaches.append(_distance(centre, joint.axis) + max(s.size[0] for s in shapes))
            places.append(float(centre @ joint.axis))
    return WheelSize(max(reaches), "its rollers", float(np.mean(places))) if reaches else None


def shape_sizes(
    tree: FrozenTree, joint: Joint, reasons: list[str] | None = None
) -> Iterator[tuple[str, WheelSize]]:
    """Yield the size from each kind of shape, with its role: round shapes first, then meshes.

    Args:
        reasons: Where to add why meshes cannot be read.
    """
    parts, paths = wheel_parts(tree, joint), tree.description.mesh_paths
    for role in SHAPE_ROLES:
        shapes = [each.shape for each in parts if each.role == role and is_round(each, joint.axis)]
        if shapes:
            yield role, _widest([_round_size(shape, joint.axis, role) for shape in shapes])
    for role in SHAPE_ROLES:
        sizes, unread = [], []
        for part in parts:
            if part.role == role and part.shape.kind == "mesh":
                try:
                    size = _bounds(part.shape, joint.axis, role, paths)
                except MeshError as error:
                    unread.append(f'mesh "{part.shape.mesh}" {error}')
                else:
                    near = part.own or size.aside <= MAX_ECCENTRICITY * (size.radius or 0.0)
                    sizes += [size] * near
        if sizes:
            yield role, _widest(sizes)._replace(unread="".join(unread[:1]))
        if reasons is not None:
            reasons += unread


def is_round(part: WheelShape, axis: Array) -> bool:
    """Return whether a part is round about an axle (3,) through the frame's origin.

    The sine between a cylinder and the axle may be MAX_TILT_SINE. A part of another link than the
    joint's own may be MAX_ECCENTRICITY of its radius off the axle.
    """
    shape, centre = part.shape, part.shape.origin[:3, 3]
    if shape.kind not in ("sphere", "cylinder", "capsule") or not shape.size[0] > 0.0:
        return False
    tilt = 0.0 if shape.kind == "sphere" else _distance(shape.origin[:3, 2], axis)
    near = part.own or _distance(centre, axis) <= MAX_ECCENTRICITY * shape.size[0]
    return tilt <= MAX_TILT_SINE and near


def _distance(point: Array, axis: Array) -> float:
    """Return the distance of a point (3,) from the line through the origin along an axis (3,)."""
    return float(np.linalg.norm(np.cross(point, axis)))


def _round_size(shape: Shape, axis: Array, role: str) -> WheelSize:
    """Return the size of a round shape about an axle (3,) through the frame's origin."""
    middle = shape.origin[:3, 3]
    return WheelSize(
        radius=shape.size[0],
        source=f"{role} {shape.kind}, line {shape.line}",
        offset=float(middle @ axis),
        aside=_distance(middle, axis),
        width=0.0 if shape.kind == "sphere" else shape.size[1],
    )


def _widest(found: list[WheelSize]) -> WheelSize:
    """Return the widest of some sizes; of several so wide, with their middle's offset."""
    widest = max(found, key=lambda size: size.radius or 0.0)
    reach = widest.radius or 0.0
    tyres = [size.offset for size in found if reach - (size.radius or 0.0) <= RADIUS_ROUNDING_M]
    return widest._replace(offset=float(np.mean(tyres)))


def _bounds(shape: Shape, axis: Array, role: str, paths: MeshPaths) -> WheelSize:
    """Return the size of a mesh about an axle (3,) through the frame's origin.

    Its radius is its reach, which a tread's lugs do not tilt.
    """
    surfaces = read_shape(str(shape.mesh), shape.size, paths).surfaces
    points = np.concatenate([surface.vertices for surface in surfaces]) * shape.size
    points = points @ shape.origin[:3, :3].T + shape.origin[:3, 3]
    along = points @ axis
    first = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    first /= np.linalg.norm(first)
    across = points @ np.column_stack([first, np.cross(axis, first)])
    narrow, wide = sorted(np.ptp(across, axis=0).tolist())
    return WheelSize(
        radius=0.5 * wide,
        source=f"bounds of the {role} mesh, line {shape.line}",
        offset=0.5 * float(along.min() + along.max()),
        uneven=f"{narrow:.3g} m by {wide:.3g} m" if narrow < MIN_EXTENT_RATIO * wide else "",
        aside=math.hypot(*(0.5 * (across.min(axis=0) + across.max(axis=0)))),
        width=float(np.ptp(along)),
    )


def rollers_of(tree: FrozenTree, wheel: Joint) -> tuple[Joint, ...]:
    """Return the rollers on a wheel that hold still or turn freely; none, if too few."""
    below = (tree.description.child_joints[link] for link, _ in tree.rigid_links(wheel.child))
    rollers = tuple(joint for joints in below for joint in joints if joint.endless)
    return rollers if len(rollers) >= MIN_ROLLERS else ()
