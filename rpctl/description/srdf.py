"""Group states of an SRDF: the named postures that MoveIt keeps beside a URDF."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from rpctl.description.records import READ_DEFAULTS, ReadSettings
from rpctl.description.urdf.document import Refusal, parse_document
from rpctl.description.urdf.findings import Findings, excerpt
from rpctl.description.xacro.expansion import expand, is_xacro, list_arguments
from rpctl.errors import DescriptionError, fault_at
from rpctl.files.caps import read_input

SAME_POSITION = 1e-9  # rad or m; two groups may both state a joint that they share


def read_state(
    path: str | Path, name: str, settings: ReadSettings = READ_DEFAULTS
) -> dict[str, tuple[float, int]]:
    """Return the positions of a group state; those of several groups of that name are joined.

    Args:
        path: The SRDF, or the .xacro that becomes one; lines are those of what it becomes.
        settings: Of the robot: its packages, and the values of arguments that the SRDF has, too.

    Returns:
        By joint its position, rad or m, and the line of the file.

    Raises:
        DescriptionError: The file is no SRDF, has no such state, or contradicts itself.
        ExpansionError: The .xacro cannot be expanded.
    """
    path, findings = Path(path), Findings()
    root = _document(path, findings, settings)
    states = root.findall("group_state")
    chosen = [state for state in states if state.get("name") == name]
    if not chosen:
        known = ", ".join(dict.fromkeys(state.get("name", "?") for state in states))
        listed = f"its states are {known}" if known else "it has no group states"
        raise fault_at(
            path, root.sourceline, f'there is no group state "{excerpt(name)}"; {listed}'
        )
    stated: dict[str, tuple[float, int]] = {}
    for element in (each for state in chosen for each in state.findall("joint")):
        joint = element.get("name", "")
        if not joint:
            findings.error(element, "<joint> of a group state without a name; name it")
        elif len(element.get("value", "").split()) < 2:  # else the base's own, planar or floating
            value = findings.number(element, "value")
            before, line = stated.setdefault(joint, (value, element.sourceline))
            if abs(before - value) > SAME_POSITION:
                findings.error(
                    element,
                    f'joint "{joint}" is at {value:g} here and at {before:g} at line {line}; '
                    "states with the same name are merged; correct one of them",
                )
    if findings.errors:
        raise DescriptionError(path, findings.sorted())
    return stated


def _document(path: Path, findings: Findings, settings: ReadSettings) -> Any:
    """Return the root element of an SRDF; of a .xacro with the robot's arguments that it declares.

    Raises:
        DescriptionError: There is none in the file.
        ExpansionError: The file is xacro that cannot be expanded.
    """
    data = read_input(path, "MAX_BYTES", "an SRDF and a state in it, such as robot.srdf:home")
    try:
        if is_xacro(path, data):
            given = settings.xacro_args
            declared = {each.name for each in list_arguments(path, settings)} if given else ()
            given = {name: value for name, value in given.items() if name in declared}
            data = expand(path, replace(settings, xacro_args=given)).text.encode("utf-8")
        root = parse_document(data, findings)
        if root.find("link") is not None:
            raise Refusal("this is a URDF; give the SRDF beside it", root.sourceline)
    except Refusal as refusal:
        raise fault_at(path, refusal.line, str(refusal)) from None
    return root
