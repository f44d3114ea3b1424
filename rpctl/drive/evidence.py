"""The evidence for a drive: which wheels stand, on which lines, on which swivels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lxml import etree

from rpctl.description.records import Description
from rpctl.drive.drive_file import DriveSpec
from rpctl.drive.near_misses import advise_lock, advise_mimics
from rpctl.drive.standing import Standing, stand
from rpctl.drive.swivels import CASTER_WORDS, Found, find_swivels
from rpctl.drive.wheels import Candidate, coaxial
from rpctl.errors import DriveError, UnknownNameError

BALL_WORDS = ("ball", *CASTER_WORDS)


@dataclass(frozen=True)
class Evidence:
    """What a description's wheels are, before a drive is made of them.

    Attributes:
        description: The robot.
        standing: The wheels on the ground, and what does not reach it.
        lines: Wheels that the root link holds, those about one line together.
        balls: Spheres that the root link holds beside a pair of wheels: they slide sideways, too.
        swivels: Upright joints that carry the other wheels.
        actuated: Joints that a ``<transmission>`` names.
        spec: What the user says.
        near: What is nearly a wheel: hangs on a joint that moves, or mimics another; sentences.
    """

    description: Description
    standing: Standing
    lines: tuple[tuple[Candidate, ...], ...]
    balls: tuple[Candidate, ...]
    swivels: tuple[Found, ...]
    actuated: frozenset[str]
    spec: DriveSpec
    near: tuple[str, ...]

    @property
    def fixed(self) -> tuple[Candidate, ...]:
        """The wheels that the root link holds, balls left out."""
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
        DriveError: A joint that is called a swivel carries no wheel.
        UnknownNameError: A swivel's joint is not known.
    """
    standing = stand(description, locked, candidates, bool(spec.wheels))
    document = etree.fromstring(description.xml.encode())
    actuated = frozenset(joint.get("name") for joint in document.iterfind("transmission/joint"))
    swivels = find_swivels(description, locked, standing.wheels, spec.swivels, actuated)
    _require_swivels(description, spec, {swivel.joint.name for swivel in swivels})
    held = [wheel for wheel in standing.wheels if wheel.swivel is None]
    lines, balls = _apart(held)
    near = (*advise_lock(description, locked), *advise_mimics(description, locked))
    return Evidence(description, standing, lines, balls, tuple(swivels), actuated, spec, near)


def _apart(
    held: list[Candidate],
) -> tuple[tuple[tuple[Candidate, ...], ...], tuple[Candidate, ...]]:
    """Return the lines of wheels that the root link holds, and the balls beside them.

    Where all are spheres, names tell which are balls; where no pair is left, none is.
    """
    spheres = tuple(wheel for wheel in held if wheel.ball)
    named = tuple(wheel for wheel in spheres if _called_ball(wheel))
    for balls in (spheres, named):
        lines = lines_of([wheel for wheel in held if wheel not in balls])
        if any(len(line) > 1 for line in lines):
            return lines, balls
    return lines_of(held), ()


def _called_ball(wheel: Candidate) -> bool:
    names = f"{wheel.joint.name} {wheel.joint.child}".lower()
    return any(word in names for word in BALL_WORDS)


def lines_of(wheels: list[Candidate]) -> tuple[tuple[Candidate, ...], ...]:
    """Return the wheels by lines: those about one line, seen from above, together."""
    lines: list[list[Candidate]] = []
    for wheel in wheels:
        line = next((line for line in lines if coaxial(line[0], wheel)), None)
        if line is None:
            lines.append([wheel])
        else:
            line.append(wheel)
    return tuple(map(tuple, lines))


def _require_swivels(description: Description, spec: DriveSpec, found: set[str]) -> None:
    """Refuse swivels of a drive file that are none.

    Raises:
        DriveError: A joint carries no wheel.
        UnknownNameError: A joint is not known.
    """
    for name in spec.swivels:
        if name not in description.joint:
            raise UnknownNameError("swivel joint", name, description.joint)
        if name not in found:
            joint = description.joint[name]
            listed = f"; swivels are {', '.join(sorted(found))}" if found else ""
            raise DriveError(
                f'{description.path}:{joint.line}: joint "{name}" is no swivel: it has to turn '
                "about an upright axis, be held by the root link, and carry a wheel that stands "
                f"on the ground{listed}"
            )
