"""Where a robot's joints are at many configurations at once.

Numbers of K configurations stand side by side in the last axis, so that each operation takes all of
them. Everything is seen in the root link's axes, from its origin. There a vector of a joint's frame
is the sum of the frame's axes times its entries: one small matrix product for all of K.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import BASE_NQ, ROOT_JOINT
from rpctl.robot.model import Robot


@dataclass(frozen=True, eq=False)
class AlignedJoint:
    """A joint whose frame is turned such that its axis is the third one.

    Attributes:
        parent: Index of the joint above it; 0 is the root.
        place: Rows (4, 3) in the frame of the joint above: the axes at position 0, the origin.
        slides: Whether it slides along its axis; else it turns about it.
        entry: Where its position, or its cosine and then its sine, stand in q.
        is_pair: Whether they are two.
        column: Index of its rate in v.
        turned: Rotation (3, 3) from the turned frame to that of Pinocchio.
    """

    parent: int
    place: Array
    slides: bool
    entry: int
    is_pair: bool
    column: int
    turned: Array


@dataclass(frozen=True, eq=False)
class AlignedTree:
    """All joints of a robot but the root, parents first; joint k of Pinocchio is number k − 2.

    Attributes:
        robot: The robot.
        joints: Its joints.
    """

    robot: Robot = field(repr=False)
    joints: tuple[AlignedJoint, ...]


@dataclass(frozen=True, eq=False)
class Placements:
    """Where the joints are at K configurations, in the root link's axes.

    Attributes:
        tree: The joints.
        axes: The axes of the frames (n + 1, 3, 3, K): axis, then entry; those of the root first.
        origins: Their origins (n + 1, 3, K), m.
    """

    tree: AlignedTree = field(repr=False)
    axes: Array
    origins: Array


def aligned_tree(robot: Robot) -> AlignedTree:
    """Return the joints of a robot with turned frames."""
    model, found = robot.model, list[AlignedJoint]()
    for number in range(ROOT_JOINT + 1, model.njoints):
        joint, parent = model.joints[number], int(model.parents[number]) - ROOT_JOINT
        motion = np.array(joint.createData().S).ravel()  # (6,) linear, angular
        slides = bool(motion[:3].any())
        axis = motion[:3] if slides else motion[3:]
        turned = _with_third_axis(axis)
        above = np.eye(3) if parent == 0 else found[parent - 1].turned
        placement = model.jointPlacements[number]
        axes = above.T @ placement.rotation @ turned
        place = np.vstack([axes.T, above.T @ placement.translation])
        index, column = int(joint.idx_q), int(joint.idx_v)
        found.append(AlignedJoint(parent, place, slides, index, joint.nq == 2, column, turned))
    return AlignedTree(robot, tuple(found))


def _with_third_axis(axis: Array) -> Array:
    """Return a rotation (3, 3) whose third column is a unit axis (3,)."""
    least = int(np.abs(axis).argmin())
    first = np.cross(np.eye(3)[least], axis)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])


def placements(tree: AlignedTree, q: Array, only: frozenset[int] | None = None) -> Placements:
    """Return where joints are at configurations.

    Args:
        q: Configurations (K, nq).
        only: Numbers of the joints that are looked at, with all above them; None: all.
    """
    count, n = len(q), len(tree.joints)
    axes, origins = np.empty((n + 1, 3, 3, count)), np.empty((n + 1, 3, count))
    axes[0], origins[0] = np.eye(3)[:, :, None], 0.0
    columns = np.ascontiguousarray(q[:, BASE_NQ:].T)
    for number, joint in enumerate(tree.joints):
        if only is not None and number not in only:
            continue
        above = axes[joint.parent].reshape(3, 3 * count)
        x, y, z, origin = (joint.place @ above).reshape(4, 3, count)
        mine, position = axes[number + 1], columns[joint.entry - BASE_NQ]
        np.add(origins[joint.parent], origin, out=origins[number + 1])
        mine[2] = z
        if joint.slides:
            mine[0], mine[1] = x, y
            origins[number + 1] += position * z
            continue
        if joint.is_pair:
            cos, sin = position, columns[joint.entry - BASE_NQ + 1]
        else:
            cos, sin = np.cos(position), np.sin(position)
        mine[0] = cos * x
        mine[0] += sin * y
        mine[1] = cos * y
        mine[1] -= sin * x
    return Placements(tree, axes, origins)


@dataclass(frozen=True, eq=False)
class EndEffectorFrame:
    """The end effector as a frame that a joint carries.

    Attributes:
        tree: The joints.
        chain: Numbers of those that move it.
        joint: The last of them, counted from 1; 0 is the root.
        place: Its axes and origin (4, 3) in the turned frame of that joint.
    """

    tree: AlignedTree = field(repr=False)
    chain: frozenset[int]
    joint: int
    place: Array

    def at(self, q: Array) -> tuple[Array, Array]:
        """Return the end effector's axes (3, 3, K) in the root link's, and where it is (K, 3).

        Args:
            q: Configurations (K, nq).

        Returns:
            The axes: axis, then entry. The place is in the world, m.
        """
        found, count = placements(self.tree, q, self.chain), len(q)
        mine = (self.place @ found.axes[self.joint].reshape(3, 3 * count)).reshape(4, 3, count)
        x, y, z = found.origins[self.joint] + mine[3]
        cos, sin = q[:, 2], q[:, 3]
        place = np.column_stack([q[:, 0] + cos * x - sin * y, q[:, 1] + sin * x + cos * y, z])
        return mine[:3], place


def end_effector_frame(tree: AlignedTree) -> EndEffectorFrame:
    """Return the frame of a robot's end effector.

    Raises:
        RpctlError: It has none.
    """
    robot = tree.robot
    if robot.end_effector is None:
        raise RpctlError(f"{robot.name} has no arm, so no end effector")
    model = robot.model
    frame = model.frames[model.getFrameId(robot.end_effector, pin.FrameType.BODY)]
    joint = int(frame.parentJoint) - ROOT_JOINT
    turned = np.eye(3) if joint == 0 else tree.joints[joint - 1].turned
    place = np.vstack([frame.placement.rotation.T, frame.placement.translation]) @ turned
    chain, above = set[int](), joint
    while above:
        chain.add(above - 1)
        above = tree.joints[above - 1].parent
    return EndEffectorFrame(tree, frozenset(chain), joint, place)
