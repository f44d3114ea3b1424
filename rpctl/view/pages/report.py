"""One self-contained HTML file that plays a run; it needs no server and no network."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.registry import name_of
from rpctl.errors import RpctlError
from rpctl.files.writing import write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.merits.collision_facts import Collision
from rpctl.simulation.merits.linear_loop import STILL, LoopPoles, loop_poles
from rpctl.simulation.merits.summary import Summary, summarize
from rpctl.simulation.run.run import Run
from rpctl.view.pages.motion_data import chart_data, overlay
from rpctl.view.pages.page import (
    Badge,
    Curve,
    LegendEntry,
    Section,
    asset,
    embed,
    policy,
    render_page,
)
from rpctl.view.pages.panel import (
    compare_legend,
    compare_panel,
    headline_badges,
    headline_rows,
    legend,
    panel,
    subtitle,
)
from rpctl.view.pages.settings import setting_text
from rpctl.view.pages.third_party import licences, meshcat_script, uplot_script
from rpctl.view.scene.scene import Scene, build_scene, compare_scene, node_prefix

STYLES = ("uplot/uPlot.min.css", "report.css", "charts.css")
SCRIPTS = ("chart_parts.js", "charts.js", "forces.js", "camera.js", "scene.js", "page.js")
THUMB_PX = 16  # width of the slider's thumb, whose middle stands at the time
TITLE = "Linear loop"
NO_SWING = 0.99  # damping of poles that are equal but for rounding
LOW_DAMPING = 0.4  # below it a loop overshoots by a quarter and swings on
HOW = (
    "Eigenvalues of the sampled loop, with efforts held for a control period, linearised about "
    "the reference at times when it moves. They hold for references that change slowly compared "
    "with them."
)


@dataclass(frozen=True)
class Page:
    """The content of a report.

    Attributes:
        title: What it is of.
        subtitle: A line about it.
        scene_label: What the scene shows.
        panel: What stands beside the scene.
        legend: Of the scene.
        scene: The scene.
        data: What the page's scripts need besides the scene.
        figures: The few figures that stand above everything else, with their labels.
        badges: Verdicts beside them.
        run: Digest of its run's file, if it is of one run and that is known.
        marks: On the timeline.
    """

    title: str
    subtitle: str
    scene_label: str
    panel: Sequence[Section]
    legend: Sequence[LegendEntry]
    scene: Scene
    data: Mapping[str, Any]
    figures: Sequence[tuple[str, str]] = ()
    badges: Sequence[Badge] = ()
    run: str = ""
    marks: Sequence[TimelineMark] = ()


@dataclass(frozen=True)
class TimelineMark:
    """When links ran into something: its place on the slider as CSS, and a sentence."""

    style: str
    text: str


def write_report(
    run: Run | Sequence[Run],
    path: str | Path,
    *,
    robot: Robot | None = None,
    scene: Scene | None = None,
    summary: Summary | None = None,
    names: Sequence[str] | None = None,
) -> Path:
    """Write the report of a run, or the comparison of several, as one HTML file, atomically.

    Args:
        run: The run; of several runs the first is drawn solid, the others translucent.
        path: The file.
        robot: The robot of a single run, if it is already loaded; else the run's own.
        scene: The scene of a single run, if it is already built.
        summary: The figures of merit of a single run; None: compute them.
        names: Names of several runs; None: names from their differences.

    Returns:
        The path.

    Raises:
        RpctlError: There is no run, the file cannot be written, or meshcat lacks its viewer.
    """
    runs = [run] if isinstance(run, Run) else list(run)
    if not runs:
        raise RpctlError("no run is given; give one or more")
    if len(runs) > 1:
        return write_atomically(path, comparison_page(runs, names or _names(runs)))
    found = robot or robot_of(runs[0])
    scene = scene or build_scene(found, runs[0])
    return write_atomically(path, report_page(runs[0], found, scene, summary or summarize(runs[0])))


def report_page(run: Run, robot: Robot | RpctlError, scene: Scene, summary: Summary) -> bytes:
    """Return the page of one run.

    Args:
        run: The run; where its digest is known, the page carries it.
        robot: Its robot, or why it cannot be had.
        scene: Its scene.
        summary: Its figures of merit.

    Raises:
        RpctlError: meshcat lacks its viewer.
    """
    collisions = summary.collisions if scene.duration > 0.0 else ()
    return page_bytes(
        Page(
            title=run.robot.name,
            subtitle=subtitle(run),
            scene_label=f"{run.robot.name} following its reference, in three dimensions",
            figures=headline_rows(run, summary),
            badges=headline_badges(run, summary),
            legend=legend(run, scene.stand_ins),
            panel=panel(run, summary, scene.notes, poles_section(run, robot)),
            scene=scene,
            data={
                **overlay(robot, run, scene.times),
                "plots": chart_data([run], [run.robot.name]),
            },
            run=run.digest or "",
            marks=[timeline_mark(each, float(run.t[0]), scene.duration) for each in collisions],
        )
    )


def comparison_page(
    runs: Sequence[Run],
    names: Sequence[str],
    robots: Sequence[Robot | RpctlError] = (),
) -> bytes:
    """Return the page of several runs.

    Args:
        runs: At least two.
        names: What they are called.
        robots: Their robots, or why these cannot be had; none loads them.

    Raises:
        RpctlError: There are more or fewer names than runs, or meshcat lacks its viewer.
    """
    if len(names) != len(runs):
        raise RpctlError(f"{len(runs)} runs, {len(names)} names; give a name for each run")
    scene = compare_scene(robots or [robot_of(run) for run in runs], runs)
    names_of_robots = " · ".join(dict.fromkeys(run.robot.name for run in runs))
    return page_bytes(
        Page(
            title=names_of_robots,
            subtitle=f"{len(runs)} runs: {' · '.join(names)}",
            scene_label=f"{len(runs)} runs of {names_of_robots}, in three dimensions",
            legend=compare_legend(runs, names, scene.stand_ins),
            panel=compare_panel(runs, names, [summarize(run) for run in runs], scene.notes),
            scene=scene,
            data={"plots": chart_data(runs, names)},
        )
    )


def robot_of(run: Run, package_dirs: Sequence[str | Path] = ()) -> Robot | RpctlError:
    """Return the robot of a run, or why it cannot be had: a run is shown without it, too.

    Args:
        run: The run.
        package_dirs: Where its packages or its file lie; see :meth:`rpctl.Run.load_robot`.
    """
    try:
        return run.load_robot(package_dirs)
    except RpctlError as error:
        return error


def report_policy() -> str:
    """Return the policy of the page of a run, which a page that holds it needs, too."""
    return policy(*_scripts())


def timeline_mark(collision: Collision, start: float, duration: float) -> TimelineMark:
    """Return the mark of a collision, as wide as that lasted.

    Args:
        collision: Of the run.
        start: The run's first time, s.
        duration: Of the timeline, s.
    """
    left = min(max((collision.first_time - start) / duration, 0.0), 1.0)
    width = min(max(collision.duration / duration, 0.0), 1.0 - left)
    style = (
        f"left:calc({0.5 * THUMB_PX:g}px + {left:.4f}*(100% - {THUMB_PX}px));"
        f"width:max(3px, {width:.4f}*(100% - {THUMB_PX}px))"
    )
    return TimelineMark(style, collision.sentence)


def _names(runs: Sequence[Run]) -> list[str]:
    """Return names that tell runs apart: what differs of robot, reference and laws, or numbers."""
    facts = [
        (
            run.robot.name,
            setting_text(run.config.run.reference),
            setting_text(name_of(run.config.kinematic)),
            setting_text(
                name_of(run.config.dynamic) if run.config.output is None else "velocity output"
            ),
        )
        for run in runs
    ]
    apart = [k for k, column in enumerate(zip(*facts, strict=True)) if len(set(column)) > 1]
    plain = [", ".join(fact[k] for k in apart or (0, 1)) for fact in facts]
    if len(set(plain)) == len(plain):
        return plain
    return [f"{k}: {name}" for k, name in enumerate(plain, 1)]


def page_bytes(page: Page) -> bytes:
    """Return a page as a file's bytes.

    Raises:
        RpctlError: meshcat lacks its viewer.
    """
    scene = page.scene
    shown = {
        "runs": [
            {"prefix": node_prefix(k), "duration": float(times[-1]), "frames": len(times)}
            for k, times in enumerate(scene.motions, 1)
        ],
        "duration": scene.duration,
        "hull": np.round(scene.hull, 3).tolist(),
        "start": scene.start.tolist(),
        "follow": scene.follow,
        "origin": scene.origin.tolist(),
        "commands": [base64.b64encode(command).decode() for command in scene.commands],
    }
    text = render_page(
        "report.html",
        title=f"{page.title} · rpctl",
        styles=STYLES,
        scripts=_scripts(),
        run=page.run,
        page=page,
        licences=licences(charts=True),
        data=embed({**shown, **page.data}),
    )
    return text.encode("utf-8", "backslashreplace")


def _scripts() -> tuple[str, str, str]:
    """Return the scripts of a report: meshcat's, uPlot's and its own."""
    own = '"use strict";\n(() => {\n' + "\n".join(map(asset, SCRIPTS)) + "})();\n"
    return meshcat_script(), uplot_script(), own


def poles_section(run: Run, robot: Robot | RpctlError) -> Section | None:
    """Return the section on the poles of a run's loop; None where its robot cannot be had."""
    if isinstance(robot, RpctlError):
        return None
    try:
        poles = loop_poles(run, robot)
    except RpctlError as error:
        return Section(TITLE, quiet=f"None: {error}.")
    stable = bool(poles.decay.min() > -STILL)
    return Section(
        TITLE,
        [Badge(stable, "stable" if stable else "unstable")],
        rows=[("Slowest pole", _slowest(poles)), ("Least damped", _least_damped(poles))],
        curve=_curve(poles.t, poles.decay),
        notes=[verdict(poles)],
        quiet=HOW,
    )


