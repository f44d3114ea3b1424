"""Where mesh files lie: where the URDF points, and only below the folders that it may use."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from rpctl.description.packages import DECLARE, find_packages, forget, inside
from rpctl.description.urdf.findings import excerpt
from rpctl.errors import Finding, RpctlError

EXTENSIONS = (".stl", ".dae", ".obj", ".ply", ".glb")
PACKAGE, FILE = "package://", "file://"
MAX_NAME = 1024  # characters of a file's name; systems take 4096 with the folder's


class MeshError(RpctlError):
    """A mesh that was refused, was not found, or could not be read."""


class MissingPackageError(MeshError):
    """A package that was not found.

    Attributes:
        package: Its name.
        fix: What to do.
    """

    def __init__(self, package: str, fix: str) -> None:
        super().__init__(f'package "{package}" was not found; {fix}')
        self.package, self.fix = package, fix


class MeshPaths:
    """Finds the files that one URDF names.

    A file, symlinks followed, lies in a folder that the URDF may use
    (:class:`rpctl.description.packages.Packages`), or in the package that ``package://`` names.

    Args:
        urdf: The URDF.
        package_dirs: Folders that the user declares: packages, or folders that hold packages.

    Attributes:
        stalled: Names of the meshes that took too long to read.
    """

    def __init__(self, urdf: Path, package_dirs: Sequence[Path] = ()) -> None:
        self._folder = str(urdf.absolute().parent)
        self._known = find_packages(urdf, package_dirs)
        self._packages: dict[str, tuple[str, ...]] = {}
        self._fixes: dict[str, str] = {}  # by package that was not found
        self.stalled: set[str] = set()

    def resolve(self, name: str) -> Path:
        """Return the file of a mesh.

        Args:
            name: ``package://NAME/rest``, or a path from the URDF's folder, or an absolute one,
                with or without ``file://``.

        Raises:
            MeshError: The name is refused, or there is no such file.
        """
        if len(name) > MAX_NAME or not name.isprintable():
            raise MeshError("refused: this is not a valid file name")
        confined = []
        for path, package in self._candidates(name):
            file = os.path.realpath(path)
            if self._known.allow(file) if package is None else inside(file, (package,)):
                confined.append(file)
        if not confined:
            raise MeshError(
                "refused: it lies outside the folders that the URDF may use (its own, its "
                "package's, those of package://); move it there, or declare its folder with "
                "--package-dir"
            )
        if os.path.splitext(confined[0])[1].lower() not in EXTENSIONS:  # noqa: PTH122 - speed
            raise MeshError(f"refused: the name of a mesh must end in {', '.join(EXTENSIONS)}")
        for file in confined:
            if os.path.isfile(file):  # noqa: PTH113 - speed; a robot has 100 meshes
                return Path(file)
        raise MeshError("no such file; add it, or correct the name")

    def _candidates(self, name: str) -> list[tuple[str, str | None]]:
        """Return the paths that a name may mean, each with the package that confines it."""
        if not name.startswith(PACKAGE):
            path = name.removeprefix(FILE) if name.startswith(f"{FILE}/") else name
            if ":" in path:
                raise MeshError(
                    "refused: rpctl reads only package:// and paths relative to the URDF's "
                    "folder; write one of these"
                )
            return [(path if path[0] == "/" else f"{self._folder}/{path}", None)]
        package, _, rest = name.removeprefix(PACKAGE).partition("/")
        if package in ("", ".", ".."):
            raise MeshError("refused: package:// without the name of a package; name it")
        if package not in self._packages:
            self._packages[package] = self._known.find(package)
            if not self._packages[package]:
                self._fixes[package] = DECLARE + self._known.remark
                forget()  # somebody may put it there before the next try
        if package in self._fixes:
            raise MissingPackageError(package, self._fixes[package])
        return [(f"{folder}/{rest}", folder) for folder in self._packages[package]]


def check_meshes(first: Mapping[str, int], paths: MeshPaths) -> list[Finding]:
    """Return a warning for each mesh that is missing or refused.

    Meshes do not change a robot's dynamics, so none of these is an error. Several meshes with one
    fault share one warning at the first one's line, and so do all packages that are not there.

    Args:
        first: The first line of each mesh, by its name in the URDF.
    """
    faults: dict[str, list[str]] = {}
    missing: dict[str, MissingPackageError] = {}
    for mesh in first:
        try:
            paths.resolve(mesh)
        except MeshError as error:  # noqa: PERF203 - all are told
            faults.setdefault(str(error), []).append(mesh)
            if isinstance(error, MissingPackageError):
                missing[str(error)] = error
    joined = []
    if len(missing) > 1:
        wanted = {error.package: faults.pop(fault) for fault, error in missing.items()}
        joined = [_missing_packages(wanted, first, next(iter(missing.values())).fix)]
    for fault, meshes in faults.items():
        others = f" and {len(meshes) - 1} more" if len(meshes) > 1 else ""
        joined.append(
            Finding("warning", first[meshes[0]], f'mesh "{excerpt(meshes[0])}"{others}: {fault}')
        )
    return joined


def _missing_packages(
    wanted: Mapping[str, Sequence[str]], lines: Mapping[str, int], fix: str
) -> Finding:
    """Return the warning that names all packages that were not found."""
    said = []
    for package, meshes in wanted.items():
        more = f" and {len(meshes) - 1} more" if len(meshes) > 1 else ""
        said.append(f"{package} (line {lines[meshes[0]]}{more})")
    fix = fix.replace("above it", "above them")
    return Finding(
        "warning",
        min(lines[meshes[0]] for meshes in wanted.values()),
        f"{len(wanted)} packages of meshes were not found: {', '.join(said)}; {fix}",
    )
