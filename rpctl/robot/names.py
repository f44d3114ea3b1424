"""What a user calls a robot: a path, a name of the catalogue, or one of robot_descriptions."""

from __future__ import annotations

from pathlib import Path

from rpctl.errors import RpctlError, UnknownNameError
from rpctl.files.opening import at_home, is_file
from rpctl.robot import catalog, robot_descriptions
from rpctl.robot.source import Source


def find_source(source: str | Path) -> Source:
    """Return the file of a path or a name; a bare word is a name if it can be one.

    Names of the catalogue count before those of robot_descriptions.

    Raises:
        UnknownNameError: There is no such name; the nearest are suggested.
        RpctlError: The package that has the name is not installed, or has not fetched its files.
    """
    path = Path(source)
    if isinstance(source, Path) or path.suffix or "/" in source:
        return Source(at_home(path))
    if source in catalog.names():
        entry = catalog.find(source)
        return Source(entry.path, entry.name, entry.drive, entry.lock)
    if is_file(path):
        return Source(path)
    found = robot_descriptions.find_robot(source)
    if found is not None:
        return found
    public = [robot.name for robot in robot_descriptions.list_robots()]
    if not public and source.endswith(robot_descriptions.SUFFIX):
        raise RpctlError(
            f"robot {source!r} is not known; names that end so are those of "
            f"{robot_descriptions.PACKAGE}: {robot_descriptions.INSTALL}"
        )
    raise UnknownNameError("robot", source, (*catalog.names(), *public))
