"""Obstacles from above: hatched, and dashed how near to them the centre of the body may come."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.simulation.run import Run
from rpctl.view.plots.style import Theme
from rpctl.view.scene.obstacles import BASE, TIP, DrawnObstacle, near, rims, run_obstacles

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OBSTACLE_LABELS = {BASE: "obstacle of the base", TIP: "obstacle of the end effector"}
HATCHES = {BASE: "////", TIP: "...."}
HALF_PLANE_DIAGONALS = 20.0  # m, or diagonals of what is drawn: how far a half-plane goes on
ZORDER = 1.2  # above the grid, below the robot
CLEARANCE_STYLE: dict[str, Any] = {"lw": 0.6, "ls": (0, (4, 2.5)), "zorder": ZORDER}


def draw_obstacles(axes: Axes, run: Run, theme: Theme) -> None:
    """Draw the obstacles of a run whose paths are drawn already; those near them come in view."""
    obstacles = run_obstacles(run)
    if not obstacles:
        return
    lower, upper = np.array(axes.dataLim.min), np.array(axes.dataLim.max)
    shown = near(np.concatenate([rims(obstacles), *_nearest_points(obstacles, run)]), lower, upper)
    if len(shown):
        axes.update_datalim(shown)
        axes.autoscale_view()
    colours = {BASE: theme.base_obstacle, TIP: theme.tip_obstacle}
    far = HALF_PLANE_DIAGONALS * max(float(np.hypot(*(upper - lower))), 1.0)
    for obstacle in obstacles:
        fill_style = _fill_style(obstacle.body, colours[obstacle.body])
        _draw(axes, obstacle, 0.5 * (lower + upper), far, fill_style)
    for body in dict.fromkeys(obstacle.body for obstacle in obstacles):
        axes.fill([], [], label=OBSTACLE_LABELS[body], **_fill_style(body, colours[body]))
    if any(obstacle.radius for obstacle in obstacles):
        axes.plot(
            [], [], label="as near as its centre may come", color=theme.ink, **CLEARANCE_STYLE
        )


def half_plane(plane: HalfPlane, centre: Array, far: float) -> Array:
    """Return the corners (4, 2) of so much of the floor beyond a line, m; two are on the line.

    Args:
        plane: The half-plane.
        centre: Beside the middle of the line (2,), m.
        far: How far it goes on in each direction, m.
    """
    (gap,) = plane.distance(centre[None])
    foot = centre - gap * plane.normal
    along = far * np.array([-plane.normal[1], plane.normal[0]])
    ends = np.stack([foot - along, foot + along])
    return np.concatenate([ends, ends[::-1] - far * plane.normal])


def _nearest_points(obstacles: Sequence[DrawnObstacle], run: Run) -> list[Array]:
    """Return the points (1, 2) of the lines of half-planes that the bodies come nearest to, m."""
    feet = []
    for body, shape in ((o.body, o.shape) for o in obstacles):
        path = (run.log.base if body == BASE else run.log.ee)[:, :2]
        if isinstance(shape, HalfPlane) and path.size:
            gaps = shape.distance(path)
            k = int(np.argmin(gaps))
            feet.append(path[k : k + 1] - gaps[k] * shape.normal)
    return feet


def _draw(
    axes: Axes, obstacle: DrawnObstacle, centre: Array, far: float, fill_style: dict[str, Any]
) -> None:
    """Draw one; unlike what is plotted, it has no say in how far the axes go."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle, Polygon

    shape, radius = obstacle.shape, obstacle.radius
    clearance_style = {**CLEARANCE_STYLE, "color": fill_style["ec"]}
    if isinstance(shape, Disc):
        axes.add_artist(Circle((shape.x, shape.y), shape.radius, **fill_style))
        if radius:
            axes.add_artist(
                Circle((shape.x, shape.y), shape.radius + radius, fill=False, **clearance_style)
            )
        return
    corners = half_plane(shape, centre, far)
    axes.add_artist(Polygon(corners, **fill_style))
    if radius:
        axes.add_artist(Line2D(*(corners[:2] + radius * shape.normal).T, **clearance_style))


def _fill_style(body: str, colour: str) -> dict[str, Any]:
    """Return how an obstacle is filled: edge and hatching in one colour, on a tint of it."""
    from matplotlib.colors import to_rgba

    tint = to_rgba(colour, 0.1)
    return {"fc": tint, "ec": colour, "lw": 0.8, "hatch": HATCHES[body], "zorder": ZORDER}
