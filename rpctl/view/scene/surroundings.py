"""What surrounds the robot in a scene: lights, ground and trails, as meshcat commands."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.view.scene import threejs, trails

BASE_COLOUR = 0x0072B2  # Okabe-Ito blue: the base's actual path, in the plots as in the scene
TIP_COLOUR = 0xD55E00  # vermilion: the end effector's
DESIRED_COLOUR = 0x6B7480  # neutral: whatever is desired
GRID_COLOUR = 0x808890
SHADOW_MAP_PX = 2048  # pixels
SUN_DIRECTION = np.array([-0.35, -0.55, 1.0])  # direction to the light that casts shadows


def trails_command(paths: dict[str, Array], lower: Array, upper: Array) -> bytes:
    """Return the command that draws the paths, the desired ones dashed.

    A viewer that plays the run shows the first part of ``trail-base`` and ``trail-tip``.
    """
    width = trail_width(lower, upper)
    geometries, materials, nodes = [], [], []

    def draw(name: str, mesh: trails.Mesh | None, colour: int) -> None:
        if mesh is None:
            return
        vertices, faces = mesh
        position = {"position": threejs.attribute(vertices.astype(np.float32))}
        geometries.append(threejs.geometry(name, position, faces))
        paint = {"uuid": name, "type": "MeshBasicMaterial", "color": colour, "side": 2}
        materials.append(paint)
        entries = {"geometry": name, "material": name, "renderOrder": 3}
        nodes.append(threejs.node("Mesh", f"trail-{name}", frustumCulled=False, **entries))

    for kind, colour in (("base", BASE_COLOUR), ("tip", TIP_COLOUR)):
        if kind not in paths:
            continue
        shape = trails.ribbon if kind == "base" else trails.tube
        thick = width if kind == "base" else 0.55 * width
        up = [0.0, 0.0, 0.3 * width if kind == "base" else 0.0]
        desired, actual = paths[f"{kind}-desired"] + up, paths[kind] + 2 * np.array(up)
        pieces = [shape(piece, 0.8 * thick) for piece in trails.dashes(desired, thick)]
        draw(f"{kind}-desired", trails.join(pieces), DESIRED_COLOUR)
        draw(kind, shape(actual, thick), colour)
    root = threejs.node("Group", "trails", children=nodes)
    return threejs.set_object("/rpctl/trails", root, geometries, materials)


def trail_width(lower: Array, upper: Array) -> float:
    """Return how wide a trail is in a scene that shows so much, m."""
    return float(np.clip(0.006 * np.linalg.norm((upper - lower)[:2]), 0.006, 0.05))


def ground_disc(lower: Array, upper: Array) -> tuple[Array, float]:
    """Return the centre (2,) and the radius of the ground of a scene that shows so much, m."""
    radius = 0.75 * float(np.linalg.norm((upper - lower)[:2])) + 1.0
    return 0.5 * (lower + upper)[:2], radius


def ground_command(lower: Array, upper: Array, height: float) -> bytes:
    """Return the command that draws the grid, of half or whole metres, and catches shadows."""
    centre, radius = ground_disc(lower, upper)
    step = float(next(s for s in (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 1e9) if radius / s <= 16))
    step = max(min(step, radius), 0.25)
    points, opacity = trails.grid(centre, radius, step, height)
    tone = [GRID_COLOUR >> 16, GRID_COLOUR >> 8 & 255, GRID_COLOUR & 255]
    colours = np.column_stack([np.tile(tone, (len(points), 1)), 150.0 * opacity]).astype(np.uint8)
    grid = threejs.geometry(
        "grid",
        {
            "position": threejs.attribute(points.astype(np.float32)),
            "color": threejs.attribute(colours, normalized=True),
        },
    )
    plane = {"uuid": "plane", "type": "PlaneGeometry", "width": 2 * radius, "height": 2 * radius}
    clear = {"transparent": True, "depthWrite": False}
    materials = [
        {"uuid": "grid", "type": "LineBasicMaterial", "vertexColors": 2, **clear},
        {"uuid": "shadow", "type": "ShadowMaterial", "opacity": 0.16, **clear},
    ]
    pose = np.eye(4)
    pose[:3, 3] = centre[0], centre[1], height
    nodes = [
        threejs.node("LineSegments", "grid", geometry="grid", material="grid", renderOrder=1),
        threejs.node(
            "Mesh",
            "shadow",
            geometry="plane",
            material="shadow",
            receiveShadow=True,
            renderOrder=2,
            **threejs.fixed_matrix(pose),
        ),
    ]
    root = threejs.node("Group", "ground", children=nodes)
    return threejs.set_object("/rpctl/ground", root, [grid, plane], materials)


def lights_command(lower: Array, upper: Array) -> bytes:
    """Return the command that lights the scene: soft from the sky, and one sun with shadows."""
    axes = _sun_axes()
    corners = np.array([[(lower, upper)[k >> i & 1][i] for i in range(3)] for k in range(8)])
    seen = corners @ axes.T
    (left, bottom, near), (right, top, far) = seen.min(axis=0) - 0.2, seen.max(axis=0) + 0.2
    sun = np.eye(4)
    distance = max(far, 0.0) + 1.0  # the sun shines towards the origin, wherever the motion is
    sun[:3, 3] = axes[2] * distance
    box = {"left": left, "right": right, "bottom": bottom, "top": top}
    box |= {"near": 0.1, "far": distance - near + 1.0}
    camera = {"uuid": "sun-view", "type": "OrthographicCamera", "zoom": 1.0}
    camera |= {key: float(value) for key, value in box.items()}
    shadow = {
        "mapSize": [SHADOW_MAP_PX, SHADOW_MAP_PX],
        "bias": -5e-4,
        "radius": 3,
        "camera": camera,
    }
    sky, fill = np.eye(4), np.eye(4)
    sky[2, 3] = 1.0
    fill[:3, 3] = 3.0, -1.0, 1.0
    nodes = [
        threejs.node(
            "HemisphereLight",
            "sky",
            color=0xFFFFFF,
            groundColor=0x9AA0A8,
            intensity=0.58,
            **threejs.fixed_matrix(sky),
        ),
        threejs.node(
            "DirectionalLight",
            "sun",
            color=0xFFFFFF,
            intensity=0.36,
            castShadow=True,
            shadow=shadow,
            **threejs.fixed_matrix(sun),
        ),
        threejs.node(
            "DirectionalLight", "fill", color=0xFFFFFF, intensity=0.1, **threejs.fixed_matrix(fill)
        ),
    ]
    return threejs.set_object("/rpctl/lights", threejs.node("Group", "lights", children=nodes))


def _sun_axes() -> Array:
    """Return right, up and backward (3, 3) of the view from the sun."""
    back = SUN_DIRECTION / np.linalg.norm(SUN_DIRECTION)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(back, right), back])
