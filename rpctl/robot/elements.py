"""Elements of a URDF as records: links, joints and shapes, with a finding for every fault."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.errors import Finding
from rpctl.robot.description import (
    MOVING_KINDS,
    Array,
    Joint,
    Link,
    Mimic,
    Shape,
    rotation_rpy,
)

KNOWN_KINDS = (*MOVING_KINDS, "fixed", "floating", "planar")
SPD_MARGIN = 1e-12  # of the largest entry: below it an inertia's eigenvalue is rounding


class Findings:
    """Collects what is wrong, so that several faults show at once."""

    def __init__(self) -> None:
        self.items: list[Finding] = []

    def add(self, severity: str, element: Any, message: str) -> None:
        """Note a finding at an element's line."""
        line = None if element is None else element.sourceline
        self.items.append(Finding(severity, line, message))

    def error(self, element: Any, message: str) -> None:
        """Note an error."""
        self.add("error", element, message)

    def numbers(self, element: Any, attribute: str, count: int, default: str | None) -> list[float]:
        """Return ``count`` finite numbers of an attribute; on a fault note it and return zeros."""
        text = None if element is None else element.get(attribute, default)
        if element is None:
            text = default
        where = f'<{element.tag} {attribute}="{text}">' if element is not None else attribute
        if text is None:
            self.error(element, f'<{element.tag}> has no attribute "{attribute}"; add it')
            return [0.0] * count
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            self.error(element, f"{where} is not a number; write digits with a decimal point")
            return [0.0] * count
        if len(values) != count:
            self.error(element, f"{where} has {len(values)} numbers; give {count}")
        elif not all(map(math.isfinite, values)):
            self.error(element, f"{where} is not finite; give a finite number")
        else:
            return values
        return [0.0] * count

    def number(self, element: Any, attribute: str, default: str | None = None) -> float:
        """Return one finite number of an attribute."""
        return self.numbers(element, attribute, 1, default)[0]


def _origin(findings: Findings, element: Any) -> Array:
    origin = element.find("origin")
    placement = np.eye(4)
    placement[:3, 3] = findings.numbers(origin, "xyz", 3, "0 0 0")
    placement[:3, :3] = rotation_rpy(*findings.numbers(origin, "rpy", 3, "0 0 0"))
    return _frozen(placement)


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array


def read_colour(findings: Findings, material: Any) -> tuple[float, ...] | None:
    """Return the RGBA of a <material>, or None where it has no <color>."""
    colour = None if material is None else material.find("color")
    return None if colour is None else tuple(findings.numbers(colour, "rgba", 4, None))


def read_link(findings: Findings, element: Any, colours: dict[str, Any]) -> Link:
    """Return the record of a <link>; ``colours`` are the robot's named materials."""
    name = element.get("name", "")
    inertial = element.find("inertial")
    mass, com, inertia = None, np.zeros(3), np.zeros((3, 3))
    if inertial is not None:
        mass, com, inertia = _inertial(findings, inertial, name)
    return Link(
        name=name,
        line=element.sourceline,
        mass=mass,
        com=_frozen(com),
        inertia=_frozen(inertia),
        visuals=_shapes(findings, element, "visual", colours),
        collisions=_shapes(findings, element, "collision", colours),
    )


