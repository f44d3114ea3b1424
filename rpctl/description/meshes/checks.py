"""Warnings about meshes that a robot names and that cannot be shown."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from rpctl.description.meshes.paths import MeshError, MeshPaths, MissingPackageError
from rpctl.description.records import Description
from rpctl.description.urdf.findings import excerpt
from rpctl.errors import Finding, InputError
from rpctl.files.opening import read_input

IMAGES = re.compile(rb"<init_from>([^<]*)(?:<ref>([^<]*))?</")
IMAGE_LIBRARY_BYTES = 2**16  # bytes of a DAE's library of images that are searched for textures


def check_meshes(description: Description) -> list[Finding]:
    """Return a warning for each mesh that is missing, refused, or names a texture out of reach.

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
            fault = _texture_fault(paths.resolve(mesh), paths)
        except MeshError as error:
            fault = str(error)
            if isinstance(error, MissingPackageError):
                missing[fault] = error
        if fault:
            faults.setdefault(fault, []).append(mesh)
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


def _texture_fault(mesh: Path, paths: MeshPaths) -> str | None:
    """Return what is wrong with the textures that a DAE names; None where nothing is."""
    if mesh.suffix.lower() != ".dae":
        return None
    try:
        named = _images(mesh)
    except InputError as error:
        return error.fault
    for texture in named:
        if texture and paths.leaves(texture, mesh.parent):
            return (
                f'its texture "{excerpt(texture)}" lies out of reach and is left out; put it beside'
            )
    return None


def _images(mesh: Path) -> list[str]:
    """Return the textures that a DAE names; its library of images may stand anywhere in it."""
    data = read_input(mesh, "MAX_MESH_BYTES", "a mesh")
    begin = data.find(b"<library_images")
    library = data[begin : begin + IMAGE_LIBRARY_BYTES] if begin >= 0 else b""
    found = [(inner or outer).strip() for outer, inner in IMAGES.findall(library)]
    return [name.decode("utf-8", "replace") for name in found]
