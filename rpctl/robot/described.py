"""Descriptions with other masses and losses: in the records, and in the text that proofs read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from lxml import etree

from rpctl.description.density import inertial_element
from rpctl.description.document import parse_document
from rpctl.description.findings import Findings
from rpctl.description.records import Description, Joint, Link

Element = Any


def with_links(description: Description, links: Mapping[str, Link]) -> Description:
    """Return a description with other masses, centres and inertias of some links.

    What was estimated stays an estimate, which the user's text does not have.

    Args:
        description: The description.
        links: Their records, by name.
    """
    if not links:
        return description
    root = etree.fromstring(description.xml)
    _write_links(root, links)
    written = {name: link for name, link in links.items() if not link.estimated}
    return replace(
        description,
        links=tuple(links.get(link.name, link) for link in description.links),
        xml=str(etree.tostring(root, encoding="unicode")),
        raw=_edited(description.raw, lambda root: _write_links(root, written)),
    )


def with_joint_losses(description: Description, joints: Mapping[str, Joint]) -> Description:
    """Return a description with other damping and friction of some joints.

    Args:
        description: The description.
        joints: Their records, by name.
    """
    if not joints:
        return description
    return replace(
        description,
        joints=tuple(joints.get(joint.name, joint) for joint in description.joints),
        raw=_edited(description.raw, lambda root: _write_losses(root, joints)),
    )


def _edited(raw: bytes, change: Callable[[Element], None]) -> bytes:
    """Return a file's bytes changed; they were read once, so they can be read again."""
    root = parse_document(raw, Findings())
    change(root)
    return bytes(etree.tostring(root))


def _write_links(root: Element, links: Mapping[str, Link]) -> None:
    for element, link in _named(root, "link", links):
        _remove(element, "inertial")
        element.append(inertial_element(link))


def _write_losses(root: Element, joints: Mapping[str, Joint]) -> None:
    for element, joint in _named(root, "joint", joints):
        _remove(element, "dynamics")
        losses = {"damping": repr(joint.damping), "friction": repr(joint.friction)}
        etree.SubElement(element, "dynamics", losses)


def _named(root: Element, tag: str, records: Mapping[str, Any]) -> Iterator[tuple[Element, Any]]:
    """Yield the robot's own elements of a tag that there are records of."""
    for element in root.findall(tag):
        name = (element.get("name") or "").strip()
        if name in records:
            yield element, records[name]


def _remove(element: Element, tag: str) -> None:
    for old in element.findall(tag):
        element.remove(old)
