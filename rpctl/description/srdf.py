"""Group states of an SRDF: the named postures that MoveIt keeps beside a URDF."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rpctl.description.records import READ_DEFAULTS, ReadSettings
from rpctl.description.urdf.document import Refusal, parse_document
from rpctl.description.urdf.findings import Findings, excerpt
from rpctl.description.xacro.expansion import expand, is_xacro, list_arguments
from rpctl.errors import DescriptionError, fault_at
from rpctl.files.opening import read_input

SAME_POSITION = 1e-9  # rad or m; two groups may both state a joint that they share


@dataclass(frozen=True)
class StatedPosition:
    """Where a group state puts a joint.

    Attributes:
        joint: Name of the joint.
        value: Position, rad or m.
        line: Line of the file.
    """

    joint: str
    value: float
    line: int


def read_state(
    path: str | Path, name: str, settings: ReadSettings = READ_DEFAULTS
) -> tuple[StatedPosition, ...]:
    """Return the positions of a group state; those of several groups of that name are joined.

    Args:
        path: The SRDF, or the .xacro that becomes one; lines are those of what it becomes.
        settings: Of the robot: its packages, and the values of arguments that the SRDF has, too.

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
        listed = f"its states are {known}" if known else "it has none"
        raise fault_at(
            path, root.sourceline, f'no group state is called "{excerpt(name)}"; {listed}'
        )
    stated: dict[str, StatedPosition] = {}
    for state in chosen:
        for element in state.findall("joint"):
            _add(stated, findings, element)
    if findings.errors:
        raise DescriptionError(path, findings.sorted())
    return tuple(stated.values())


def _document(path: Path, findings: Findings, settings: ReadSettings) -> Any:
    """Return the root element of an SRDF.

    Raises:
        DescriptionError: There is none in the file.
        ExpansionError: The file is xacro that cannot be expanded.
    """
    data = read_input(path, "MAX_BYTES", "an SRDF and a state in it, as robot.srdf:home")
    try:
        if is_xacro(path, data):
            data = _expanded(path, settings)
        root = parse_document(data, findings)
        if root.find("link") is not None:
            raise Refusal("this is a URDF; give the SRDF beside it", root.sourceline)
    except Refusal as refusal:
        raise fault_at(path, refusal.line, str(refusal)) from None
    return root


def _expanded(path: Path, settings: ReadSettings) -> bytes:
    """Return what a .xacro becomes, with the robot's arguments as far as it declares them."""
    given = settings.xacro_args
    if given:
        declared = {argument.name for argument in list_arguments(path, settings)}
        given = {name: value for name, value in given.items() if name in declared}
    return expand(path, replace(settings, xacro_args=given)).text.encode("utf-8")


def _add(stated: dict[str, StatedPosition], findings: Findings, element: Any) -> None:
    """Add the position of one <joint>, or note what is wrong with it."""
    name = element.get("name", "")
    if not name:
        findings.error(element, "<joint> of a group state without a name; name it")
        return
    if len(element.get("value", "").split()) > 1:
        return  # a planar or floating joint, which no URDF has: the base's own
    value = findings.number(element, "value")
    known = stated.get(name)
    if known is not None and abs(known.value - value) > SAME_POSITION:
        text = f'joint "{name}" is at {value:g} here and at {known.value:g} at line {known.line}'
        findings.error(element, f"{text}; states of one name are joined, correct one of them")
    stated.setdefault(name, StatedPosition(name, value, element.sourceline))
