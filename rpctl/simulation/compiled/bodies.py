"""The tree of bodies that move: frames along the joints' axes, inertias as ten numbers each.

The ten numbers are linear in what a body is made of: m, m c (3), and the inertia about the origin
of the body's frame, xx, yy, zz, xy, xz, yz.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT, JointEntry
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.scalars import cleaned

NUMBERS = 10  # of a body's inertia


@dataclass(frozen=True, eq=False)
class MovingBody:
    """A body behind a joint along the z axis of its own frame.

    Attributes:
        joint: Name of the joint; of the first body, that of the planar root.
        parent: Index of the body that carries it.
        slides: Whether the joint slides; else it turns.
        R: Axes (3, 3) of the body's frame at position 0 in the parent's axes.
        p: Its origin (3,) there, m.
        entry: Where the joint's position is in q; of the root nowhere.
        index: Index of its rate in v.
        armature: Inertia of its rotor, kg m² or kg.
        frame: Pose (4, 4) of the body's frame in that of Pinocchio's joint.
    """

    joint: str
    parent: int
    slides: bool
    R: Array
    p: Array
    entry: JointEntry | None
    index: int
    armature: float
    frame: Array


def moving_bodies(robot: Robot) -> tuple[MovingBody, ...]:
    """Return the bodies of a robot, the root first, parents before children."""
    model = robot.model
    root = MovingBody(
        model.names[ROOT_JOINT], -1, False, np.eye(3), np.zeros(3), None, 0, 0.0, np.eye(4)
    )
    bodies = [root]
    for i in range(ROOT_JOINT + 1, model.njoints):
        axis = model.joints[i].createData().S.ravel()
        slides = not axis[3:].any()
        parent = bodies[model.parents[i] - ROOT_JOINT]
        to_z = along_z(axis[:3] if slides else axis[3:])
        frame = np.eye(4)
        frame[:3, :3] = to_z
        index = int(model.joints[i].idx_v)
        placement = model.jointPlacements[i]
        bodies.append(
            MovingBody(
                joint=model.names[i],
                parent=model.parents[i] - ROOT_JOINT,
                slides=slides,
                R=cleaned(parent.frame[:3, :3].T @ placement.rotation @ to_z),
                p=cleaned(parent.frame[:3, :3].T @ placement.translation),
                entry=robot.entries[model.names[i]],
                index=index,
                armature=float(model.armature[index]),
                frame=frame,
            )
        )
    return tuple(bodies)


def along_z(axis: Array) -> Array:
    """Return a rotation (3, 3) whose last column is a unit axis (3,)."""
    for k in np.flatnonzero(axis == 1.0):
        return np.roll(np.eye(3), k - 2, axis=0)  # x, y and z in another order
    across = np.eye(3)[int(np.abs(axis).argmin())]
    first = np.cross(across, axis)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])


def inertial_numbers(robot: Robot) -> Array:
    """Return the ten numbers of each body (n, 10) in the axes of Pinocchio's joints."""
    inertias = list(robot.model.inertias)[ROOT_JOINT:]
    return np.array([ten_numbers(inertia) for inertia in inertias])


def ten_numbers(inertia: pin.Inertia) -> Array:
    """Return m, m c (3) and the inertia about the origin: xx, yy, zz, xy, xz, yz."""
    m, c = inertia.mass, inertia.lever
    I = inertia.inertia + m * ((c @ c) * np.eye(3) - np.outer(c, c))  # noqa: E741 (its letter)
    return np.array([m, *(m * c), *np.diag(I), I[0, 1], I[0, 2], I[1, 2]])


def in_frame(numbers: Array, frame: Array) -> Array:
    """Return the ten numbers (..., 10) of bodies in another frame.

    Args:
        numbers: In the axes of Pinocchio's joint.
        frame: Pose (4, 4) of the other frame in those axes.
    """
    R, p = frame[:3, :3], frame[:3, 3]
    m, mc = numbers[..., 0], numbers[..., 1:4]
    I = inertia_matrix(numbers)  # noqa: E741
    second = 0.5 * np.trace(I, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - I  # ∫ r rᵀ dm
    outer = mc[..., :, None] * p
    second = second - outer - np.swapaxes(outer, -1, -2) + m[..., None, None] * np.outer(p, p)
    second = R.T @ second @ R
    I = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second  # noqa: E741
    moved = (mc - m[..., None] * p) @ R
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    return np.concatenate([m[..., None], moved, I[..., rows, columns]], axis=-1)


def inertia_matrix(numbers: Array) -> Array:
    """Return the inertia (..., 3, 3) about the origin."""
    return np.asarray(numbers[..., [[4, 7, 8], [7, 5, 9], [8, 9, 6]]])
