"""A run's folder: ``run.npz`` and what is made of it; each file says of which run it is.

``run.npz`` is written first. Whenever writing ends, each of the other files is of that run or says
that it is of another one, and :func:`find_faults` tells: nothing passes for what it is not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rpctl.errors import RpctlError
from rpctl.files.caps import is_file, is_folder
from rpctl.files.writing import make_folder, to_json, write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.merits.summary import Summary, summarize
from rpctl.simulation.run.part import PART_FOLDER, is_part
from rpctl.simulation.run.run import Run
from rpctl.view.labels import JSON_KEY, digest, mark_of
from rpctl.view.pages.report import comparison_page, report_page, robot_of
from rpctl.view.plots.figures import tracking_image
from rpctl.view.scene.robot_meshes import MAX_TRIANGLES
from rpctl.view.scene.scene import Scene, build_scene

RUN_FILE, SUMMARY_FILE, FIGURE_FILE, REPORT_FILE = (
    "run.npz",
    "summary.json",
    "tracking.png",
    "report.html",
)
MADE_FILES = (SUMMARY_FILE, FIGURE_FILE, REPORT_FILE)  # that every run's folder has
MARKED_SUFFIXES = (".json", ".png", ".pdf", ".gif", ".mp4", ".html")  # of files that may be marked
MAX_LOOKED_AT = 200  # files of a folder whose marks are read
MAX_REPORT_MB = 6.0  # of a report, unless the user says otherwise
BYTES_PER_MB = 1_000_000  # of a megabyte
SHRINK_RATIO = 0.5  # of a robot's triangles, from one attempt at a smaller report to the next
MIN_TRIANGLES = 1000  # of a whole robot: fewer make no smaller report

Say = Callable[[str], object]


@dataclass(frozen=True)
class RunFolder:
    """What was written of a run.

    Attributes:
        summary: Its figures of merit.
        report: The report.
        report_bytes: Its size.
        notes: What could not be done, in sentences.
        perturbed: What became of the run with a perturbed plant, or None.
        digest: Digest of its ``run.npz``, which the others carry.
        content: The files by their paths, until they are written.
    """

    summary: Summary
    report: Path
    report_bytes: int
    notes: tuple[str, ...]
    perturbed: Mapping[str, Any] | None = None
    digest: str | None = None
    content: Mapping[Path, bytes] = field(default_factory=dict, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as ``summary.json`` says it."""
        return {
            JSON_KEY: self.digest,
            **self.summary.to_dict(),
            "perturbed": self.perturbed,
            "report": str(self.report),
            "report_bytes": self.report_bytes,
            "notes": self.notes,
        }


def write_folder(
    run: Run, folder: Path, megabytes: float = MAX_REPORT_MB, precision: str = "double"
) -> RunFolder:
    """Write all files of a run; each is there whole or not at all, the run itself first.

    Files that were made from an earlier run are removed once the new one is there. Others, as
    pictures of a film or a configuration, stay.

    Args:
        run: The run.
        folder: Where; made if it is not there.
        megabytes: What the report may take, MB; meshes are simplified until it does.
        precision: Of the run's file, see :meth:`rpctl.Run.save`; all else is made of the run.

    Returns:
        The figures of merit, the report's path and size, and notes on what could not be done.

    Raises:
        RpctlError: The folder cannot be made or written to.
    """
    make_folder(folder)
    run = replace(run, digest=digest(run.save(folder / RUN_FILE, precision)))
    for name in find_faults(folder, run.digest or "").keys() & set(MADE_FILES):
        (folder / name).unlink(missing_ok=True)
    made = make_files(run, folder, run.load_robot(), megabytes)
    write_files(made)
    return made


