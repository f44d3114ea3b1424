"""Where a robot's file lies: a path, a name of the catalogue, or one of robot_descriptions.

That package's modules clone repositories when they are imported. They are read here instead: a
module names its files by a few assignments, and what these say is found without running it.
"""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rpctl.description.packages import require_folders
from rpctl.description.records import ReadSettings
from rpctl.errors import DescriptionError, InputError, RpctlError, UnknownNameError
from rpctl.files.caps import at_home, is_file, is_folder, read_text
from rpctl.libraries import install_command
from rpctl.robot import catalog
from rpctl.robot.load_settings import LoadSettings

PACKAGE = "robot_descriptions"
SUFFIX = "_description"
CACHE_VARIABLE, COMMIT_VARIABLE = "ROBOT_DESCRIPTIONS_CACHE", "ROBOT_DESCRIPTION_COMMIT"
WHEELED_TAGS = {"wheeled", "mobile_manipulator"}


@dataclass(frozen=True)
class PublicRobot:
    """A robot of the package's list.

    Attributes:
        name: Its name there, ``fetch_description``.
        robot: What it is called.
        tags: Its kinds, as the list has them.
        file: Its URDF, or the .xacro that becomes one, there or not.
    """

    name: str
    robot: str
    tags: tuple[str, ...]
    file: Path

    @property
    def cached(self) -> bool:
        """Whether its file is in the cache."""
        return self.file.is_file()

    @property
    def wheeled(self) -> bool:
        """Whether it may have wheels, by its tags."""
        return not WHEELED_TAGS.isdisjoint(self.tags)


def list_robots() -> tuple[PublicRobot, ...]:
    """Return the package's robots that have a URDF, by name; none where it is not installed."""
    folder = _folder()
    if folder is None:
        return ()
    listed = _table(folder / "_descriptions.py", "DESCRIPTIONS")
    return tuple(
        PublicRobot(
            name,
            str(entry.get("robot", name)),
            tuple(sorted(entry.get("tags", ()))),
            _file(_assignments(folder, name)),
        )
        for name, entry in sorted(listed.items())
        if "URDF" in entry.get("formats", ("URDF",)) and (folder / f"{name}.py").is_file()
    )


def find_robot(name: str) -> Source | None:
    """Return where a robot of the package lies; None if the package has none of this name.

    Args:
        name: ``fetch_description``, say.

    Raises:
        RpctlError: The package is not installed, or the robot is not in its cache.
    """
    folder = _folder()
    if folder is None or not (folder / f"{name}.py").is_file():
        return None
    values = _assignments(folder, name)
    file = _file(values)
    if not file.is_file():
        raise RpctlError(
            f"{name} is not in the cache of {PACKAGE}, {cache_folder()}; "
            f"`python -m {PACKAGE} pull {name}` downloads it"
        )
    given = (values.get("PACKAGE_PATH"), values.get("REPOSITORY_PATH"))
    packages = [*_mapping(values, "XACRO_PACKAGE_PATHS").values(), *given]
    return Source(
        path=file,
        name=name,
        package_dirs=tuple(Path(p) for p in packages if isinstance(p, str) and Path(p).is_dir()),
        xacro_args=_mapping(values, "XACRO_ARGS") if file.suffix == ".xacro" else {},
    )


def cache_folder() -> Path:
    """Return the folder in which the package keeps its clones."""
    return Path(os.environ.get(CACHE_VARIABLE, f"~/.cache/{PACKAGE}")).expanduser()


def _folder() -> Path | None:
    """Return the package's folder; None where it is not installed."""
    spec = find_spec(PACKAGE)  # of a package at the top: nothing is imported
    places = list(spec.submodule_search_locations or ()) if spec else []
    return Path(places[0]) if places else None


def _file(values: Mapping[str, Any]) -> Path:
    """Return the robot's file: its URDF, or the .xacro that becomes one."""
    return Path(str(values.get("URDF_PATH") or values.get("XACRO_PATH") or os.devnull))


def _mapping(values: Mapping[str, Any], name: str) -> dict[str, str]:
    found = values.get(name)
    return found if isinstance(found, dict) else {}


def _assignments(folder: Path, name: str) -> dict[str, Any]:
    """Return what a module assigns to its names, as far as it can be told without running it."""
    values: dict[str, Any] = {}
    repositories = _table(folder / "_repositories.py", "REPOSITORIES")

    def clone(repository: Any) -> str | None:
        path = repositories.get(repository, {}).get("cache_path")
        commit = os.environ.get(COMMIT_VARIABLE)
        if path is None:
            return None
        return str(cache_folder() / (f"{path}-{commit}/{path}" if commit else path))

    for target, value in _top_level(_tree(folder / f"{name}.py")):
        values[target] = _value(value, values, clone)
    return values


