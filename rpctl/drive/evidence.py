"""The evidence for a drive: which wheels touch the ground, on which lines, on which swivels."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description, Joint
from rpctl.drive.controls import BaseControl
from rpctl.drive.drive import TRAILING, DriveSpec
from rpctl.drive.leftovers import Leftover, find_leftovers
from rpctl.drive.wheels import (
    CASTER_WORDS,
    GROUND_TOLERANCE_M,
    SwivelCandidate,
    WheelCandidate,
    coaxial,
    find_swivels,
    ground_tolerance,
)
from rpctl.errors import DriveError, UnknownNameError

BALL_WORDS = ("ball", *CASTER_WORDS)
PLACEHOLDER_RADIUS_M = 0.1  # of a wheel whose size the user is asked for
MAX_RADIUS_RATIO = 2.0  # largest ratio of an unknown wheel's radius to the largest known radius


@dataclass(frozen=True)
class Evidence:
    """The wheels of a description, sorted by what holds them.

    Attributes:
        tree: The robot.
        grounded: The wheels on the ground, and the candidates that do not reach it.
        lines: Wheels that the root link holds, those about one line together.
        balls: Spheres that the root link holds beside a pair of wheels: they slide sideways, too.
        swivels: Upright joints that carry the other wheels.
        controls: Plugins and controllers that move the base.
        spec: What the user says.
        leftovers: Joints that look like wheels and are none of these.
    """

    tree: FrozenTree
    grounded: GroundedWheels
    lines: tuple[tuple[WheelCandidate, ...], ...]
    balls: tuple[WheelCandidate, ...]
    swivels: tuple[SwivelCandidate, ...]
    controls: tuple[BaseControl, ...]
    spec: DriveSpec
    leftovers: tuple[Leftover, ...]

    @property
    def description(self) -> Description:
        """The description of the robot."""
        return self.tree.description

    @property
    def actuated(self) -> frozenset[str]:
        """Joints with a transmission, or a command interface of ros2_control."""
        return self.description.actuated

    @property
    def idle(self) -> set[str]:
        """Joints of effort limit 0 that neither a transmission nor a plugin drives."""
        told = self.actuated.union(*(control.joints for control in self.controls))
        return {j.name for j in self.description.joints if not j.effort and j.name not in told}

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
        told = {each.joint for each in self.spec.swivel if each.role is not None}
        trails = (
            swivel.role in TRAILING or (swivel.trails and swivel.joint.name not in told)
            for swivel in self.swivels
        )
        return not self.lines and bool(self.swivels) and all(trails)

    @property
    def powered(self) -> bool:
        """Whether a transmission drives a wheel, or a swivel that carries one."""
        joints = {wheel.joint.name for wheel in self.grounded.wheels}
        return bool(self.actuated & (joints | {swivel.joint.name for swivel in self.swivels}))

    def on_caster(self, wheel: WheelCandidate) -> bool:
        """Return whether a caster or a trailer carries a wheel."""
        return any(wheel in swivel.wheels for swivel in self.swivels if swivel.role in TRAILING)


def gather_evidence(
    tree: FrozenTree,
    candidates: list[WheelCandidate],
    spec: DriveSpec,
    controls: tuple[BaseControl, ...],
    free: Collection[str] = (),
) -> Evidence:
    """Return the wheels among the candidates, sorted by what holds them.

    Args:
        free: Joints that the user wants free: they are no wheels.

    Raises:
        DriveError: A joint that is called a swivel carries no wheel.
        UnknownNameError: A swivel's joint is not known.
    """
    grounded = find_grounded(tree, candidates, bool(spec.wheels))
    swivels = find_swivels(tree, grounded.wheels, spec.swivels)
    _require_swivels(tree.description, spec, {swivel.joint.name for swivel in swivels})
    held = [wheel for wheel in grounded.wheels if wheel.swivel is None]
    driven = tuple(dict.fromkeys(name for control in controls for name in control.joints))
    lines, balls = _split_balls(held, tree.description.actuated.union(driven))
    leftovers = find_leftovers(tree, grounded.wheels, free, driven)
    return Evidence(tree, grounded, lines, balls, tuple(swivels), controls, spec, leftovers)


def _split_balls(
    held: list[WheelCandidate], driven: Collection[str]
) -> tuple[tuple[tuple[WheelCandidate, ...], ...], tuple[WheelCandidate, ...]]:
    """Return the wheels on the root link grouped by common axle, and the ball casters beside them.

    What is called a caster, while others have motors and it has none, is as good as a ball. If all
    are spheres, their names tell which are balls; if no pair is left then, none is a ball.
    """
    motors = any(wheel.joint.name in driven for wheel in held)
    spheres = tuple(
        wheel
        for wheel in held
        if wheel.ball or (motors and wheel.joint.name not in driven and _is_named_ball(wheel))
    )
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


@dataclass(frozen=True)
class GroundedWheels:
    """Which candidates touch the ground.

    Attributes:
        wheels: Those that do, with their radii.
        rejected: Why each of the others does not, in sentences.
        doubts: What was assumed of their sizes, in sentences.
        sizeless: Joints of wheels whose radius nothing tells: it is a placeholder.
    """

    wheels: tuple[WheelCandidate, ...]
    rejected: tuple[str, ...]
    doubts: tuple[str, ...]
    sizeless: tuple[Joint, ...]


def find_grounded(
    tree: FrozenTree, candidates: Sequence[WheelCandidate], declared: bool
) -> GroundedWheels:
    """Return which candidates reach the ground; the lowest of them defines its height.

    The radius of a wheel of unknown size is its axle's height above the ground; if no size is
    known, the ground is at the root link's origin. One joint alone is no wheel, nor is one that
    ends more than its radius above the lowest part of the body.

    Args:
        declared: Whether the user says that all of them are wheels.
    """
    rejected: list[str] = []
    if not declared:
        candidates, rejected = _clear_of_body(tree, candidates)
    known = [c for c in candidates if c.radius is not None]
    ground = min((c.bottom for c in known), default=0.0)
    least = min((float(c.centre[2]) - ground for c in candidates), default=0.0)
    widest = max((float(c.radius) for c in known if c.radius is not None), default=least)
    place = "the other wheels' ground" if known else f'the root link "{tree.description.root}"'
    wheels, doubts, sizeless = [], [], []
    for candidate in candidates:
        height, name = float(candidate.centre[2]) - ground, candidate.joint.name
        wheel = candidate
        if candidate.radius is None:
            if height <= 0.0:
                wheels.append(replace(candidate, radius=PLACEHOLDER_RADIUS_M))
                sizeless.append(candidate.joint)
                continue
            if height > MAX_RADIUS_RATIO * widest and not declared:
                rejected.append(f'"{name}": its axle is {height:.3g} m above the ground: no wheel')
                continue
            wheel = replace(candidate, radius=height, source=f"axle height over {place}")
            doubts.append(_radius_doubt(candidate, wheel))
        gap = wheel.bottom - ground
        if gap > ground_tolerance(wheel.radius or 0.0) and not declared:
            rejected.append(f'"{name}": it ends {gap:.3g} m above the ground: no wheel')
            continue
        wheels.append(wheel)
    return GroundedWheels(tuple(wheels), tuple(rejected), tuple(doubts), tuple(sizeless))


def _clear_of_body(
    tree: FrozenTree, candidates: Sequence[WheelCandidate]
) -> tuple[list[WheelCandidate], list[str]]:
    """Return the candidates that reach below the body, and a reason for each of the others."""
    body = (link for link, _ in tree.rigid_links(tree.description.root))
    heights = [ends for link in body for ends in tree.heights(link)]
    foot = min((c.bottom for c in candidates if c.radius is not None), default=math.nan)
    # A shape that the lowest wheel stands on is the ground, as files of simulators have it.
    floor = min(
        (low for low, high in heights if not abs(high - foot) <= GROUND_TOLERANCE_M),
        default=math.inf,
    )
    kept, rejected = [], []
    for candidate in candidates:
        name, radius = candidate.joint.name, candidate.radius
        if radius is not None and candidate.bottom - floor > radius:
            gap = candidate.bottom - floor
            rejected.append(f'"{name}": the body reaches {gap:.3g} m lower: no wheel')
        elif len(candidates) == 1:
            rejected.append(
                f'"{name}": no other joint turns about a level axle: one alone is no wheel'
            )
        else:
            kept.append(candidate)
    return kept, rejected


def _radius_doubt(candidate: WheelCandidate, wheel: WheelCandidate) -> str:
    """Return the doubt about a candidate of unknown radius that became a wheel."""
    note = f" ({candidate.source})" if candidate.source else ""
    return (
        f'no shape tells the size of wheel "{wheel.joint.name}"{note}: its radius, '
        f"{wheel.radius:.4g} m, is the {wheel.source}; give its radius in a drive file if it is "
        "another"
    )