def make_files(
    run: Run, folder: Path, robot: Robot | RpctlError, megabytes: float = MAX_REPORT_MB
) -> RunFolder:
    """Return what is made of a run that is in its folder already; nothing is written.

    Args:
        run: The run, with the digest of its file.
        folder: The folder.
        robot: The robot of the run, or why it cannot be had.
        megabytes: What the report may take, MB.
    """
    summary = summarize(run)
    report, scene = sized_report(run, robot, summary, megabytes)
    path, notes = folder / REPORT_FILE, tuple(scene.notes)
    made = RunFolder(summary, path, len(report), notes, run.perturbed, run.digest)
    content = {
        folder / SUMMARY_FILE: (to_json(made.to_dict()) + "\n").encode(),
        folder / FIGURE_FILE: tracking_image(run),
        path: report,
    }
    return replace(made, content=content)


def write_files(made: RunFolder) -> None:
    """Write what is made of a run. Links in the folder are replaced, not written through.

    Raises:
        RpctlError: The folder cannot be written to.
    """
    for path, content in made.content.items():
        write_atomically(path, content, follow_links=False)


def sized_report(
    run: Run, robot: Robot | RpctlError, summary: Summary, megabytes: float = MAX_REPORT_MB
) -> tuple[bytes, Scene]:
    """Return a report within a size: meshes are simplified until it fits or cannot become smaller.

    Args:
        run: The run.
        robot: Its robot, or why it cannot be had.
        summary: Its figures of merit.
        megabytes: The size, MB.
    """
    triangles = MAX_TRIANGLES
    while True:
        scene = build_scene(robot, run, triangles)
        page = report_page(run, robot, scene, summary)
        if len(page) <= megabytes * BYTES_PER_MB:
            return page, scene
        if triangles < MIN_TRIANGLES or isinstance(robot, RpctlError):
            break
        triangles = int(SHRINK_RATIO * triangles)
    note = (
        f"the report takes {len(page) / BYTES_PER_MB:.2f} MB: with fewer triangles it would be "
        "hardly"
    )
    return page, replace(scene, notes=(*scene.notes, f"{note} any smaller"))


def find_faults(folder: Path, run: str) -> dict[str, str]:
    """Return what is wrong with files of a folder, by name, in words that follow the name.

    They are missing, or were made from another run than the folder's own.

    Files that a user keeps there, and that do not say that they are made from a run, are not told.

    Args:
        folder: The folder.
        run: Digest of its ``run.npz``.
    """
    faults = {}
    marked = sorted(p.name for p in folder.iterdir() if p.suffix.lower() in MARKED_SUFFIXES)
    for name in dict.fromkeys((*MADE_FILES, *marked[:MAX_LOOKED_AT])):
        path, made, mark = folder / name, name in MADE_FILES, None
        with suppress(RpctlError, OSError):
            mark = mark_of(path)
        if made and not path.exists():
            faults[name] = "is missing"
        elif mark is None and made:
            faults[name] = "does not say which run it belongs to"
        elif mark is not None and mark != run:
            faults[name] = "belongs to another run"
    return faults


# ---- a run as ``rpctl view`` shows it ----------------------------------------


def is_run(name: str) -> bool:
    """Return whether a path is a run: a folder that holds one, an ``.npz``, or a part of one."""
    path = Path(name)
    held = is_file(path / RUN_FILE) or is_part(path / PART_FOLDER)
    return held or path.suffix == ".npz" or is_part(path)


