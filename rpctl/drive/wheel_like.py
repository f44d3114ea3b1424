"""Joints that look like wheels, whatever holds them: by shape, by height, by name."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rpctl.description.frozen_tree import MAX_TILT_SINE, FrozenTree
from rpctl.description.records import Joint
from rpctl.drive.grounded import ground_tolerance
from rpctl.drive.wheel_size import round_parts, wheel_size

WHEEL_WORDS = ("wheel", "tyre", "tire")
MAX_CAMBER_SINE = 0.5  # of a wheel's axle off the level; a steeper one is no wheel's
NEAR_RADII = 1.0  # so many of its radii above the ground a wheel may end that hangs in a suspension


@dataclass(frozen=True)
class WheelLike:
    """A free joint that looks like a wheel's.

    Attributes:
        joint: The joint.
        named: Whether a name says so.
        height: Of its centre in the root link's frame, m.
        radius: m; None if no shape tells it.
        round: Whether its shapes are round about its axle.
    """

    joint: Joint
    named: bool
    height: float
    radius: float | None
    round: bool

    @property
    def bottom(self) -> float:
        """Height of its lowest point in the root link's frame, m; NaN without a radius."""
        return math.nan if self.radius is None else self.height - self.radius

    def stands(self, ground: float) -> bool:
        """Return whether it ends on the ground, whose height is given in m."""
        return abs(self.bottom - ground) <= ground_tolerance(self.radius or 0.0)

    def is_near(self, ground: float) -> bool:
        """Return whether it ends near the ground, whose height is given in m."""
        return self.bottom - ground <= NEAR_RADII * (self.radius or 0.0)


def wheel_like(tree: FrozenTree, joint: Joint) -> WheelLike | None:
    """Return a free joint's likeness to a wheel's; None if it has none.

    Its axis is about level, and it turns without limits, or is called a wheel.

    Args:
        tree: The robot.
        joint: One of its joints.
    """
    named = is_named_wheel(joint)
    if not tree.is_free(joint) or joint.kind == "prismatic" or not (named or joint.endless):
        return None
    if abs(float(tree.axis(joint)[2])) > (MAX_CAMBER_SINE if named else MAX_TILT_SINE):
        return None
    size = wheel_size(tree, joint)
    centre = tree.frame(joint)[:3, 3] + size.offset * tree.axis(joint)
    rolls = size.radius is not None and not size.uneven
    is_round = rolls or bool(round_parts(tree, joint))
    return WheelLike(joint, named, float(centre[2]), size.radius, is_round)


def is_named_wheel(joint: Joint) -> bool:
    """Return whether the name of a joint, or of the link that it moves, is a wheel's."""
    return any(word in f"{joint.name} {joint.child}".lower() for word in WHEEL_WORDS)


def moved_below(tree: FrozenTree, link: str) -> list[Joint]:
    """Return the free joints below a link, in the order of the tree."""
    found, stack = [], [*reversed(tree.description.child_joints[link])]
    while stack:
        joint = stack.pop()
        found += [joint] * tree.is_free(joint)
        stack += reversed(tree.description.child_joints[joint.child])
    return found
