"""Joints of a URDF as records, and what it tells of their motors, springs and plugins.

URDF itself has no word for a rotor's inertia; files that give one have Drake's,
``<drake:rotor_inertia value="..."/>`` and ``<drake:gear_ratio value="..."/>`` of an <actuator>. The
ratio may stand in URDF's own ``<mechanicalReduction>`` as well.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from lxml import etree

from rpctl.arrays import Array, read_only
from rpctl.description.records import MOVING_KINDS, Joint, Mimic, Plugin
from rpctl.description.urdf.findings import Fault, Findings, excerpt, parse_numbers
from rpctl.description.urdf.links import read_origin

KNOWN_KINDS = (*MOVING_KINDS, "fixed")
LIMITED_KINDS = ("revolute", "prismatic")
AXIS_LENGTH_TOLERANCE = 1e-3  # of an axis from length 1; below it is rounding
MIN_AXIS_LENGTH = 1e-6  # a shorter axis is none
MAX_POSITION = {"revolute": 5e2, "prismatic": 1e3}  # rad (80 turns), m; beyond it a limit is none
DEGREES = 15.0, 360.0  # a whole number of rad between these is meant to be degrees
FAR_M = 20.0  # of a joint from its parent: no robot is that large, but in mm many are
MIN_LIMIT = 1e-9  # of the same units; a velocity limit below it, such as 0, is none
NO_LIMIT = -1.0  # what files write for no limit
MAX_LIMIT = 1e9  # N·m, N, rad/s or m/s; a limit beyond it stands for none
FINITE_INFINITY = 1e16  # infinity for other readers, which want a finite number
LARGE_ROTOR = 0.1  # kg m²: no motor of a joint has such a rotor, but in g cm² many seem to


def read_joint(findings: Findings, element: Any) -> Joint:
    """Return the record of a <joint>."""
    name, kind = element.get("name", ""), element.get("type", "")
    _require_kind(findings, element, name, kind)
    lower, upper, effort, velocity = _read_limits(findings, element, name, kind)
    damping, friction = _read_losses(findings, element, name, kind, effort, velocity)
    origin = read_origin(findings, element)
    if (far := float(np.linalg.norm(origin[:3, 3]))) > FAR_M:
        findings.warn(
            element.find("origin"),
            f'joint "{name}" is {far:.4g} m from its parent\'s origin; if lengths are in mm, give '
            "m",
        )
    return Joint(
        name=name,
        line=element.sourceline,
        kind=kind,
        parent=_read_end(findings, element, name, "parent"),
        child=_read_end(findings, element, name, "child"),
        origin=origin,
        axis=_read_axis(findings, element, name, kind),
        lower=lower,
        upper=upper,
        effort=effort,
        velocity=velocity,
        mimic=_read_mimic(findings, element, name),
        damping=damping,
        friction=friction,
    )


def _read_losses(
    findings: Findings, element: Any, name: str, kind: str, effort: float, velocity: float
) -> tuple[float, float]:
    """Return damping and friction; 0 where the file gives none, or one below 0.

    Args:
        effort: Its limit, N·m or N.
        velocity: Likewise, rad/s or m/s.
    """
    dynamics = findings.only(element, "dynamics")
    if dynamics is None:
        return 0.0, 0.0
    damping, friction = (_read_loss(findings, dynamics, name, k) for k in ("damping", "friction"))
    slides, effort = kind == "prismatic", effort or math.inf  # what nothing drives has no limit
    if friction > effort:
        unit = "N" if slides else "N m"
        findings.warn(dynamics, f'friction {friction:g} of joint "{name}" exceeds its effort limit '
                      f"{effort:g}: it cannot start; give both in {unit}")  # fmt: skip
    elif damping * velocity + friction > effort:
        unit = "N s/m" if slides else "N m s/rad"
        findings.warn(dynamics, f'damping {damping:g} of joint "{name}" takes more than its effort '
                      f"limit {effort:g} at its velocity limit {velocity:g}; give it in "
                      f"{unit}")  # fmt: skip
    return damping, friction


def _read_loss(findings: Findings, dynamics: Any, name: str, key: str) -> float:
    value = findings.number(dynamics, key, "0")
    if value < 0.0:
        findings.warn(dynamics, f'{key} {value:g} of joint "{name}" is negative, which would '
                                'drive it; rpctl uses 0; correct the sign')  # fmt: skip
    return max(value, 0.0)


def _require_kind(findings: Findings, element: Any, name: str, kind: str) -> None:
    if kind in ("floating", "planar"):
        findings.error(
            element,
            f'joint "{name}" is {kind}; '
            "rpctl places the base itself; make it fixed, or remove the joint and its parent",
        )
    elif kind not in KNOWN_KINDS:
        has = f'type "{excerpt(kind)}"' if kind else "no type"
        findings.error(element, f'joint "{name}" has {has}; use one of {", ".join(KNOWN_KINDS)}')


def _read_end(findings: Findings, element: Any, name: str, end: str) -> str:
    reference = findings.only(element, end)
    link = "" if reference is None else reference.get("link", "")
    if not link:
        findings.error(element, f'joint "{name}" has no <{end} link="...">; add it')
    return link


def _read_axis(findings: Findings, element: Any, name: str, kind: str) -> Array:
    given, before = findings.only(element, "axis"), len(findings.items)
    axis = findings.numbers(given, "xyz", 3, "1 0 0")
    length = math.hypot(*axis)
    if kind in MOVING_KINDS:
        if given is None:
            given = etree.SubElement(element, "axis", xyz="1 0 0")  # some readers have another
        elif length <= MIN_AXIS_LENGTH and len(findings.items) == before:
            findings.error(
                given, f'axis of joint "{name}" is zero; give a direction such as "0 0 1"'
            )
        elif abs(length - 1.0) > AXIS_LENGTH_TOLERANCE and length > MIN_AXIS_LENGTH:
            findings.warn(
                given, f'axis of joint "{name}" has length {length:.6g}; rpctl scales it to 1'
            )
            given.set("xyz", " ".join(repr(value / length) for value in axis))
    return read_only(np.array(axis) / length if length > MIN_AXIS_LENGTH else np.zeros(3))


def _read_mimic(findings: Findings, element: Any, name: str) -> Mimic | None:
    mimic = findings.only(element, "mimic")
    if mimic is None:
        return None
    multiplier = findings.number(mimic, "multiplier", "1")
    offset = findings.number(mimic, "offset", "0")
    if not mimic.get("joint"):
        findings.error(mimic, f'<mimic> of joint "{name}" has no attribute "joint"; name the joint')
    if multiplier == 0:
        findings.warn(mimic, f'joint "{name}" mimics with multiplier 0: it never moves; '
                      "make it fixed, or correct the multiplier")  # fmt: skip
    return Mimic(mimic.get("joint", ""), multiplier, offset)


def _read_limits(findings: Findings, element: Any, name: str, kind: str) -> tuple[float, ...]:
    """Return lower, upper, effort and velocity; infinite where the file gives none."""
    limit = findings.only(element, "limit")
    lower, upper, effort, velocity = -math.inf, math.inf, math.inf, math.inf
    if limit is None and kind in LIMITED_KINDS:
        findings.warn(
            element,
            f'joint "{name}" has no <limit>; rpctl treats it as unlimited; give lower and upper',
        )
    if limit is not None:
        effort, velocity = (_read_size(findings, limit, name, k) for k in ("effort", "velocity"))
        if kind in LIMITED_KINDS:
            lower, upper = _read_range(findings, limit, name, kind)
    limits = {"lower": lower, "upper": upper, "effort": effort, "velocity": velocity}
    if kind in LIMITED_KINDS or (limit is not None and kind in MOVING_KINDS):
        limit = etree.SubElement(element, "limit") if limit is None else limit
        for key, value in limits.items():  # other readers refuse a <limit> that is not complete
            limit.set(key, repr(min(max(value, -FINITE_INFINITY), FINITE_INFINITY)))
    return lower, upper, effort, velocity


def _read_range(findings: Findings, limit: Any, name: str, kind: str) -> tuple[float, float]:
    if kind == "revolute" and not {"lower", "upper"} & set(limit.attrib):
        findings.warn(
            limit,
            f'joint "{name}" cannot move: its <limit> has no lower and upper, which count as 0; '
            'rpctl treats it as unlimited; give them, or make it type="continuous"',
        )
        return -math.inf, math.inf
    lower, upper = (_extended(findings, limit, key, "0") for key in ("lower", "upper"))
    if lower > upper:
        findings.error(limit, f'joint "{name}" has lower {lower:g} > upper {upper:g}; swap the two')
    elif lower == upper:
        findings.warn(
            limit, f'joint "{name}" cannot move: lower and upper are {lower:g}; give its range'
        )
    least, most = DEGREES
    whole = (value % 1.0 == 0.0 and abs(value) <= most for value in (lower, upper))
    if kind == "revolute" and max(-lower, upper) > least and all(whole):
        findings.warn(limit, f'limits {lower:g} and {upper:g} of joint "{name}" are read as rad; '
                             'if they are degrees, give rad')  # fmt: skip
    far = MAX_POSITION[kind]
    for key, value in (("lower", lower), ("upper", upper)):
        if far < abs(value) < math.inf:
            findings.warn(limit, f'{key} limit {value:g} of joint "{name}" is out of range; rpctl '
                                 'treats it as unlimited; give rad or m')  # fmt: skip
    return (lower if lower >= -far else -math.inf), (upper if upper <= far else math.inf)


def _read_size(findings: Findings, limit: Any, name: str, attribute: str) -> float:
    """Return an effort or velocity limit; inf where the file gives none, 0 of an undriven joint."""
    size = _extended(findings, limit, attribute, "inf")
    text = f'{attribute} limit {size:g} of joint "{name}"'
    if size == NO_LIMIT:
        findings.warn(limit, f"{text} is treated as no limit; give a positive one, or none")
        return math.inf
    if size <= -MIN_LIMIT:
        findings.warn(limit, f"{text} is negative; rpctl uses {-size:g}")
    elif size < MIN_LIMIT:
        if attribute == "effort":
            return 0.0
        findings.warn(limit, f"{text} is ignored; give a positive one")
    return abs(size) if MIN_LIMIT <= abs(size) <= MAX_LIMIT else math.inf


def _extended(findings: Findings, limit: Any, attribute: str, default: str) -> float:
    """Return a number that may be infinite or huge, as limits are in the wild."""
    text = limit.get(attribute, "").strip() or default
    if text.lower().lstrip("+-") in ("inf", "infinity"):
        return float(text)
    try:
        return parse_numbers(text, 1)[0]
    except ValueError as fault:
        findings.error(limit, f'<limit {attribute}="{excerpt(text)}"> {fault}')
        return 0.0


def read_rotors(findings: Findings, root: Any) -> dict[str, float]:
    """Return the inertia I n² of each joint's rotor, seen from the joint, by the joint's name.

    A transmission of several joints, as a differential has, tells of none: its rotors turn with all
    of them.
    """
    rotors: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joints, actuators = transmission.findall("joint"), transmission.findall("actuator")
        given = [each for each in actuators if each.find("rotor_inertia") is not None]
        if not given:
            continue
        if len(joints) != 1:
            findings.warn(
                given[0],
                "rpctl ignores the rotor of a transmission with several joints; give its inertia "
                "as --armature PATTERN=KG_M2",
            )
            continue
        name = joints[0].get("name", "")
        inertia = sum(_inertia(findings, actuator, name) for actuator in given)
        rotors[name] = rotors.get(name, 0.0) + inertia
    return rotors


def _inertia(findings: Findings, actuator: Any, joint: str) -> float:
    """Return I n² of one actuator of a joint."""
    element = actuator.find("rotor_inertia")
    inertia = findings.number(element, "value")
    if inertia < 0.0:
        findings.warn(element, f'the rotor inertia {inertia:g} of joint "{joint}" is negative; '
                               "rpctl uses 0; correct it")  # fmt: skip
        return 0.0
    if inertia > LARGE_ROTOR:
        findings.warn(
            element,
            f'the rotor inertia {inertia:g} of joint "{joint}" is too large for a motor; give kg '
            "m2, on the motor's side of the gears",
        )
    return inertia * _ratio(findings, actuator) ** 2


def _ratio(findings: Findings, actuator: Any) -> float:
    """Return how many times as fast as its joint a rotor turns; 1 if the file does not say."""
    ratio = actuator.find("gear_ratio")
    if ratio is not None:
        return findings.number(ratio, "value")
    reduction = actuator.find("mechanicalReduction")
    if reduction is None:
        return 1.0
    text = (reduction.text or "").strip()
    try:
        return parse_numbers(text, 1)[0]
    except Fault as fault:
        findings.error(reduction, f"<mechanicalReduction>{excerpt(text)} {fault}")
        return 1.0


def read_actuated(root: Any) -> frozenset[str]:
    """Return the joints with a transmission, or a command interface of ros2_control."""
    joints = "transmission/joint | ros2_control/joint[command_interface]"
    return frozenset(joint.get("name") for joint in root.xpath(joints))


def read_sprung(root: Any) -> dict[str, int]:
    """Return the lines of the springs that <gazebo> or <dynamics> gives joints, by the joint."""
    found = {}
    for each in root.xpath("gazebo[@reference] | joint[dynamics]"):
        said = each.xpath(
            "dynamics/@*[starts-with(name(), 'spring')] | .//springStiffness/text()"
            " | .//spring_stiffness/text() | .//stiffness/text()"
        )
        if any(positive_number(text) is not None for text in said):
            found[each.get("reference") or each.get("name")] = each.sourceline
    return found


def read_plugins(root: Any) -> tuple[Plugin, ...]:
    """Return the plugins of simulators."""
    return tuple(
        Plugin(each.get("filename", ""), each.get("name", ""), each.sourceline, _texts(each))
        for each in root.iterfind(".//plugin")
    )


def _texts(plugin: Any) -> dict[str, tuple[str, ...]]:
    """Return the texts of a plugin's elements by tag, in small letters and without _."""
    texts: dict[str, tuple[str, ...]] = {}
    for element in plugin.iter("*"):
        tag, text = element.tag.replace("_", "").lower(), (element.text or "").strip()
        if text:
            texts[tag] = (*texts.get(tag, ()), text)
    return texts


def positive_number(text: object) -> float | None:
    """Return a positive, finite number that a text has, or None."""
    try:
        number = float(str(text))
    except ValueError:
        return None
    return number if math.isfinite(number) and number > 0.0 else None
