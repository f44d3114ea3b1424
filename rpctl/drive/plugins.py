"""What a URDF tells simulators and controllers of its base: plugins, and joints with actuators."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from rpctl.description.document import parse_document
from rpctl.description.findings import Findings
from rpctl.description.records import Description

PLANAR = "planar"  # moves the base any way, whatever its wheels: weak evidence
KINDS = (  # words of a plugin's file or name, or of a controller's type, without _ and -
    ("mecanum", "mecanum"),
    ("skidsteer", "skid-steer"),
    ("diffdrive", "differential"),
    ("differentialdrive", "differential"),
    ("ackermann", "car-like"),
    ("tricycle", "tricycle"),
    ("omnidrive", "omni"),
    ("omniwheel", "omni"),
    ("planarmove", PLANAR),
    ("forcebasedmove", PLANAR),
)
JOINT_TAG = re.compile(r".*(joint|wheel)(name)?s?")  # an element that names a wheel's joint
MARKS = (b"<plugin", b"<ros2_control", b"tiffness>")  # of a file that has any of this


@dataclass(frozen=True)
class BaseControl:
    """A plugin or a controller that moves the base.

    Attributes:
        kind: Type of the drive that it is made for, or ``"planar"`` for any.
        label: What to call it in a sentence.
        line: Its line in the URDF; None for one of another file.
        joints: Joints that it names as wheels'.
        radius: Of the wheels, m, or None.
        separation: Distance between the left and the right wheels, m, or None.
        radius_multiplier: Factor of the radius in its odometry.
        separation_multiplier: Factor of the separation.
    """

    kind: str
    label: str
    line: int | None
    joints: tuple[str, ...] = ()
    radius: float | None = None
    separation: float | None = None
    radius_multiplier: float = 1.0
    separation_multiplier: float = 1.0


@dataclass(frozen=True)
class SimulatorTags:
    """What a URDF has for simulators and controllers.

    Attributes:
        controls: Plugins that move the base.
        actuated: Joints with a transmission, or a command interface of ros2_control.
        sprung: Joints with a spring of Gazebo.
        parameters: Files of parameters that its plugins name.
    """

    controls: tuple[BaseControl, ...]
    actuated: frozenset[str]
    sprung: frozenset[str]
    parameters: tuple[Path, ...]


def read_simulator_tags(description: Description) -> SimulatorTags:
    """Return what a description has for simulators and controllers."""
    document = etree.fromstring(description.xml.encode())
    actuated = {joint.get("name") for joint in document.iterfind("transmission/joint")}
    if not any(mark in description.raw for mark in MARKS):
        return SimulatorTags((), frozenset(actuated), frozenset(), ())
    root = parse_document(description.raw, Findings())
    for joint in root.iterfind("ros2_control/joint"):
        if joint.find("command_interface") is not None:
            actuated.add(joint.get("name"))
    sprung = (g.get("reference") for g in root.iterfind("gazebo") if _has_spring(g))
    plugins = [*root.iterfind(".//plugin")]
    parameters = (each.text.strip() for p in plugins for each in p.iterfind("parameters")
                  if each.text)  # fmt: skip
    return SimulatorTags(
        controls=tuple(control for plugin in plugins for control in _control(plugin)),
        actuated=frozenset(actuated),
        sprung=frozenset(sprung),
        parameters=tuple(Path(text) for text in parameters),
    )


def kind_of(text: str) -> str | None:
    """Return the type of drive that a name of a plugin or a controller mentions, or None."""
    words = re.sub(r"[_\-\s]", "", text.lower())
    return next((kind for word, kind in KINDS if word in words), None)


def _has_spring(gazebo: Any) -> bool:
    """Return whether a <gazebo> element gives its joint a spring."""
    stiffness = [gazebo.findtext(tag) for tag in ("springStiffness", ".//spring_stiffness")]
    return any(read_number(value) is not None for value in stiffness)


def _control(plugin: Any) -> Iterator[BaseControl]:
    """Yield the control of the base that a plugin is, if it is one."""
    name = plugin.get("filename", "") or plugin.get("name", "")
    kind = kind_of(f"{plugin.get('filename', '')} {plugin.get('name', '')}")
    if kind is None:
        return
    values = {key: texts for key, texts in _values(plugin).items() if texts}
    diameter = _first(values, "wheeldiameter")
    radius = _first(values, "wheelradius")
    yield BaseControl(
        kind=kind,
        label=f'plugin "{name}"',
        line=plugin.sourceline,
        joints=tuple(
            text
            for key, texts in values.items()
            if JOINT_TAG.fullmatch(key) and "steer" not in key
            for text in texts
        ),
        radius=0.5 * diameter if radius is None and diameter is not None else radius,
        separation=_first(values, "wheelseparation"),
    )


def _values(plugin: Any) -> dict[str, list[str]]:
    """Return the texts of a plugin's elements by tag, in small letters and without _."""
    values: dict[str, list[str]] = {}
    for element in plugin.iter("*"):
        text = (element.text or "").strip()
        if text:
            values.setdefault(element.tag.replace("_", "").lower(), []).append(text)
    return values


def _first(values: dict[str, list[str]], key: str) -> float | None:
    """Return the first number of a key, or None."""
    return next((n for n in map(read_number, values.get(key, ())) if n is not None), None)


def read_number(text: object) -> float | None:
    """Return a positive, finite number that a text has, or None."""
    try:
        number = float(str(text))
    except ValueError:
        return None
    return number if math.isfinite(number) and number > 0.0 else None
