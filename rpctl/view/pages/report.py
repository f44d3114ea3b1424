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
from rpctl.view.pages.summary_panel import headline, legend, panel, setting_text, subtitle
from rpctl.view.pages.third_party import licences_html, meshcat_script, uplot_script
from rpctl.view.scene.scene import Scene, build_scene

STYLES = ("uplot/uPlot.min.css", "palette.css", "report.css", "charts.css")
SCRIPTS = ("limit_lines.js", "charts.js", "forces.js", "scene.js", "page.js")


@dataclass(frozen=True)
class Page:
    """The content of a report; all texts but ``title`` and ``scene_label`` are HTML already."""

    title: str
    subtitle: str
    scene_label: str
    figures: str
    legend: str
    panel: str
    duration: float
    data: Mapping[str, Any]


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
        RpctlError: The robot of a run cannot be loaded, there is no run, or meshcat lacks its
            viewer.
    """
    runs = [run] if isinstance(run, Run) else list(run)
    if not runs:
        raise RpctlError("there is no run to report on; give one or several")
    if len(runs) > 1:
        page = compare(runs, names or _names(runs))
    else:
        robot = robot or runs[0].load_robot()
        scene = scene or build_scene(robot, runs[0])
        page = single(runs[0], robot, scene, summary or summarize(runs[0]))
    return write_atomically(path, _render(page).encode("utf-8", "backslashreplace"))


def single(run: Run, robot: Robot, scene: Scene, summary: Summary) -> Page:
    """Return the content of the page of one run.

    Args:
        run: The run.
        robot: Its robot.
        scene: Its scene.
        summary: Its figures of merit.
    """
    return Page(
        title=run.robot.name,
        subtitle=subtitle(run),
        scene_label=f"{run.robot.name} following its reference, in three dimensions",
        figures=headline(run, summary),
        legend=legend(run, scene.stand_ins),
        panel=panel(run, summary, scene.notes),
        duration=scene.duration,
        data={
            **_scene_data([scene], scene),
            **overlay(robot, run, scene.times),
            "plots": chart_data([run], [run.robot.name]),
        },
    )


def compare(runs: Sequence[Run], names: Sequence[str]) -> Page:
    """Return the content of the page of several runs.

    Raises:
        RpctlError: There are more or fewer names than runs.
    """
    if len(names) != len(runs):
        raise RpctlError(f"{len(runs)} runs, {len(names)} names; give a name for each run")
    scenes = [build_scene(run.load_robot(), run) for run in runs]
    scene = merge(runs, scenes)
    robots = " · ".join(dict.fromkeys(run.robot.name for run in runs))
    return Page(
        title=robots,
        subtitle=escape(f"{len(runs)} runs: " + " · ".join(names)),
        scene_label=f"{len(runs)} runs of {robots}, in three dimensions",
        figures="",
        legend=compare_legend(runs, names, scene.stand_ins),
        panel=compare_panel(runs, names, [summarize(run) for run in runs], scene.notes),
        duration=scene.duration,
        data={**_scene_data(scenes, scene), "plots": chart_data(runs, names)},
    )


def _names(runs: Sequence[Run]) -> list[str]:
    """Return names that tell runs apart: what differs of robot, reference and laws, or numbers."""
    facts = [
        (
            run.robot.name,
            setting_text(run.config.run.reference),
            setting_text(name_of(run.config.kinematic)),
            setting_text(name_of(run.config.dynamic)),
        )
        for run in runs
    ]
    apart = [k for k, column in enumerate(zip(*facts, strict=True)) if len(set(column)) > 1]
    plain = [", ".join(fact[k] for k in apart or (0, 1)) for fact in facts]
    if len(set(plain)) == len(plain):
        return plain
    return [f"{k}: {name}" for k, name in enumerate(plain, 1)]


def _render(page: Page) -> str:
    meshcat, uplot = meshcat_script(), uplot_script()
    script = '"use strict";\n(() => {\n' + "\n".join(map(asset, SCRIPTS)) + "})();\n"
    return Template(asset("template.html")).substitute(
        policy=policy(meshcat, uplot, script),
        title=f"{escape(page.title)} · rpctl",
        css="".join(map(asset, STYLES)),
        name=escape(page.title),
        subtitle=page.subtitle,
        scene_label=escape(page.scene_label),
        figures=page.figures,
        duration=f"{page.duration:.6f}",
        legend=page.legend,
        panel=page.panel,
        licences=licences_html(charts=True),
        data=embed(page.data),
        meshcat=meshcat,
        uplot=uplot,
        script=script,
    )


def _scene_data(scenes: Sequence[Scene], scene: Scene) -> dict[str, Any]:
    """Return the page's data of the runs' scenes and of the scene merged from them."""
    return {
        "runs": [
            {
                "prefix": f"run{k}-" if k > 1 else "",
                "duration": each.duration,
                "frames": len(each.times),
            }
            for k, each in enumerate(scenes, 1)
        ],
        "duration": scene.duration,
        "hull": np.round(scene.hull, 3).tolist(),
        "start": scene.start.tolist(),
        "follow": scene.follow,
        "origin": scene.origin.tolist(),
        "commands": [base64.b64encode(command).decode() for command in scene.commands],
    }
