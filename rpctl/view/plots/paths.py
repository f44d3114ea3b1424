"""The plan view of a run: its paths, the robot along them, and the obstacles.

Only the paper figure has this panel: the page shows the same in its scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import MaxNLocator
from scipy.spatial import ConvexHull, QhullError

from rpctl.arrays import Array
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.robot.coordinates import read_root
from rpctl.simulation.merits.obstacles import BASE, TIP, AvoidedObstacle, run_obstacles
from rpctl.simulation.run.run import Run
from rpctl.view.charts import PATHS
from rpctl.view.plots import style
from rpctl.view.scene.stage import line_ends, near, rims

MAX_POSES = 10  # of the robot along its path, at most
MIN_POSE_SPACING = 1.2  # lengths of the robot from one of its poses to the next, at least
ROUND_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # of the time between them, in powers of ten
MAX_TICKS = 9  # of the x axis, at most
HEADING_TICK_RATIO = 0.4  # of the track: length of a heading's tick
OBSTACLE_LABELS = {BASE: "obstacle of the base", TIP: "obstacle of the end effector"}
HATCHES = {BASE: "////", TIP: "...."}
HALF_PLANE_DIAGONALS = 20.0  # m, or diagonals of what is drawn: how far a half-plane goes on
ZORDER = 1.2  # above the grid, below the robot
CLEARANCE_STYLE: dict[str, Any] = {"lw": 0.6, "ls": (0, (4, 2.5)), "zorder": ZORDER}


def draw_paths(axes: Axes, run: Run) -> None:
    """Draw the paths of base and end effector, actual and desired, robot and obstacles."""
    pairs = []
    if run.robot.drive.wheels:
        pairs.append((run.log.base, run.base_ref, style.BASE, "base"))
    if run.log.ee.shape[1]:
        pairs.append((run.log.ee, run.log.ee_ref, style.TIP, "end effector"))
    for actual, _, colour, label in pairs:
        axes.plot(*actual[:, :2].T, color=colour, lw=1.2, label=label)
        axes.plot(*actual[0, :2], "o", color=style.PAPER, mec=colour, mew=1.1, ms=4.2, zorder=4)
    for number, (_, desired, _, _) in enumerate(pairs):
        axes.plot(*desired[:, :2].T, label=None if number else "desired", **style.DESIRED_STYLE)
    axes.plot([], [], "o", color=style.PAPER, mec=style.INK, mew=0.9, ms=3.6, label="start")
    if run.robot.drive.wheels:
        _draw_poses(axes, run)
    draw_obstacles(axes, run)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=MAX_TICKS, steps=[1, 2, 5, 10]))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, m")
    axes.set_ylabel(PATHS.axis)


def _draw_poses(axes: Axes, run: Run) -> None:
    """Draw the robot's outline and heading at regular times."""
    outline = support_outline(run)
    size = _size(run)
    interval = _interval(run, size)
    wanted = np.arange(run.t[0], run.t[-1] + 1e-9, interval) if interval else run.t[:1]
    for k in np.searchsorted(run.t, wanted).clip(max=len(run.t) - 1):
        x, y, heading = run.log.base[k]
        ahead = HEADING_TICK_RATIO * size * np.array([np.cos(heading), np.sin(heading)])
        axes.plot([x, x + ahead[0]], [y, y + ahead[1]], color=style.INK, lw=0.9, zorder=3.5)
        if outline is not None:
            corners = style.placed(outline, read_root(run.q[k])).T
            axes.fill(*corners, fc=style.BASE, ec="none", alpha=0.08, zorder=1.5)
            axes.fill(*corners, fc="none", ec=style.INK, lw=0.5, alpha=0.7, zorder=1.6)
    if interval and outline is not None:
        text = f"contacts and heading, every {interval:g} s"
        axes.fill([], [], fc=style.FAINT, ec=style.INK, lw=0.5, label=text)


