"""A robot's parts as three.js objects: their meshes, their paint, and the ghost's veil."""

from __future__ import annotations

from collections.abc import Iterator

from rpctl.view.scene import wire
from rpctl.view.scene.bodies import Bodies, Part

GHOST_COLOUR = 0x3FA39A  # teal
GHOST_OPACITY = 0.3
IN_FRONT = 1  # stencil of the robot's pixels: the ghost leaves them alone
REPLACE, NOT_EQUAL = 7681, 517  # three.js: ReplaceStencilOp, NotEqualStencilFunc


def geometries(bodies: Bodies) -> list[wire.Json]:
    """Return each mesh once, however many parts show it."""
    return [
        wire.geometry(
            f"mesh-{number}",
            {
                "position": wire.attribute(surface.vertices),
                "normal": wire.attribute(surface.normals, normalized=True),
            },
            surface.faces,
        )
        for number, surface in enumerate(bodies.surfaces)
    ]


def materials(bodies: Bodies) -> list[wire.Json]:
    """Return one material a colour, and the ghost's two."""
    paints = [_paint(_uuid(rgba), rgba) for rgba in dict.fromkeys(p.rgba for p in bodies.parts)]
    return [*paints, _veil(), _tint()]


def solid(bodies: Bodies, joint: int) -> list[wire.Json]:
    """Return the parts of a joint, each with a fixed matrix, mirrored or scaled as it may be."""
    return [
        wire.node("Mesh", f"part-{k}", material=_uuid(part.rgba), castShadow=True, **shape)
        for k, part, shape in _shapes(bodies, joint)
    ]


def ghost(bodies: Bodies, joint: int) -> list[wire.Json]:
    """Return the parts of a joint as a ghost: first their depth, then one tint over all."""
    shapes = list(_shapes(bodies, joint))
    veils = [
        wire.node("Mesh", f"veil-{k}", material="veil", renderOrder=4, **shape)
        for k, _, shape in shapes
    ]
    return veils + [
        wire.node("Mesh", f"tint-{k}", material="tint", renderOrder=5, **shape)
        for k, _, shape in shapes
    ]


def _shapes(bodies: Bodies, joint: int) -> Iterator[tuple[int, Part, wire.Json]]:
    for k, part in enumerate(bodies.parts):
        if part.joint == joint:
            yield k, part, {"geometry": f"mesh-{part.surface}", **wire.fixed(part.pose)}


def _uuid(rgba: tuple[float, ...]) -> str:
    return "paint-" + "-".join(f"{part:g}" for part in rgba)


def _paint(uuid: str, rgba: tuple[float, ...]) -> wire.Json:
    return {
        "uuid": uuid,
        "type": "MeshPhongMaterial",
        "color": wire.colour(rgba),
        "specular": 0x1C1C1C,
        "shininess": 24,
        "side": 2,
        "opacity": rgba[3],
        "transparent": rgba[3] < 1.0,
        "stencilWrite": True,
        "stencilRef": IN_FRONT,
        "stencilZPass": REPLACE,
    }


def _veil() -> wire.Json:
    """Return a material that only fills the depth: of the ghost, the nearest face is drawn."""
    return {"uuid": "veil", "type": "MeshBasicMaterial", "colorWrite": False, **_behind()}


def _tint() -> wire.Json:
    return {
        "uuid": "tint",
        "type": "MeshLambertMaterial",
        "color": GHOST_COLOUR,
        "emissive": 0x202428,
        "opacity": GHOST_OPACITY,
        "depthWrite": False,
        **_behind(),
    }


def _behind() -> wire.Json:
    """Return what keeps the ghost behind the robot, so that it never tints it, wherever it is."""
    stencil = {"stencilWrite": True, "stencilRef": IN_FRONT, "stencilFunc": NOT_EQUAL}
    return {"transparent": True, "side": 2, **stencil}
