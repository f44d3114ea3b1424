"""Swivels: upright joints that carry wheels, and whether they steer or trail."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.drive import Swivel
from rpctl.drive.drive_file import SwivelSpec
from rpctl.drive.wheels import WheelCandidate, leftward

MIN_TRAIL_M = 5e-3  # m, or
MIN_TRAIL_RADII = 0.1  # of the radius: a contact nearer to the swivel's axis does not trail
CASTER_WORDS = ("caster", "castor", "swivel")  # in a joint's name they end the doubt
SHARED_TRAIL_ROUNDING_M = 2e-3  # m; rounding of a file: a smaller trail of one of several
TRAIL_ROUNDING_M = 1e-9  # m; a smaller one is that of numbers


@dataclass(frozen=True)
class SwivelCandidate:
    """A swivel joint of a description: its pivot, heading, trail and role, at position 0.

    Attributes:
        joint: The joint.
        wheels: The wheels that it carries.
        pivot: Where its axis meets the ground (x, y) in the root link's frame, m.
        sign: 1 where its axis points up, −1 where it points down.
        ahead: Rolling direction of its wheels (2,), forward, or away from the contact of a caster.
        trail: Distance of the contact ahead of the axis, m.
        role: ``"steered"`` or ``"caster"``.
        trails: Whether its contact is so far off its axis that it would trail.
        why: The reason for the role, in words.
        doubt: The evidence for the other role, in words; empty if there is none.
    """

    joint: Joint
    wheels: tuple[WheelCandidate, ...]
    pivot: Array
    sign: float
    ahead: Array
    trail: float
    role: str
    trails: bool
    why: str
    doubt: str

    @property
    def heading(self) -> float:
        """Rolling direction at position 0 in the root link's frame, rad."""
        return math.atan2(self.ahead[1], self.ahead[0])

    def lateral(self, wheel: WheelCandidate) -> float:
        """Return the distance of a wheel's contact to the left of the axis, m."""
        left = np.array([-self.ahead[1], self.ahead[0]])
        return float(left @ (wheel.centre[:2] - self.pivot))

    def towards(self, forward: Array) -> SwivelCandidate:
        """Return the swivel with wheels that roll towards a direction (2,), unless they trail.

        Swivels that share a lateral force take its mean over one left.
        """
        if self.role == "caster" or float(self.ahead @ forward) >= 0.0:
            return self
        return replace(self, ahead=-self.ahead, trail=-self.trail)

    def trailing(self) -> SwivelCandidate:
        """Return the swivel as a caster: its contact lies behind its axis."""
        side, doubt, why = 1.0 if self.trail < 0.0 else -1.0, "", self.why
        if self.role != "caster":
            why = f"contact {1e3 * abs(self.trail):.3g} mm off its axis; {why}"
        if math.isfinite(self.joint.upper - self.joint.lower):
            doubt = f'"{self.joint.name}" is a caster, yet it has limits, into which it would run'
        return replace(
            self,
            ahead=side * self.ahead,
            trail=side * self.trail,
            role="caster",
            why=why,
            doubt=doubt,
        )

    def record(self, role: str, driven: bool, shares: str | None = None) -> Swivel:
        """Return the drive's record of it.

        Args:
            role: Its role in the drive, see :class:`Swivel`.
            shares: Swivel with which it shares one lateral constraint, or None.
        """
        mimic = self.joint.mimic
        return Swivel(
            joint=self.joint.name,
            role=role,
            pivot=(float(self.pivot[0]), float(self.pivot[1])),
            heading=self.heading,
            sign=self.sign,
            trail=0.0 if abs(self.trail) < TRAIL_ROUNDING_M else self.trail,
            driven=driven,
            shares=shares,
            ratio=1.0 if mimic is None else mimic.multiplier,
            offset=0.0 if mimic is None else mimic.offset,
            why=self.why,
        )


def find_swivels(
    tree: FrozenTree,
    wheels: tuple[WheelCandidate, ...],
    specs: Mapping[str, SwivelSpec],
) -> list[SwivelCandidate]:
    """Return the swivels that carry the given wheels, in file order.

    Args:
        specs: What the user says of swivels, by joint.
    """
    groups: dict[str, list[WheelCandidate]] = {}
    for wheel in wheels:
        if wheel.swivel is not None:
            groups.setdefault(wheel.swivel.name, []).append(wheel)
    return [
        _swivel_candidate(tree, tuple(group), specs.get(name, SwivelSpec(name)))
        for name, group in groups.items()
    ]


def _swivel_candidate(
    tree: FrozenTree, wheels: tuple[WheelCandidate, ...], spec: SwivelSpec
) -> SwivelCandidate:
    joint = wheels[0].swivel
    assert joint is not None
    pivot, up = tree.frame(joint)[:2, 3], tree.axis(joint)[2]
    left = leftward(wheels[0].axle)
    ahead = np.array([left[1], -left[0]]) / math.hypot(left[0], left[1])
    contact = np.mean([wheel.centre[:2] for wheel in wheels], axis=0)
    trail = float(ahead @ (contact - pivot))
    radius = max(wheel.radius or 0.0 for wheel in wheels)
    trails = abs(trail) > max(MIN_TRAIL_M, MIN_TRAIL_RADII * radius)
    role, why, doubt = _role(joint, trail, trails, spec, joint.name in tree.description.actuated)
    if role == "caster" and trail > 0.0:
        ahead, trail = -ahead, -trail
    return SwivelCandidate(
        joint, wheels, pivot, math.copysign(1.0, up), ahead, trail, role, trails, why, doubt
    )


def _role(
    joint: Joint,
    trail: float,
    trails: bool,
    spec: SwivelSpec,
    actuated: bool,
) -> tuple[str, str, str]:
    """Return whether a swivel steers or trails, why, and what speaks against it."""
    limited = math.isfinite(joint.upper - joint.lower)
    distance = f"contact {1e3 * abs(trail):.3g} mm off its axis"
    if abs(trail) < SHARED_TRAIL_ROUNDING_M:
        distance = "contact below its axis"
    if spec.role is not None:
        return spec.role, "the drive file says so", ""
    if joint.mimic is not None:
        return "steered", f'it mimics "{joint.mimic.joint}"', ""
    if actuated:
        return "steered", "a transmission drives it", ""
    named = any(word in joint.name.lower() for word in CASTER_WORDS)
    doubt = f'"{joint.name}" is taken for a caster; say role = "steered" of its [[swivel]] in a '
    doubt += 'drive file if it steers, "caster" if not'
    if trails and not limited:
        return "caster", f"{distance}, no limits", "" if named else doubt
    if trails and named:
        why = f"{distance}, its name; but it has limits"
        return "caster", why, f"{doubt}; a caster would run into its limits"
    return "steered", f"{distance}, {'limits' if limited else 'no limits'}", ""
