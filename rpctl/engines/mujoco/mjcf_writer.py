"""A robot's ``MjSpec`` as MJCF: every number in full, every default left out.

MuJoCo's writer rounds to six digits, so that what is read back is another robot. How many it writes
is a setting of its library that its Python module leaves out; here it writes enough to read each
double again, and they are then shortened as far as they may be. An export reads its file back, so a
MuJoCo that rounds all the same is found.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from lxml import etree

from rpctl.engines.mujoco.library import mujoco_library

DIGITS = 17  # of which each double is read again
LONG_NUMBER = re.compile(r"-?\d+\.\d{9,}(e[+-]?\d+)?")
WRITTEN_LAST = ("sensor", "keyframe", "custom")  # sections that stand below the model's own


@dataclass(frozen=True)
class Part:
    """An element that is added to a body or a section: a drawn shape, a sensor, a text.

    Attributes:
        tag: As MJCF calls it.
        attributes: As written.
    """

    tag: str
    attributes: dict[str, str]


def numbers(values: Iterable[float]) -> str:
    """Return numbers as MJCF has them, each in the fewest digits that it is read from again."""
    return " ".join(_number(value) for value in values)


def write_model(
    spec: Any, drawn: dict[str, list[Part]], sections: dict[str, list[Part]], comment: str
) -> Any:
    """Return the root element of the MJCF of a spec that was compiled.

    Args:
        spec: ``MjSpec``.
        drawn: Shapes that are only drawn, lights and cameras, by the name of their body.
        sections: What else there is, by section: ``"asset"``, ``"sensor"``, ``"custom"`` …
        comment: What a reader is told at the top.
    """
    root = etree.fromstring(_xml(spec))
    root.insert(0, etree.Comment(comment))
    for motor in root.iter("general"):  # MuJoCo calls them so
        motor.tag = "motor"
    bodies = {body.get("name"): body for body in root.iter("body")}
    bodies["world"] = world = root.find("worldbody")
    for name, parts in drawn.items():
        _add(bodies[name], parts)
    for name, parts in sections.items():
        if parts:
            section = etree.Element(name)
            _add(section, parts)
            root.insert(len(root) if name in WRITTEN_LAST else root.index(world), section)
    return root


def to_bytes(root: Any) -> bytes:
    """Return a document as the bytes of a file."""
    etree.indent(root)
    return bytes(etree.tostring(root, encoding="utf-8", xml_declaration=False)) + b"\n"


def _xml(spec: Any) -> str:
    """Return a spec as MuJoCo writes it, with all digits that count."""
    native = ctypes.CDLL(mujoco_library()._functions.__file__)
    usual = native._mjPRIVATE__get_xml_precision()
    native._mjPRIVATE__set_xml_precision(DIGITS)
    try:
        return LONG_NUMBER.sub(lambda found: _number(found[0]), spec.to_xml())
    finally:
        native._mjPRIVATE__set_xml_precision(usual)


def _add(parent: Any, parts: Iterable[Part]) -> None:
    for part in parts:
        etree.SubElement(parent, part.tag, part.attributes)


def _number(value: Any) -> str:
    """Return a number in the fewest digits that it is read from again."""
    number = float(value)
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)
