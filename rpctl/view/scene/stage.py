"""What surrounds a motion: ground with its grid, lights, obstacles as columns and low walls."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.control.registry import name_of
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle, law_obstacles, shape_text
from rpctl.view.palette import light, number_of, rgb
from rpctl.view.scene import threejs, trails

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
    grid: threejs.Json = {"geometry": _grid(centre, radius, height), "material": lines}
    shade: threejs.Json = {"geometry": plane, "material": shadow, "receiveShadow": True}
    nodes = [
        threejs.node("LineSegments", "grid", renderOrder=1, **grid),
        threejs.node("Mesh", "shadow", pose, renderOrder=2, **shade),
    ]
    return threejs.set_group("/rpctl/ground", "ground", nodes)


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
    visible = opacity.reshape(-1, 2).max(axis=1).repeat(2) > 0.0
    return level(flat + origin, height)[visible], opacity[visible]


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
    return threejs.set_group("/rpctl/lights", "lights", nodes)


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


OBSTACLE_TITLES = {BASE: "Base obstacles", TIP: "End-effector obstacles"}
RIM_POINTS = 96  # points of a disc's edge
NEAR_RATIO = 0.5  # of the diagonal of a motion: obstacles farther from it are not framed
NEAR_MIN_M = 0.5  # m: how far they are framed however small the motion is
OBSTACLES_PATH = "/rpctl/obstacles"
HEIGHT_RATIOS = {BASE: 0.5, TIP: 1.05}  # of the robot: how high columns are, which have no end
WALL_HEIGHT_RATIO = 0.5  # of a column's height
EDGE_OPACITY, FLOOR_OPACITY, FOOT_OPACITY, TOP_OPACITY = (
    0.95,
    0.16,
    0.36,
    0.06,
)  # opacity: edges, floor, sides below and above
TINT_RATIO = 0.22  # of the ground's radius: how far the floor beyond a wall is tinted
WALL_PIECES = 64  # of a wall's length
FADE_EXPONENT = 0.7  # exponent: how softly a wall ends where the ground does
SEE_THROUGH = {  # it writes no depth, so it hides nothing
    "type": "MeshBasicMaterial",
    "vertexColors": 2,
    "transparent": True,
    "depthWrite": False,
    "side": 2,
}

FadedMesh = tuple[trails.Mesh, Array]  # a mesh, and the opacity of its vertices


def obstacle_texts(law: object) -> dict[str, str]:
    """Return the obstacles of a law and of laws within it as texts, by the body they are for."""
    texts_of: dict[str, list[str]] = {}
    for body, shape, _ in law_obstacles(law):
        text = shape_text(shape) if isinstance(shape, Disc | HalfPlane) else name_of(shape)
        texts_of.setdefault(OBSTACLE_TITLES[body], []).append(text)
    return {label: "; ".join(dict.fromkeys(texts)) for label, texts in texts_of.items()}


def rim(disc: Disc) -> Array:
    """Return the edge of a disc (RIM + 1, 2), closed, m."""
    turns = np.linspace(0.0, 2.0 * math.pi, RIM_POINTS + 1)
    return disc.radius * np.column_stack([np.cos(turns), np.sin(turns)]) + (disc.x, disc.y)


def rims(obstacles: Iterable[AvoidedObstacle]) -> Array:
    """Return the edges (n, 2) of all discs, m."""
    edges = [rim(o.shape) for o in obstacles if isinstance(o.shape, Disc)]
    return np.concatenate([np.empty((0, 2)), *edges])


def near(points: Array, lower: Array, upper: Array) -> Array:
    """Return the points (n, 2) near enough to a motion to be included in its picture, m.

    Args:
        points: Of obstacles, m.
        lower: Least coordinates of the motion (2,) or more, m.
        upper: Its largest coordinates, m.
    """
    low, high = lower[:2], upper[:2]
    reach = max(NEAR_RATIO * float(np.hypot(*(high - low))), NEAR_MIN_M)
    return points[((points > low - reach) & (points < high + reach)).all(axis=1)]


def obstacle_corners(
    obstacles: Sequence[AvoidedObstacle], cloud: Array, ground: float, size: float
) -> Array:
    """Return points (n, 3) of the discs near a motion, m, for a camera to include.

    Args:
        obstacles: Any.
        cloud: Points (n, 3) of the motion, m.
        ground: Height of the ground, m.
        size: Height of the robot, m.
    """
    lower, upper = cloud.min(axis=0), cloud.max(axis=0)
    found = [np.empty((0, 3))]
    for obstacle in obstacles:
        edge = near(rims([obstacle]), lower, upper)
        found += [level(edge, ground), level(edge, ground + HEIGHT_RATIOS[obstacle.body] * size)]
    return np.concatenate(found)


def obstacle_commands(
    obstacles: Sequence[AvoidedObstacle], lower: Array, upper: Array, ground: float, size: float
) -> list[bytes]:
    """Return the command that draws obstacles, one mesh for each body, or nothing.

    Args:
        obstacles: Any.
        lower: Least coordinates of what the scene shows (3,), m.
        upper: Largest coordinates (3,), m.
        ground: Height of the ground, m.
        size: Height of the robot, m.
    """
    width = trails.trail_width(lower, upper)
    place = ground_disc(lower, upper)
    nodes = []
    for body in dict.fromkeys(obstacle.body for obstacle in obstacles):
        height, dashed = HEIGHT_RATIOS[body] * size, body == TIP
        parts: list[FadedMesh] = []
        for shape in (obstacle.shape for obstacle in obstacles if obstacle.body == body):
            if isinstance(shape, Disc):
                parts += column(shape, height, width, dashed)
            else:
                parts += wall(shape, *place, WALL_HEIGHT_RATIO * height, width, dashed)
        mesh = trails.join([part for part, _ in parts])
        if mesh is None:
            continue
        name, opacity = f"obstacles-{body}", np.concatenate([alpha for _, alpha in parts])
        entries: threejs.Json = {"geometry": _geometry(mesh, opacity, ground + 0.2 * width)}
        entries["material"] = {"color": number_of(name), **SEE_THROUGH}
        nodes.append(threejs.node("Mesh", name, renderOrder=3, **entries))
    return [threejs.set_group(OBSTACLES_PATH, "obstacles", nodes)] if nodes else []


def column(disc: Disc, height: float, width: float, dashed: bool) -> list[FadedMesh]:
    """Return the sides, floor and edge of a disc on a ground at height 0.

    Args:
        disc: The disc.
        height: Of its sides, m.
        width: Of its edge, m.
        dashed: Whether its edge is dashed.
    """
    edge = level(rim(disc), 0.0)
    count = len(edge) - 1
    fan = np.column_stack([np.full(count, count + 1), np.arange(count), np.arange(1, count + 1)])
    floor = np.concatenate([edge, [[disc.x, disc.y, 0.0]]]), fan
    return [
        (floor, np.full(count + 2, FLOOR_OPACITY)),
        *_edges(edge, width, dashed),
        _sides(edge, height, np.ones(len(edge))),
    ]


def wall(
    plane: HalfPlane, centre: Array, radius: float, height: float, width: float, dashed: bool
) -> list[FadedMesh]:
    """Return side, edge and blocked floor of a half-plane, as far as the ground extends.

    Args:
        plane: The half-plane.
        centre: Of the ground (2,), m.
        radius: Of the ground, m: towards it all fades out.
        height: Of the wall, m.
        width: Of its edge, m.
        dashed: Whether its edge is.

    Returns:
        Nothing where the line passes the ground by.
    """
    line = clip(plane, centre, radius)
    if line is None:
        return []

    def fade(points: Array) -> Array:
        away = np.hypot(*(points[:, :2] - centre).T) / radius
        return np.asarray(np.clip(1.0 - away, 0.0, 1.0) ** FADE_EXPONENT)

    stops = np.linspace(0.0, 1.0, WALL_PIECES + 1)[:, None]
    edge = level(line[0] + stops * (line[1] - line[0]), 0.0)
    beyond = edge - TINT_RATIO * radius * np.array([*plane.normal, 0.0])
    floor = np.stack([edge, beyond], 1).reshape(-1, 3), trails.strip(len(edge), 2)
    shade = np.column_stack([1.5 * FLOOR_OPACITY * fade(edge), np.zeros(len(edge))]).reshape(-1)
    edges = [(mesh, alpha * fade(mesh[0])) for mesh, alpha in _edges(edge, width, dashed)]
    return [(floor, shade), *edges, _sides(edge, height, fade(edge))]


def clip(plane: HalfPlane, centre: Array, radius: float) -> Array | None:
    """Return the ends (2, 2) of a half-plane's line within a circle, m, or None outside it.

    Args:
        plane: The half-plane.
        centre: Centre of the circle (2,) or more, m.
        radius: Radius of the circle, m.
    """
    (gap,) = plane.distance(np.asarray(centre)[None, :2])
    if abs(gap) >= radius:
        return None
    return line_ends(plane, centre[:2], gap, float(np.sqrt(radius**2 - gap**2)))


def line_ends(plane: HalfPlane, centre: Array, gap: float, half: float) -> Array:
    """Return two points (2, 2) of a half-plane's line, ``half`` m either way of a place's foot.

    Args:
        plane: The half-plane.
        centre: The place (2,), m.
        gap: Its distance from the line, m.
        half: m.
    """
    foot = centre - gap * plane.normal
    along = half * np.array([-plane.normal[1], plane.normal[0]])
    return np.stack([foot - along, foot + along])


def _edges(path: Array, width: float, dashed: bool) -> list[FadedMesh]:
    """Return the band along an edge on the floor."""
    pieces = trails.dashes(path, 0.8 * width) if dashed else [path]
    mesh = trails.join([trails.ribbon(piece, width) for piece in pieces])
    return [] if mesh is None else [(mesh, np.full(len(mesh[0]), EDGE_OPACITY))]


def _sides(edge: Array, height: float, opacity: Array) -> FadedMesh:
    """Return the side above an edge (n, 3); its opacity (n,) falls towards its top."""
    top = edge + np.array([0.0, 0.0, height])
    mesh = np.stack([edge, top], 1).reshape(-1, 3), trails.strip(len(edge), 2)
    return mesh, np.column_stack([FOOT_OPACITY * opacity, TOP_OPACITY * opacity]).reshape(-1)


def level(points: Array, height: float) -> Array:
    """Return points (n, 3) at one height, m, above or below places (n, 2)."""
    return np.column_stack([points, np.full(len(points), height)])


def _geometry(mesh: trails.Mesh, opacity: Array, height: float) -> threejs.Json:
    """Return a mesh, raised by a height (m), white so that its material colours it."""
    vertices = mesh[0] + np.array([0.0, 0.0, height])
    paint = np.column_stack([np.full((len(opacity), 3), 255.0), 255.0 * opacity])
    attributes = {
        "position": threejs.attribute(vertices.astype(np.float32)),
        "color": threejs.attribute(np.rint(paint).astype(np.uint8), normalized=True),
    }
    return threejs.geometry(attributes, mesh[1])