def open_run(path: Path, say: Say = lambda note: None) -> tuple[Run, Path | None]:
    """Open the run of a folder, of a ``run.npz``, or of the part that a simulation has left.

    Of a folder that holds a part that is newer than its run, the part is shown. A part is older
    where the simulation had ended, and rpctl was stopped while it drew.

    Args:
        path: A folder, a ``run.npz``, or a part.
        say: Called with what the user should know of it.

    Returns:
        The run; the folder whose files are made from it, None where it lies alone, or is a part.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    part, file = path if is_part(path) else path / PART_FOLDER, path / RUN_FILE
    if is_part(part) and not (is_file(file) and _changed(part) <= file.stat().st_mtime_ns):
        run = Run.load(part)
        said = run.notes[-1] if run.notes else f"it reaches t = {float(run.t[-1]):.4g} s"
        say(f"{part}: {said}")
        if file.is_file():
            say(f"{file} belongs to an earlier simulation and is unchanged")
        return run, None
    file = file if is_folder(path) else path
    run = replace(Run.load(file), digest=digest(file))
    return run, file.parent if file.name == RUN_FILE else None


def load_run(path: Path, say: Say = lambda note: None) -> Run:
    """Load the run that :func:`open_run` opens; see there."""
    return open_run(path, say)[0]


def _changed(folder: Path) -> int:
    """Return when a folder or a file in it was changed last, ns."""
    return max(each.stat().st_mtime_ns for each in (folder, *folder.iterdir()))


class RunPage:
    """The page of a run, drawn again when the run changes.

    Args:
        path: The run: a folder, a ``run.npz``, or a part.
        package_dirs: Where its packages or its robot's file lie.
        say: Called with what is missing and what is drawn.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """

    def __init__(
        self,
        path: Path,
        package_dirs: Sequence[str | Path] = (),
        say: Say = lambda note: None,
    ) -> None:
        self._path, self._package_dirs, self._say = path, package_dirs, say
        self._content, self._state = b"", self._look()
        self._content = self._make()

    def __call__(self) -> bytes:
        """Return the page."""
        state = self._look()
        if state != self._state:
            self._content, self._state = self._make(), state
        return self._content

    def _look(self) -> tuple[int, int]:
        """Return what changes when the run is written again."""
        file = self._path / RUN_FILE if self._path.is_dir() else self._path
        try:
            found = file.stat()
        except OSError:
            return 0, 0  # a part, or gone
        return found.st_mtime_ns, found.st_size

    def _make(self) -> bytes:
        """Draw the report, and what is missing beside it; what lies there is never shown.

        Raises:
            RunFileError: There is no run, or it cannot be read.
        """
        run, folder = open_run(self._path, self._say)
        faults = {} if folder is None else find_faults(folder, run.digest or "")
        if faults:
            self._say(f"{folder}: {', '.join(map(' '.join, faults.items()))}")
        if folder is None or faults.keys().isdisjoint(MADE_FILES):
            return sized_report(run, self._robot(run), summarize(run))[0]
        made = make_files(run, folder, self._robot(run))
        try:
            write_files(made)
        except RpctlError as error:
            self._say(f"{error}; rpctl shows the report without saving it")
        else:
            self._say(f"{folder}: rpctl draws {', '.join(MADE_FILES)} again")
        return made.content[made.report]

    def _robot(self, run: Run) -> Robot | RpctlError:
        robot = robot_of(run, self._package_dirs)
        if isinstance(robot, RpctlError):
            self._say(f"rpctl cannot draw the robot: {robot}")
        return robot


def comparison(
    paths: Sequence[Path],
    package_dirs: Sequence[str | Path] = (),
    say: Say = lambda note: None,
) -> bytes:
    """Return the page of several runs, called as their folders or files are, numbered where alike.

    Args:
        paths: At least two; see :func:`open_run`.
        package_dirs: Where their packages or their robots' files lie.
        say: Called with what the user should know of them.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    names = [_name(path.absolute()) for path in paths]
    if len(set(names)) < len(names):
        names = [f"{k}: {name}" for k, name in enumerate(names, 1)]
    runs = [load_run(path, say) for path in paths]
    robots = [robot_of(run, package_dirs) for run in runs]
    for name, robot in zip(names, robots, strict=True):
        if isinstance(robot, RpctlError):
            say(f"{name}: rpctl cannot draw the robot: {robot}")
    return comparison_page(runs, names, robots)


def _name(run: Path) -> str:
    if run.name in (RUN_FILE, PART_FOLDER):
        return run.parent.name
    return run.name if is_folder(run) else run.stem
