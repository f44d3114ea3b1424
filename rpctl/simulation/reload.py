"""The robot of a run, from what the run holds: nothing is evaluated, no stored folder is used."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from glob import escape
from pathlib import Path

from rpctl.description.expansion import is_xacro
from rpctl.description.packages import require_folders
from rpctl.description.records import Description
from rpctl.description.urdf import parse, read
from rpctl.errors import RpctlError, RunFileError
from rpctl.files.opening import read_source
from rpctl.robot.load import assemble
from rpctl.robot.model import Robot
from rpctl.robot.names import find_source
from rpctl.robot.payload import with_payload
from rpctl.robot.source import Source
from rpctl.simulation.facts import RobotFacts, urdf_bytes

MAX_NAME = 255  # bytes of a file's name
NOWHERE = Path("/nonexistent")  # Debian keeps it free: no mesh and no package lies around it


def load_robot(
    known: RobotFacts, package_dirs: Sequence[str | Path] = (), expand: bool = False
) -> Robot:
    """Return the robot of a run.

    Its URDF is the one that the run holds. What lies around the robot's file, as meshes do, is used
    only if that file is there and is, byte for byte, the one of the run: who sends a run can name
    any path in it, but does not know what lies there. A run that holds no URDF needs the file.

    Args:
        known: What the run holds of its robot.
        package_dirs: Packages, or folders that hold packages, or the folder where the robot's file
            lies now. Folders that the run names are not used.
        expand: Whether a .xacro may be evaluated, where the run holds no URDF.

    Raises:
        RunFileError: The run holds no URDF, and its file is not there, has changed, or is xacro.
        RpctlError: The robot cannot be built.
    """
    folders = require_folders(package_dirs)
    source, data = next(_unchanged(known, folders), (None, b""))
    if known.urdf is not None:
        source = source or Source((*folders, NOWHERE)[0] / _file_name(known))
        description = _kept(known, source.path)
    elif source is not None:
        description = parse(source.path, data)
    else:
        source, description = _expanded(known, folders, expand)
    settings = source.read_settings(folders, known.xacro_args, known.ignore_missing_packages)
    robot = assemble(
        source,
        replace(description, read_with=settings),
        known.drive,
        {escape(name): position for name, position in known.locked.items()},
        known.density,
        known.end_effector,
        home=dict(known.home) or "zero",  # as it was before runs kept it
        free="*",  # nothing but what was locked
        losses=known.losses,
        armature=False if known.armature is None else known.armature,
    )
    for payload in known.payloads:
        robot = with_payload(robot, *payload)
    return replace(robot, name=known.name, source=known.source)


def has_surroundings(robot: Robot) -> bool:
    """Return whether the file of a robot is known to be there, so that its meshes may be, too."""
    return robot.description.path.parent != NOWHERE


def _unchanged(known: RobotFacts, folders: Sequence[Path]) -> Iterator[tuple[Source, bytes]]:
    """Yield the robot's file, where it is there and has the run's digest, and its bytes."""
    digest = known.file_sha256 or known.urdf_sha256
    for source in _places(known, folders):
        try:
            data = read_source(source.path)
        except RpctlError:
            continue
        if hashlib.sha256(data).hexdigest() == digest:
            yield source, data


def _places(known: RobotFacts, folders: Sequence[Path]) -> Iterator[Source]:
    """Yield where the robot's file may lie: where it lay, and in folders that the user declares."""
    path = Path(known.source)
    if path.is_absolute():
        yield Source(path)
    elif len(path.parts) == 1:
        with suppress(RpctlError, OSError):  # a name that is not known here, or none at all
            yield find_source(known.source)
    for folder in folders:
        yield Source(folder / _file_name(known))


def _file_name(known: RobotFacts) -> str:
    """Return the name of the robot's file; one that no file can have is replaced."""
    name = Path(known.source).name
    return name if name.isprintable() and 0 < len(name) <= MAX_NAME else "robot.urdf"


def _kept(known: RobotFacts, path: Path) -> Description:
    """Return the description in the URDF that the run holds, as if it lay at a path."""
    data = urdf_bytes(known)
    if hashlib.sha256(data).hexdigest() != known.urdf_sha256:
        raise RunFileError(f"{known.name}: the URDF in the run is not the one that it tells of")
    return replace(
        parse(path, data),
        expanded=known.file_sha256 not in (None, known.urdf_sha256),
        file_sha256=known.file_sha256,
    )


def _expanded(
    known: RobotFacts, folders: Sequence[Path], allowed: bool
) -> tuple[Source, Description]:
    """Return the .xacro of a run that does not hold its URDF, and what it becomes, if allowed.

    Raises:
        RunFileError: It is not allowed, there is no such file, or it becomes another URDF.
    """
    for source in _places(known, folders):
        try:
            xacro = is_xacro(source.path, read_source(source.path))
        except RpctlError:
            continue
        if xacro and not allowed:
            raise RunFileError(
                f"{source.path}: the run does not hold its robot, and this file is xacro, which is "
                "evaluated; give --expand if you trust it, or track the robot again"
            )
        if xacro:
            settings = source.read_settings(
                folders, known.xacro_args, known.ignore_missing_packages
            )
            description = read(source.path, settings)
            if description.sha256 == known.urdf_sha256:
                return source, description
        raise RunFileError(f"{source.path}: the URDF has changed since the run; track it again")
    raise RunFileError(
        f"{known.source}: the run does not hold its robot, and this file is not there; declare "
        "the folder in which it lies now with --package-dir, or track the robot again"
    )
