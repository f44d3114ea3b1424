"""Where ROS packages lie: in the folders that the user declares, and around the URDF.

It needs little but the standard library: the process that expands xacro imports it, too.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rpctl.errors import RpctlError

DECLARE = "declare the folder that holds it with --package-dir or in ROS_PACKAGE_PATH"
MANIFEST = "package.xml"
MANIFEST_NAME = re.compile(rb"<name>\s*([^<\s]+)\s*</name>")
MANIFEST_BYTES = 2**14  # bytes of a manifest that are searched for the package's name


@dataclass(frozen=True)
class Packages:
    """The folders that one file may use.

    Attributes:
        roots: Below these, symlinks followed, it may name files by path: its own folder, its
            package's, those that the user declares, and the environment's search paths.
        places: Folders that are packages, or hold them; the first that has a package counts.
    """

    roots: tuple[str, ...]
    places: tuple[str, ...]

    def find(self, name: str) -> tuple[str, ...]:
        """Return the folders that a package's name may mean, the likeliest first.

        Args:
            name: Of the package; one that is no single folder's name is found nowhere.
        """
        if name in ("", ".", "..") or "/" in name or "\0" in name:
            return ()
        folders = []
        for place in self.places:
            folders += [place] * _is_called(place, name)
            folders += [os.path.join(place, name)]  # noqa: PTH118 - as os.path.realpath's
        return tuple(os.path.realpath(f) for f in folders if os.path.isdir(f))  # noqa: PTH112


def find_packages(file: Path, package_dirs: Sequence[Path] = ()) -> Packages:
    """Return what a file may use.

    Args:
        file: A URDF, or what becomes one.
        package_dirs: Folders that the user declares: packages, or folders that hold packages.
    """
    folder = file.absolute().parent
    around = [f for f in (folder, *folder.parents) if f != f.parent]  # the disk is no package
    own = [f for f in around if (f / MANIFEST).is_file()][:1]
    searched = _search_path("ROS_PACKAGE_PATH")
    searched += [prefix / "share" for prefix in _search_path("AMENT_PREFIX_PATH")]
    roots = [os.path.realpath(f) for f in (folder, *own, *package_dirs, *searched)]
    places = [os.path.abspath(f) for f in (*package_dirs, *around, *searched)]  # noqa: PTH100
    return Packages(tuple(dict.fromkeys(roots)), tuple(dict.fromkeys(places)))


def require_folders(package_dirs: Iterable[str | Path]) -> tuple[Path, ...]:
    """Return the folders that a user declares, absolute.

    Raises:
        RpctlError: One of them is no folder.
    """
    if isinstance(package_dirs, str | Path):
        package_dirs = (package_dirs,)
    folders = tuple(Path(folder).absolute() for folder in package_dirs)
    for folder in folders:
        if not folder.is_dir():
            raise RpctlError(f"{folder}: no such folder; give a package, or one that holds some")
    return folders


def inside(file: str, roots: Sequence[str]) -> bool:
    """Whether a file, symlinks followed, lies in one of the folders, or is one."""
    return any(file == root or file.startswith(root.rstrip(os.sep) + os.sep) for root in roots)


def _search_path(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _is_called(folder: str, name: str) -> bool:
    """Whether a folder is the package of this name, by its own name or by its manifest."""
    path = Path(folder)
    manifest = path / MANIFEST
    if path.name == name or not manifest.is_file():
        return path.name == name
    try:
        with manifest.open("rb") as file:
            name_match = MANIFEST_NAME.search(file.read(MANIFEST_BYTES))
    except OSError:
        return False
    return name_match is not None and name_match[1] == name.encode()
