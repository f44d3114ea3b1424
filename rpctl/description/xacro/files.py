"""What an expansion may see of the disk, and what it may say: both are checked here.

Files lie below declared folders, or in ROS packages. The process that expands opens nothing
itself: it asks, and what it says is foreign, for hostile code may have run in it.
"""

from __future__ import annotations

import errno
import json
import os
import re
from collections.abc import Callable, Container, Mapping
from fnmatch import filter as matching
from itertools import islice
from pathlib import Path
from typing import Any

from rpctl.description.packages import DECLARE, Packages, has_manifest, inside
from rpctl.description.xacro.hooks import GONE, READ
from rpctl.errors import InputError
from rpctl.files.caps import cap, read_input

OUTSIDE = f"refused: it lies outside the folders that the file may use; {DECLARE}"
HIDDEN = "refused: it is hidden or in a hidden folder; move what the robot needs out of it"
SYSTEM = ("/proc", "/sys", "/dev")  # below no robot's folder, though it be the whole disk
WILD = re.compile(r"[*?[]")
MAX_MATCHES = 1000  # files of one pattern that are told
MAX_REQUESTS = 10_000  # of one expansion; the largest public ones make some hundred
MAX_PATH = 4096  # characters, as Linux has it
Answer = Mapping[str, Any]  # of the process that expands
ENVIRONMENT = "env:"  # how the name of an argument begins that is a variable of the environment
MAX_TOLD = 1000  # rows of each list that are kept
TEXT, LINE = (str,), (int, type(None))
SINGLES: dict[str, tuple[type, ...]] = {  # the types of what is one value
    "told": TEXT, "error": TEXT, "file": (str, type(None)), "line": LINE,
    "argument": TEXT, "variable": TEXT, "no_file": TEXT,
}  # fmt: skip
TEXTS = (  # lists of texts
    "dropped", "undeclared", "early", "unused", "macros", "asked", "open_arguments",
)  # fmt: skip
ROWS: dict[str, tuple[tuple[type, ...], ...]] = {  # lists of rows; a file's path is FILE
    "wants": (TEXT, TEXT, LINE, TEXT),
    "left_out": (TEXT, LINE, TEXT),
    "moved": (TEXT, TEXT),
    "arguments": (TEXT, (str, type(None)), TEXT, (int,)),
    "old": (TEXT, TEXT, (int,)),
    "plain": (TEXT, TEXT, (int,)),
    "defined": (TEXT, TEXT, (int,)),
}
# Columns that name files read.
FILES = {"wants": 1, "left_out": 0, "arguments": 2, "old": 0, "plain": 0}


