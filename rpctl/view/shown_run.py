"""A run as ``rpctl view`` shows it: which motion, what is missing beside it, and its page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rpctl.errors import RpctlError
from rpctl.files.opening import is_file, is_folder
from rpctl.robot.model import Robot
from rpctl.simulation.part import is_part
from rpctl.simulation.run import Run
from rpctl.simulation.spool import PART_FOLDER
from rpctl.simulation.summary import summarize
from rpctl.view.marks import digest
from rpctl.view.pages.report import comparison_page, robot_of
from rpctl.view.run_folder import (
    MADE_FILES,
    RUN_FILE,
    find_faults,
    make_files,
    read_report,
    sized_report,
    write_files,
)

Say = Callable[[str], object]


@dataclass(frozen=True)
class ShownRun:
    """A run, and where it lies.

    Attributes:
        run: The run.
        folder: The folder whose files are made from it; None where it lies alone, or is the part
            of a simulation.
        notes: What the user should know of it, in sentences.
    """

    run: Run
    folder: Path | None
    notes: tuple[str, ...] = ()


def is_run(name: str) -> bool:
    """Return whether a path is a run: a folder that holds one, an ``.npz``, or a part of one."""
    path = Path(name)
    held = is_file(path / RUN_FILE) or is_part(path / PART_FOLDER)
    return held or path.suffix == ".npz" or is_part(path)


def open_run(path: Path) -> ShownRun:
    """Open the run of a folder, of a ``run.npz``, or of the part that a simulation has left.

    Of a folder that holds a part that is newer than its run, the part is shown. A part is older
    where the simulation had ended, and rpctl was stopped while it drew.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    if is_part(path):
        return _part(path, ())
    part, file = path / PART_FOLDER, path / RUN_FILE
    if is_part(part) and not (is_file(file) and _changed(part) <= file.stat().st_mtime_ns):
        older = (f"{file} is of an earlier simulation and stays as it is",) * file.is_file()
        return _part(part, older)
    file = file if is_folder(path) else path
    run = replace(Run.load(file), digest=digest(file))
    return ShownRun(run, file.parent if file.name == RUN_FILE else None)


def load_run(path: Path, say: Say = lambda note: None) -> Run:
    """Load the run that :func:`open_run` opens.

    Args:
        path: A folder, a ``run.npz``, or a part.
        say: Called with what the user should know of it.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    shown = open_run(path)
    for note in shown.notes:
        say(note)
    return shown.run


def _part(part: Path, notes: tuple[str, ...]) -> ShownRun:
    run = Run.load(part)
    said = run.notes[-1] if run.notes else f"it reaches t = {float(run.t[-1]):.4g} s"
    return ShownRun(run, None, (f"{part}: {said}", *notes))


def _changed(folder: Path) -> int:
    """Return when a folder or a file in it was changed last, ns."""
    return max(each.stat().st_mtime_ns for each in (folder, *folder.iterdir()))


class RunPage:
    """The page of a run, drawn where there is none of this run, and again when the run changes.

    Args:
        path: The run: a folder, a ``run.npz``, or a part.
        package_dirs: Where its packages or its robot's file lie.
        expand: Whether a .xacro may be evaluated, where the run does not hold its robot.
        say: Called with what is missing and what is drawn.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """

    def __init__(
        self,
        path: Path,
        package_dirs: Sequence[str | Path] = (),
        expand: bool = False,
        say: Say = lambda note: None,
    ) -> None:
        self._path, self._package_dirs, self._expand, self._say = path, package_dirs, expand, say
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
        """Return the report that is there, if it is one of this run; else draw and keep it.

        Raises:
            RunFileError: There is no run, or it cannot be read.
        """
        shown = open_run(self._path)
        run, folder = shown.run, shown.folder
        for note in shown.notes:
            self._say(note)
        if folder is None or run.digest is None:
            return sized_report(run, self._robot(run), summarize(run))[0]
        faults = find_faults(folder, run.digest)
        if faults:
            self._say(f"{folder}: {', '.join(map(str, faults))}")
        stored = read_report(folder, run.digest)
        if stored is not None and not any(fault.name in MADE_FILES for fault in faults):
            return stored
        made = make_files(run, folder, self._robot(run))
        try:
            write_files(made)
        except RpctlError as error:
            self._say(f"{error}; the report is shown, and not kept")
        else:
            self._say(f"{folder}: {', '.join(MADE_FILES)} are drawn again")
        return made.report

    def _robot(self, run: Run) -> Robot | RpctlError:
        robot = robot_of(run, self._package_dirs, self._expand)
        if isinstance(robot, RpctlError):
            self._say(f"the robot cannot be drawn: {robot}")
        return robot


def comparison(
    paths: Sequence[Path],
    package_dirs: Sequence[str | Path] = (),
    expand: bool = False,
    say: Say = lambda note: None,
) -> bytes:
    """Return the page of several runs, called as their folders or files are, numbered where alike.

    Args:
        paths: At least two; see :func:`open_run`.
        package_dirs: Where their packages or their robots' files lie.
        expand: Whether a .xacro may be evaluated, where a run does not hold its robot.
        say: Called with what the user should know of them.

    Raises:
        RunFileError: There is no run, or it cannot be read.
    """
    names = [_name(path.absolute()) for path in paths]
    if len(set(names)) < len(names):
        names = [f"{k}: {name}" for k, name in enumerate(names, 1)]
    runs = [load_run(path, say) for path in paths]
    robots = [robot_of(run, package_dirs, expand) for run in runs]
    for name, robot in zip(names, robots, strict=True):
        if isinstance(robot, RpctlError):
            say(f"{name}: the robot cannot be drawn: {robot}")
    return comparison_page(runs, names, robots)


def _name(run: Path) -> str:
    if run.name in (RUN_FILE, PART_FOLDER):
        return run.parent.name
    return run.name if is_folder(run) else run.stem
