"""A robot's parts as three.js objects: meshes, materials, and the ghost's depth-only pass."""

from __future__ import annotations

from collections.abc import Iterator

from rpctl.view.scene import threejs
from rpctl.view.scene.robot_meshes import Bodies, BodyPart

GHOST_COLOUR = 0x3FA39A  # teal
GHOST_OPACITY = 0.3
ROBOT_STENCIL = 1  # stencil of the robot's pixels: the ghost leaves them alone
REPLACE, NOT_EQUAL = 7681, 517  # three.js: ReplaceStencilOp, NotEqualStencilFunc


def geometries(bodies: Bodies) -> list[threejs.Json]:
    """Return each mesh once, however many parts show it."""
    return [
        threejs.geometry(
            f"mesh-{number}",
            {
                "position": threejs.attribute(surface.vertices),
                "normal": threejs.attribute(surface.normals, normalized=True),
            },
            surface.faces,
        )
        for number, surface in enumerate(bodies.surfaces)
    ]


def materials(bodies: Bodies) -> list[threejs.Json]:
    """Return one material a colour, and the ghost's two."""
    paints = [_paint(_uuid(rgba), rgba) for rgba in dict.fromkeys(p.rgba for p in bodies.parts)]
    return [*paints, _veil(), _tint()]


def solid(bodies: Bodies, joint: int) -> list[threejs.Json]:
    """Return the parts of a joint, each with a fixed matrix, mirrored or scaled as it may be."""
    return [
        threejs.node("Mesh", f"part-{k}", material=_uuid(part.rgba), castShadow=True, **shape)
        for k, part, shape in _shapes(bodies, joint)
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
        "color": GHOST_COLOUR,
        "emissive": 0x202428,
        "opacity": GHOST_OPACITY,
        "depthWrite": False,
        **_behind(),
    }


def _behind() -> threejs.Json:
    """Return the entries that keep the ghost behind the robot, so that it never tints the robot."""
    stencil = {"stencilWrite": True, "stencilRef": ROBOT_STENCIL, "stencilFunc": NOT_EQUAL}
    return {"transparent": True, "side": 2, **stencil}
