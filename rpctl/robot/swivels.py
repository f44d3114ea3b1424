"""Swivels: upright joints that carry wheels, and whether they steer or trail."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rpctl.description.records import Array, Description, Joint
from rpctl.robot.drive import Swivel
from rpctl.robot.drive_file import SwivelSpec
from rpctl.robot.wheels import Candidate, leftward, upright_axis

TRAIL = 5e-3  # m, or
TRAIL_SHARE = 0.1  # of the radius: a contact nearer to the swivel's axis does not trail
CASTER_WORDS = ("caster", "castor", "swivel")  # in a joint's name they end the doubt
STEADY = 2e-3  # m; a smaller trail of a steered wheel is rounding, and left out


@dataclass(frozen=True)
class Found:
    """A swivel of a description, with what its wheels make of it at position 0.

    Attributes:
        joint: The joint.
        wheels: The wheels that it carries.
        pivot: Where its axis meets the ground (x, y) in the root link's frame, m.
        sign: 1 where its axis points up, −1 where it points down.
        ahead: Rolling direction of its wheels (2,), forward, or away from the contact of a caster.
        trail: Distance of the contact ahead of the axis, m.
        role: ``"steered"`` or ``"caster"``.
        why: The reason for the role, in words.
        doubt: What the other role would be told by, or nothing.
    """

    joint: Joint
    wheels: tuple[Candidate, ...]
    pivot: Array
    sign: float
    ahead: Array
    trail: float
    role: str
    why: str
    doubt: str

    @property
    def heading(self) -> float:
        """Rolling direction at position 0 in the root link's frame, rad."""
        return math.atan2(self.ahead[1], self.ahead[0])

    def lateral(self, wheel: Candidate) -> float:
        """Return the distance of a wheel's contact to the left of the axis, m."""
        left = np.array([-self.ahead[1], self.ahead[0]])
        return float(left @ (wheel.centre[:2] - self.pivot))

    def record(self, role: str, driven: bool, shares: str | None = None) -> Swivel:
        """Return the drive's record of it."""
        steady = role != "caster" and abs(self.trail) < STEADY
        mimic = self.joint.mimic
        return Swivel(
            joint=self.joint.name,
            role=role,
            pivot=(float(self.pivot[0]), float(self.pivot[1])),
            heading=self.heading,
            sign=self.sign,
            trail=0.0 if steady else self.trail,
            driven=driven,
            shares=shares,
            ratio=1.0 if mimic is None else mimic.multiplier,
            offset=0.0 if mimic is None else mimic.offset,
            why=self.why,
        )


def find_swivels(
    description: Description,
    locked: Mapping[str, float],
    wheels: tuple[Candidate, ...],
    told: Mapping[str, SwivelSpec],
    actuated: frozenset[str],
) -> list[Found]:
    """Return the swivels that carry the given wheels, in file order."""
    groups: dict[str, list[Candidate]] = {}
    for wheel in wheels:
        if wheel.swivel is not None:
            groups.setdefault(wheel.swivel.name, []).append(wheel)
    return [
        _found(description, locked, tuple(group), told.get(name, SwivelSpec()), name in actuated)
        for name, group in groups.items()
    ]


def _found(
    description: Description,
    locked: Mapping[str, float],
    wheels: tuple[Candidate, ...],
    told: SwivelSpec,
    actuated: bool,
) -> Found:
    joint = wheels[0].swivel
    assert joint is not None
    pose = description.pose(joint.parent, dict(locked)) @ joint.origin
    pivot = pose[:2, 3]
    up = upright_axis(description, locked, joint)[2]
    left = leftward(wheels[0].axle)
    ahead = np.array([left[1], -left[0]]) / math.hypot(left[0], left[1])
    contact = np.mean([wheel.centre[:2] for wheel in wheels], axis=0)
    trail = float(ahead @ (contact - pivot))
    role, why, doubt = _role(joint, wheels, trail, told, actuated)
    if role == "caster" and trail > 0.0:
        ahead, trail = -ahead, -trail
    return Found(joint, wheels, pivot, math.copysign(1.0, up), ahead, trail, role, why, doubt)


def _role(
    joint: Joint,
    wheels: tuple[Candidate, ...],
    trail: float,
    told: SwivelSpec,
    actuated: bool,
) -> tuple[str, str, str]:
    """Return whether a swivel steers or trails, why, and what speaks against it."""
    radius = max(wheel.radius or 0.0 for wheel in wheels)
    trails = abs(trail) > max(TRAIL, TRAIL_SHARE * radius)
    limited = math.isfinite(joint.upper - joint.lower)
    distance = f"its contact is {1e3 * abs(trail):.3g} mm off its axis"
    if told.role is not None:
        return told.role, "the drive file says so", ""
    if joint.mimic is not None:
        return "steered", f'it mimics "{joint.mimic.joint}"', ""
    if actuated:
        return "steered", "a transmission drives it", ""
    if trails and not limited:
        doubt = f'"{joint.name}" is taken for a caster; [[swivel]] role = "steered" if it steers'
        named = any(word in joint.name.lower() for word in CASTER_WORDS)
        return "caster", f"{distance}, it turns without limits", "" if named else doubt
    why = "it turns between limits" if limited else distance
    return "steered", why, ""
