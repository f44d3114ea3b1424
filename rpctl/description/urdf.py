"""The strict pass over a URDF: XML to records, with a line for everything that is wrong."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

from lxml import etree

from rpctl.description.document import parse_document, require_few_links
from rpctl.description.encoding import Refusal
from rpctl.description.expansion import expand, explanation, is_xacro
from rpctl.description.findings import Findings
from rpctl.description.joints import read_joint
from rpctl.description.links import read_link
from rpctl.description.read_settings import READ_DEFAULTS, ReadSettings
from rpctl.description.records import Description, Joint, Link
from rpctl.description.shapes import read_colour
from rpctl.description.structure import check_names, check_spelling, check_tree, resolve_mimics
from rpctl.description.transmissions import read_rotors
from rpctl.errors import DescriptionError, Finding
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.opening import read_source

ENGINES_READ = {  # what dynamics need; engines refuse robots for faults in the rest
    "robot": {"link", "joint", "transmission"},
    "link": {"inertial"},
    "inertial": {"origin", "mass", "inertia"},
    "joint": {"origin", "parent", "child"},
}
ENGINES_READ_OF_MOVING = ENGINES_READ["joint"] | {"axis", "limit", "mimic"}


def read(path: str | Path, settings: ReadSettings = READ_DEFAULTS) -> Description:
    """Read a URDF strictly, or a .xacro that becomes one.

    Args:
        path: The file.
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
            fault = f"it holds no xacro and takes no arguments; leave out {given}"
            raise DescriptionError(path, [Finding("error", None, fault)])
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
        raise DescriptionError(path, [Finding("error", refusal.line, str(refusal))]) from None
    colours = {e.get("name"): read_colour(findings, e) for e in root.findall("material")}
    links = tuple(read_link(findings, element, colours) for element in root.findall("link"))
    joints = tuple(read_joint(findings, element) for element in root.findall("joint"))
    rotors = read_rotors(findings, root)
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
    name = name or path.stem
    described = _description(path, name, data, root, links, joints, findings)
    return replace(described, rotors=rotors)


def _document(data: bytes, findings: Findings) -> Any:
    """Return the <robot> element, or raise one clear refusal."""
    most = cap("MAX_BYTES")
    if len(data) > most:
        text = f"the file is over {most} bytes; a URDF names its meshes, it does not hold them"
        raise Refusal(f"{text}; {how_to_raise('MAX_BYTES')}")
    root = parse_document(data, findings)
    count = len(root.findall("link"))
    if not count:
        if root.find("group") is not None or root.find("disable_collisions") is not None:
            fix = "give the URDF beside it"
            raise Refusal(f"this is SRDF, what MoveIt adds to a URDF; {fix}", root.sourceline)
        text = "the robot has no <link>; a URDF has at least one"
        raise Refusal(f"{text}, and xacro's macros alone are no robot", root.sourceline)
    require_few_links(count, root.sourceline)
    return root


def _description(
    path: Path,
    name: str,
    data: bytes,
    root: Any,
    links: tuple[Link, ...],
    joints: tuple[Joint, ...],
    findings: Findings,
) -> Description:
    children = {joint.child for joint in joints}
    return Description(
        path=path,
        name=name,
        xml=_engine_xml(root, name),
        sha256=hashlib.sha256(data).hexdigest(),
        root=next(link.name for link in links if link.name not in children),
        links=links,
        joints=joints,
        findings=tuple(findings.sorted()),
        raw=data,
        urdf=data,
    )


def _engine_xml(root: Any, name: str) -> str:
    """Return the document as the engines downstream read it: inertias and joints."""
    root.attrib.clear()
    root.set("name", name)
    _keep(root, ENGINES_READ["robot"])
    for link in root.findall("link"):
        _keep(link, ENGINES_READ["link"])
        for inertial in link:
            _keep(inertial, ENGINES_READ["inertial"])
    for joint in root.findall("joint"):
        fixed = joint.get("type") == "fixed"
        _keep(joint, ENGINES_READ["joint"] if fixed else ENGINES_READ_OF_MOVING)
    return str(etree.tostring(root, encoding="unicode"))


def _keep(element: Any, tags: set[str]) -> None:
    for child in list(element):
        if child.tag not in tags:
            element.remove(child)