class XacroFiles:
    """The files that one expansion may read.

    Attributes:
        known: Paths that were asked for, as they were asked for.
        missing: Those where there is no file.
    """

    def __init__(self, file: Path, packages: Packages) -> None:
        """Take the folders that the file may use.

        Args:
            file: The file to expand, absolute.
        """
        self._file = os.path.realpath(file)
        self._packages = packages
        self._found: dict[str, None] = {}  # folders that were told, in order
        places = (packages.declared, packages.around, packages.searched)
        anchors = {*packages.own, *(os.path.realpath(f) for each in places for f in each)}
        self._anchors = sorted(anchors, key=len, reverse=True)
        self._requests = 0
        self.known = {str(file)}
        self.missing: set[str] = set()

    def reply(self, verb: object, asked: object) -> bytes:
        """Return the answer to a request.

        Raises:
            ValueError: There is no such request, or they are too many.
        """
        self._requests += 1
        if self._requests > MAX_REQUESTS:
            raise ValueError("too many requests")
        verbs: dict[object, Callable[[str], Any]] = {
            "find": self.find, "place": self.place, "match": self.match
        }  # fmt: skip
        if not isinstance(asked, str) or "\0" in asked:
            raise ValueError("a path or a name must be text")
        if verb != "read":
            return json.dumps(verbs[verb](asked)).encode()
        try:
            return READ + self.read(asked)
        except OSError as error:
            return GONE + json.dumps((error.errno, error.strerror)).encode()

    def read(self, path: str) -> bytes:
        """Return a file's bytes.

        Raises:
            OSError: It may not be read, is not there, or is none.
        """
        if len(path) > MAX_PATH:
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG), path)
        self.known |= {path, os.path.normpath(path)}
        real = os.path.realpath(path)
        reason = self._refusal(real)
        if reason:
            raise PermissionError(errno.EACCES, reason, path)
        if not os.path.exists(real):  # noqa: PTH110 - as Packages': texts
            self.missing.add(path)
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path)
        try:
            return read_input(real, "MAX_BYTES", "a file of xacro or YAML")
        except InputError as error:
            raise OSError(errno.EIO, error.fault, path) from None

    def find(self, name: str) -> tuple[str, ...]:
        """Return the folders that a package's name may mean, the likeliest first.

        A package has a manifest. A folder without one counts where paths reach it anyway: below
        the file's own folder, or a declared one.
        """
        folders = tuple(folder for folder in self._packages.find(name) if self._is_package(folder))
        self._found |= dict.fromkeys(folders[:1])
        return folders

    def place(self, path: str) -> str | None:
        """Return where a file of a package lies in its source; None: as the path says, or nowhere.

        Packages install their folders elsewhere than they keep them: ``description/urdf`` becomes
        ``urdf``. Such a path has but one place in the source that ends like it.
        """
        folder = next((f for f in self._found if path.startswith(f"{f}/")), None)
        if folder is None or os.path.isfile(path) or ".." in Path(path).parts:  # noqa: PTH113
            return None
        rest, name = path.removeprefix(folder), Path(path).name
        steps = islice(os.walk(folder), cap("MAX_FOLDERS"))
        places = [f"{here}/{name}" for here, _, names in steps if name in names]
        places = [place for place in places if place.endswith(rest)]
        may = [place for place in places if not self._refusal(os.path.realpath(place))]
        return may[0] if len(may) == 1 else None

    def match(self, pattern: str) -> list[str]:
        """Return the files that a pattern names and that may be read."""
        start, *parts = Path(pattern).parts or ("",)
        paths, looks = [start], cap("MAX_FOLDERS")
        for part in parts:
            if WILD.search(part):
                folders, looks = paths[:looks], looks - len(paths[:looks])
                paths = [path for folder in folders for path in self._matching(folder, part)]
            else:
                paths = [os.path.join(path, part) for path in paths]  # noqa: PTH118
        paths = [path for path in paths if os.path.isfile(path)]  # noqa: PTH113
        return [path for path in paths if not self._refusal(os.path.realpath(path))][:MAX_MATCHES]

    def _matching(self, folder: str, pattern: str) -> list[str]:
        """Return what is called so in a folder, if it may be listed; not what is hidden."""
        if self._refusal(os.path.realpath(folder)):
            return []
        try:
            names = sorted(matching(os.listdir(folder), pattern))  # noqa: PTH208
        except OSError:
            return []
        return [os.path.join(folder, name) for name in names if name[0] != "."]  # noqa: PTH118

    def _refusal(self, real: str) -> str | None:
        """Return why a path, symlinks followed, may not be read; None if it may."""
        if real == self._file:
            return None
        if inside(real, SYSTEM):
            return OUTSIDE
        roots = [root for root in (*self._packages.own, *self._found) if inside(real, (root,))]
        if not roots:
            index = (each for folders in self._packages.index.values() for each in folders)
            roots = [root for root in index if inside(real, (root,)) and self._is_package(root)]
        if not roots:
            return OUTSIDE
        return HIDDEN if all(_has_hidden(real, root) for root in roots) else None

    def _is_package(self, folder: str) -> bool:
        """Whether a folder is one of ROS packages that files may come from."""
        anchor = next((a for a in self._anchors if inside(folder, (a,))), os.sep)
        if _has_hidden(folder, anchor):
            return False
        return has_manifest(folder) or inside(folder, self._packages.own)


def _has_hidden(path: str, root: str) -> bool:
    """Whether a path goes through hidden folders below a root, or is hidden."""
    return any(part.startswith(".") for part in Path(path).relative_to(root).parts)


def check_answer(answer: Any, known: Container[str], missing: Container[str]) -> dict[str, Any]:
    """Return an answer that is of the form it should have.

    Args:
        known: The files that it has asked for; it may name no other.

    Raises:
        ValueError: It is of another form.
    """
    if not isinstance(answer, Mapping) or not answer.keys() <= {*SINGLES, *TEXTS, *ROWS}:
        raise ValueError("its answer is of an unknown form")
    checked: dict[str, Any] = {name: [] for name in (*TEXTS, *ROWS)}
    checked |= {"told": "", "file": None, "line": None}
    for name, value in answer.items():
        if name in SINGLES:
            _require(isinstance(value, SINGLES[name]), name)
        else:
            _require(isinstance(value, list), name)
            value = value[:MAX_TOLD]
            _require(all(_is_row(row, name) for row in value), name)
            _require(name not in FILES or all(row[FILES[name]] in known for row in value), name)
        checked[name] = value
    _require(checked["file"] is None or checked["file"] in known, "file")
    _require(all(file in known for file in checked["undeclared"]), "undeclared")
    if checked.get("no_file") not in missing:
        checked.pop("no_file", None)
    return checked


def _is_row(row: Any, name: str) -> bool:
    if name in TEXTS:
        return isinstance(row, str)
    types = ROWS[name]
    return (
        isinstance(row, list)
        and len(row) == len(types)
        and all(isinstance(each, type_) for each, type_ in zip(row, types, strict=True))
    )


def _require(holds: bool, name: str) -> None:
    if not holds:
        raise ValueError(f'"{name}" of its answer is of an unknown form')
