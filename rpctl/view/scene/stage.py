"""The ground of a scene with its grid, and the lights above it."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.view.palette import light, rgb
from rpctl.view.scene import threejs

GRID_PIECES = 16  # each line fades out in so many steps
SHADOW_MAP_PX = 2048  # pixels
SUN_DIRECTION = np.array([-0.35, -0.55, 1.0])  # direction to the light that casts shadows


def ground_disc(lower: Array, upper: Array) -> tuple[Array, float]:
    """Return centre (2,) and radius of the ground for a scene between two corners (3,), m."""
    radius = 0.75 * float(np.linalg.norm((upper - lower)[:2])) + 1.0
    return 0.5 * (lower + upper)[:2], radius


def ground_command(lower: Array, upper: Array, height: float) -> bytes:
    """Return the command that draws the ground: a grid of round spacing, and shadows.

    Args:
        lower: Least coordinates of what the scene shows (3,), m.
        upper: Largest coordinates (3,), m.
        height: Height of the ground, m.
    """
    centre, radius = ground_disc(lower, upper)
    plane = {"type": "PlaneGeometry", "width": 2 * radius, "height": 2 * radius}
    clear = {"transparent": True, "depthWrite": False}
    lines = {"type": "LineBasicMaterial", "vertexColors": 2, **clear}
    shadow = {"type": "ShadowMaterial", "opacity": 0.16, **clear}
    pose = np.eye(4)
    pose[:3, 3] = centre[0], centre[1], height
    grid: threejs.Json = {
        "geometry": _grid(centre, radius, height),
        "material": lines,
        "renderOrder": 1,
    }
    shade: threejs.Json = {
        "geometry": plane,
        "material": shadow,
        "renderOrder": 2,
        "receiveShadow": True,
    }
    nodes = [
        threejs.node("LineSegments", "grid", **grid),
        threejs.node("Mesh", "shadow", pose, **shade),
    ]
    return threejs.set_object("/rpctl/ground", threejs.node("Group", "ground", children=nodes))


def _grid(centre: Array, radius: float, height: float) -> threejs.Json:
    """Return the grid's geometry, of half or whole metres where that suits the radius (m)."""
    step = float(next(s for s in (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 1e9) if radius / s <= 16))
    step = max(min(step, radius), 0.25)
    points, opacity = grid_lines(centre, radius, step, height)
    tone = rgb(light("grid"))
    colours = np.column_stack([np.tile(tone, (len(points), 1)), 150.0 * opacity]).astype(np.uint8)
    return threejs.geometry(
        {
            "position": threejs.attribute(points.astype(np.float32)),
            "color": threejs.attribute(colours, normalized=True),
        },
    )


def grid_lines(centre: Array, radius: float, step: float, height: float) -> tuple[Array, Array]:
    """Return the grid's line ends (n, 3), m, and their opacity (n,), 0 at ``radius``.

    Args:
        centre: Of the grid (2,), m.
        radius: Where the lines end, m.
        step: Distance between lines, which lie on its multiples, m.
        height: z of all lines, m.
    """
    count = int(np.ceil(radius / step))
    offsets = step * np.arange(-count, count + 1)
    stops = np.linspace(-count * step, count * step, 2 * GRID_PIECES + 1)
    ends = np.column_stack([stops[:-1], stops[1:]]).reshape(-1)
    origin = np.round(np.asarray(centre[:2]) / step) * step  # lines stay on multiples of the step
    across, along = np.repeat(offsets, len(ends)), np.tile(ends, len(offsets))
    flat = np.concatenate([np.column_stack([across, along]), np.column_stack([along, across])])
    distance = np.linalg.norm(flat, axis=1) / (count * step)
    opacity = np.clip(1.0 - distance, 0.0, 1.0) ** 1.2
    points = np.column_stack([flat + origin, np.full(len(flat), height)])
    visible = opacity.reshape(-1, 2).max(axis=1).repeat(2) > 0.0
    return points[visible], opacity[visible]


def lights_command(lower: Array, upper: Array) -> bytes:
    """Return the command that lights the scene: a sky, and a sun that casts shadows."""
    sky, fill = np.eye(4), np.eye(4)
    sky[2, 3] = 1.0
    fill[:3, 3] = 3.0, -1.0, 1.0
    above = {"color": 0xFFFFFF, "groundColor": 0x9AA0A8, "intensity": 0.58}
    nodes = [
        threejs.node("HemisphereLight", "sky", sky, **above),
        _sun(lower, upper),
        threejs.node("DirectionalLight", "fill", fill, color=0xFFFFFF, intensity=0.1),
    ]
    return threejs.set_object("/rpctl/lights", threejs.node("Group", "lights", children=nodes))


def _sun(lower: Array, upper: Array) -> threejs.Json:
    """Return the sun, whose shadows cover the box between two corners (3,), m."""
    axes = view_axes(SUN_DIRECTION)
    seen = corners_of(lower, upper) @ axes.T
    (left, bottom, near), (right, top, far) = seen.min(axis=0) - 0.2, seen.max(axis=0) + 0.2
    sun = np.eye(4)
    distance = max(far, 0.0) + 1.0  # the sun shines towards the origin, wherever the motion is
    sun[:3, 3] = axes[2] * distance
    box = {"left": left, "right": right, "bottom": bottom, "top": top}
    box |= {"near": 0.1, "far": distance - near + 1.0}
    shadow = {
        "mapSize": [SHADOW_MAP_PX, SHADOW_MAP_PX],
        "bias": -5e-4,
        "radius": 3,
        "camera": {
            "uuid": "sun-view",
            "type": "OrthographicCamera",
            "zoom": 1.0,
            **{key: float(value) for key, value in box.items()},
        },
    }
    shine = {"color": 0xFFFFFF, "intensity": 0.36, "castShadow": True, "shadow": shadow}
    return threejs.node("DirectionalLight", "sun", sun, **shine)


def corners_of(lower: Array, upper: Array) -> Array:
    """Return the corners (8, 3) of the box between two of them (3,)."""
    return np.array(np.meshgrid(*np.stack([lower, upper], axis=1))).reshape(3, -1).T


def view_axes(direction: Array) -> Array:
    """Return right, up and backward (3, 3) of a level view from a direction, not z."""
    back = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(back, right), back])
