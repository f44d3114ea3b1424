"""Where mesh files lie: where the URDF points, and only below the folders that it may use."""

from __future__ import annotations

import os
from pathlib import Path

from rpctl.errors import RpctlError

EXTENSIONS = (".stl", ".dae", ".obj", ".ply", ".glb")
PACKAGE = "package://"
MAX_NAME = 1024  # characters of a file's name; systems take 4096 with the folder's


class MeshError(RpctlError):
    """A mesh that was refused, was not found, or could not be read."""


def resolve(name: str, urdf: Path) -> Path:
    """Return the file that a URDF names; as :class:`MeshPaths`, for one mesh."""
    return MeshPaths(urdf).resolve(name)


class MeshPaths:
    """Finds the files that one URDF names.

    A file, symlinks followed, lies in the URDF's folder, below the nearest ancestor that holds a
    ``package.xml``, or in the package that ``package://`` names.

    Args:
        urdf: The URDF.
    """

    def __init__(self, urdf: Path) -> None:
        folder = urdf.absolute().parent
        self._folder = str(folder)
        self._ancestors = [f for f in (folder, *folder.parents) if f != f.parent]
        package = [f for f in (folder, *folder.parents) if (f / "package.xml").is_file()][:1]
        self._roots = tuple(os.path.realpath(root) for root in (folder, *package))
        self._real_folders: dict[str, str] = {}
        self._packages: dict[str, tuple[str, ...]] = {}

    def resolve(self, name: str) -> Path:
        """Return the file of a mesh.

        Args:
            name: ``package://NAME/rest``, or a path from the URDF's folder.

        Raises:
            MeshError: The name is refused, or there is no such file.
        """
        if len(name) > MAX_NAME or not name.isprintable():
            raise MeshError("refused: no file has such a name")
        confined = []
        for path, roots in self._candidates(name):
            file = self._real(path)
            if _inside(file, roots):
                confined.append(file)
        if not confined:
            raise MeshError(
                "refused: it lies outside the folders that the URDF may use (its own, its "
                "package's, those of package://); move it there"
            )
        if os.path.splitext(confined[0])[1].lower() not in EXTENSIONS:  # noqa: PTH122 - speed
            raise MeshError(f"refused: a mesh ends in {', '.join(EXTENSIONS)}")
        for file in confined:
            if os.path.isfile(file):  # noqa: PTH113 - speed; a robot has 100 meshes
                return Path(file)
        raise MeshError("no such file; put it there, or correct the name")

    def leaves(self, name: str, folder: Path) -> bool:
        """Whether a file that a mesh in ``folder`` names lies outside all the robot's folders."""
        if len(name) > MAX_NAME or not name.isprintable() or ":" in name:
            return True
        roots = (*self._roots, *(root for roots in self._packages.values() for root in roots))
        return not _inside(self._real(name if name[:1] == "/" else f"{folder}/{name}"), roots)

    def _candidates(self, name: str) -> list[tuple[str, tuple[str, ...]]]:
        """Return the paths that a name may mean, each with the folders that confine it."""
        if not name.startswith(PACKAGE):
            if ":" in name:
                raise MeshError(
                    "refused: only package:// and paths from the URDF's folder are read; "
                    "write one of these"
                )
            return [(f"{self._folder}/{name}" if name[0] != "/" else name, self._roots)]
        package, _, rest = name.removeprefix(PACKAGE).partition("/")
        folders = self._packages.get(package)
        if folders is None:
            folders = self._packages[package] = tuple(_package_folders(package, self._ancestors))
        if not folders:
            raise MeshError(f'package "{package}" was not found; add it to ROS_PACKAGE_PATH')
        return [(f"{folder}/{rest}", (folder,)) for folder in folders]

    def _real(self, path: str) -> str:
        """Return a path with symlinks followed; its folder is looked up once."""
        folder, _, leaf = path.rpartition("/")
        if leaf in ("", ".", "..") or os.path.islink(path):  # noqa: PTH114 - speed
            return os.path.realpath(path)
        real = self._real_folders.get(folder)
        if real is None:
            real = self._real_folders[folder] = os.path.realpath(folder or "/")
        return os.path.join(real, leaf)  # noqa: PTH118 - speed


def _inside(file: str, roots: tuple[str, ...]) -> bool:
    return any(file == root or file.startswith(root + os.sep) for root in roots)


def _package_folders(package: str, ancestors: list[Path]) -> list[str]:
    """Return the folders that a package name may mean, the nearest to the URDF first."""
    if package in ("", ".", ".."):
        raise MeshError("refused: package:// without the name of a package; name it")
    folders = []
    for folder in ancestors:  # the whole disk is no package, nor are its top folders
        folders += [folder] * (folder.name == package) + [folder / package]
    for entry in _search_path("ROS_PACKAGE_PATH"):
        folders += [entry] * (entry.name == package) + [entry / package]
    folders += [entry / "share" / package for entry in _search_path("AMENT_PREFIX_PATH")]
    return [os.path.realpath(folder) for folder in folders if folder.is_dir()]


def _search_path(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
