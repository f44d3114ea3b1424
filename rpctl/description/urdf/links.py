"""Links of a URDF as records: mass and inertia with doubts about them, poses, shapes, colours."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array, read_only
from rpctl.description.records import Link, Shape, rotation_rpy
from rpctl.description.urdf.findings import Fault, Findings, excerpt, parse_numbers

SPD_MARGIN = 1e-12  # of the largest entry: below it an inertia's eigenvalue is rounding
TRIANGLE_MARGIN = 1e-6  # of the larger side: CAD rounding
MAX_MASS_KG = 1e4  # kg; above it a link's mass is probably in grams
MAX_GYRATION_RADIUS_M = 10.0  # m; a radius of gyration above it is probably one in mm
OSMIUM_DENSITY = 22600.0  # kg/m³, of the densest metal
MIN_OSMIUM_INERTIA = 0.01  # of that of a ball of osmium: below it the units are probably wrong
AXES = ("xx", "xy", "xz", "yy", "yz", "zz")
Colours = dict[str | None, tuple[float, ...] | None]
MAX_LENGTH_M = 100.0  # m; above it a length is probably in mm
MAX_ANGLE = 4.0 * math.pi  # rad; above it an angle is probably in degrees


def read_link(findings: Findings, element: Any, colours: Colours) -> Link:
    """Return the record of a <link>.

    Args:
        colours: RGBA of the robot's named materials, by name.
    """
    mass, com, inertia = _read_inertial(findings, element)
    return Link(
        name=element.get("name", ""),
        line=element.sourceline,
        mass=mass,
        com=read_only(com),
        inertia=read_only(inertia),
        visuals=read_shapes(findings, element, "visual", colours),
        collisions=read_shapes(findings, element, "collision", colours),
    )


def _read_inertial(findings: Findings, link: Any) -> tuple[float | None, Array, Array]:
    """Return a <link>'s mass (kg), centre of mass (3,) (m) and inertia (3, 3) (kg·m²).

    The inertia is about the centre of mass, with the axes of the link's frame. The mass is None
    where the link has no <inertial>.
    """
    nothing = np.zeros(3), np.zeros((3, 3))
    inertial, name = findings.only(link, "inertial"), link.get("name", "")
    if inertial is None:
        return None, *nothing
    mass_element, inertia_element = (findings.only(inertial, tag) for tag in ("mass", "inertia"))
    if mass_element is None or inertia_element is None:
        missing = "mass" if mass_element is None else "inertia"
        findings.error(
            inertial,
            f'<inertial> of link "{name}" has no <{missing}>; '
            "add it, or remove the <inertial> and let --density estimate it",
        )
        return 0.0, *nothing
    before = len(findings.items)
    mass = findings.number(mass_element, "value")
    xx, xy, xz, yy, yz, zz = (findings.number(inertia_element, f"i{axes}") for axes in AXES)
    origin = read_origin(findings, inertial)
    turned = origin[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    inertia = turned @ origin[:3, :3].T
    if mass < 0:
        findings.error(mass_element, f'mass {mass:g} of link "{name}" is negative; give its kg')
    elif all(finding.severity != "error" for finding in findings.items[before:]):
        if mass > MAX_MASS_KG:
            findings.warn(
                mass_element,
                f'mass {mass:g} kg of link "{name}" is very large; is it in grams? give kg',
            )
        _doubt_inertia(findings, inertia_element, name, mass, inertia)
    return mass, origin[:3, 3], inertia


def _doubt_inertia(
    findings: Findings, element: Any, name: str, mass: float, inertia: Array
) -> None:
    """Note an inertia that no body of this mass has."""
    moments = np.linalg.eigvalsh(inertia)
    least, middle, most = moments.tolist()
    listed = f"principal moments {', '.join(f'{m:.3g}' for m in moments)} kg·m²"
    slack = SPD_MARGIN * max(most, 0.0)
    ball = 3.0 * mass / (4.0 * math.pi * OSMIUM_DENSITY)  # r³ of one of osmium, m³
    if mass == 0:
        if inertia.any():
            findings.warn(
                element,
                f'link "{name}" has an inertia but the mass 0; give its mass, or no inertia',
            )
    elif most == least == 0:
        findings.add_at(
            "info",
            element.sourceline,
            f'link "{name}" is a point mass: its inertia is 0; give it if the link turns',
        )
    elif least < -slack or least <= slack < most:
        findings.warn(
            element,
            f'inertia of link "{name}" is not positive definite ({listed}); no rigid body has '
            "this inertia; correct it",
        )
    elif most > (least + middle) * (1 + TRIANGLE_MARGIN):
        findings.warn(
            element,
            f'inertia of link "{name}" breaks the triangle rule ({listed}); no rigid body has '
            "this inertia; correct it",
        )
    elif (radius := math.sqrt(most / mass)) > MAX_GYRATION_RADIUS_M:
        findings.warn(
            element,
            f'inertia of link "{name}" is that of {mass:g} kg at {radius:.3g} m from the axis; '
            "is it in kg·mm² (divide by 1e6) or g·mm² (by 1e9)? give kg·m²",
        )
    elif most < MIN_OSMIUM_INERTIA * 0.4 * mass * ball ** (2.0 / 3.0):
        findings.warn(
            element,
            f'inertia of link "{name}" is too small for {mass:g} kg: the largest moment, '
            f"{most:.3g} kg·m², is less than osmium's; check its unit, kg·m²",
        )


def read_colour(findings: Findings, material: Any) -> tuple[float, ...] | None:
    """Return the RGBA of a <material>, or None where it gives none that can be read."""
    colour = None if material is None else material.find("color")
    if colour is None:
        return None
    text = colour.get("rgba", "")
    try:
        rgba = parse_numbers(text, 4)
    except Fault as fault:
        findings.warn(colour, f'<color rgba="{excerpt(text)}"> {fault}')
        return None
    if min(rgba) < 0 or max(rgba) > 1:
        findings.warn(colour, f'<color rgba="{excerpt(text)}"> leaves [0, 1]; divide 0-255 by 255')
    return tuple(min(max(value, 0.0), 1.0) for value in rgba)


def read_shapes(findings: Findings, link: Any, tag: str, colours: Colours) -> tuple[Shape, ...]:
    """Return the shapes of a link; those that cannot be used are noted and left out.

    Args:
        tag: ``"visual"`` or ``"collision"``.
        colours: RGBA of the robot's named materials, by name.
    """
    shapes = (_shape(findings, element, colours) for element in link.findall(tag))
    return tuple(shape for shape in shapes if shape is not None)


def _shape(findings: Findings, element: Any, colours: Colours) -> Shape | None:
    geometry = findings.only(element, "geometry")
    if geometry is None or not len(geometry):
        findings.warn(element, f"<{element.tag}> without a shape in <geometry> is ignored; add one")
        return None
    solid, *others = geometry
    if others:
        findings.warn(others[0], "a second shape in <geometry>; rpctl reads only the first")
    size = _size(findings, solid)
    if size is None:
        return None
    material = element.find("material")
    rgba = read_colour(findings, material)
    if rgba is None and material is not None:
        rgba = colours.get(material.get("name"))
    mesh = solid.get("filename") if solid.tag == "mesh" else None
    return Shape(solid.tag, size, read_origin(findings, element), mesh, rgba, solid.sourceline)


def _size(findings: Findings, solid: Any) -> tuple[float, ...] | None:
    """Return the size of a shape, or None for one that is no use."""
    kind, before = solid.tag, len(findings.items)
    if kind == "box":
        size = findings.numbers(solid, "size", 3, None)
    elif kind in ("cylinder", "capsule"):
        size = [findings.number(solid, "radius"), findings.number(solid, "length")]
    elif kind == "sphere":
        size = [findings.number(solid, "radius")]
    elif kind == "mesh":
        if not solid.get("filename"):
            findings.warn(solid, "<mesh> without a filename is ignored; give one")
            return None
        size = findings.numbers(solid, "scale", 3, "1 1 1")
    else:
        findings.warn(solid, f"<{kind}> is not a URDF shape; rpctl ignores it")
        return None
    return _sane(findings, solid, size) if len(findings.items) == before else tuple(size)


def _sane(findings: Findings, solid: Any, size: list[float]) -> tuple[float, ...] | None:
    if solid.tag == "mesh":
        if 0.0 not in size:
            return tuple(size)
        findings.warn(solid, "<mesh> with a scale of 0 is ignored; correct the scale")
        return None
    if min(size) < 0 or max(size) == 0:
        findings.warn(
            solid, f"<{solid.tag}> has a size that is not positive and is ignored; correct it"
        )
        return None
    if max(size) > MAX_LENGTH_M:
        findings.warn(solid, f"<{solid.tag}> is over {MAX_LENGTH_M:g} m large; is it in mm? give m")
    return tuple(size)


def read_origin(findings: Findings, element: Any) -> Array:
    """Return the pose (4, 4) of an element's <origin>, read-only; the identity without one."""
    origin = findings.only(element, "origin")
    placement = np.eye(4)
    if origin is not None:
        xyz = findings.numbers(origin, "xyz", 3, "0 0 0")
        rpy = findings.numbers(origin, "rpy", 3, "0 0 0")
        placement[:3, 3] = xyz
        if any(rpy):
            placement[:3, :3] = rotation_rpy(*rpy)
        _doubt(findings, origin, xyz, rpy)
    return read_only(placement)


def _doubt(findings: Findings, origin: Any, xyz: list[float], rpy: list[float]) -> None:
    if origin.get("quat_xyzw") is not None:
        findings.error(
            origin, "rpctl does not read <origin quat_xyzw>; write the rotation as rpy (rad)"
        )
    if max(map(abs, xyz)) > MAX_LENGTH_M:
        findings.warn(origin, f'<origin xyz="{origin.get("xyz")}"> is over {MAX_LENGTH_M:g} m '
                      "away; is it in mm? give m")  # fmt: skip
    if max(map(abs, rpy)) > MAX_ANGLE:
        findings.warn(origin, f'<origin rpy="{origin.get("rpy")}"> is over two turns; is it in '
                      "degrees? give rad")  # fmt: skip
