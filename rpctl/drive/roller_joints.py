"""The rollers of wheels that a file has as joints."""

from __future__ import annotations

from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Joint

MIN_ROLLERS = 3  # endless joints on one wheel that are its rollers


def rollers_of(tree: FrozenTree, wheel: Joint) -> tuple[Joint, ...]:
    """Return the rollers on a wheel that hold still or turn freely; none, if too few.

    Args:
        tree: The robot.
        wheel: The wheel's joint.
    """
    found, stack = [], [*tree.description.child_joints[wheel.child]]
    while stack:
        joint = stack.pop()
        if joint.endless:
            found.append(joint)
        elif not tree.is_free(joint):
            stack += tree.description.child_joints[joint.child]
    return tuple(found) if len(found) >= MIN_ROLLERS else ()
