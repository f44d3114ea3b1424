"""The plane from above: paths, and the robot's outline and heading along them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.run import Run
from rpctl.view.plots.obstacles import draw_obstacles
from rpctl.view.plots.style import DESIRED_STYLE, Theme, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_POSES = 10  # of the robot along its path, at most
MIN_POSE_SPACING = 1.2  # lengths of the robot from one of its poses to the next, at least
ROUND_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # of the time between them, in powers of ten
MAX_TICKS = 9  # of the x axis, at most
HEADING_TICK_RATIO = 0.4  # of the track: length of a heading's tick


def draw_paths(axes: Axes, run: Run, theme: Theme) -> None:
    """Draw the paths of base and end effector, actual and desired, robot and obstacles."""
    from matplotlib.ticker import MaxNLocator

    pairs = []
    if run.robot.drive.wheels:
        pairs.append((run.log.base, run.base_ref, theme.base, "base"))
    if run.log.ee.shape[1]:
        pairs.append((run.log.ee, run.log.ee_ref, theme.tip, "end effector"))
    for actual, _, colour, label in pairs:
        axes.plot(*thin(actual[:, :2]).T, color=colour, lw=1.2, label=label)
        axes.plot(*actual[0, :2], "o", color=theme.paper, mec=colour, mew=1.1, ms=4.2, zorder=4)
    for number, (_, desired, _, _) in enumerate(pairs):
        explained = None if number else "desired"
        axes.plot(*thin(desired[:, :2]).T, color=theme.desired, label=explained, **DESIRED_STYLE)
    axes.plot([], [], "o", color=theme.paper, mec=theme.ink, mew=0.9, ms=3.6, label="start")
    if run.robot.drive.wheels:
        _draw_poses(axes, run, theme)
    draw_obstacles(axes, run, theme)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=MAX_TICKS, steps=[1, 2, 5, 10]))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _draw_poses(axes: Axes, run: Run, theme: Theme) -> None:
    """Draw the robot's outline and heading at regular times."""
    outline = support_outline(run)
    size = _size(run)
    interval = _interval(run, size)
    wanted = np.arange(run.t[0], run.t[-1] + 1e-9, interval) if interval else run.t[:1]
    for k in np.searchsorted(run.t, wanted).clip(max=len(run.t) - 1):
        x, y, heading = run.log.base[k]
        length = HEADING_TICK_RATIO * size
        tick = [x, x + length * np.cos(heading)], [y, y + length * np.sin(heading)]
        axes.plot(*tick, color=theme.ink, lw=0.9, zorder=3.5)
        if outline is not None:
            placed = run.q[k, :2] + outline @ _rotation(run.q[k]).T
            axes.fill(*placed.T, fc=theme.base, ec="none", alpha=0.08, zorder=1.5)
            axes.fill(*placed.T, fc="none", ec=theme.ink, lw=0.5, alpha=0.7, zorder=1.6)
    if interval and outline is not None:
        text = f"contacts and heading, every {interval:g} s"
        axes.fill([], [], fc=theme.faint, ec=theme.ink, lw=0.5, label=text)


def support_outline(run: Run) -> Array | None:
    """Return the corners (n, 2) around the contacts in the root link's frame, m, or None.

    There are none where fewer than three contacts are known, or all lie in one line.
    """
    from scipy.spatial import ConvexHull, QhullError

    points = np.array(run.ground.points).reshape(-1, 2)
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return None


def _rotation(q: Array) -> Array:
    """Return the rotation (2, 2) of the root link at a configuration (nq,)."""
    cosine, sine = q[2:4]
    return np.array([[cosine, -sine], [sine, cosine]])


def _size(run: Run) -> float:
    """Return how far apart the contacts are, m: the size of what is drawn of the robot."""
    points = np.array(run.ground.points).reshape(-1, 2)
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    return max(extent, run.robot.drive.track) or 1.0


def _interval(run: Run, size: float) -> float:
    """Return a round time between poses, s, in which the robot leaves its place; 0: never."""
    duration = float(run.t[-1] - run.t[0])
    length = float(np.linalg.norm(np.diff(run.log.base[:, :2], axis=0), axis=1).sum())
    count = min(MAX_POSES, length / (MIN_POSE_SPACING * size))
    if count < 1.0:
        return 0.0
    least = duration / count
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(power * step for step in ROUND_STEPS if power * step >= 0.999 * least))
