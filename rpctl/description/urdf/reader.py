"""The strict pass over a URDF: XML to records, with a line for everything that is wrong."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any
from unicodedata import category

from lxml import etree

from rpctl.description.records import READ_DEFAULTS, Description, Joint, Link, Mimic, ReadSettings
from rpctl.description.urdf.document import Refusal, parse_document, require_few_links
from rpctl.description.urdf.findings import MAX_NUMBER, Findings
from rpctl.description.urdf.joints import (
    read_actuated,
    read_joint,
    read_plugins,
    read_rotors,
    read_sprung,
)
from rpctl.description.urdf.links import read_colour, read_link
from rpctl.description.xacro.expansion import expand, explanation, is_xacro
from rpctl.errors import DescriptionError, fault_at
from rpctl.files.caps import cap, how_to_raise, read_source

ENGINES_READ = {  # what dynamics need; engines refuse robots for faults in the rest
    "robot": {"link", "joint", "transmission"},
    "link": {"inertial"},
    "inertial": {"origin", "mass", "inertia"},
    "joint": {"origin", "parent", "child"},
}
ENGINES_READ_OF_MOVING = ENGINES_READ["joint"] | {"axis", "limit", "mimic"}
RESERVED = ("universe", "root_joint")  # Pinocchio's own joints
MAX_CHAIN = 20  # mimics that follow one another
MAX_LISTED = 6  # names that one message lists
CHILDREN = {
    "robot": ("link", "joint", "material", "gazebo", "transmission", "sensor", "ros2_control"),
    "link": ("inertial", "visual", "collision", "contact", "self_collision_checking", "sensor"),
    "joint": (
        "origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration",
        "safety_controller",
    ),
    "inertial": ("origin", "mass", "inertia"),
}  # fmt: skip
MIN_SPELLING_LIKENESS = 0.75  # least likeness (0 to 1) of a misspelt name


def read(path: str | Path, settings: ReadSettings = READ_DEFAULTS) -> Description:
    """Read a URDF strictly, or a .xacro that becomes one.

    Args:
        settings: Where packages lie, and the values of xacro's arguments.

    Returns:
        The description, with warnings among its findings.

    Raises:
        DescriptionError: The file is missing, is not XML or URDF, or has errors; all that were
            found are named, each with its line.
        ExpansionError: The .xacro cannot be expanded.
    """
    path = Path(path)
    data = read_source(path)
    digest = hashlib.sha256(data).hexdigest()
    if not is_xacro(path, data):
        if settings.xacro_args:
            given = ", ".join(settings.xacro_args)
            raise fault_at(
                path, None, f"it contains no xacro, so it takes no arguments; leave out {given}"
            )
        return replace(parse(path, data), read_with=settings, file_sha256=digest)
    expansion = expand(path, settings)
    description = parse(path, expansion.text.encode("utf-8"))
    findings = (*expansion.findings, *description.findings, explanation(path))
    return replace(
        description, read_with=settings, expanded=True, findings=findings, file_sha256=digest
    )


def parse(path: Path, data: bytes) -> Description:
    """Return the description in a file's bytes; as :func:`read`, without the reading."""
    findings = Findings()
    try:
        root = _document(data, findings)
    except Refusal as refusal:
        raise fault_at(path, refusal.line, str(refusal)) from None
    colours = {e.get("name"): read_colour(findings, e) for e in root.findall("material")}
    links = tuple(read_link(findings, element, colours) for element in root.findall("link"))
    joints = tuple(read_joint(findings, element) for element in root.findall("joint"))
    rotors, plugins = read_rotors(findings, root), read_plugins(root)
    actuated, sprung = read_actuated(root), read_sprung(root)
    check_spelling(findings, root)
    check_names(findings, root)
    if not findings.errors:
        check_tree(findings, root, links, joints)
        joints = resolve_mimics(findings, root, joints)
    name = root.get("name", "").strip()
    if not name:
        findings.warn(root, f'<robot> has no name; it is called "{path.stem}", add name="..."')
    if findings.errors:
        raise DescriptionError(path, findings.sorted())
    children = {joint.child for joint in joints}
    return Description(
        path=path,
        name=name or path.stem,
        xml=_engine_xml(root, name or path.stem),
        sha256=hashlib.sha256(data).hexdigest(),
        root=next(link.name for link in links if link.name not in children),
        links=links,
        joints=joints,
        findings=tuple(findings.sorted()),
        raw=data,
        urdf=data,
        rotors=rotors,
        plugins=plugins,
        actuated=actuated,
        sprung=sprung,
    )


