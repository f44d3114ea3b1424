"""The robot of a run, from what the run holds: nothing is evaluated, no stored folder is used."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from glob import escape
from pathlib import Path

from rpctl.description.packages import require_folders
from rpctl.description.records import Description
from rpctl.description.urdf.reader import parse
from rpctl.errors import RpctlError, RunFileError
from rpctl.files.caps import read_source
from rpctl.robot.load import assemble
from rpctl.robot.load_settings import LoadSettings
from rpctl.robot.model import Robot
from rpctl.robot.sources import Source, find_source
from rpctl.robot.vary import with_payload
from rpctl.simulation.run.facts import RobotFacts, urdf_bytes

MAX_NAME = 255  # bytes of a file's name
NOWHERE = Path("/nonexistent")  # Debian keeps it free: no mesh and no package lies around it


def load_robot(known: RobotFacts, package_dirs: Sequence[str | Path] = ()) -> Robot:
    """Return the robot of a run.

    Its URDF is the one that the run holds. What lies around the robot's file, as meshes do, is used
    only if that file is there and is, byte for byte, the one of the run: who sends a run can name
    any path in it, but does not know what lies there.

    Args:
        known: What the run holds of its robot.
        package_dirs: Packages, or folders that hold packages, or the folder where the robot's file
            lies now. Folders that the run names are not used.

    Raises:
        RunFileError: The URDF is not the one that the run tells of.
        RpctlError: The robot cannot be built.
    """
    folders = require_folders(package_dirs)
    elsewhere = Source((*folders, NOWHERE)[0] / _file_name(known))
    source = next(_unchanged(known, folders), elsewhere)
    description = _kept(known, source.path)
    settings = LoadSettings(
        drive=known.drive,
        lock={escape(name): position for name, position in known.locked.items()},
        density=known.density,
        end_effector=known.end_effector,
        package_dirs=tuple(map(str, folders)),
        xacro_args=known.xacro_args,
        ignore_missing_packages=known.ignore_missing_packages,
        home=known.home,
        free=("*",),  # nothing but what was locked
        losses=known.losses,
        armature=False if known.armature is None else dict(known.armature) or True,
    )
    description = replace(description, read_with=source.read_settings(settings))
    robot = assemble(source, description, settings)
    for payload in known.payloads:
        robot = with_payload(robot, *payload)
    return replace(robot, name=known.name, source=known.source)


def has_surroundings(robot: Robot) -> bool:
    """Return whether the file of a robot is known to be there, so that its meshes may be, too."""
    return robot.description.path.parent != NOWHERE


def _unchanged(known: RobotFacts, folders: Sequence[Path]) -> Iterator[Source]:
    """Yield the robot's file, where it is there and has the run's digest."""
    for source in _places(known, folders):
        try:
            data = read_source(source.path)
        except RpctlError:
            continue
        if hashlib.sha256(data).hexdigest() == known.file_sha256:
            yield source


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
        expanded=known.file_sha256 != known.urdf_sha256,
        file_sha256=known.file_sha256,
    )
