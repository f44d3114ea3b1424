"""Warnings about meshes that a robot names and that cannot be shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rpctl.description.meshes.paths import MeshError, MissingPackageError
from rpctl.description.records import Description
from rpctl.description.urdf.findings import excerpt
from rpctl.errors import Finding


def check_meshes(description: Description) -> list[Finding]:
    """Return a warning for each mesh that is missing or refused.

    Meshes do not change a robot's dynamics, so none of these is an error. Several meshes with one
    fault share one warning at the first one's line, and so do all packages that are not there.
    """
    first: dict[str, int] = {}
    for link in description.links:
        for shape in (*link.visuals, *link.collisions):
            if shape.mesh is not None:
                first.setdefault(shape.mesh, shape.line)
    if not first:
        return []
    paths = description.mesh_paths
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
    return joined + [
        Finding("warning", first[meshes[0]], f"{_listed(meshes)}: {fault}")
        for fault, meshes in faults.items()
    ]


def _missing_packages(
    wanted: Mapping[str, Sequence[str]], lines: Mapping[str, int], fix: str
) -> Finding:
    """Return the warning that names all packages that were not found."""
    said = []
    for package, meshes in wanted.items():
        more = f" and {len(meshes) - 1} more" if len(meshes) > 1 else ""
        said.append(f"{package} (line {lines[meshes[0]]}{more})")
    line = min(lines[meshes[0]] for meshes in wanted.values())
    fix = fix.replace("above it", "above them")
    return Finding(
        "warning",
        line,
        f"{len(wanted)} packages of meshes were not found: {', '.join(said)}; {fix}",
    )


def _listed(meshes: list[str]) -> str:
    others = f" and {len(meshes) - 1} more" if len(meshes) > 1 else ""
    return f'mesh "{excerpt(meshes[0])}"{others}'
