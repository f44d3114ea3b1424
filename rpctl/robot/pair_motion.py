"""How near the shapes of a pair can be: bounds that cost less than their distance.

Each shape is within a ball, so a pair is no nearer than its balls. And where the joints below the
last common one of a pair move by Δ, no point of one shape moves against the other by more than
Σ r |Δ|: r is 1 for a prismatic joint, and for one that turns the distance of the farthest point
that it can carry round, with all joints between them stretched out.
"""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np

from rpctl.arrays import Array
from rpctl.robot.collision import WORLD, CollisionModel, CollisionShape
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot

ROOT_COLUMNS = 2  # of a motion: how far the root link went, and how far it turned


def joint_motion(robot: Robot, q: Array) -> Array:
    """Return how far each joint went from one configuration to the next (K - 1, columns).

    The columns are the root link's way (m) and turn (rad), then the other joints' in the model's
    order; rad or m, not negative.

    Args:
        q: Configurations (K, nq).
    """
    way = np.hypot(*np.diff(q[:, :2], axis=0).T)
    moved = [way, _turn(q[:, 2], q[:, 3])]
    for entry in robot.entries.values():
        if entry.is_pair:
            moved.append(_turn(q[:, entry.index], q[:, entry.index + 1]))
        else:
            moved.append(np.abs(np.diff(q[:, entry.index])))
    return np.column_stack(moved)


def approach_rates(model: CollisionModel, travel: Array) -> Array:
    """Return by how much at most each pair approaches per motion of each joint (n, columns).

    Args:
        travel: How far from 0 each joint goes, as columns of :func:`joint_motion` (columns,); of
            prismatic joints it counts, m.
    """
    shapes = model.shapes
    found = _carried(model.robot, shapes, travel)[model.pairs].sum(axis=1)
    joints = np.array([shape.joint for shape in shapes], dtype=np.intp)[model.pairs]
    for number, shape in enumerate(shapes):
        # How far a level plane is does not change as the base moves.
        if shape.joint == WORLD and np.isinf(shape.radius) and abs(shape.geometry.n[2]) == 1.0:
            found[model.pairs[:, 1] == number, :ROOT_COLUMNS] = 0.0
    for above in range(ROOT_JOINT, model.robot.model.njoints):
        carried = np.zeros(model.robot.model.njoints, dtype=bool)
        carried[list(model.robot.model.subtrees[above])] = True
        found[carried[joints].all(axis=1), _columns(above)] = 0.0
    return found


def ball_gaps(model: CollisionModel, q: Array) -> Array:
    """Return how far apart the balls about the shapes of each pair are (n, K), m.

    Negative where they overlap. A half-space is itself, not a ball.

    Args:
        q: Configurations (K, nq).
    """
    shapes, (first, second) = model.shapes, model.pairs.T
    poses = model.robot.joint_poses(q, {shape.joint for shape in shapes})
    centres = np.empty((3, len(shapes), len(q)))
    for number, shape in enumerate(shapes):
        pose = poses[shape.joint]
        centres[:, number] = np.einsum("ijk,j->ik", pose[:, :3], shape.centre) + pose[:, 3]
    gaps = np.zeros((len(first), len(q)))
    for places in centres:
        gaps += np.square(places[first] - places[second])
    radii = np.array([shape.radius for shape in shapes])
    gaps = np.sqrt(gaps) - (radii[first] + radii[second])[:, None]
    for number, shape in enumerate(shapes):
        if isinstance(shape.geometry, coal.Halfspace):
            rows = second == number
            normal = shape.pose[:3, :3] @ shape.geometry.n
            height = np.einsum("i,ijk->jk", normal, centres[:, first[rows]])
            edge = shape.geometry.d + normal @ shape.pose[:3, 3]
            gaps[rows] = height - edge - radii[first[rows], None]
    return gaps


def joint_travel(robot: Robot, q: Array) -> Array:
    """Return how far from 0 each joint goes over configurations (K, nq), as columns of motion."""
    far = [0.0, np.pi]
    far += [float(np.abs(entry.read_all(q)).max(initial=0.0)) for entry in robot.entries.values()]
    return np.array(far)


def joint_limits_travel(robot: Robot) -> Array:
    """Return how far from 0 each joint may go, as columns of motion; endless ones slide 1 m."""
    spans = (robot.description.joint[name].span(1.0) for name in robot.entries)
    return np.array([0.0, np.pi, *(max(map(abs, span)) for span in spans)])


def _carried(robot: Robot, shapes: Sequence[CollisionShape], travel: Array) -> Array:
    """Return how far the farthest point of each shape moves per motion of each joint (n, columns).

    Of a joint that turns that is how far the point is from it at most: from its own joint, and on
    from that to those above it.
    """
    model = robot.model
    way = np.zeros((model.njoints, ROOT_COLUMNS + model.njoints - ROOT_JOINT - 1))
    turns = np.zeros(way.shape, dtype=bool)
    way[ROOT_JOINT, 0], turns[ROOT_JOINT, 1] = 1.0, True
    for joint in range(ROOT_JOINT + 1, model.njoints):
        above, column = int(model.parents[joint]), _columns(joint)
        slides = "JointModelP" in model.joints[joint].shortname()  # all others turn about one axis
        farther = float(np.linalg.norm(model.jointPlacements[joint].translation))
        farther += float(travel[column]) if slides else 0.0
        way[joint] = way[above] + farther * turns[above]
        turns[joint] = turns[above]
        way[joint, column], turns[joint, column] = float(slides), not slides
    joints = [shape.joint for shape in shapes]
    own = np.array([np.linalg.norm(shape.centre) + shape.radius for shape in shapes])
    return way[joints] + np.where(turns[joints], own[:, None], 0.0)


def _columns(joint: int) -> slice | int:
    """Return the columns of a joint."""
    return slice(0, ROOT_COLUMNS) if joint == ROOT_JOINT else ROOT_COLUMNS + joint - ROOT_JOINT - 1


def _turn(cos: Array, sin: Array) -> Array:
    """Return the angles (K - 1,) from one direction (K,) to the next, rad, without their signs."""
    return np.abs(
        np.arctan2(sin[1:] * cos[:-1] - cos[1:] * sin[:-1], cos[1:] * cos[:-1] + sin[1:] * sin[:-1])
    )
