"""One self-contained HTML file that plays a run; it needs no server and no network."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from rpctl.control.unregistered import name_of
from rpctl.errors import RpctlError
from rpctl.files.writing import write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.run import Run
from rpctl.simulation.summary import Summary, summarize
from rpctl.view.pages.chart_data import chart_data
from rpctl.view.pages.compare import compare_legend, compare_panel, merge
from rpctl.view.pages.forces import overlay
from rpctl.view.pages.page import asset, embed, escape, policy
from rpctl.view.pages.poles import poles_section
from rpctl.view.pages.summary_panel import headline, legend, panel, setting_text, subtitle
from rpctl.view.pages.third_party import licences_html, meshcat_script, uplot_script
from rpctl.view.pages.timeline import timeline_marks
from rpctl.view.scene.scene import Scene, build_scene, node_prefix

STYLES = ("uplot/uPlot.min.css", "palette.css", "report.css", "charts.css")
MARK_TAG = '<meta name="rpctl-run" content="$run">'  # of the template, right after the policy
SCRIPTS = ("limit_lines.js", "charts.js", "forces.js", "scene.js", "page.js")


@dataclass(frozen=True)
class Page:
    """The content of a report; all texts but ``title`` and ``scene_label`` are HTML already.

    ``run`` is the digest of its run's file, if it is of one run and that is known.
    """

    title: str
    subtitle: str
    scene_label: str
    figures: str
    legend: str
    panel: str
    duration: float
    data: Mapping[str, Any]
    run: str = ""
    marks: str = ""


def write_report(
    run: Run | Sequence[Run],
    path: str | Path,
    *,
    robot: Robot | None = None,
    scene: Scene | None = None,
    summary: Summary | None = None,
    names: Sequence[str] | None = None,
) -> Path:
    """Write the report of a run, or the comparison of several: one HTML file, whole or not at all.

    Args:
        run: The run; several are shown over one another, the first as it is, others as ghosts.
        path: The file.
        robot: The robot of a single run, where it is loaded already.
        scene: The scene of a single run, where it is built already.
        summary: The figures of merit of a single run; None computes them.
        names: What several runs are called; None tells them apart by what differs.

    Returns:
        The path.

    Raises:
        RpctlError: There is no run, or meshcat lacks its viewer.
    """
    runs = [run] if isinstance(run, Run) else list(run)
    if not runs:
        raise RpctlError("there is no run to report on; give one or several")
    if len(runs) > 1:
        return write_atomically(path, comparison_page(runs, names or _names(runs)))
    found = robot or robot_of(runs[0])
    scene = scene or build_scene(found, runs[0])
    page = report_page(runs[0], found, scene, summary or summarize(runs[0]))
    return write_atomically(path, page)


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
    return page_bytes(single(run, robot, scene, summary))


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
    return page_bytes(compare(runs, names, robots or [robot_of(run) for run in runs]))


def robot_of(
    run: Run, package_dirs: Sequence[str | Path] = (), expand: bool = False
) -> Robot | RpctlError:
    """Return the robot of a run, or why it cannot be had: a run is shown without it, too.

    Args:
        run: The run.
        package_dirs: Where its packages or its file lie; see :meth:`rpctl.Run.load_robot`.
        expand: Whether a .xacro may be evaluated, where the run does not hold its robot.
    """
    try:
        return run.load_robot(package_dirs, expand)
    except RpctlError as error:
        return error


def report_head(digest: str) -> bytes:
    """Return how the page of a run begins if this version of rpctl has drawn it.

    That is all up to its policy and its run's digest. After this policy a browser runs no script
    but rpctl's, whatever else the page holds.

    Args:
        digest: Of the run's file.
    """
    head, mark, _ = asset("template.html").partition(MARK_TAG)
    return Template(head + mark).substitute(policy=report_policy(), run=escape(digest)).encode()


def report_policy() -> str:
    """Return the policy of the page of a run, which a page that holds it needs, too."""
    return policy(*_scripts())


def single(run: Run, robot: Robot | RpctlError, scene: Scene, summary: Summary) -> Page:
    """Return the content of the page of one run.

    Args:
        run: The run.
        robot: Its robot, or why it cannot be had.
        scene: Its scene.
        summary: Its figures of merit.
    """
    return Page(
        title=run.robot.name,
        subtitle=subtitle(run),
        scene_label=f"{run.robot.name} following its reference, in three dimensions",
        figures=headline(run, summary),
        legend=legend(run, scene.stand_ins),
        panel=panel(run, summary, scene.notes, poles_section(run, robot)),
        duration=scene.duration,
        data={
            **scene_data([scene], scene),
            **overlay(robot, run, scene.times),
            "plots": chart_data([run], [run.robot.name]),
        },
        run=run.digest or "",
        marks=timeline_marks(summary.collisions, float(run.t[0]), scene.duration),
    )


def compare(
    runs: Sequence[Run], names: Sequence[str], robots: Sequence[Robot | RpctlError]
) -> Page:
    """Return the content of the page of several runs.

    Args:
        runs: The runs.
        names: What they are called.
        robots: Their robots, or why these cannot be had.

    Raises:
        RpctlError: There are more or fewer names than runs.
    """
    if len(names) != len(runs):
        raise RpctlError(f"{len(runs)} runs, {len(names)} names; give a name for each run")
    scenes = [build_scene(robot, run) for robot, run in zip(robots, runs, strict=True)]
    scene = merge(runs, scenes)
    names_of_robots = " · ".join(dict.fromkeys(run.robot.name for run in runs))
    return Page(
        title=names_of_robots,
        subtitle=escape(f"{len(runs)} runs: " + " · ".join(names)),
        scene_label=f"{len(runs)} runs of {names_of_robots}, in three dimensions",
        figures="",
        legend=compare_legend(runs, names, scene.stand_ins),
        panel=compare_panel(runs, names, [summarize(run) for run in runs], scene.notes),
        duration=scene.duration,
        data={**scene_data(scenes, scene), "plots": chart_data(runs, names)},
    )


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
    """Return a page as a file's bytes."""
    return _render(page).encode("utf-8", "backslashreplace")


