"""The tree of bodies that move, in frames in which it takes few operations.

A joint turns about, or slides along, the z axis of the body behind it. Where that axis leaves the
body's frame free, to spin about it and to slide along it, the frame is such that few entries are
left of what carries the next body ([KD04]).

[KD04] W. Khalil, E. Dombre, "Modeling, Identification and Control of Robots", Kogan Page, 2004.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.kernels.scalars import ROUNDING, Rotation, cleaned, exact
from rpctl.robot.coordinates import ROOT_JOINT, JointEntry
from rpctl.robot.model import Robot
from rpctl.robot.variation import pseudo_inertia

STRAIGHT = (1.0, 0.0)
ON_AXIS_M = 1e-12  # m: an origin so near to an axis is on it
SLANTED = 0.1  # sine of the angle between two axes: below it they meet, if at all, far away


@dataclass(frozen=True, eq=False)
class MovingBody:
    """A body behind a joint along the z axis of its own frame.

    At position θ its axes in the parent's are Rz(yaw) Rx(tilt) Rz(θ + offset) of a joint that
    turns, Rz(yaw) Rx(tilt) Rz(offset) of one that slides.

    Attributes:
        joint: Name of the joint; of the first body, that of the planar root.
        parent: Index of the body that carries it.
        slides: Whether the joint slides; else it turns.
        yaw: First rotation.
        tilt: Second rotation.
        offset: Angle of the third at position 0, rad.
        p: Origin of the frame in the parent's at position 0 (3,), m.
        entry: Where the joint's position is in q; of the root nowhere.
        index: Index of its rate in v.
        armature: Inertia of its rotor, kg m² or kg.
        frame: Pose (4, 4) of the body's frame in that of Pinocchio's joint.
    """

    joint: str
    parent: int
    slides: bool
    yaw: Rotation
    tilt: Rotation
    offset: float
    p: Array
    entry: JointEntry | None
    index: int
    armature: float
    frame: Array

    @property
    def pose(self) -> Array:
        """Pose (4, 4) in the parent's frame at position 0."""
        return pose_of(rotation(self.yaw, self.tilt, exact(self.offset)), self.p)


@dataclass(eq=False)
class _Draft:
    """A body whose frame is being chosen: Pinocchio's joint axes turned so that z is the axis."""

    parent: int
    slides: bool
    frame: Array  # (4, 4) in Pinocchio's joint
    pose: Array  # (4, 4) in the parent's draft
    angles: tuple[float, float, float]  # yaw, tilt and third angle of that pose
    child: int = -1  # the body behind it for which the frame is chosen
    spin: float = 0.0
    shift: Array = None  # type: ignore[assignment]  # (3,) of the origin, in the spun axes


def moving_bodies(robot: Robot) -> tuple[MovingBody, ...]:
    """Return the bodies of a robot, the root first, parents before children."""
    model = robot.model
    drafts = [_Draft(-1, False, np.eye(4), np.eye(4), (0.0, 0.0, 0.0), shift=np.zeros(3))]
    for i in range(ROOT_JOINT + 1, model.njoints):
        drafts.append(_draft(robot, i, drafts))
    _choose_children(drafts)
    _choose_spins(drafts)
    _choose_origins(drafts)
    return tuple(_body(robot, i, drafts) for i in range(len(drafts)))


def _draft(robot: Robot, i: int, drafts: list[_Draft]) -> _Draft:
    model, parent = robot.model, int(robot.model.parents[i]) - ROOT_JOINT
    axis = model.joints[i].createData().S.ravel()
    slides = not axis[3:].any()
    frame = pose_of(along_z(axis[:3] if slides else axis[3:]), np.zeros(3))
    pose = drafts[parent].frame.T @ model.jointPlacements[i].homogeneous @ frame
    return _Draft(parent, slides, frame, pose, euler_angles(pose), shift=np.zeros(3))


