"""Where ROS packages lie: in the folders that the user declares, and around the URDF."""

from __future__ import annotations

import os
import re
import tempfile
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

from rpctl.errors import InputError, RpctlError
from rpctl.files.caps import at_home, cap, how_to_raise, is_folder, open_input

DECLARE = "declare a folder above it with --package-dir or in ROS_PACKAGE_PATH"
MANIFEST = "package.xml"
MANIFEST_NAME = re.compile(rb"<name>\s*([^<\s]+)\s*</name>")
COMMENT = re.compile(rb"<!--(?:.*?-->|.*)", re.DOTALL)
MANIFEST_BYTES = 2**14  # bytes of a manifest that are searched for the package's name
IGNORE_MARKS = {"COLCON_IGNORE", "CATKIN_IGNORE", "AMENT_IGNORE"}
WORKSPACE_MARKS = (".catkin_workspace", ".catkin_tools", ".rosinstall")
BUILT = ("install", "devel")  # with build/, what catkin or colcon leave in a workspace
LEAST_DEPTH = 3  # parts of a path, "/" among them, of a folder that is searched unasked
Index = dict[str, tuple[str, ...]]


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
        return f" (the search of {', '.join(cut)} was stopped; {how_to_raise('MAX_FOLDERS')})"

    def find(self, name: str) -> tuple[str, ...]:
        """Return the folders that a package's name may mean, the likeliest first.

        Args:
            name: Of the package; one that is no single folder's name is found nowhere.
        """
        if name in ("", ".", "..") or "/" in name or "\0" in name:
            return ()
        first, rest = _named(self.declared, name), _named(self.around, name)
        rest.sort(key=has_manifest, reverse=True)
        folders = [*first, *self.index.get(name, ()), *rest]
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
            raise RpctlError(f"{folder}: no such folder; give a package, or a folder with packages")
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


@lru_cache(maxsize=64)
def search(folder: str) -> tuple[Index, bool]:
    """Return the packages below a folder by name, and whether the search came to its end.

    A package is a folder with a manifest, called as the manifest says; what is below one is its
    own. Hidden folders and those that bear an ignore mark are skipped, symlinks are followed
    once. The nearest come first. The result is kept for the process; :func:`forget` drops it.
    """
    found: dict[str, list[str]] = defaultdict(list)
    seen = {os.path.realpath(folder)}
    queue = deque([folder])
    for _ in range(cap("MAX_FOLDERS")):
        if not queue:
            break
        here = queue.popleft()
        below = _entries(here)
        if MANIFEST in below and (name := package_name(here)):
            found[name].append(os.path.realpath(here))
            continue
        if IGNORE_MARKS & below.keys():
            continue
        for name in sorted(below):
            real = os.path.realpath(path) if (path := below[name]) else ""
            if real and not name.startswith(".") and real not in seen:
                seen.add(real)
                queue.append(path)
    return {name: tuple(folders) for name, folders in found.items()}, not queue


def forget() -> None:
    """Drop all that was found, for somebody may have put the missing package there since."""
    search.cache_clear()


def has_manifest(folder: str) -> bool:
    """Whether a folder is a package by its manifest; whatever is called so, however long."""
    return os.path.isfile(f"{folder}/{MANIFEST}")  # noqa: PTH113 - pathlib's raises


def package_name(folder: str) -> str | None:
    """Return the name that a folder's manifest gives; None without one."""
    try:
        with open_input(f"{folder}/{MANIFEST}", "MAX_BYTES", "a manifest") as file:
            begins = file.read(MANIFEST_BYTES) or b""
    except (OSError, InputError):
        return None
    match = MANIFEST_NAME.search(COMMENT.sub(b"", begins))
    return match[1].decode("utf-8", "replace") if match else None


def workspace(file: Path) -> str | None:
    """Return the folder in which a file's fellow packages lie; None where there is none to search.

    That is the source space of the workspace around it, else the repository, else the outermost
    folder ``src`` above it, else the folder that its own package lies in. Neither a home nor what
    lies above one, nor the system's folder for temporary files, is searched.
    """
    around = [folder for folder in file.parents if _may_be_searched(folder)]
    for folder in around:
        if _is_workspace(folder):
            source = folder / "src"
            return str(source if source in around else folder)
    above = [folder for folder in around if folder.name == "src" or (folder / ".git").exists()]
    packages = [folder for folder in around if (folder / MANIFEST).is_file()]
    if not above and packages and packages[-1].parent in around:
        above = [packages[-1].parent]
    return str(above[-1]) if above else None


def _may_be_searched(folder: Path) -> bool:
    home = Path(os.path.expanduser("~"))  # noqa: PTH111 - Path.home() raises without one
    shared = (home, *home.parents, Path(tempfile.gettempdir()))
    return len(folder.parts) >= LEAST_DEPTH and folder not in shared


def _is_workspace(folder: Path) -> bool:
    """Whether a folder bears the marks that the tools leave in a workspace."""
    built = (folder / "build").is_dir() and any((folder / name).is_dir() for name in BUILT)
    return built or any((folder / mark).exists() for mark in WORKSPACE_MARKS)


def _entries(folder: str) -> dict[str, str]:
    """Return the names in a folder, with the path of each that is a folder, and "" for files."""
    try:
        with os.scandir(folder) as entries:
            return {entry.name: entry.path if _is_folder(entry) else "" for entry in entries}
    except OSError:
        return {}


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:  # a symlink that leads to itself
        return False
