"""A robot's parts as three.js objects: meshes, materials, and the ghost's depth-only pass."""

from __future__ import annotations

from collections.abc import Iterator

from rpctl.view.scene import hatching, threejs
from rpctl.view.scene.robot_meshes import Bodies, BodyPart

GHOST_COLOUR = 0x3FA39A  # teal
GHOST_OPACITY = 0.3
ROBOT_STENCIL = 1  # stencil of the robot's pixels: the ghost leaves them alone
STAND_IN = "stand-in"  # names of the nodes that are hatched: stand-in-1, ...
REPLACE, NOT_EQUAL = 7681, 517  # three.js: ReplaceStencilOp, NotEqualStencilFunc


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
            attributes["uv"] = hatching.coordinates(surface.vertices, bodies.size)
        found.append(threejs.geometry(f"mesh-{number}", attributes, surface.faces))
    return found


def materials(bodies: Bodies) -> list[threejs.Json]:
    """Return one material a colour, the hatched one where it is needed, and the ghost's two."""
    colours = dict.fromkeys(part.rgba for part in bodies.parts if not part.stands_in)
    paints = [_paint(_uuid(rgba), rgba) for rgba in colours]
    if bodies.stand_ins:
        paints.append({**_paint(hatching.HATCH, (1.0, 1.0, 1.0, 1.0)), "map": hatching.HATCH})
    return [*paints, _veil(), _tint()]


def images(bodies: Bodies) -> dict[str, list[threejs.Json]]:
    """Return the textures and images of the materials, as ``threejs.set_object`` takes them."""
    if not bodies.stand_ins:
        return {}
    return {"textures": [hatching.texture()], "images": [hatching.image()]}


def solid(bodies: Bodies, joint: int) -> list[threejs.Json]:
    """Return the parts of a joint, each with a fixed matrix, mirrored or scaled as it may be."""
    return [
        threejs.node("Mesh", f"{name}-{k}", material=paint, castShadow=True, **shape)
        for k, part, shape in _shapes(bodies, joint)
        for name, paint in [
            (STAND_IN, hatching.HATCH) if part.stands_in else ("part", _uuid(part.rgba))
        ]
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
