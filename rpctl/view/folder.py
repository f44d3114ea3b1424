"""A run's folder: ``run.npz``, ``summary.json``, ``tracking.png`` and ``report.html``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from rpctl.errors import RpctlError
from rpctl.files import to_json, write_atomically
from rpctl.simulation.run import Run
from rpctl.simulation.summary import summarize
from rpctl.view.plots import save_tracking_figure
from rpctl.view.report import write_report
from rpctl.view.scene import build_scene

RUN, SUMMARY, FIGURE, REPORT = "run.npz", "summary.json", "tracking.png", "report.html"


def write_folder(run: Run, folder: Path) -> dict[str, Any]:
    """Write all files of a run; each is there whole or not at all.

    Args:
        run: The run.
        folder: Where; made if it is not there.

    Returns:
        The figures of merit, with the report's path and notes on shapes that could not be drawn.

    Raises:
        RpctlError: The folder cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RpctlError(f"{folder}: cannot be made: {error.strerror or error}") from None
    run.save(folder / RUN)
    robot = run.load_robot()
    scene = build_scene(robot, run)
    estimated = sum(link.estimated for link in robot.description.links)
    if estimated:
        note = f"the inertias of {estimated} links are estimates at {run.density:g} kg/m³"
        scene = replace(scene, notes=(note, *scene.notes))
    summary = summarize(run)
    save_tracking_figure(run, folder / FIGURE)
    write_report(run, folder / REPORT, scene=scene, summary=summary)
    summary |= {"report": str(folder / REPORT), "notes": list(scene.notes)}
    write_atomically(folder / SUMMARY, (to_json(summary) + "\n").encode())
    return summary


def load_run(run: Path) -> Run:
    """Load the run of a folder or ``run.npz``.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    return Run.load(run / RUN if run.is_dir() else run)


def find_report(run: Path) -> Path:
    """Return the report of a run's folder or ``run.npz``; written anew where it is not there.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    folder = run if run.is_dir() else run.parent
    report = folder / REPORT
    if not report.is_file() or not (folder / RUN).is_file():
        write_report(load_run(run), report)
    return report
