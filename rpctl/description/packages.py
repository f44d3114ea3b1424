"""Where ROS packages lie: in the folders that the user declares, and around the URDF."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from rpctl.description.package_index import (
    MANIFEST,
    Index,
    has_manifest,
    package_name,
    search,
    workspace,
)
from rpctl.errors import RpctlError
from rpctl.files.caps import how_to_raise
from rpctl.files.opening import at_home, is_folder

DECLARE = "declare a folder above it with --package-dir or in ROS_PACKAGE_PATH"


@dataclass(frozen=True)
class Packages:
    """The folders that one file may use.

    Attributes:
        folder: The folder of the file.
        own: Below these, symlinks followed, it may name files by path: its own folder, its
            package's, those that the user declares, and the environment's search paths.
        declared: Folders that the user declares: packages, or folders that hold packages at any
            depth. They count first.
        around: Folders above the file and those of the environment that are packages, or hold
            them.
        searched: Folders besides the declared ones whose packages at any depth count, too.
    """

    folder: str
    own: tuple[str, ...]
    declared: tuple[str, ...]
    around: tuple[str, ...]
    searched: tuple[str, ...]

    @cached_property
    def index(self) -> Index:
        """Folders of the packages in the folders that are searched, by name, likeliest first.

        Of several in one search, those nearest to the file come first.
        """
        found: dict[str, list[str]] = {}
        for place in (*self.declared, *self.searched):
            for name, folders in search(place)[0].items():
                found.setdefault(name, []).extend(sorted(folders, key=self._distance))
        return {name: tuple(dict.fromkeys(folders)) for name, folders in found.items()}

    def _distance(self, folder: str) -> int:
        """Return how little of a folder's path is the file's, too."""
        return -len(os.path.commonpath([self.folder, folder]))

    @cached_property
    def roots(self) -> tuple[str, ...]:
        """Below these, symlinks followed, the file may name files by path."""
        return (*self.own, *(folder for folders in self.index.values() for folder in folders))

    def allow(self, file: str) -> bool:
        """Whether the file may name this one by path; nothing is searched where its own may."""
        return inside(file, self.own) or inside(file, self.roots)

    @property
    def remark(self) -> str:
        """What to add where a package was not found: that a search was broken off; or nothing."""
        cut = [place for place in (*self.declared, *self.searched) if not search(place)[1]]
        if not cut:
            return ""
        return f" (the search of {', '.join(cut)} was broken off; {how_to_raise('MAX_FOLDERS')})"

    def find(self, name: str) -> tuple[str, ...]:
        """Return the folders that a package's name may mean, the likeliest first.

        Args:
            name: Of the package; one that is no single folder's name is found nowhere.
        """
        if name in ("", ".", "..") or "/" in name or "\0" in name:
            return ()
        first, rest = _named(self.declared, name), _named(self.around, name)
        folders = [*first, *self.index.get(name, ()), *sorted(rest, key=_is_bare)]
        return tuple(dict.fromkeys(f for f in folders if os.path.isdir(f)))  # noqa: PTH112


def find_packages(file: Path, package_dirs: Sequence[Path] = ()) -> Packages:
    """Return what a file may use.

    Args:
        file: A URDF, or what becomes one.
        package_dirs: Folders that the user declares: packages, or folders that hold packages.
    """
    file = file.absolute()
    folder = file.parent
    around = [f for f in (folder, *folder.parents) if f != f.parent]  # the disk is no package
    own = [f for f in around if (f / MANIFEST).is_file()][:1]
    paths = _search_path("ROS_PACKAGE_PATH")
    shares = [prefix / "share" for prefix in _search_path("AMENT_PREFIX_PATH")]
    fellow = workspace(file)
    return Packages(
        folder=os.path.realpath(folder),
        own=_unique(os.path.realpath(f) for f in (folder, *own, *package_dirs, *paths, *shares)),
        declared=_absolute(package_dirs),
        around=_absolute([*around, *paths, *shares]),
        searched=_absolute([*([] if fellow is None else [Path(fellow)]), *paths]),
    )


def require_folders(package_dirs: Iterable[str | Path]) -> tuple[Path, ...]:
    """Return the folders that a user declares, absolute.

    Raises:
        RpctlError: One of them is no folder.
    """
    if isinstance(package_dirs, str | Path):
        package_dirs = (package_dirs,)
    folders = tuple(at_home(folder).absolute() for folder in package_dirs)
    for folder in folders:
        if not is_folder(folder):
            raise RpctlError(f"{folder}: no such folder; give a package, or one that holds some")
    return folders


def inside(file: str, roots: Sequence[str]) -> bool:
    """Whether a file, symlinks followed, lies in one of the folders, or is one."""
    return any(file == root or file.startswith(root.rstrip(os.sep) + os.sep) for root in roots)


def _search_path(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _absolute(folders: Iterable[Path]) -> tuple[str, ...]:
    return _unique(os.path.abspath(folder) for folder in folders)  # noqa: PTH100


def _unique(folders: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(folders))


def _named(places: Iterable[str], name: str) -> list[str]:
    """Return the folders of a name: each place that is called so, and what is so called in it."""
    folders = []
    for place in places:
        folders += [place] * (Path(place).name == name or package_name(place) == name)
        folders += [os.path.join(place, name)]  # noqa: PTH118 - as os.path.realpath's
    return [os.path.realpath(folder) for folder in folders]


def _is_bare(folder: str) -> bool:
    """Whether a folder has no manifest."""
    return not has_manifest(folder)
