"""Folders searched for packages, as rospack and colcon do, and where a file's workspace begins."""

from __future__ import annotations

import os
import re
import tempfile
from collections import defaultdict, deque
from functools import lru_cache
from pathlib import Path

from rpctl.errors import InputError
from rpctl.files.caps import cap
from rpctl.files.opening import open_input

MANIFEST = "package.xml"
MANIFEST_NAME = re.compile(rb"<name>\s*([^<\s]+)\s*</name>")
COMMENT = re.compile(rb"<!--(?:.*?-->|.*)", re.DOTALL)
MANIFEST_BYTES = 2**14  # bytes of a manifest that are searched for the package's name
IGNORE_MARKS = {"COLCON_IGNORE", "CATKIN_IGNORE", "AMENT_IGNORE"}
WORKSPACE_MARKS = (".catkin_workspace", ".catkin_tools", ".rosinstall")
BUILT = ("install", "devel")  # with build/, what catkin or colcon leave in a workspace
LEAST_DEPTH = 3  # parts of a path, "/" among them, of a folder that is searched unasked

Index = dict[str, tuple[str, ...]]


@lru_cache(maxsize=64)
def search(folder: str) -> tuple[Index, bool]:
    """Return the packages below a folder by name, and whether the search came to its end.

    A package is a folder with a manifest, called as the manifest says; what is below one is its
    own. Hidden folders and those that bear an ignore mark are skipped, symlinks are followed
    once. The nearest come first. The result is kept for the process; :func:`forget` drops it.

    Args:
        folder: An absolute path.
    """
    found: dict[str, list[str]] = defaultdict(list)
    most = cap("MAX_FOLDERS")
    seen = {os.path.realpath(folder)}
    queue = deque([folder])
    for _ in range(most):
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

    Args:
        file: An absolute path.
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
