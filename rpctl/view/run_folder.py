"""A run's folder: ``run.npz`` and what is made of it; each file says of which run it is.

``run.npz`` is written first. Whenever writing ends, each of the other files is of that run or says
that it is of another one, and :func:`find_faults` tells: nothing passes for what it is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from rpctl.errors import RpctlError
from rpctl.files.opening import open_input
from rpctl.files.writing import make_folder, to_json, write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.run import Run
from rpctl.simulation.summary import Summary, summarize
from rpctl.view.marks import JSON_KEY, digest, mark_of
from rpctl.view.pages.report import report_head, report_page
from rpctl.view.plots.figures import tracking_image
from rpctl.view.scene.robot_meshes import MAX_TRIANGLES
from rpctl.view.scene.scene import Scene, build_scene, redrawn

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
        digest: Digest of its ``run.npz``, which the others carry.
    """

    summary: Summary
    report: Path
    report_bytes: int
    notes: tuple[str, ...]
    perturbed: Mapping[str, Any] | None = None
    digest: str | None = None

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


class FileFault(NamedTuple):
    """A file of a run's folder that is not there, or not of that run.

    Attributes:
        name: Of the file.
        reason: What is wrong, in words that follow the name.
    """

    name: str
    reason: str

    def __str__(self) -> str:
        """Return the file and its fault."""
        return f"{self.name} {self.reason}"


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
    path = run.save(folder / RUN_FILE, precision)
    run = replace(run, digest=digest(path))
    for fault in find_faults(folder, run.digest or ""):
        if fault.name in MADE_FILES:
            (folder / fault.name).unlink(missing_ok=True)
    made = make_files(run, folder, run.load_robot(), megabytes)
    write_files(made)
    return made.folder


@dataclass(frozen=True, eq=False)
class MadeFiles:
    """What is made of a run, before it is written.

    Attributes:
        folder: What there is to say of it.
        content: The files, by their paths.
    """

    folder: RunFolder
    content: Mapping[Path, bytes]

    @property
    def report(self) -> bytes:
        """The report."""
        return self.content[self.folder.report]


def make_files(
    run: Run, folder: Path, robot: Robot | RpctlError, megabytes: float = MAX_REPORT_MB
) -> MadeFiles:
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
    return MadeFiles(made, content)


def write_files(made: MadeFiles) -> None:
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
    triangles, scene = MAX_TRIANGLES, build_scene(robot, run)
    page = report_page(run, robot, scene, summary)
    room = megabytes * BYTES_PER_MB - (len(page) - _encoded_size(scene))  # for the robot
    for _ in range(REPORT_ATTEMPTS):
        size = _encoded_size(scene)
        if size <= room or not triangles or isinstance(robot, RpctlError):
            break
        triangles = int(SIZE_TARGET_RATIO * triangles * max(room / size, 0.0))
        scene = redrawn(scene, robot, run, triangles)
    if triangles < MAX_TRIANGLES:
        page = report_page(run, robot, scene, summary)
    if len(page) > megabytes * BYTES_PER_MB:
        note = f"the report takes {len(page) / BYTES_PER_MB:.2f} MB: fewer triangles make it hardly"
        scene = replace(scene, notes=(*scene.notes, f"{note} any smaller"))
    return page, scene


def _encoded_size(scene: Scene) -> int:
    """Return the bytes that the robots of a scene take in a page, as base64."""
    return 4 * -(-scene.robot_bytes // 3)


def find_faults(folder: Path, run: str) -> list[FileFault]:
    """Return which files of a folder are missing or were made from another run than its own.

    Files that a user keeps there, and that do not say that they are made from a run, are not told.

    Args:
        folder: The folder.
        run: Digest of its ``run.npz``.
    """
    faults = []
    for name in dict.fromkeys((*MADE_FILES, *_names(folder))):
        path, made = folder / name, name in MADE_FILES
        mark = _mark(path)
        if made and not path.exists():
            faults.append(FileFault(name, "is missing"))
        elif mark is None and made:
            faults.append(FileFault(name, "does not say of which run it is"))
        elif mark is not None and mark != run:
            faults.append(FileFault(name, "is of another run"))
        elif name == REPORT_FILE and read_report(folder, run) is None:
            faults.append(FileFault(name, "was drawn by another version of rpctl"))
    return faults


def read_report(folder: Path, run: str) -> bytes | None:
    """Return the report in a folder, if this version of rpctl has drawn it of this run; else None.

    A report that somebody else wrote is shown only if it begins as ours do: with a policy that
    lets a browser run rpctl's scripts and no others.

    Args:
        folder: The folder.
        run: Digest of its ``run.npz``.
    """
    head = report_head(run)
    try:
        with open_input(folder / REPORT_FILE, "MAX_SHOWN_BYTES", "a report") as file:
            return head + file.read() if file.read(len(head)) == head else None
    except (RpctlError, OSError):
        return None


def _mark(path: Path) -> str | None:
    try:
        return mark_of(path)
    except (RpctlError, OSError):
        return None


def _names(folder: Path) -> Iterator[str]:
    """Yield the files of a folder that may say of which run they are."""
    with_room = (p.name for p in sorted(folder.iterdir()) if p.suffix.lower() in MARKED_SUFFIXES)
    for name, _ in zip(with_room, range(MAX_LOOKED_AT), strict=False):
        yield name
