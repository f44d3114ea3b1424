"""A robot's parts as three.js objects: meshes, materials, and the ghost's depth-only pass.

What stands in for a missing mesh is hatched: stripes along planes x + y + z = c. The place of a
vertex in the stripes is linear in its coordinates, so that any triangles carry them, without
seams, and every face of a box shows diagonals.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rpctl.view.palette import light, number_of, rgb
from rpctl.view.scene import threejs
from rpctl.view.scene.robot_meshes import Bodies, BodyPart

GHOST_OPACITY = 0.3
ROBOT_STENCIL = 1  # stencil of the robot's pixels: the ghost leaves them alone
STAND_IN = "stand-in"  # names of the nodes that are hatched: stand-in-1, ...
REPLACE, NOT_EQUAL = 7681, 517  # three.js: ReplaceStencilOp, NotEqualStencilFunc
HATCH = "hatch"
STRIPE_RATIO = 0.025  # of the robot's size: from one stripe to the next
DARK_RATIO = 0.3  # of the distance between two stripes: how wide a stripe is
TEXELS = 64  # of a stripe and the gap beside it
SMOOTH_TEXELS = 2.0  # of a stripe's edge
REPEAT, LINEAR = 1000, 1006  # three.js: RepeatWrapping, LinearFilter
RGBA_FORMAT, UNSIGNED_BYTES = 1023, 1009  # three.js: RGBAFormat, UnsignedByteType


def geometries(bodies: Bodies) -> list[threejs.Json]:
    """Return each mesh once, however many parts show it."""
    hatched = {part.surface for part in bodies.parts if part.stands_in}
    found = []
    for number, surface in enumerate(bodies.surfaces):
        attributes = {
            "position": threejs.attribute(surface.vertices),
            "normal": threejs.attribute(surface.normals, normalized=True),
        }
        if number in hatched:
            attributes["uv"] = _stripes(surface.vertices, bodies.size)
        found.append(threejs.geometry(f"mesh-{number}", attributes, surface.faces))
    return found


def materials(bodies: Bodies) -> list[threejs.Json]:
    """Return one material a colour, the hatched one where it is needed, and the ghost's two."""
    colours = dict.fromkeys(part.rgba for part in bodies.parts if not part.stands_in)
    paints = [_paint(_uuid(rgba), rgba) for rgba in colours]
    if bodies.stand_ins:
        paints.append({**_paint(HATCH, (1.0, 1.0, 1.0, 1.0)), "map": HATCH})
    return [*paints, _veil(), _tint()]


def images(bodies: Bodies) -> dict[str, list[threejs.Json]]:
    """Return the textures and images of the materials, as ``threejs.set_object`` takes them."""
    if not bodies.stand_ins:
        return {}
    return {"textures": [_stripe_texture()], "images": [_stripe_image()]}


def solid(bodies: Bodies, joint: int) -> list[threejs.Json]:
    """Return the parts of a joint, each with a fixed matrix, mirrored or scaled as it may be."""
    return [
        threejs.node("Mesh", f"{name}-{k}", material=paint, castShadow=True, **shape)
        for k, part, shape in _shapes(bodies, joint)
        for name, paint in [(STAND_IN, HATCH) if part.stands_in else ("part", _uuid(part.rgba))]
    ]


def ghost(bodies: Bodies, joint: int) -> list[threejs.Json]:
    """Return the parts of a joint as a ghost: first their depth, then one tint over all."""
    shapes = list(_shapes(bodies, joint))
    veils = [
        threejs.node("Mesh", f"veil-{k}", material="veil", renderOrder=4, **shape)
        for k, _, shape in shapes
    ]
    return veils + [
        threejs.node("Mesh", f"tint-{k}", material="tint", renderOrder=5, **shape)
        for k, _, shape in shapes
    ]


def _shapes(bodies: Bodies, joint: int) -> Iterator[tuple[int, BodyPart, threejs.Json]]:
    for k, part in enumerate(bodies.parts):
        if part.joint == joint:
            yield k, part, {"geometry": f"mesh-{part.surface}", **threejs.fixed_matrix(part.pose)}


def _uuid(rgba: tuple[float, ...]) -> str:
    return "paint-" + "-".join(f"{part:g}" for part in rgba)


def _paint(uuid: str, rgba: tuple[float, ...]) -> threejs.Json:
    return {
        "uuid": uuid,
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
    """Return a material that writes depth only, so that only the ghost's nearest face is drawn."""
    return {"uuid": "veil", "type": "MeshBasicMaterial", "colorWrite": False, **_behind()}


def _tint() -> threejs.Json:
    return {
        "uuid": "tint",
        "type": "MeshLambertMaterial",
        "color": number_of("ghost"),
        "emissive": 0x202428,
        "opacity": GHOST_OPACITY,
        "depthWrite": False,
        **_behind(),
    }


def _behind() -> threejs.Json:
    """Return the entries that keep the ghost behind the robot, so that it never tints the robot."""
    stencil = {"stencilWrite": True, "stencilRef": ROBOT_STENCIL, "stencilFunc": NOT_EQUAL}
    return {"transparent": True, "side": 2, **stencil}


def _stripes(vertices: NDArray[np.float32], size: float) -> threejs.Json:
    """Return the places of vertices in the stripes as a vertex attribute.

    Args:
        vertices: (n, 3), m.
        size: Of the robot, m.
    """
    along = vertices.sum(axis=1, dtype=float) / (np.sqrt(3.0) * STRIPE_RATIO * size)
    return threejs.attribute(np.column_stack([along, np.zeros(len(along))]).astype(np.float32))


def _stripe_image() -> threejs.Json:
    """Return one stripe and the gap beside it as pixels: no file that would be loaded later."""
    place = np.arange(TEXELS) + 0.5
    edge = np.minimum(place, TEXELS - place) - 0.5 * (1.0 - DARK_RATIO) * TEXELS
    share = np.clip(0.5 + edge / SMOOTH_TEXELS, 0.0, 1.0)[:, None]
    ground, stripe = (np.array(rgb(light(name))) for name in ("hatch-back", "hatch"))
    colours = np.rint((1.0 - share) * ground + share * stripe)
    pixels = np.column_stack([colours, np.full(TEXELS, 255)]).astype(np.uint8)
    data = {"type": "Uint8Array", "data": threejs.typed(pixels), "width": TEXELS, "height": 1}
    return {"uuid": HATCH, "url": data}


def _stripe_texture() -> threejs.Json:
    """Return the stripes as a texture, which is repeated."""
    return {
        "uuid": HATCH,
        "image": HATCH,
        "wrap": [REPEAT, REPEAT],
        "minFilter": LINEAR,
        "magFilter": LINEAR,
        "format": RGBA_FORMAT,
        "type": UNSIGNED_BYTES,
    }
