"""<visual> and <collision>: shapes, and their colours."""

from __future__ import annotations

from typing import Any

from rpctl.description.findings import Fault, Findings, excerpt, parse_numbers
from rpctl.description.origin import MAX_LENGTH_M, read_origin
from rpctl.description.records import Shape

Colours = dict[str | None, tuple[float, ...] | None]


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
        findings: Where to note faults.
        link: The <link>.
        tag: ``"visual"`` or ``"collision"``.
        colours: RGBA of the robot's named materials, by name.
    """
    shapes = (_shape(findings, element, colours) for element in link.findall(tag))
    return tuple(shape for shape in shapes if shape is not None)


def _shape(findings: Findings, element: Any, colours: Colours) -> Shape | None:
    geometry = findings.only(element, "geometry")
    solids = [] if geometry is None else list(geometry)
    if not solids:
        findings.warn(element, f"<{element.tag}> without a shape in <geometry>; it is left out")
        return None
    solid = solids[0]
    if len(solids) > 1:
        findings.warn(solids[1], "a second shape in <geometry>; only the first is read")
    size = _size(findings, solid)
    if size is None:
        return None
    material = element.find("material")
    rgba = read_colour(findings, material)
    if rgba is None and material is not None:
        rgba = colours.get(material.get("name"))
    mesh = solid.get("filename") if solid.tag == "mesh" else None
    origin = read_origin(findings, element)
    return Shape(solid.tag, size, origin, mesh, rgba, solid.sourceline)


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
            findings.warn(solid, "<mesh> without a filename; it is left out")
            return None
        size = findings.numbers(solid, "scale", 3, "1 1 1")
    else:
        findings.warn(solid, f"<{kind}> is no URDF shape; it is left out")
        return None
    if len(findings.items) == before:
        return _sane(findings, solid, size)
    return tuple(size)


def _sane(findings: Findings, solid: Any, size: list[float]) -> tuple[float, ...] | None:
    if solid.tag == "mesh":
        if 0.0 not in size:
            return tuple(size)
        findings.warn(solid, "<mesh> with a scale of 0; it is left out")
        return None
    if min(size) < 0 or max(size) == 0:
        findings.warn(solid, f"<{solid.tag}> has a size that is not positive; it is left out")
        return None
    if max(size) > MAX_LENGTH_M:
        findings.warn(solid, f"<{solid.tag}> is over {MAX_LENGTH_M:g} m large; is it in mm? give m")
    return tuple(size)