def support_outline(run: Run) -> Array | None:
    """Return the corners (n, 2) around the contacts in the root link's frame, m, or None.

    There are none where fewer than three contacts are known, or all lie in one line.
    """
    points = np.array(run.ground.points).reshape(-1, 2)
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return None


def _size(run: Run) -> float:
    """Return the size of the robot as drawn, m: the extent of its contacts, or its track."""
    points = np.array(run.ground.points).reshape(-1, 2)
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    return max(extent, run.robot.drive.track) or 1.0


def _interval(run: Run, size: float) -> float:
    """Return a round time between drawn poses, s; 0 where the robot moves less than one spacing."""
    duration = float(run.t[-1] - run.t[0])
    length = float(np.linalg.norm(np.diff(run.log.base[:, :2], axis=0), axis=1).sum())
    count = min(MAX_POSES, length / (MIN_POSE_SPACING * size))
    if count < 1.0:
        return 0.0
    least = duration / count
    steps = 10.0 ** np.floor(np.log10(least)) * np.array(ROUND_STEPS)
    return float(steps[steps >= 0.999 * least][0])


def draw_obstacles(axes: Axes, run: Run) -> None:
    """Draw the obstacles of a run after its paths; the axes widen to include those nearby."""
    obstacles = run_obstacles(run)
    if not obstacles:
        return
    lower, upper = np.array(axes.dataLim.min), np.array(axes.dataLim.max)
    shown = near(np.concatenate([rims(obstacles), *_nearest_points(obstacles, run)]), lower, upper)
    if len(shown):
        axes.update_datalim(shown)
        axes.autoscale_view()
    colours = {BASE: style.BASE_OBSTACLE, TIP: style.TIP_OBSTACLE}
    far = HALF_PLANE_DIAGONALS * max(float(np.hypot(*(upper - lower))), 1.0)
    for obstacle in obstacles:
        fill_style = _fill_style(obstacle.body, colours[obstacle.body])
        _draw(axes, obstacle, 0.5 * (lower + upper), far, fill_style)
    for body in dict.fromkeys(obstacle.body for obstacle in obstacles):
        axes.fill([], [], label=OBSTACLE_LABELS[body], **_fill_style(body, colours[body]))
    if any(obstacle.radius for obstacle in obstacles):
        axes.plot(
            [], [], label="as near as its centre may come", color=style.INK, **CLEARANCE_STYLE
        )


def half_plane(plane: HalfPlane, centre: Array, far: float) -> Array:
    """Return the corners (4, 2) of a rectangle on the blocked side of a half-plane, m.

    The first two lie on its line.

    Args:
        plane: The half-plane.
        centre: Beside the middle of the line (2,), m.
        far: How far it goes on in each direction, m.
    """
    (gap,) = plane.distance(centre[None])
    ends = line_ends(plane, centre, gap, far)
    return np.concatenate([ends, ends[::-1] - far * plane.normal])


def _nearest_points(obstacles: Sequence[AvoidedObstacle], run: Run) -> list[Array]:
    """Return, for each half-plane, the point (1, 2) of its line nearest to its body's path, m."""
    feet = []
    for body, shape in ((o.body, o.shape) for o in obstacles):
        path = (run.log.base if body == BASE else run.log.ee)[:, :2]
        if isinstance(shape, HalfPlane) and path.size:
            gaps = shape.distance(path)
            k = int(np.argmin(gaps))
            feet.append(path[k : k + 1] - gaps[k] * shape.normal)
    return feet


def _draw(
    axes: Axes, obstacle: AvoidedObstacle, centre: Array, far: float, fill_style: dict[str, Any]
) -> None:
    """Draw one obstacle; it does not widen the axes."""
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
    tint = to_rgba(colour, 0.1)
    return {"fc": tint, "ec": colour, "lw": 0.8, "hatch": HATCHES[body], "zorder": ZORDER}
