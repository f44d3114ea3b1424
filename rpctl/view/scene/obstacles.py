"""Obstacles: their texts and outlines, and how a scene draws them: columns, low walls."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.control.registry import name_of
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle, law_obstacles, shape_text
from rpctl.view.palette import number_of
from rpctl.view.scene import threejs, trails
from rpctl.view.scene.stage import ground_disc

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
        top = ground + HEIGHT_RATIOS[obstacle.body] * size
        found += [_level(edge, ground), _level(edge, top)]
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
        shapes = [obstacle.shape for obstacle in obstacles if obstacle.body == body]
        height, dashed = HEIGHT_RATIOS[body] * size, body == TIP
        parts: list[FadedMesh] = []
        for shape in shapes:
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
    root = threejs.node("Group", "obstacles", children=nodes)
    return [threejs.set_object(OBSTACLES_PATH, root)] if nodes else []


def column(disc: Disc, height: float, width: float, dashed: bool) -> list[FadedMesh]:
    """Return the sides, floor and edge of a disc on a ground at height 0.

    Args:
        disc: The disc.
        height: Of its sides, m.
        width: Of its edge, m.
        dashed: Whether its edge is dashed.
    """
    edge = _level(rim(disc), 0.0)
    count = len(edge) - 1
    centre = np.array([[disc.x, disc.y, 0.0]])
    fan = np.column_stack([np.full(count, count + 1), np.arange(count), np.arange(1, count + 1)])
    floor = np.concatenate([edge, centre]), fan
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
    edge = _level(line[0] + stops * (line[1] - line[0]), 0.0)
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
    foot = centre[:2] - gap * plane.normal
    along = np.sqrt(radius**2 - gap**2) * np.array([-plane.normal[1], plane.normal[0]])
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


def _level(points: Array, height: float) -> Array:
    return np.column_stack([points, np.full(len(points), height)])


def _geometry(mesh: trails.Mesh, opacity: Array, height: float) -> threejs.Json:
    """Return a mesh, raised by a height (m), white so that its material colours it."""
    vertices, faces = mesh[0] + np.array([0.0, 0.0, height]), mesh[1]
    paint = np.column_stack([np.full((len(opacity), 3), 255.0), 255.0 * opacity])
    attributes = {
        "position": threejs.attribute(vertices.astype(np.float32)),
        "color": threejs.attribute(np.rint(paint).astype(np.uint8), normalized=True),
    }
    return threejs.geometry(attributes, faces)
