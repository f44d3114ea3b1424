"""Checks of the structure: known elements, unique names, one tree over all links, mimics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import Any
from unicodedata import category

from rpctl.description.findings import MAX_NUMBER, Findings
from rpctl.description.records import Joint, Link, Mimic

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
                text = f"<{tag}> in <{parent.tag}> is not URDF, it is left out; "
                findings.warn(child, f"{text}did you mean <{near[0]}>?")


def check_names(findings: Findings, root: Any) -> None:
    """Note links and joints without a name, of one name, or of a name that is taken or unfit."""
    _require_writing(findings, root)
    for tag in ("link", "joint"):
        lines: dict[str, int] = {}
        for element in root.findall(tag):
            name = element.get("name")
            if not name:
                findings.error(element, f"<{tag}> without a name; name it")
            elif name in lines:
                text = f'{tag} "{name}" is already at line {lines[name]}; rename one of them'
                findings.error(element, text)
            elif tag == "joint" and name in RESERVED:
                text = f'joint "{name}" has a name that Pinocchio takes for itself; rename it'
                findings.error(element, text)
            if name:
                lines.setdefault(name, element.sourceline)
                _require_writing(findings, element)


def _require_writing(findings: Findings, element: Any) -> None:
    """Refuse a name that could end the line it is written on, or steer a terminal."""
    if any(category(sign) == "Cc" for sign in element.get("name", "")):
        text = (
            f'{element.tag} "{element.get("name")}" has a control character in its name; remove it'
        )
        findings.error(element, text)


def check_tree(
    findings: Findings, root: Any, links: Sequence[Link], joints: Sequence[Joint]
) -> None:
    """Note every reason why the joints are not one tree over the links.

    Args:
        findings: Where to note faults.
        root: The <robot>.
        links: Its links.
        joints: Its joints.
    """
    elements = {element.get("name"): element for element in root.findall("joint")}
    names = {link.name for link in links}
    parents: dict[str, Joint] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in names:
                text = f'joint "{joint.name}" names an unknown link "{end}"; correct the name'
                findings.error(elements[joint.name], text)
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
        text = f"{len(roots)} root links ({listed}{more}); join them by fixed joints"
        findings.error(root, text)
    elif not roots:
        findings.error(root, "the joints form a cycle; a URDF is a tree with one root link")
    else:
        for name in sorted(names - _reached(roots[0], joints)):
            text = f'link "{name}" is in a cycle, not below the root; correct a parent'
            findings.error(elements[parents[name].name], text)


def _reached(root: str, joints: Sequence[Joint]) -> set[str]:
    below: dict[str, list[str]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint.child)
    reached, stack = {root}, [root]
    while stack:
        new = [child for child in below.get(stack.pop(), ()) if child not in reached]
        reached.update(new)
        stack.extend(new)
    return reached


def resolve_mimics(findings: Findings, root: Any, joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Return the joints with every mimic following a free joint; note those that cannot.

    Args:
        findings: Where to note faults.
        root: The <robot>; its <mimic> elements are corrected, too.
        joints: Its joints.
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
            text = f'joint "{joint.name}" mimics "{joint.mimic.joint}", itself a mimic; '
            findings.warn(element, f'{text}read as one of "{mimic.joint}"')
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
            return f"mimics in a circle ({' > '.join(seen[:MAX_LISTED])}); let one be free", mimic
        if not followed.moving:
            return f'mimics joint "{followed.name}", which is fixed; make it fixed, too', mimic
        seen.append(followed.name)
        if abs(mimic.multiplier) > MAX_NUMBER or abs(mimic.offset) > MAX_NUMBER:
            return "mimics with an absurd multiplier or offset; correct it", mimic
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
