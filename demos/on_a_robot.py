"""One picture of a run on a robot that is noisy and late: its path, its error, what it was sent.

The demos of such robots share it; alone it does nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

import rpctl

INK, SOFT, LINE = "#1a1d21", "#5c6470", "#e1e4e8"
DESIRED, BASE, ARM, BOUND = "#6b7480", "#0072b2", "#d55e00", "#b3261e"
MM = 1e3
SMALLEST = 0.1  # mm that an axis shows
UNITS = {"v": "m/s", "vx": "m/s", "vy": "m/s"}
STYLE: Any = {
    "font.family": "DejaVu Sans", "font.size": 9.0, "text.color": INK, "axes.edgecolor": LINE,
    "axes.labelcolor": SOFT, "xtick.color": SOFT, "ytick.color": SOFT, "axes.titlesize": 9.0,
    "axes.titlelocation": "left", "axes.grid": True, "grid.color": LINE, "grid.linewidth": 0.6,
    "axes.spines.top": False, "axes.spines.right": False, "figure.facecolor": "white",
}  # fmt: skip


@dataclass(frozen=True)
class Story:
    """What a picture tells.

    Attributes:
        title: The robot, and what it is sent.
        conditions: Under which it runs, a line each.
        robot: The robot.
        run: The run.
        other: The same by a controller that learns how late the robot is, if it is shown.
    """

    title: str
    conditions: tuple[str, ...]
    robot: rpctl.Robot
    run: rpctl.Run
    other: rpctl.Run | None = None


def base_error(run: rpctl.Run) -> Any:
    """Return how far the root link is from where it should be at each sample (K,), m."""
    return np.hypot(*(run.q[:, :2] - run.q_ref[:, :2]).T)


def draw(story: Story, path: Path) -> None:
    """Draw a story and say where it is."""
    run, count = story.run, len(story.robot.drive.base_speeds)
    arm = len(story.robot.joint_names) > 0
    with plt.rc_context(STYLE):
        figure = plt.figure(figsize=(10.0, 1.9 + 1.15 * (1 + count + arm)), layout="constrained")
        grid = figure.add_gridspec(1 + count + arm, 2, width_ratios=(1.0, 1.12))
        _draw_path(figure.add_subplot(grid[:, 0]), story)
        first = figure.add_subplot(grid[0, 1])
        _draw_error(first, story)
        rows = [figure.add_subplot(grid[1 + k, 1], sharex=first) for k in range(count + arm)]
        for k, axes in enumerate(rows[:count]):
            _draw_command(axes, story, k)
        if arm:
            _draw_arm(rows[-1], story)
        for axes in [first, *rows[:-1]]:
            axes.tick_params(labelbottom=False)
        rows[-1].set_xlabel("time, s")
        first.set_xlim(run.t[0], run.t[-1])
        figure.suptitle(
            story.title, x=0.008, ha="left", fontsize=13.0, fontweight="bold", color=INK
        )
        engine: Any = figure.get_layout_engine()
        engine.set(rect=(0.0, 0.085, 1.0, 0.915), wspace=0.06)
        figure.text(
            0.008, 0.018, "\n".join(story.conditions), fontsize=8.2, color=SOFT, linespacing=1.5
        )
        figure.savefig(path, dpi=150)
        plt.close(figure)
    print(f"wrote {path}")


def _draw_path(axes: Any, story: Story) -> None:
    run = story.run
    axes.plot(*run.q_ref[:, :2].T, color=DESIRED, lw=1.4, ls=(0, (4, 3)), label="reference")
    axes.plot(*run.q[:, :2].T, color=BASE, lw=1.8, label="robot")
    if story.other is not None:
        axes.plot(*story.other.q[:, :2].T, color=ARM, lw=0.9, label="lateness learnt")
    axes.plot(*run.q[0, :2], "o", color=BASE, ms=5)
    axes.annotate("start", run.q[0, :2], (-4, -12), textcoords="offset points", color=SOFT)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.09), ncol=3, frameon=False)


def _draw_error(axes: Any, story: Story) -> None:
    runs = [(BASE, 1.8, story.run), (ARM, 0.9, story.other)]
    rms = []
    for colour, width, run in runs:
        if run is not None:
            error = MM * base_error(run)
            axes.semilogy(run.t, np.maximum(error, SMALLEST), color=colour, lw=width)
            rms.append(np.sqrt(np.mean(error[run.t > 0.5 * run.t[-1]] ** 2)))
    own, *learnt = rms
    beside = "".join(f"; {each:.1f} learnt" for each in learnt)
    axes.set_title(f"base off its reference, mm: {own:.1f} rms, second half{beside}")
    axes.set_ylim(SMALLEST, 300.0)
    axes.set_yticks([0.1, 1.0, 10.0, 100.0], ["0.1", "1", "10", "100"])
    axes.minorticks_off()


def _draw_command(axes: Any, story: Story, k: int) -> None:
    run, name = story.run, story.robot.quasi_velocities[k]
    output = run.config.output
    assert output is not None
    sent, most, unit = run.log.nu_cmd[:, k], output.speeds[name], UNITS.get(name, "rad/s")
    axes.set_title(
        f"sent {name}, {unit}: at most {most:g} {unit}, {output.accelerations[name]:g} {unit}², "
        f"{output.jerks[name]:g} {unit}³"
    )
    axes.step(run.t, sent, where="post", color=BASE, lw=1.1)
    for limit in (most, -most):
        axes.axhline(limit, color=BOUND, lw=0.9, ls=(0, (2, 2)))
    low = -1.25 * most if sent.min() < -0.05 * most else -0.15 * most
    axes.set_ylim(low, 1.25 * most)


def _draw_arm(axes: Any, story: Story) -> None:
    run, robot = story.run, story.robot
    output = run.config.output
    assert output is not None
    first = len(robot.drive.base_speeds)
    most = np.array([output.speeds[name] for name in robot.joint_names])
    worst = MM * np.abs(run.q - run.q_ref)[run.t > 0.5 * run.t[-1]]
    entries = [robot.entries[name].index for name in robot.joint_names]
    axes.set_title(
        "arm's rates over their bounds: "
        f"joints within {worst[:, entries].max():.0f} mrad, second half"
    )
    axes.step(run.t, run.log.nu_cmd[:, first:] / most, where="post", color=ARM, lw=0.7, alpha=0.8)
    for limit in (1.0, -1.0):
        axes.axhline(limit, color=BOUND, lw=0.9, ls=(0, (2, 2)))
    axes.set_ylim(-1.25, 1.25)