def _choose_children(drafts: list[_Draft]) -> None:
    """Name of each body the child with most behind it."""
    behind = [0] * len(drafts)
    for i in reversed(range(1, len(drafts))):
        parent = drafts[i].parent
        behind[parent] += 1 + behind[i]
        best = drafts[parent].child
        if best < 0 or behind[i] >= behind[best]:
            drafts[parent].child = i


def _choose_spins(drafts: list[_Draft]) -> None:
    """Spin the frames so that the next body is reached by a tilt about x alone."""
    for draft in drafts[1:]:
        if draft.slides:
            draft.spin = -draft.angles[2]
        elif draft.child > 0:
            draft.spin = drafts[draft.child].angles[0]


def _choose_origins(drafts: list[_Draft]) -> None:
    """Slide the origins along the axes so that the next one has no z, the last one no y."""
    for draft in reversed(drafts[1:]):
        parent = drafts[draft.parent]
        if draft.slides:
            continue
        if draft.child < 0 and draft.parent > 0 and not parent.slides:
            level = math.sin(draft.angles[1])
            ahead = (turn_z(parent.spin).T @ draft.pose[:3, 3])[1]
            draft.shift[2] = ahead / level if level > SLANTED else 0.0
        elif draft.child > 0 and not drafts[draft.child].slides:
            draft.shift[2] = _origin_of(drafts, drafts[draft.child])[2]
    for draft in drafts[1:]:
        if draft.slides:
            draft.shift = -_axes(drafts, draft).T @ _origin_of(drafts, draft)


def _axes(drafts: list[_Draft], draft: _Draft) -> Array:
    """Return the axes (3, 3) of a spun frame in its parent's at position 0."""
    spun = turn_z(drafts[draft.parent].spin).T @ draft.pose[:3, :3] @ turn_z(draft.spin)
    return np.asarray(spun)


def _origin_of(drafts: list[_Draft], draft: _Draft) -> Array:
    """Return the origin (3,) of a frame in its parent's at position 0."""
    parent = drafts[draft.parent]
    origin = turn_z(parent.spin).T @ draft.pose[:3, 3] - parent.shift
    return np.asarray(origin + _axes(drafts, draft) @ draft.shift)


def _body(robot: Robot, i: int, drafts: list[_Draft]) -> MovingBody:
    draft, name = drafts[i], robot.model.names[i + ROOT_JOINT]
    yaw, tilt, third = draft.angles
    index = int(robot.model.joints[i + ROOT_JOINT].idx_v)
    return MovingBody(
        joint=name,
        parent=draft.parent,
        slides=draft.slides,
        yaw=exact(yaw - drafts[draft.parent].spin) if i else STRAIGHT,
        tilt=exact(tilt),
        offset=third + draft.spin,
        p=cleaned(_origin_of(drafts, draft)) if i else np.zeros(3),
        entry=robot.entries[name] if i else None,
        index=index,
        armature=float(robot.model.armature[index]) if i else 0.0,
        frame=draft.frame
        @ pose_of(turn_z(draft.spin), np.zeros(3))
        @ pose_of(np.eye(3), draft.shift),
    )


def along_z(axis: Array) -> Array:
    """Return a rotation (3, 3) whose last column is a unit axis (3,)."""
    for k in np.flatnonzero(axis == 1.0):
        return np.roll(np.eye(3), k - 2, axis=0)  # x, y and z in another order
    across = np.eye(3)[int(np.abs(axis).argmin())]
    first = np.cross(across, axis)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])


