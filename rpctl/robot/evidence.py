"""The evidence for a drive: which wheels stand, on which lines, on which swivels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lxml import etree

from rpctl.description.records import Description
from rpctl.errors import UnknownNameError
from rpctl.robot.drive_file import DriveSpec
from rpctl.robot.swivels import Found, find_swivels
from rpctl.robot.wheels import Candidate, Standing, coaxial, stand


@dataclass(frozen=True)
class Evidence:
    """What a description's wheels are, before a drive is made of them.

    Attributes:
        description: The robot.
        standing: The wheels on the ground, and what does not reach it.
        lines: Wheels that the root link holds, those about one line together.
        swivels: Upright joints that carry the other wheels.
        actuated: Joints that a ``<transmission>`` names.
        spec: What the user says.
    """

    description: Description
    standing: Standing
    lines: tuple[tuple[Candidate, ...], ...]
    swivels: tuple[Found, ...]
    actuated: frozenset[str]
    spec: DriveSpec

    @property
    def fixed(self) -> tuple[Candidate, ...]:
        """The wheels that the root link holds."""
        return tuple(wheel for line in self.lines for wheel in line)

    @property
    def pairs(self) -> tuple[tuple[Candidate, ...], ...]:
        """The lines with a wheel to the left and one to the right."""
        return tuple(line for line in self.lines if len(line) > 1)

    @property
    def steered(self) -> tuple[Found, ...]:
        """The swivels that steer."""
        return tuple(swivel for swivel in self.swivels if swivel.role == "steered")


def gather(
    description: Description,
    locked: Mapping[str, float],
    candidates: list[Candidate],
    spec: DriveSpec,
) -> Evidence:
    """Return what the wheels of a description are.

    Args:
        description: The robot.
        locked: Frozen joints and their positions (rad or m).
        candidates: The joints that could carry wheels.
        spec: What the user says.

    Raises:
        DriveError: The radius of a wheel is not known.
        UnknownNameError: A swivel's joint is not known.
    """
    standing = stand(description, candidates, bool(spec.wheels))
    document = etree.fromstring(description.xml.encode())
    actuated = frozenset(joint.get("name") for joint in document.iterfind("transmission/joint"))
    for name in spec.swivels:
        if name not in description.joint:
            raise UnknownNameError("swivel joint", name, description.joint)
    lines: list[list[Candidate]] = []
    for wheel in (wheel for wheel in standing.wheels if wheel.swivel is None):
        line = next((line for line in lines if coaxial(line[0], wheel)), None)
        if line is None:
            lines.append([wheel])
        else:
            line.append(wheel)
    swivels = find_swivels(description, locked, standing.wheels, spec.swivels, actuated)
    return Evidence(description, standing, tuple(map(tuple, lines)), tuple(swivels), actuated, spec)
