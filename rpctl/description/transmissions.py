"""The rotors that a URDF's transmissions tell of.

URDF itself has no word for a rotor's inertia; files that give one have Drake's,
``<drake:rotor_inertia value="..."/>`` and ``<drake:gear_ratio value="..."/>`` of an <actuator>. The
ratio may stand in URDF's own ``<mechanicalReduction>`` as well.
"""

from __future__ import annotations

from typing import Any

from rpctl.description.findings import Fault, Findings, excerpt, parse_numbers

LARGE_ROTOR = 0.1  # kg m²: no motor of a joint has such a rotor, but in g cm² many seem to


def read_rotors(findings: Findings, root: Any) -> dict[str, float]:
    """Return the inertia I n² of each joint's rotor, seen from the joint, by the joint's name.

    A transmission of several joints, as a differential has, tells of none: its rotors turn with all
    of them.

    Args:
        findings: Gets what is wrong with them.
        root: The <robot> element.
    """
    rotors: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joints, actuators = transmission.findall("joint"), transmission.findall("actuator")
        given = [each for each in actuators if each.find("rotor_inertia") is not None]
        if not given:
            continue
        if len(joints) != 1:
            findings.warn(given[0], "the rotor of a transmission of several joints is left out; "
                          "give its inertia as --armature PATTERN=KG_M2")  # fmt: skip
            continue
        name = joints[0].get("name", "")
        for actuator in given:
            inertia = _inertia(findings, actuator, name)
            rotors[name] = rotors.get(name, 0.0) + inertia
    return rotors


def _inertia(findings: Findings, actuator: Any, joint: str) -> float:
    """Return I n² of one actuator of a joint."""
    element = actuator.find("rotor_inertia")
    inertia = findings.number(element, "value")
    if inertia < 0.0:
        findings.warn(element, f'the rotor inertia {inertia:g} of joint "{joint}" is negative; '
                      "0 is used, correct it")  # fmt: skip
        return 0.0
    if inertia > LARGE_ROTOR:
        findings.warn(element, f'the rotor inertia {inertia:g} of joint "{joint}" is that of no '
                      "motor; give kg m2, before the gears")  # fmt: skip
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
