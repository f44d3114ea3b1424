"""A run's folder: ``run.npz``, ``summary.json``, ``tracking.png`` and ``report.html``."""

from __future__ import annotations

from collections.abc import Sequence
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
    summary = summarize(run)
    save_tracking_figure(run, folder / FIGURE)
    write_report(run, folder / REPORT, robot=robot, scene=scene, summary=summary)
    summary |= {"report": str(folder / REPORT), "notes": list(scene.notes)}
    write_atomically(folder / SUMMARY, (to_json(summary) + "\n").encode())
    return summary


def find_report(run: Path, package_dirs: Sequence[str | Path] = ()) -> Path:
    """Return the report of a run's folder or ``run.npz``; written anew where it is not there.

    Args:
        run: The folder or file.
        package_dirs: Where its packages lie now, if not where they lay then.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    folder = run if run.is_dir() else run.parent
    report = folder / REPORT
    if not report.is_file() or not (folder / RUN).is_file():
        loaded = _load(run)
        write_report(loaded, report, robot=loaded.load_robot(package_dirs))
    return report


def write_comparison(paths: Sequence[Path], page: Path) -> Path:
    """Write the comparison of the runs of folders or ``run.npz`` files as one page.

    The runs are called as their folders or files are, numbered where these are alike.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    names = [_name(path.absolute()) for path in paths]
    if len(set(names)) < len(names):
        names = [f"{k}: {name}" for k, name in enumerate(names, 1)]
    return write_report([_load(path) for path in paths], page, names=names)


def _name(run: Path) -> str:
    if run.is_dir():
        return run.name
    return run.parent.name if run.name == RUN else run.stem


def _load(run: Path) -> Run:
    return Run.load(run / RUN if run.is_dir() else run)