def _document(data: bytes, findings: Findings) -> Any:
    """Return the <robot> element, or raise one clear refusal."""
    most = cap("MAX_BYTES")
    if len(data) > most:
        raise Refusal(
            f"the file is over {most} bytes; a URDF refers to meshes, it does not contain them; "
            f"{how_to_raise('MAX_BYTES')}"
        )
    root = parse_document(data, findings)
    count = len(root.findall("link"))
    if not count:
        if root.find("group") is not None or root.find("disable_collisions") is not None:
            raise Refusal(
                "this is an SRDF, which MoveIt uses beside a URDF; give the URDF", root.sourceline
            )
        raise Refusal(
            "the robot has no <link>; a URDF has at least one, and xacro's macros alone are no "
            "robot",
            root.sourceline,
        )
    require_few_links(count, root.sourceline)
    return root


def _engine_xml(root: Any, name: str) -> str:
    """Return the document as the engines downstream read it: inertias and joints."""
    root.attrib.clear()
    root.set("name", name)
    for parent in (root, *root.xpath("link | link/inertial | joint")):
        moves = parent.tag == "joint" and parent.get("type") != "fixed"
        kept = ENGINES_READ_OF_MOVING if moves else ENGINES_READ[parent.tag]
        for child in list(parent):
            if child.tag not in kept:
                parent.remove(child)
    return str(etree.tostring(root, encoding="unicode"))


def check_spelling(findings: Findings, root: Any) -> None:
    """Note elements whose names are almost those of URDF; they would be left out silently."""
    for parent in (root, *root.findall("link"), *root.findall("joint"), *root.iter("inertial")):
        known = CHILDREN[parent.tag]
        for child in parent:
            tag = str(child.tag)
            if tag in known:
                continue
            near = get_close_matches(tag[:60], known, n=1, cutoff=MIN_SPELLING_LIKENESS)
            if near:
                findings.warn(
                    child,
                    f"<{tag}> in <{parent.tag}> is not URDF and is ignored; did you mean "
                    f"<{near[0]}>?",
                )


def check_names(findings: Findings, root: Any) -> None:
    """Note links and joints without a name, of one name, or of a name that is taken or unfit."""
    for element in (root, *root.xpath("link | joint")):
        name = element.get("name", "")
        if any(
            category(sign) == "Cc" for sign in name
        ):  # it could end its line, or steer a terminal
            findings.error(
                element, f'{element.tag} "{name}" has a control character in its name; remove it'
            )
    for tag in ("link", "joint"):
        lines: dict[str, int] = {}
        for element in root.findall(tag):
            name = element.get("name")
            if not name:
                findings.error(element, f"<{tag}> without a name; name it")
            elif name in lines:
                findings.error(
                    element, f'{tag} "{name}" is already at line {lines[name]}; rename one of them'
                )
            elif tag == "joint" and name in RESERVED:
                findings.error(
                    element, f'joint "{name}" has a name that Pinocchio reserves; rename it'
                )
            lines.setdefault(name, element.sourceline)


