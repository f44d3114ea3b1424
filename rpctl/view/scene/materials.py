"""A robot's parts as three.js objects: meshes, materials, and the ghost's depth-only pass.

What stands in for a missing mesh is hatched: stripes along planes x + y + z = c. The place of a
vertex in the stripes is linear in its coordinates, so that any triangles carry them, without
seams, and every face of a box shows diagonals.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rpctl.view.palette import light, number_of, rgb
from rpctl.view.scene import threejs
from rpctl.view.scene.robot_meshes import Bodies

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
    meshes = [_mesh(bodies, number, number in hatched) for number in range(len(bodies.surfaces))]
    veil, tint = _veil(), _tint(f"{prefix}tint", opacity)
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


def _mesh(bodies: Bodies, number: int, hatched: bool) -> threejs.Json:
    surface = bodies.surfaces[number]
    attributes = {
        "position": threejs.attribute(surface.vertices),
        "normal": threejs.attribute(surface.normals, normalized=True),
    }
    if hatched:
        attributes["uv"] = _stripes(surface.vertices, bodies.size)
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


def _veil() -> threejs.Json:
    """Return a material that writes depth only."""
    return {"type": "MeshBasicMaterial", "colorWrite": False, **BEHIND}


def _tint(name: str, opacity: float) -> threejs.Json:
    """Return a ghost's tint; its name keeps it apart from others, as pages recolour each."""
    return {
        "name": name,
        "type": "MeshLambertMaterial",
        "color": number_of("ghost"),
        "emissive": 0x202428,
        "opacity": opacity,
        "depthWrite": False,
        **BEHIND,
    }


def _stripes(vertices: NDArray[np.float32], size: float) -> threejs.Json:
    """Return the places of vertices in the stripes as a vertex attribute.

    Args:
        vertices: (n, 3), m.
        size: Of the robot, m.
    """
    along = vertices.sum(axis=1, dtype=float) / (np.sqrt(3.0) * STRIPE_RATIO * size)
    return threejs.attribute(np.column_stack([along, np.zeros(len(along))]).astype(np.float32))


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
