"""The evidence for a drive: which wheels touch the ground, on which lines, on which swivels."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description
from rpctl.drive.drive_file import DriveSpec, SwivelSpec
from rpctl.drive.grounded import GroundedWheels, find_grounded
from rpctl.drive.leftovers import Leftover, find_leftovers
from rpctl.drive.plugins import BaseControl, SimulatorTags
from rpctl.drive.swivels import CASTER_WORDS, SwivelCandidate, find_swivels
from rpctl.drive.wheels import WheelCandidate, coaxial
from rpctl.errors import DriveError, UnknownNameError

BALL_WORDS = ("ball", *CASTER_WORDS)


@dataclass(frozen=True)
class Evidence:
    """The wheels of a description, sorted by what holds them.

    Attributes:
        tree: The robot.
        grounded: The wheels on the ground, and the candidates that do not reach it.
        lines: Wheels that the root link holds, those about one line together.
        balls: Spheres that the root link holds beside a pair of wheels: they slide sideways, too.
        swivels: Upright joints that carry the other wheels.
        tags: What the file tells simulators and controllers.
        spec: What the user says.
        leftovers: Joints that look like wheels and are none of these.
    """

    tree: FrozenTree
    grounded: GroundedWheels
    lines: tuple[tuple[WheelCandidate, ...], ...]
    balls: tuple[WheelCandidate, ...]
    swivels: tuple[SwivelCandidate, ...]
    tags: SimulatorTags
    spec: DriveSpec
    leftovers: tuple[Leftover, ...]

    @property
    def description(self) -> Description:
        """The description of the robot."""
        return self.tree.description

    @property
    def controls(self) -> tuple[BaseControl, ...]:
        """Plugins and controllers that move the base."""
        return self.tags.controls

    @property
    def actuated(self) -> frozenset[str]:
        """Joints with a transmission, or a command interface of ros2_control."""
        return self.tags.actuated

    @property
    def fixed(self) -> tuple[WheelCandidate, ...]:
        """The wheels that the root link holds, balls left out."""
        return tuple(wheel for line in self.lines for wheel in line)

    @property
    def pairs(self) -> tuple[tuple[WheelCandidate, ...], ...]:
        """The lines with a wheel to the left and one to the right."""
        return tuple(line for line in self.lines if len(line) > 1)

    @property
    def steered(self) -> tuple[SwivelCandidate, ...]:
        """The swivels that steer."""
        return tuple(swivel for swivel in self.swivels if swivel.role == "steered")

    @property
    def trailing(self) -> bool:
        """Whether every wheel trails an upright joint, powered or not, and none is held firmly."""
        told = self.spec.swivels
        trails = (
            swivel.role == "caster"
            or (swivel.trails and told.get(swivel.joint.name, SwivelSpec()).role is None)
            for swivel in self.swivels
        )
        return not self.lines and bool(self.swivels) and all(trails)

    @property
    def powered(self) -> bool:
        """Whether a transmission drives a wheel, or a swivel that carries one."""
        joints = {wheel.joint.name for wheel in self.grounded.wheels}
        return bool(self.actuated & (joints | {swivel.joint.name for swivel in self.swivels}))

    def on_caster(self, wheel: WheelCandidate) -> bool:
        """Return whether a caster carries a wheel."""
        return any(wheel in swivel.wheels for swivel in self.swivels if swivel.role == "caster")


def gather_evidence(
    tree: FrozenTree,
    candidates: list[WheelCandidate],
    spec: DriveSpec,
    tags: SimulatorTags,
    free: Collection[str] = (),
) -> Evidence:
    """Return the wheels among the candidates, sorted by what holds them.

    Args:
        tree: The robot.
        candidates: The joints that could carry wheels.
        spec: What the user says.
        tags: What the file tells simulators and controllers.
        free: Joints that the user wants free: they are no wheels.

    Raises:
        DriveError: The radius of a wheel is not known.
        DriveError: A joint that is called a swivel carries no wheel.
        UnknownNameError: A swivel's joint is not known.
    """
    grounded = find_grounded(tree, candidates, bool(spec.wheels))
    swivels = find_swivels(tree, grounded.wheels, spec.swivels, tags.actuated)
    _require_swivels(tree.description, spec, {swivel.joint.name for swivel in swivels})
    held = [wheel for wheel in grounded.wheels if wheel.swivel is None]
    lines, balls = _split_balls(held)
    driven = tuple(dict.fromkeys(name for control in tags.controls for name in control.joints))
    leftovers = find_leftovers(tree, grounded, free, driven)
    return Evidence(tree, grounded, lines, balls, tuple(swivels), tags, spec, leftovers)


def _split_balls(
    held: list[WheelCandidate],
) -> tuple[tuple[tuple[WheelCandidate, ...], ...], tuple[WheelCandidate, ...]]:
    """Return the wheels on the root link grouped by common axle, and the ball casters beside them.

    If all are spheres, their names tell which are balls; if no pair is left then, none is a ball.
    """
    spheres = tuple(wheel for wheel in held if wheel.ball)
    named = tuple(wheel for wheel in spheres if _is_named_ball(wheel))
    for balls in (spheres, named):
        lines = lines_of([wheel for wheel in held if wheel not in balls])
        if any(len(line) > 1 for line in lines):
            return lines, balls
    return lines_of(held), ()


def _is_named_ball(wheel: WheelCandidate) -> bool:
    names = f"{wheel.joint.name} {wheel.joint.child}".lower()
    return any(word in names for word in BALL_WORDS)


def lines_of(wheels: list[WheelCandidate]) -> tuple[tuple[WheelCandidate, ...], ...]:
    """Return the wheels by lines: those about one line, seen from above, together."""
    lines: list[list[WheelCandidate]] = []
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
