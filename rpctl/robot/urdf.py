"""The strict pass over a URDF: XML to records, with a line for everything that is wrong."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from rpctl.errors import DescriptionError, Finding
from rpctl.robot.description import (
    MOVING_KINDS,
    Array,
    Description,
    Joint,
    Link,
    Mimic,
    Shape,
    rotation_rpy,
)

MAX_BYTES = 32 * 2**20  # the largest public URDFs are near 1 MB; far above that is a mistake
MAX_LINKS = 2000  # Pinocchio's time grows with the square of the links
MAX_MOVING_JOINTS = 500  # Pinocchio's Data grows with the square of nv and crashes near 4200
KNOWN_KINDS = (*MOVING_KINDS, "fixed", "floating", "planar")
OTHER_FORMATS = {"sdf": "SDF", "mujoco": "MJCF", "mujocoinclude": "MJCF", "COLLADA": "COLLADA"}
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


def read(path: str | Path) -> Description:
    """Read a URDF strictly.

    Args:
        path: The file.

    Returns:
        The description, with warnings among its findings.

    Raises:
        DescriptionError: The file is missing, is not XML or URDF, or has errors; all that were
            found are named, each with its line.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        fix = "give a URDF file or a name listed by `rpctl robots`"
        raise DescriptionError(path, [Finding("error", None, f"{reason}; {fix}")]) from None
    return parse(path, data)


def parse(path: Path, data: bytes) -> Description:
    """Return the description in a file's bytes; as :func:`read`, without the reading."""
    root = _xml(path, data)
    findings = Findings()
    colours = {
        material.get("name"): _rgba(findings, material) for material in root.findall("material")
    }
    links = tuple(_link(findings, element, colours) for element in root.findall("link"))
    joints = tuple(_joint(findings, element) for element in root.findall("joint"))
    _names(findings, root)
    if not any(f.severity == "error" for f in findings.items):
        _tree(findings, root, links, joints)
    errors = [f for f in findings.items if f.severity == "error"]
    if errors:
        raise DescriptionError(path, errors)
    children = {joint.child for joint in joints}
    return Description(
        path=path,
        name=root.get("name") or path.stem,
        xml=etree.tostring(root, encoding="unicode"),
        sha256=hashlib.sha256(data).hexdigest(),
        root=next(link.name for link in links if link.name not in children),
        links=links,
        joints=joints,
        findings=tuple(findings.items),
    )


def _xml(path: Path, data: bytes) -> Any:
    """Return the <robot> element, or raise one clear error."""

    def refuse(message: str, line: int | None = None) -> DescriptionError:
        return DescriptionError(path, [Finding("error", line, message)])

    if len(data) > MAX_BYTES:
        raise refuse(
            f"{len(data)} bytes is over the limit of {MAX_BYTES} (rpctl.robot.urdf.MAX_BYTES); "
            "a URDF names its meshes, it does not hold them"
        )
    if not data.strip():
        raise refuse("the file is empty; give a URDF")
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise refuse(f"not XML: {error.msg}; a URDF is an XML file", error.lineno) from None
    if root.getroottree().docinfo.doctype:
        raise refuse("a DOCTYPE is not part of URDF; remove it", 1)
    if root.tag in OTHER_FORMATS:
        raise refuse(f"this is {OTHER_FORMATS[root.tag]}, not URDF; export the robot as URDF", 1)
    if root.tag != "robot":
        if etree.QName(root).localname == "robot":
            raise refuse('<robot> has a default namespace; remove its xmlns="..."', root.sourceline)
        raise refuse(f"the root element is <{root.tag}>; a URDF's is <robot>", root.sourceline)
    macros = [e for e in root.iter() if isinstance(e.tag, str) and "xacro" in e.tag]
    if macros:
        raise refuse("xacro is left unexpanded; run `xacro` on it first", macros[0].sourceline)
    if not root.findall("link"):
        raise refuse("the robot has no <link>; a URDF has at least one", root.sourceline)
    if len(root.findall("link")) > MAX_LINKS:
        raise refuse(f"more than {MAX_LINKS} links (rpctl.robot.urdf.MAX_LINKS)")
    return root


def _origin(findings: Findings, element: Any) -> Array:
    origin = element.find("origin")
    placement = np.eye(4)
    placement[:3, 3] = findings.numbers(origin, "xyz", 3, "0 0 0")
    placement[:3, :3] = rotation_rpy(*findings.numbers(origin, "rpy", 3, "0 0 0"))
    return _frozen(placement)


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array


def _rgba(findings: Findings, material: Any) -> tuple[float, ...] | None:
    colour = None if material is None else material.find("color")
    return None if colour is None else tuple(findings.numbers(colour, "rgba", 4, None))


def _link(findings: Findings, element: Any, colours: dict[str, Any]) -> Link:
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
        rgba = _rgba(findings, material)
        if rgba is None and material is not None:
            rgba = colours.get(material.get("name"))
        mesh = solid.get("filename") if solid.tag == "mesh" else None
        origin = _origin(findings, element)
        shapes.append(Shape(solid.tag, tuple(size), origin, mesh, rgba, solid.sourceline))
    return tuple(shapes)


def _joint(findings: Findings, element: Any) -> Joint:
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


def _names(findings: Findings, root: Any) -> None:
    for tag in ("link", "joint"):
        elements = root.findall(tag)
        counts = Counter(element.get("name") for element in elements)
        for element in elements:
            name = element.get("name")
            if not name:
                findings.error(element, f"<{tag}> without a name; name it")
            elif counts[name] > 1:
                findings.error(element, f'{tag} "{name}" is named {counts[name]} times; rename')


def _tree(
    findings: Findings, root: Any, links: tuple[Link, ...], joints: tuple[Joint, ...]
) -> None:
    """Note what keeps the joints from being one tree over the links."""
    elements = {e.get("name"): e for e in root.findall("joint")}
    names = {link.name for link in links}
    parents: dict[str, Joint] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in names:
                findings.error(
                    elements[joint.name], f'joint "{joint.name}" names an unknown link "{end}"'
                )
        if joint.child in parents:
            findings.error(
                elements[joint.name],
                f'link "{joint.child}" has two parents: joints "{parents[joint.child].name}" '
                f'and "{joint.name}"; a URDF is a tree, remove one',
            )
        parents[joint.child] = joint
        if joint.mimic is not None and joint.mimic.joint not in elements:
            findings.error(
                elements[joint.name],
                f'joint "{joint.name}" mimics an unknown joint "{joint.mimic.joint}"',
            )
    roots = [link.name for link in links if link.name not in parents]
    if len(roots) > 1:
        listed = ", ".join(f'"{name}"' for name in roots[:6])
        findings.error(root, f"{len(roots)} root links ({listed}); join them by fixed joints")
    elif not roots:
        findings.error(root, "the joints form a cycle; a URDF is a tree with one root link")
    else:
        reached, edge = {roots[0]}, [roots[0]]
        below: dict[str, list[str]] = {}
        for joint in joints:
            below.setdefault(joint.parent, []).append(joint.child)
        while edge:
            new = below.get(edge.pop(), [])
            reached.update(new)
            edge.extend(new)
        for name in sorted(names - reached):
            findings.error(
                elements[parents[name].name], f'link "{name}" is in a cycle, not below the root'
            )
    if sum(joint.moving for joint in joints) > MAX_MOVING_JOINTS:
        findings.error(
            root,
            f"more than {MAX_MOVING_JOINTS} moving joints (rpctl.robot.urdf.MAX_MOVING_JOINTS)",
        )
