"""The evidence for a drive: which wheels touch the ground, on which lines, on which swivels."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description
from rpctl.drive.controls import BaseControl
from rpctl.drive.drive import DriveSpec
from rpctl.drive.leftovers import Leftover, find_leftovers
from rpctl.drive.wheels import (
    CASTER_WORDS,
    GROUND_TOLERANCE_M,
    SwivelCandidate,
    WheelCandidate,
    coaxial,
    find_candidates,
    find_swivels,
    ground_tolerance,
    is_called,
)
from rpctl.errors import DriveError, require_known

BALL_WORDS = ("ball", *CASTER_WORDS)
UNFIT = {
    "wheel": "cannot carry a wheel: it must be continuous, about a level axis, and held by the "
    "root link, rigidly or by one upright joint",
    "swivel": "is no swivel: it must turn about an upright axis, be held by the root link, and "
    "carry a wheel that stands on the ground",
}
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
            each.swivel.trails or (each.off_axis and each.joint.name not in told)
            for each in self.swivels
        )
        return not self.lines and bool(self.swivels) and all(trails)

    @property
    def powered(self) -> bool:
        """Whether a transmission drives a wheel, or a swivel that carries one."""
        joints = {wheel.joint.name for wheel in self.grounded.wheels}
        return bool(self.actuated & (joints | {swivel.joint.name for swivel in self.swivels}))

    def swivel_of(self, wheel: WheelCandidate) -> SwivelCandidate | None:
        """Return the swivel that carries a wheel."""
        return next((swivel for swivel in self.swivels if wheel in swivel.wheels), None)

    def on_caster(self, wheel: WheelCandidate) -> bool:
        """Return whether a caster or a trailer carries a wheel."""
        carrier = self.swivel_of(wheel)
        return carrier is not None and carrier.swivel.trails


def gather_evidence(
    tree: FrozenTree,
    spec: DriveSpec,
    controls: tuple[BaseControl, ...],
    free: Collection[str] = (),
) -> Evidence:
    """Return the wheels of a robot, sorted by what holds them.

    Args:
        free: Joints that the user wants free: they are no wheels.

    Raises:
        DriveError: A joint cannot be the wheel's or the swivel that the specification calls it.
        UnknownNameError: Such a joint is not known.
    """
    candidates = find_candidates(tree, spec.wheels)
    _require_fit(tree.description, "wheel", spec.wheels, [c.joint.name for c in candidates])
    if spec.wheels:
        candidates = [each for each in candidates if each.joint.name in spec.wheels]
    grounded = find_grounded(tree, candidates, bool(spec.wheels))
    swivels = find_swivels(tree, grounded.wheels, spec.swivels)
    _require_fit(tree.description, "swivel", spec.swivels, [s.joint.name for s in swivels])
    held = [wheel for wheel in grounded.wheels if wheel.swivel is None]
    driven = tuple(dict.fromkeys(name for control in controls for name in control.joints))
    lines, balls = _split_balls(held, tree.description.actuated.union(driven))
    leftovers = find_leftovers(tree, grounded.wheels, free, driven)
    return Evidence(tree, grounded, lines, balls, swivels, controls, spec, leftovers)


def _require_fit(
    description: Description, what: str, names: Iterable[str], fit: Collection[str]
) -> None:
    """Refuse joints that a drive file calls wheels' (or swivels), and that are none of the fit."""
    require_known(f"{what} joint", names, description.joint)
    for name in names:
        if name not in fit:
            listed = f"; swivels are {', '.join(sorted(fit))}" if fit and what == "swivel" else ""
            raise DriveError(
                f'{description.path}:{description.joint[name].line}: joint "{name}" '
                f"{UNFIT[what]}{listed}"
            )


def _split_balls(
    held: list[WheelCandidate], driven: Collection[str]
) -> tuple[tuple[tuple[WheelCandidate, ...], ...], tuple[WheelCandidate, ...]]:
    """Return the wheels on the root link grouped by common axle, and the ball casters beside them.

    What is called a caster, while others have motors and it has none, is as good as a ball. If all
    are spheres, their names tell which are balls; if no pair is left then, none is a ball.
    """
    motors = any(wheel.joint.name in driven for wheel in held)
    named = [wheel for wheel in held if is_called(wheel.joint, BALL_WORDS)]
    idle = [wheel for wheel in named if motors and wheel.joint.name not in driven]
    spheres = tuple(wheel for wheel in held if wheel.ball or wheel in idle)
    for balls in (spheres, tuple(wheel for wheel in spheres if wheel in named)):
        lines = lines_of([wheel for wheel in held if wheel not in balls])
        if any(len(line) > 1 for line in lines):
            return lines, balls
    return lines_of(held), ()


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


@dataclass(frozen=True)
class GroundedWheels:
    """Which candidates touch the ground.

    Attributes:
        wheels: Those that do, with their radii; None where nothing tells it.
        rejected: Why each of the others does not, in sentences.
        doubts: What was assumed of their sizes, in sentences.
    """

    wheels: tuple[WheelCandidate, ...]
    rejected: tuple[str, ...]
    doubts: tuple[str, ...]


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
    wheels, doubts = [], []
    for candidate in candidates:
        height, name = float(candidate.centre[2]) - ground, candidate.joint.name
        gap, tolerance = candidate.bottom - ground, ground_tolerance(candidate.radius or 0.0)
        if candidate.radius is None and height <= 0.0:
            wheels.append(candidate)
        elif candidate.radius is None and (declared or height <= MAX_RADIUS_RATIO * widest):
            source = f"axle height over {place}"
            wheels.append(replace(candidate, radius=height, source=source))
            note = f" ({candidate.source})" if candidate.source else ""
            doubts.append(
                f'no shape gives the size of wheel "{name}"{note}: its radius, {height:.4g} m, is '
                f"the {source}; if that is wrong, give its radius in a drive file"
            )
        elif candidate.radius is None:
            rejected.append(f'"{name}": its axle is {height:.3g} m above the ground: no wheel')
        elif gap > tolerance and not declared:
            rejected.append(f'"{name}": it ends {gap:.3g} m above the ground: no wheel')
        else:
            wheels.append(candidate)
    return GroundedWheels(tuple(wheels), tuple(rejected), tuple(doubts))


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
        name, gap = candidate.joint.name, candidate.bottom - floor
        if gap > (candidate.radius or 0.0):
            rejected.append(f'"{name}": the body reaches {gap:.3g} m lower: no wheel')
        elif len(candidates) == 1:
            rejected.append(
                f'"{name}": no other joint turns about a level axle: one alone is no wheel'
            )
        else:
            kept.append(candidate)
    return kept, rejected
