"""Inertias that a file lacks, estimated from its shapes at one density."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import coal
import numpy as np
from lxml import etree

from rpctl.arrays import Array, read_only
from rpctl.description.meshes.jobs import stack
from rpctl.description.meshes.paths import MeshError, MeshPaths
from rpctl.description.meshes.reading import read_shape
from rpctl.description.meshes.service import StalledMeshError, ask
from rpctl.description.records import Description, Link, Shape
from rpctl.description.urdf.findings import Findings, excerpt
from rpctl.description.urdf.links import AXES
from rpctl.errors import DescriptionError, RpctlError

MAX_DENSITY = 1e6  # kg/m3; more is a wrong unit
LEAST_VOLUME = 1e-15  # m3, a cube of 10 µm; below it a mesh is flat
PRIMITIVES = {
    "box": coal.Box,
    "sphere": coal.Sphere,
    "cylinder": coal.Cylinder,
    "capsule": coal.Capsule,
}


class FlatMeshError(MeshError):
    """A mesh that encloses no volume."""


@dataclass(frozen=True)
class Solid:
    """A homogeneous body: volume (m³), centroid (3,) (m), second moment (3, 3) (m⁵).

    The second moment is the inertia at density 1, about the centroid.
    """

    volume: float
    centroid: Array
    moment: Array

    def placed(self, pose: Array) -> Solid:
        """Return the body moved by a pose (4, 4)."""
        R = pose[:3, :3]
        return Solid(self.volume, R @ self.centroid + pose[:3, 3], R @ self.moment @ R.T)


def fill(description: Description, density: float) -> Description:
    """Return a description whose links without <inertial> have those of their shapes.

    Collision shapes count, visual ones where there are none; shapes that overlap count twice.
    Links with an <inertial> stay as they are.

    Args:
        density: kg/m³.

    Raises:
        RpctlError: The density is not positive, or absurd.
        DescriptionError: A mesh that a link's inertia hangs on cannot be read.
    """
    if not 0.0 < density <= MAX_DENSITY:
        raise RpctlError(f"density is {density:g}; give kg/m3, such as 1000 for water")
    findings = Findings()
    links = tuple(_estimated(findings, description, link, density) for link in description.links)
    errors = [each for each in findings.items if each.severity == "error"]
    if errors:
        raise DescriptionError(description.path, errors)
    filled = {link.name: link for link in links if link.estimated}
    return description.edited(
        lambda root: write_inertials(root, filled),
        None,
        links=links,
        findings=(*description.findings, *findings.items),
    )


def _estimated(findings: Findings, description: Description, link: Link, density: float) -> Link:
    """Return a link with the inertia of its shapes, or as it is; what there is to say is noted."""
    if link.mass is not None:
        return link
    shapes, kind = link.collisions or link.visuals, "collision" if link.collisions else "visual"
    paths = description.mesh_paths
    solids = [*filter(None, (_solid(findings, paths, link, shape) for shape in shapes))]
    lacks = f'link "{link.name}" has no <inertial>'
    if not solids:
        above = description.parent_joint.get(link.name)
        if above is not None and above.moving:
            findings.add_at(
                "warning", link.line, f"{lacks} and no shape to estimate it from; add one of them"
            )
        return link
    whole = _sum(solids)
    mass, inertia = density * whole.volume, read_only(density * whole.moment)
    findings.add_at(
        "info",
        link.line,
        f"{lacks}; estimated: {mass:.4g} kg from {len(solids)} {kind} "
        f"shape{'s' * (len(solids) > 1)} at {density:g} kg/m3",
    )
    return replace(link, mass=mass, com=read_only(whole.centroid), inertia=inertia, estimated=True)


def _solid(findings: Findings, paths: MeshPaths, link: Link, shape: Shape) -> Solid | None:
    """Return the body of a shape in its link's frame; None of one that encloses nothing."""
    if shape.kind != "mesh":
        body = primitive(shape)
        solid = Solid(body.computeVolume(), np.zeros(3), body.computeMomentofInertia())
        return solid.placed(shape.origin) if solid.volume > LEAST_VOLUME else None
    name = f'mesh "{excerpt(shape.mesh or "")}" of link "{link.name}"'
    try:
        solid, closed = _mesh_solid(shape, paths)
    except FlatMeshError as error:
        findings.add_at("warning", shape.line, f"{name} cannot be used for the estimate: {error}")
        return None
    except MeshError as error:  # what is not known is not nothing
        findings.add_at(
            "error",
            shape.line,
            f"{name} cannot be used for the estimate: {error}; its link has no <inertial>: give "
            "one, or the mesh",
        )
        return None
    if not closed:
        findings.add_at(
            "warning",
            shape.line,
            f"{name} is not watertight; rpctl uses its convex hull; close the mesh",
        )
    return solid.placed(shape.origin)


def primitive(shape: Shape) -> Any:
    """Return a shape that is no mesh as coal has it, about its own frame."""
    return PRIMITIVES[shape.kind](*shape.size)


def _mesh_solid(shape: Shape, paths: MeshPaths) -> tuple[Solid, bool]:
    """Return the body that a mesh encloses, in the shape's frame, and whether it is closed.

    Raises:
        FlatMeshError: It encloses nothing.
        MeshError: There is no such mesh, or it cannot be read.
    """
    surfaces = read_shape(shape.mesh or "", shape.size, paths).surfaces
    arrays = stack([(surface.vertices, surface.faces) for surface in surfaces])
    try:
        answer, numbers = ask("solid", {"scale": list(shape.size)}, arrays)
        volume, centroid, moment = (np.array(each, dtype=float) for each in numbers)
        solid = Solid(float(volume.item()), centroid.reshape(3), moment.reshape(3, 3))
    except StalledMeshError:
        raise
    except MeshError as fault:
        raise FlatMeshError(str(fault)) from None
    except ValueError:
        raise MeshError("not readable: its reader answered with no body") from None
    finite = np.isfinite(solid.moment).all() and np.isfinite(solid.centroid).all()
    if not finite or not solid.volume > LEAST_VOLUME:
        raise FlatMeshError("it encloses no volume; give the link a shape that does")
    return solid, answer["closed"] is True


def _sum(solids: list[Solid]) -> Solid:
    """Return several bodies as one, by the parallel-axis rule."""
    volume = sum(solid.volume for solid in solids)
    centroid = sum((s.volume * s.centroid for s in solids), np.zeros(3)) / volume
    moment = np.zeros((3, 3))
    for solid in solids:
        d = solid.centroid - centroid
        moment += solid.moment + solid.volume * (d @ d * np.eye(3) - np.outer(d, d))
    return Solid(volume, centroid, moment)


def write_inertials(root: Any, links: Mapping[str, Link]) -> None:
    """Give links of a document the inertias of their records, by name."""
    for element in root.findall("link"):
        link = links.get(element.get("name", ""))
        if link is not None:
            for old in element.findall("inertial"):
                element.remove(old)
            element.append(inertial_element(link))


def inertial_element(link: Link) -> Any:
    """Return a link's mass, centre of mass and inertia as an <inertial>, to the last digit."""
    inertial: Any = etree.Element("inertial")
    etree.SubElement(inertial, "origin", xyz=" ".join(map(repr, link.com.tolist())), rpy="0 0 0")
    etree.SubElement(inertial, "mass", value=repr(link.mass))
    values = link.inertia[np.triu_indices(3)].tolist()
    entries = {f"i{axes}": repr(value) for axes, value in zip(AXES, values, strict=True)}
    etree.SubElement(inertial, "inertia", **entries)
    return inertial