def verdict(poles: LoopPoles) -> str:
    """Return what a designer would say of the poles, in one sentence."""
    worst = float(poles.decay.min())
    if worst < -STILL:
        grown = poles.t[poles.decay < -STILL]
        return (
            f"Errors grow near the reference between {grown[0]:.3g} and {grown[-1]:.3g} s: other "
            "gains or a shorter control period are needed."
        )
    if worst < STILL:
        return (
            "One error does not decay: the law does not act on it while the reference moves "
            "like this."
        )
    if poles.damping.min() < LOW_DAMPING:
        return "Errors decay with several oscillations: more damping would help."
    return f"Errors decay at all times, the slowest by 63 % within {1.0 / worst:.3g} s."


def _slowest(poles: LoopPoles) -> str:
    k = int(poles.decay.argmin())
    shown = 0.0 if abs(poles.decay[k]) < STILL else -poles.decay[k]
    return f"{shown:.3g} 1/s at {poles.t[k]:.3g} s".replace("-", "−")


def _least_damped(poles: LoopPoles) -> str:
    k = int(poles.damping.argmin())
    if poles.damping[k] > NO_SWING:
        return "none oscillates"
    return f"damping ratio {poles.damping[k]:.2f} at {poles.t[k]:.3g} s"


def _curve(t: Array, decay: Array) -> Curve | None:
    """Return the slowest decay rate along the run, zero at its foot."""
    if len(t) < 2:
        return None
    top = max(float(decay.max()), STILL)
    across, up = (t - t[0]) / (t[-1] - t[0]), np.clip(decay, 0.0, None) / top
    label = f"Slowest decay rate from {t[0]:.3g} to {t[-1]:.3g} s, at most {top:.3g} 1/s"
    return Curve(label, list(zip(across.tolist(), up.tolist(), strict=True)))