@lru_cache(maxsize=512)
def _tree(file: Path) -> ast.Module:
    try:
        return ast.parse(read_text(file, "MAX_BYTES", "a module"))
    except (DescriptionError, SyntaxError, ValueError) as error:
        raise RpctlError(f"{file}: {PACKAGE} cannot be read ({error}); install it again") from None


def _top_level(tree: ast.Module) -> list[tuple[str, ast.expr]]:
    """Return the names that a module assigns at its top, and what."""
    found = []
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [(each.id, node.value) for each in targets if isinstance(each, ast.Name)]
    return found


def _table(file: Path, name: str) -> dict[str, dict[str, Any]]:
    """Return a table of records, ``{name: Record(field=...)}``, by name and field."""
    found: dict[str, dict[str, Any]] = {}
    for target, value in _top_level(_tree(file)):
        if target != name or not isinstance(value, ast.Dict):
            continue
        for key, record in zip(value.keys, value.values, strict=True):
            if isinstance(key, ast.Constant) and isinstance(record, ast.Call):
                fields = {k.arg: _value(k.value, {}, lambda _: None) for k in record.keywords}
                found[str(key.value)] = {str(k): v for k, v in fields.items() if v is not None}
    return found


def _value(node: ast.expr, known: Mapping[str, Any], clone: Callable[[Any], str | None]) -> Any:
    """Return what an expression comes to; None where that is more than constants and paths.

    Args:
        clone: Returns the folder of a repository by its name.
    """

    def value(part: ast.expr) -> Any:
        return _value(part, known, clone)

    if isinstance(node, ast.Constant):
        return node.value
    if isinstance(node, ast.Name):
        return known.get(node.id)
    if isinstance(node, ast.Attribute):  # Format.URDF
        return node.attr
    if isinstance(node, ast.Set | ast.List | ast.Tuple):
        return [value(each) for each in node.elts]
    if isinstance(node, ast.Dict):
        return {value(k): value(v) for k, v in zip(node.keys, node.values, strict=True) if k}
    if not isinstance(node, ast.Call):
        return None
    called = (
        node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    )
    if called == "copy" and isinstance(node.func, ast.Attribute):
        return value(node.func.value)
    arguments = [value(each) for each in node.args]
    if called.endswith("clone_to_cache"):
        return clone(*arguments[:1])
    if called == "join" and all(isinstance(each, str) for each in arguments):
        return str(Path(*arguments))
    return arguments[0] if len(arguments) == 1 else None  # a file mended at import: as it came


@dataclass(frozen=True)
class Source:
    """The file of a robot, and how it is loaded unless the user says otherwise.

    Attributes:
        path: The file.
        name: The name that stands for it; None for a path.
        drive: Type of the drive, where nothing in the file tells it.
        lock: Joint name patterns that are frozen.
        package_dirs: Folders that hold its packages.
        xacro_args: Values of the arguments of its xacro.
    """

    path: Path
    name: str | None = None
    drive: str | None = None
    lock: tuple[str, ...] = ()
    package_dirs: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)

    def read_settings(self, settings: LoadSettings) -> ReadSettings:
        """Return how its file is read: as the user says, who comes first, and as it needs.

        Raises:
            RpctlError: One of the user's folders is none.
        """
        folders = (*require_folders(settings.package_dirs), *require_folders(self.package_dirs))
        return ReadSettings(
            tuple(dict.fromkeys(folders)),
            {**self.xacro_args, **settings.xacro_args},
            settings.ignore_missing_packages,
        )


def find_source(source: str | Path) -> Source:
    """Return the file of a path or a name; a bare word is a name if it can be one.

    Names of the catalogue count before those of robot_descriptions.

    Raises:
        UnknownNameError: There is no such name; the nearest are suggested.
        RpctlError: The package that has the name is not installed, or has not fetched its files.
    """
    path = Path(source)
    if isinstance(source, Path) or path.suffix or "/" in source:
        return Source(_file_of(source, at_home(path)))
    if source in catalog.names():
        entry = catalog.find(source)
        return Source(entry.path, entry.name, entry.drive, entry.lock)
    if is_file(path) or is_folder(path):
        return Source(_file_of(source, path))
    found = find_robot(source)
    if found is not None:
        return found
    public = [robot.name for robot in list_robots()]
    if not public and source.endswith(SUFFIX):
        raise RpctlError(
            f"robot {source!r} is not known; names that end in {SUFFIX} are those of {PACKAGE}: "
            f"run {install_command('robots')}, then `python -m {PACKAGE} pull NAME`"
        )
    raise UnknownNameError("robot", source, (*catalog.names(), *public))


def _file_of(source: str | Path, path: Path) -> Path:
    """Return a path that is no folder.

    Raises:
        InputError: It is one.
    """
    if is_folder(path):
        raise InputError(source, "this is a folder; give one of the URDF or .xacro files in it")
    return path
