"""The frozen tree: axes and rigid parts agree with the poses of its links."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl.description.frozen_tree import FrozenTree

ROBOTS = ["casters", "mixed_chain", "panda"]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_joint_moves_its_child_along_its_axis(name: str) -> None:
    """Locked a little further, a joint turns its child about its axis, or shifts it along it."""
    description, rng = rpctl.load(name).description, np.random.default_rng(5)
    locked = {j.name: float(rng.uniform(-1.0, 1.0)) for j in description.joints if j.moving}
    tree = FrozenTree(description, locked)
    for joint in description.joints:
        if not joint.moving:
            continue
        further = FrozenTree(description, {**locked, joint.name: locked[joint.name] + 0.1})
        after, before = further.pose(joint.child), tree.pose(joint.child)
        moved = after[:3, 3] - before[:3, 3]
        if joint.kind != "prismatic":
            moved = pin.log3(after[:3, :3] @ before[:3, :3].T)
        np.testing.assert_allclose(moved, 0.1 * tree.axis(joint), atol=1e-12)
