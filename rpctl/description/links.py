"""Links of a URDF as records: mass and inertia, with doubts about them, and shapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.description.findings import Findings
from rpctl.description.origin import read_origin
from rpctl.description.records import Link
from rpctl.description.shapes import Colours, read_shapes

SPD_MARGIN = 1e-12  # of the largest entry: below it an inertia's eigenvalue is rounding
TRIANGLE_MARGIN = 1e-6  # of the larger side: CAD rounding
MAX_MASS_KG = 1e4  # kg; above it a link's mass is probably in grams
MAX_GYRATION_RADIUS_M = 10.0  # m; a radius of gyration above it is probably one in mm
OSMIUM_DENSITY = 22600.0  # kg/m³, of the densest metal
MIN_OSMIUM_INERTIA = 0.01  # of that of a ball of osmium: below it the units are probably wrong
AXES = ("xx", "xy", "xz", "yy", "yz", "zz")


def read_link(findings: Findings, element: Any, colours: Colours) -> Link:
    """Return the record of a <link>.

    Args:
        findings: Where to note faults.
        element: The <link>.
        colours: RGBA of the robot's named materials, by name.
    """
    mass, com, inertia = _read_inertial(findings, element)
    visuals = read_shapes(findings, element, "visual", colours)
    collisions = read_shapes(findings, element, "collision", colours)
    for array in (com, inertia):
        array.setflags(write=False)
    return Link(
        element.get("name", ""), element.sourceline, mass, com, inertia, visuals, collisions
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
        fix = "add it, or remove the <inertial> and let --density estimate it"
        findings.error(inertial, f'<inertial> of link "{name}" has no <{missing}>; {fix}')
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
        _doubt_mass(findings, mass_element, name, mass)
        _doubt_inertia(findings, inertia_element, name, mass, inertia)
    return mass, origin[:3, 3].copy(), inertia


def _doubt_mass(findings: Findings, element: Any, name: str, mass: float) -> None:
    if mass > MAX_MASS_KG:
        text = f'mass {mass:g} kg of link "{name}" is very large; is it in grams? give kg'
        findings.warn(element, text)


def _doubt_inertia(
    findings: Findings, element: Any, name: str, mass: float, inertia: Array
) -> None:
    """Note an inertia that no body of this mass has."""
    moments = np.linalg.eigvalsh(inertia)
    least, middle, most = moments.tolist()
    listed = f"principal moments {', '.join(f'{m:.3g}' for m in moments)} kg·m²"
    slack = SPD_MARGIN * max(most, 0.0)
    if mass == 0:
        if inertia.any():
            text = f'link "{name}" has an inertia but the mass 0; give its mass, or no inertia'
            findings.warn(element, text)
    elif most == least == 0:
        text = f'link "{name}" is a point mass: its inertia is 0; give it if the link turns'
        findings.add("info", element, text)
    elif least < -slack or least <= slack < most:
        findings.warn(
            element,
            f'inertia of link "{name}" is not positive definite ({listed}); no real body has it, '
            "correct it",
        )
    elif most > (least + middle) * (1 + TRIANGLE_MARGIN):
        findings.warn(
            element,
            f'inertia of link "{name}" breaks the triangle rule ({listed}); no real body has it, '
            "correct it",
        )
    else:
        _doubt_units(findings, element, name, mass, most)


def _doubt_units(findings: Findings, element: Any, name: str, mass: float, most: float) -> None:
    radius = math.sqrt(most / mass)
    ball = (3.0 * mass / (4.0 * math.pi * OSMIUM_DENSITY)) ** (1.0 / 3.0)
    if radius > MAX_GYRATION_RADIUS_M:
        findings.warn(
            element,
            f'inertia of link "{name}" is that of {mass:g} kg at {radius:.3g} m from the axis; '
            "is it in kg·mm² (divide by 1e6) or g·mm² (by 1e9)? give kg·m²",
        )
    elif most < MIN_OSMIUM_INERTIA * 0.4 * mass * ball**2:
        findings.warn(
            element,
            f'inertia of link "{name}" is too small for {mass:g} kg: the largest moment, '
            f"{most:.3g} kg·m², is less than osmium's; check its unit, kg·m²",
        )
