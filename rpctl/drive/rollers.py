"""At which angle the rollers of wheels lie, where a file has them as joints."""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import FrozenTree
from rpctl.drive.roller_joints import rollers_of
from rpctl.drive.wheels import WheelCandidate

MECANUM_DEG = (20.0, 70.0)  # between a mecanum wheel's rollers and its axle; of an omni wheel 90


def has_mecanum_rollers(tree: FrozenTree, wheel: WheelCandidate) -> bool:
    """Return whether a wheel's rollers lie askew to its axle, as a mecanum wheel's do."""
    rollers = rollers_of(tree, wheel.joint)
    cosines = [min(1.0, abs(float(tree.axis(roller) @ wheel.axle))) for roller in rollers]
    low, high = MECANUM_DEG
    return bool(cosines) and all(low < math.degrees(math.acos(c)) < high for c in cosines)


def contact_roller(tree: FrozenTree, wheel: WheelCandidate) -> Array | None:
    """Return a vector (2,) along the roller on the ground, of a mecanum wheel with rollers.

    It is the lowest one's; in the root link's frame, of no certain length and way.
    """
    if not has_mecanum_rollers(tree, wheel):
        return None
    rollers = rollers_of(tree, wheel.joint)
    lowest = min(rollers, key=lambda roller: float(tree.pose(roller.child)[2, 3]))
    return np.asarray(tree.axis(lowest)[:2])