def _render(page: Page) -> str:
    meshcat, uplot, script = _scripts()
    return Template(asset("template.html")).substitute(
        policy=policy(meshcat, uplot, script),
        run=escape(page.run),
        title=f"{escape(page.title)} · rpctl",
        css="".join(map(asset, STYLES)),
        name=escape(page.title),
        subtitle=page.subtitle,
        scene_label=escape(page.scene_label),
        figures=page.figures,
        duration=f"{page.duration:.6f}",
        marks=page.marks,
        legend=page.legend,
        panel=page.panel,
        licences=licences_html(charts=True),
        data=embed(page.data),
        meshcat=meshcat,
        uplot=uplot,
        script=script,
    )


def _scripts() -> tuple[str, str, str]:
    """Return the scripts of a report: meshcat's, uPlot's and its own."""
    own = '"use strict";\n(() => {\n' + "\n".join(map(asset, SCRIPTS)) + "})();\n"
    return meshcat_script(), uplot_script(), own


def scene_data(scenes: Sequence[Scene], scene: Scene) -> dict[str, Any]:
    """Return the page's data of the runs' scenes and of the scene merged from them."""
    return {
        "runs": [
            {"prefix": node_prefix(k), "duration": each.duration, "frames": len(each.times)}
            for k, each in enumerate(scenes, 1)
        ],
        "duration": scene.duration,
        "hull": np.round(scene.hull, 3).tolist(),
        "start": scene.start.tolist(),
        "follow": scene.follow,
        "origin": scene.origin.tolist(),
        "commands": [base64.b64encode(command).decode() for command in scene.commands],
    }
