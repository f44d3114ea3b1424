"""A run's folder: ``run.npz``, ``summary.json``, ``tracking.png`` and ``report.html``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rpctl.errors import RpctlError
from rpctl.files.writing import to_json, write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.run import Run
from rpctl.simulation.summary import Summary, summarize
from rpctl.view.pages.report import write_report
from rpctl.view.plots.figures import save_tracking_figure
from rpctl.view.scene.robot_meshes import MAX_TRIANGLES
from rpctl.view.scene.scene import Scene, build_scene

RUN_FILE, SUMMARY_FILE, FIGURE_FILE, REPORT_FILE = (
    "run.npz",
    "summary.json",
    "tracking.png",
    "report.html",
)
MAX_REPORT_MB = 6.0  # of a report, unless the user says otherwise
BYTES_PER_MB = 1_000_000  # of a megabyte
REPORT_ATTEMPTS = 6  # at a report within its size
SIZE_TARGET_RATIO = (
    0.97  # fraction of the size limit aimed at: simplification misses its count a little
)


@dataclass(frozen=True)
class RunFolder:
    """What was written of a run.

    Attributes:
        summary: Its figures of merit.
        report: The report.
        report_bytes: Its size.
        notes: What could not be done, in sentences.
        perturbed: What became of the run with a perturbed plant, or None.
    """

    summary: Summary
    report: Path
    report_bytes: int
    notes: tuple[str, ...]
    perturbed: Mapping[str, Any] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as ``summary.json`` says it."""
        return {
            **self.summary.to_dict(),
            "perturbed": self.perturbed,
            "report": str(self.report),
            "report_bytes": self.report_bytes,
            "notes": self.notes,
        }


def write_folder(run: Run, folder: Path, megabytes: float = MAX_REPORT_MB) -> RunFolder:
    """Write all files of a run; each is there whole or not at all.

    Args:
        run: The run.
        folder: Where; made if it is not there.
        megabytes: What the report may take, MB; meshes are simplified until it does.

    Returns:
        The figures of merit, the report's path and size, and notes on what could not be done.

    Raises:
        RpctlError: The folder cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RpctlError(f"{folder}: cannot be made: {error.strerror or error}") from None
    run.save(folder / RUN_FILE)
    robot = run.load_robot()
    summary = summarize(run)
    save_tracking_figure(run, folder / FIGURE_FILE)
    report = folder / REPORT_FILE
    scene = _write_sized(run, robot, summary, report, megabytes)
    size, notes = report.stat().st_size, tuple(scene.notes)
    written = RunFolder(summary, report, size, notes, run.perturbed)
    write_atomically(folder / SUMMARY_FILE, (to_json(written.to_dict()) + "\n").encode())
    return written


def _write_sized(run: Run, robot: Robot, summary: Summary, path: Path, megabytes: float) -> Scene:
    """Write a report within a size, simplifying meshes until it fits or cannot become smaller."""
    triangles = MAX_TRIANGLES
    for _ in range(REPORT_ATTEMPTS):
        scene = build_scene(robot, run, triangles)
        write_report(run, path, robot=robot, scene=scene, summary=summary)
        excess = path.stat().st_size - megabytes * BYTES_PER_MB
        drawing = 4.0 / 3.0 * scene.robot_bytes  # as base64
        if excess <= 0.0 or not triangles:
            break
        triangles = int(SIZE_TARGET_RATIO * triangles * max(1.0 - excess / drawing, 0.0))
    if excess > 0.0:
        size = path.stat().st_size / BYTES_PER_MB
        note = f"the report takes {size:.2f} MB: fewer triangles make it hardly any smaller"
        scene = replace(scene, notes=(*scene.notes, note))
    return scene


def is_run(name: str) -> bool:
    """Return whether a path is a run: a folder that holds ``run.npz``, or an ``.npz``."""
    path = Path(name)
    return (path / RUN_FILE).is_file() or path.suffix == ".npz"


def report_source(
    runs: Sequence[Path], package_dirs: Sequence[str | Path] = ()
) -> Callable[[], bytes]:
    """Return a function that reads the report of one run or several, written first if missing.

    Args:
        runs: Their folders or ``run.npz`` files.
        package_dirs: Where packages are looked for besides where they were.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    if len(runs) == 1:
        return find_report(runs[0], package_dirs).read_bytes
    with TemporaryDirectory(prefix="rpctl-") as folder:
        content = write_comparison(runs, Path(folder) / REPORT_FILE).read_bytes()
    return lambda: content


def find_report(run: Path, package_dirs: Sequence[str | Path] = ()) -> Path:
    """Return the path of a run's report; it is written first if it is missing.

    Args:
        run: The folder or file.
        package_dirs: Where its packages lie now, if not where they lay then.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    folder = run if run.is_dir() else run.parent
    report = folder / REPORT_FILE
    if not report.is_file() or not (folder / RUN_FILE).is_file():
        loaded = load_run(run)
        robot = loaded.load_robot(package_dirs)
        _write_sized(loaded, robot, summarize(loaded), report, MAX_REPORT_MB)
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
    return write_report([load_run(path) for path in paths], page, names=names)


def _name(run: Path) -> str:
    if run.is_dir():
        return run.name
    return run.parent.name if run.name == RUN_FILE else run.stem


def load_run(run: Path) -> Run:
    """Load the run of a folder or ``run.npz``.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    return Run.load(run / RUN_FILE if run.is_dir() else run)