def _inertial(findings: Findings, inertial: Any, name: str) -> tuple[float, Array, Array]:
    mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
    if mass_element is None or inertia_element is None:
        missing = "mass" if mass_element is None else "inertia"
        findings.error(inertial, f'<inertial> of link "{name}" has no <{missing}>; add it')
        return 0.0, np.zeros(3), np.zeros((3, 3))
    mass = findings.number(mass_element, "value")
    xx, xy, xz, yy, yz, zz = (
        findings.number(inertia_element, f"i{axes}")
        for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
    )
    origin = _origin(findings, inertial)
    turned = origin[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    inertia = turned @ origin[:3, :3].T
    if mass < 0:
        findings.error(mass_element, f'mass {mass:g} of link "{name}" is negative; give its kg')
    elif mass > 0:
        moments = np.linalg.eigvalsh(inertia)
        slack = SPD_MARGIN * max(moments[-1], 0.0)
        if moments[0] < -slack or (moments[0] <= slack and moments[-1] > 0):
            findings.add(
                "warning",
                inertia_element,
                f'inertia of link "{name}" is not positive definite (principal moments '
                f"{', '.join(f'{m:.3g}' for m in moments)}); no real body has it",
            )
        elif moments[-1] > (moments[0] + moments[1]) * (1 + 1e-6):
            findings.add(
                "warning",
                inertia_element,
                f'inertia of link "{name}" breaks the triangle rule (principal moments '
                f"{', '.join(f'{m:.3g}' for m in moments)}); no real body has it",
            )
    return mass, origin[:3, 3].copy(), inertia


def _shapes(findings: Findings, link: Any, tag: str, colours: dict[str, Any]) -> tuple[Shape, ...]:
    shapes = []
    for element in link.findall(tag):
        geometry = element.find("geometry")
        solid = None if geometry is None or not len(geometry) else geometry[0]
        if solid is None:
            findings.add("warning", element, f"<{tag}> without <geometry>; it is not drawn")
            continue
        if solid.tag == "box":
            size = findings.numbers(solid, "size", 3, None)
        elif solid.tag in ("cylinder", "capsule"):
            size = [findings.number(solid, "radius"), findings.number(solid, "length")]
        elif solid.tag == "sphere":
            size = [findings.number(solid, "radius")]
        elif solid.tag == "mesh":
            size = findings.numbers(solid, "scale", 3, "1 1 1")
        else:
            findings.add("warning", solid, f"<{solid.tag}> is no URDF geometry; it is not drawn")
            continue
        material = element.find("material")
        rgba = read_colour(findings, material)
        if rgba is None and material is not None:
            rgba = colours.get(material.get("name"))
        mesh = solid.get("filename") if solid.tag == "mesh" else None
        origin = _origin(findings, element)
        shapes.append(Shape(solid.tag, tuple(size), origin, mesh, rgba, solid.sourceline))
    return tuple(shapes)


def read_joint(findings: Findings, element: Any) -> Joint:
    """Return the record of a <joint>."""
    name, kind = element.get("name", ""), element.get("type", "")
    if kind not in KNOWN_KINDS:
        findings.error(
            element, f'joint "{name}" has type "{kind}"; use one of {", ".join(KNOWN_KINDS)}'
        )
    elif kind in ("floating", "planar"):
        findings.error(
            element, f'joint "{name}" is {kind}; rpctl places the base itself, make it fixed'
        )
    ends = {}
    for end in ("parent", "child"):
        reference = element.find(end)
        if reference is None or not reference.get("link"):
            findings.error(element, f'joint "{name}" has no <{end} link="...">; add it')
        ends[end] = "" if reference is None else reference.get("link", "")
    axis = np.array(findings.numbers(element.find("axis"), "xyz", 3, "1 0 0"))
    length = float(np.linalg.norm(axis))
    if kind in MOVING_KINDS and length == 0.0:
        findings.error(
            element.find("axis"),
            f'axis of joint "{name}" is zero; give a direction such as "0 0 1"',
        )
    lower, upper, effort, velocity = _limits(findings, element, name, kind)
    dynamics, mimic = element.find("dynamics"), element.find("mimic")
    follows = None
    if mimic is not None:
        multiplier = findings.number(mimic, "multiplier", "1")
        offset = findings.number(mimic, "offset", "0")
        follows = Mimic(mimic.get("joint", ""), multiplier, offset)
    return Joint(
        name=name,
        line=element.sourceline,
        kind=kind,
        parent=ends["parent"],
        child=ends["child"],
        origin=_origin(findings, element),
        axis=_frozen(axis / length if length > 0 else axis),
        lower=lower,
        upper=upper,
        effort=effort,
        velocity=velocity,
        mimic=follows,
        damping=0.0 if dynamics is None else findings.number(dynamics, "damping", "0"),
        friction=0.0 if dynamics is None else findings.number(dynamics, "friction", "0"),
    )


def _limits(findings: Findings, element: Any, name: str, kind: str) -> tuple[float, ...]:
    limit = element.find("limit")
    if limit is None:
        if kind in ("revolute", "prismatic"):
            findings.add(
                "warning",
                element,
                f'joint "{name}" has no <limit>; it is taken as unlimited',
            )
        return -math.inf, math.inf, math.inf, math.inf
    effort, velocity = (_limit_size(findings, limit, name, key) for key in ("effort", "velocity"))
    lower, upper = -math.inf, math.inf
    if kind in ("revolute", "prismatic"):
        lower, upper = findings.number(limit, "lower", "0"), findings.number(limit, "upper", "0")
        if lower > upper:
            findings.error(
                limit, f'joint "{name}" has lower {lower:g} > upper {upper:g}; swap the two'
            )
    return lower, upper, effort, velocity


def _limit_size(findings: Findings, limit: Any, name: str, attribute: str) -> float:
    """Return an effort or velocity limit; inf where the file gives none."""
    size = findings.number(limit, attribute) if limit.get(attribute) else math.inf
    if size < 0:
        text = f'{attribute} limit {size:g} of joint "{name}" is negative; {-size:g} is used'
        findings.add("warning", limit, text)
    elif size == 0:
        text = f'{attribute} limit of joint "{name}" is 0; it is taken as not given'
        findings.add("warning", limit, text)
    return abs(size) or math.inf
