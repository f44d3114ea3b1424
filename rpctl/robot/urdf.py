"""The strict pass over a URDF: XML to records, with a line for everything that is wrong."""

from __future__ import annotations

import hashlib
from collections import Counter
from pathlib import Path
from typing import Any

from lxml import etree

from rpctl.errors import DescriptionError, Finding
from rpctl.robot.description import Description, Joint, Link
from rpctl.robot.elements import Findings, read_colour, read_joint, read_link

MAX_BYTES = 32 * 2**20  # the largest public URDFs are near 1 MB; far above that is a mistake
MAX_LINKS = 2000  # Pinocchio's time grows with the square of the links
MAX_MOVING_JOINTS = 500  # Pinocchio's Data grows with the square of nv and crashes near 4200
OTHER_FORMATS = {"sdf": "SDF", "mujoco": "MJCF", "mujocoinclude": "MJCF", "COLLADA": "COLLADA"}


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
        material.get("name"): read_colour(findings, material)
        for material in root.findall("material")
    }
    links = tuple(read_link(findings, element, colours) for element in root.findall("link"))
    joints = tuple(read_joint(findings, element) for element in root.findall("joint"))
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
