"""A branch of an arm: the joints that carry one of its ends, and how well they can move it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.description.records import Description
from rpctl.robot.boxes import LinkBoxes, LinkPoints
from rpctl.robot.model import Robot

METRES_PER_RADIAN = 0.3  # m/rad: weight of an angle relative to a distance
MIN_SINGULAR = 1e-6  # of the largest singular value: below it a direction counts as lost
GROWTH = 0.03  # m; how far the end of a branch keeps from the rest of the robot


@dataclass(frozen=True)
class Measures:
    """How well a branch stands in a posture.

    Attributes:
        singular: Singular values of the Jacobian of its end (6,), m and ``METRES_PER_RADIAN``
            rad, largest first.
        lightness: Smallest eigenvalue of the inertia of its joints, the diagonal scaled to 1: near
            0 where joints can move against each other and next to nothing moves.
        height: Of its lowest point above the ground, m.
        depth: How deep its outer half is in the rest of the robot, m.
        forward: How far ahead of the rest of the robot its end is, m.
        bearing: Angle between the way from where the branch begins to turn to its end and the
            forward direction, rad.
    """

    singular: Array
    lightness: float
    height: float
    depth: float
    forward: float
    bearing: float


class Branch:
    """The joints of a robot that carry one end and no branch before it.

    Attributes:
        robot: The robot.
        joints: Indices of these joints in ``robot.joints``, from the root on.
        end: The link that they carry.
    """

    def __init__(self, robot: Robot, end: str, joints: tuple[int, ...], posture: Array) -> None:
        """See the class.

        Args:
            robot: The robot.
            end: The link.
            joints: Indices in ``robot.joints``.
            posture: Positions of all joints (n_joints,): where the others stay.
        """
        self.robot, self.end, self.joints = robot, end, joints
        self._data = robot.model.createData()
        self._frame = robot.model.getFrameId(end, pin.FrameType.BODY)
        self._q = robot.configuration_at(np.zeros(3), posture)
        names = [robot.joints[i].name for i in joints]
        self._entries = [robot.entries[name] for name in names]
        self._mimics = [
            (robot.entries[j.name], names.index(j.mimic.joint), j.mimic)
            for j in robot.mimics
            if j.mimic is not None and j.mimic.joint in names
        ]
        self._columns = rate_columns(robot, names)
        pin.forwardKinematics(robot.model, self._data, self._q)
        self._front, self._mount = self._find_front(), self._find_mount()

    def measure(self, positions: Array, with_clearance: bool = True) -> Measures:
        """Return how well the branch stands.

        Args:
            positions: Of its joints (n,), rad or m.
            with_clearance: Whether to look at shapes, too; else heights and depths are 0.
        """
        model, data, q = self.robot.model, self._data, self._q
        for entry, position in zip(self._entries, positions, strict=True):
            entry.write(q, position)
        for entry, index, mimic in self._mimics:
            entry.write(q, mimic.multiplier * positions[index] + mimic.offset)
        frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = pin.computeFrameJacobian(model, data, q, self._frame, frame) @ self._columns
        jacobian[3:] *= METRES_PER_RADIAN
        singular = np.linalg.svd(jacobian, compute_uv=False)
        pin.crba(model, data, q, pin.Convention.WORLD)
        inertia = np.triu(data.M) + np.triu(data.M, 1).T
        inertia = self._columns.T @ inertia @ self._columns
        scale = 1.0 / np.sqrt(np.diag(inertia))
        lightness = float(np.linalg.eigvalsh(inertia * np.outer(scale, scale))[0])
        height = depth = 0.0
        if with_clearance:
            points = self._moved(data)
            height = float(points[:, 2].min()) - self.robot.drive.ground
            depth = self._rest.depth(data, self._outer(data))
        at = pin.updateFramePlacement(model, data, self._frame).translation
        x, y, z = at - self._mount
        bearing = math.atan2(math.hypot(y, z), x)
        return Measures(singular, lightness, height, depth, float(at[0]) - self._front, bearing)

    @cached_property
    def _moved(self) -> LinkPoints:
        """Points of all links that the branch moves."""
        return LinkPoints(self.robot, links_below(self.robot.description, self._name(0)))

    @cached_property
    def _outer(self) -> LinkPoints:
        """Points of the links beyond the middle of the branch."""
        middle = (len(self.joints) - 1) // 2
        return LinkPoints(self.robot, links_below(self.robot.description, self._name(middle)))

    @cached_property
    def _rest(self) -> LinkBoxes:
        """Boxes of the links that stay, or that move with the first joints only."""
        first = max(0, (len(self.joints) - 1) // 2 - 2)
        moved = set(links_below(self.robot.description, self._name(first)))
        others = [name for name in self.robot.description.link if name not in moved]
        return LinkBoxes(self.robot, others, GROWTH)

    def _find_front(self) -> float:
        """Return how far ahead of P the foremost point of the base is, m."""
        description = self.robot.description
        links = [name for name, _ in self.robot.tree.rigid_links(description.root)]
        wheels = [description.joint[w.joint].child for w in self.robot.drive.wheels]
        return float(LinkPoints(self.robot, [*links, *wheels])(self._data)[:, 0].max())

    def _find_mount(self) -> Array:
        """Return where the first joint that turns lies, or the first one at all (3,), m."""
        turning = (i for i in self.joints if self.robot.joints[i].kind != "prismatic")
        name = self.robot.joints[next(turning, self.joints[0])].name
        return np.array(self._data.oMi[self.robot.model.getJointId(name)].translation)

    def _name(self, index: int) -> str:
        return self.robot.joints[self.joints[index]].name


def rate_columns(robot: Robot, names: Sequence[str]) -> Array:
    """Return v (nv, n) for a unit rate of each of some joints, mimics following.

    Args:
        robot: The robot.
        names: Names of joints of its arm.
    """
    columns = np.zeros((robot.nv, len(names)))
    for column, name in enumerate(names):
        columns[robot.velocity_index(name), column] = 1.0
        for joint in robot.mimics:
            if joint.mimic is not None and joint.mimic.joint == name:
                columns[robot.velocity_index(joint.name), column] = joint.mimic.multiplier
    return columns


def links_below(description: Description, joint: str) -> list[str]:
    """Return the links that a joint moves."""
    links, stack = [], [description.joint[joint].child]
    while stack:
        links.append(stack.pop())
        stack += [below.child for below in description.child_joints[links[-1]]]
    return links


def split_branches(robot: Robot) -> list[tuple[str, tuple[int, ...]]]:
    """Return the ends of an arm with the joints (indices) that carry each and none before it.

    The end effector comes first, then the others by the number of joints.
    """
    description, names = robot.description, list(robot.joint_names)

    def carriers(link: str) -> list[int]:
        chain = {joint.name: joint for joint in description.chain(link)}
        followed = {j.mimic.joint for j in chain.values() if j.mimic is not None}
        return [names.index(n) for n in names if n in chain or n in followed]

    tips = sorted((joint.child for joint in robot.joints), key=lambda link: -len(carriers(link)))
    ends = [robot.end_effector, *tips] if robot.end_effector else tips
    branches, seen = [], set[int]()
    for end in ends:
        own = [index for index in carriers(end) if index not in seen]
        if own:
            branches.append((end, tuple(own)))
            seen |= set(own)
    return branches