def euler_angles(pose: Array) -> tuple[float, float, float]:
    """Return yaw, tilt and third angle of a pose, R = Rz Rx Rz.

    Where both z axes are parallel, the yaw is towards the origin, or 0 where that is on the axis.
    """
    R, (x, y) = pose[:3, :3], pose[:2, 3]
    level = math.hypot(R[0, 2], R[1, 2])
    tilt = math.atan2(level, R[2, 2])
    if level > ROUNDING:
        yaw = math.atan2(R[0, 2], -R[1, 2])
    else:
        yaw = math.atan2(y, x) if math.hypot(x, y) > ON_AXIS_M else 0.0
        tilt = 0.0 if R[2, 2] > 0.0 else math.pi
    third = rotation(exact(yaw), exact(tilt), STRAIGHT).T @ R  # of nearly parallel axes exact, too
    return yaw, tilt, math.atan2(third[1, 0] - third[0, 1], third[0, 0] + third[1, 1])


def turn_z(angle: float) -> Array:
    """Return the rotation (3, 3) by an angle about z."""
    return rotation(exact(angle), STRAIGHT, STRAIGHT)


def rotation(yaw: Rotation, tilt: Rotation, third: Rotation) -> Array:
    """Return Rz Rx Rz (3, 3).

    Args:
        yaw: Of the first rotation.
        tilt: Of the second.
        third: Of the third.
    """
    (a, b), (c, d), (e, f) = yaw, tilt, third
    first = np.array([[a, -b, 0.0], [b, a, 0.0], [0.0, 0.0, 1.0]])
    second = np.array([[1.0, 0.0, 0.0], [0.0, c, -d], [0.0, d, c]])
    return np.asarray(first @ second @ np.array([[e, -f, 0.0], [f, e, 0.0], [0.0, 0.0, 1.0]]))


def pose_of(R: Array, p: Array) -> Array:
    """Return a pose (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, p
    return pose


NUMBERS = 10  # of a body's inertia
M, MX, MY, MZ, XX, YY, ZZ, XY, XZ, YZ = range(NUMBERS)
UNFELT_BY_ROOT = (MZ, XX, YY, XY, XZ, YZ)  # it is planar


def inertias_of(robot: Robot) -> Array:
    """Return the pseudo-inertias (n, 4, 4) of the bodies in the axes of Pinocchio's joints.

    :mod:`rpctl.robot.variation` says what these are.
    """
    return np.array([pseudo_inertia(each) for each in list(robot.model.inertias)[ROOT_JOINT:]])


def felt(bodies: Sequence[MovingBody], inertias: Array, grounded: bool = False) -> Array:
    """Return the ten numbers of each body (..., n, 10) that motion and forces tell apart.

    Args:
        bodies: The bodies.
        inertias: Pseudo-inertias (..., n, 4, 4) in the axes of Pinocchio's joints.
        grounded: Whether what the planar root hides counts, too: what holds it upright.
    """
    from_frames = np.linalg.inv([body.frame for body in bodies])
    found = from_frames @ inertias @ np.swapaxes(from_frames, 1, 2)
    for i in reversed(range(1, len(bodies))):
        body, own = bodies[i], found[..., i, :, :]
        unfelt = np.zeros(own.shape)
        if body.slides:
            unfelt[..., :3, :3] = own[..., :3, :3]
        else:
            unfelt[..., 2:, 2:] = own[..., 2:, 2:]
            unfelt[..., 2, 2] += own[..., 0, 0]  # so that it has the inertia I_yy
        found[..., i, :, :] = own - unfelt
        found[..., body.parent, :, :] += body.pose @ unfelt @ body.pose.T
    numbers = _ten_numbers(found)
    if not grounded:
        numbers[..., 0, UNFELT_BY_ROOT] = 0.0
    return numbers


def _ten_numbers(inertias: Array) -> Array:
    """Return the ten numbers (..., 10) of pseudo-inertias (..., 4, 4)."""
    xx, yy, zz = (inertias[..., k, k] for k in range(3))
    moments = [yy + zz, xx + zz, xx + yy]
    products = [-inertias[..., i, j] for i, j in ((0, 1), (0, 2), (1, 2))]
    first = [inertias[..., k, 3] for k in (3, 0, 1, 2)]
    return np.stack([*first, *moments, *products], axis=-1)