def check_tree(
    findings: Findings, root: Any, links: Sequence[Link], joints: Sequence[Joint]
) -> None:
    """Note every reason why the joints are not one tree over the links."""
    elements = {element.get("name"): element for element in root.findall("joint")}
    names = {link.name for link in links}
    parents: dict[str, Joint] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in names:
                findings.error(
                    elements[joint.name],
                    f'joint "{joint.name}" names an unknown link "{end}"; correct the name',
                )
        if joint.child in parents:
            findings.error(
                elements[joint.name],
                f'link "{joint.child}" has two parents: joints "{parents[joint.child].name}" '
                f'and "{joint.name}"; a URDF is a tree, remove one',
            )
        else:
            parents[joint.child] = joint
    roots = [link.name for link in links if link.name not in parents]
    if len(roots) > 1:
        listed = ", ".join(f'"{name}"' for name in roots[:MAX_LISTED])
        more = ", ..." if len(roots) > MAX_LISTED else ""
        findings.error(root, f"{len(roots)} root links ({listed}{more}); join them by fixed joints")
    elif not roots:
        findings.error(root, "the joints form a cycle; a URDF is a tree with one root link")
    else:
        for name in sorted(_in_cycles({child: each.parent for child, each in parents.items()})):
            findings.error(
                elements[parents[name].name],
                f'link "{name}" is in a cycle, not below the root; correct a parent',
            )


def _in_cycles(above: Mapping[str, str]) -> set[str]:
    """Return the links that are below themselves, not those that only hang on such a cycle.

    Args:
        above: The parent of each link but the root.
    """
    found, seen = set[str](), set[str]()
    for name in above:
        way = []
        while name in above and name not in seen:
            seen.add(name)
            way.append(name)
            name = above[name]
        if name in way:
            found.update(way[way.index(name) :])
    return found


def resolve_mimics(findings: Findings, root: Any, joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Return the joints with every mimic following a free joint; note those that cannot.

    Args:
        root: The <robot>; its <mimic> elements are corrected, too.
    """
    by_name = {joint.name: joint for joint in joints}
    if all(joint.mimic is None for joint in joints):
        return tuple(joints)
    elements = {element.get("name"): element for element in root.findall("joint")}
    resolved = []
    for joint in joints:
        if joint.mimic is None or not joint.moving:
            resolved.append(replace(joint, mimic=None))
            continue
        element = elements[joint.name].find("mimic")
        fault, mimic = _followed(joint, joint.mimic, by_name)
        if fault:
            findings.error(element, f'joint "{joint.name}" {fault}')
        elif mimic != joint.mimic:
            findings.warn(
                element,
                f'joint "{joint.name}" mimics "{joint.mimic.joint}", itself a mimic; rpctl '
                f'resolves it to "{mimic.joint}"',
            )
            element.set("joint", mimic.joint)
            element.set("multiplier", repr(mimic.multiplier))
            element.set("offset", repr(mimic.offset))
        resolved.append(replace(joint, mimic=mimic))
    return tuple(resolved)


def _followed(joint: Joint, mimic: Mimic, by_name: dict[str, Joint]) -> tuple[str, Mimic]:
    """Return the fault of a joint's mimic, empty if it has none, and the mimic of a free joint."""
    seen = [joint.name]
    while True:
        followed = by_name.get(mimic.joint)
        if followed is None:
            return f'mimics an unknown joint "{mimic.joint}"; correct the name', mimic
        if followed.name == joint.name and len(seen) == 1:
            return "mimics itself; name another joint", mimic
        if followed.name in seen:
            return (
                f"mimics itself in a loop ({' > '.join(seen[:MAX_LISTED])}); let one be free",
                mimic,
            )
        if not followed.moving:
            return f'mimics joint "{followed.name}", which is fixed; make it fixed, too', mimic
        seen.append(followed.name)
        if abs(mimic.multiplier) > MAX_NUMBER or abs(mimic.offset) > MAX_NUMBER:
            return "mimics with a multiplier or offset that is too large; correct it", mimic
        if followed.mimic is None:
            return "", mimic
        if len(seen) > MAX_CHAIN:
            return f"mimics through a chain of over {MAX_CHAIN}; name the joint at its end", mimic
        above = followed.mimic
        mimic = Mimic(
            above.joint,
            mimic.multiplier * above.multiplier,
            mimic.multiplier * above.offset + mimic.offset,
        )
