"""How a scene's nodes move: poses of all joints, and keyframes that give them to a tolerance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.view.scene import threejs

POSITION_TOLERANCE_M = 5e-4  # m; a third of a pixel where a robot of 1.5 m fills the picture
ROTATION_TOLERANCE_RAD = 2e-3  # rad; moves what is 0.3 m away from the axis by as much
MAX_STEP_RAD = 2.0  # rad from one frame to the next

Deviation = Callable[[int, int], Array]


def position_keyframes(times: Array, values: Array) -> NDArray[np.int64]:
    """Return the frames from which straight lines give positions (n, 3) to a tolerance.

    Args:
        times: Times of the frames (n,), s.
        values: m.
    """

    def deviation(first: int, last: int) -> Array:
        fraction = _fractions(times, first, last)[:, None]
        line = (1.0 - fraction) * values[first] + fraction * values[last]
        return np.asarray(np.linalg.norm(values[first : last + 1] - line, axis=1))

    return _keep(len(times), deviation, POSITION_TOLERANCE_M)


def rotation_keyframes(times: Array, values: Array) -> NDArray[np.int64]:
    """Return the frames from which great arcs give unit quaternions (n, 4) to a tolerance.

    Args:
        times: Times of the frames (n,), s.
        values: Quaternions, of either sign.
    """

    def deviation(first: int, last: int) -> Array:
        fraction = _fractions(times, first, last)[:, None]
        start, end = values[first], values[last]
        cosine = start @ end
        if cosine < 0.0:  # the same turn, by the nearer of its two quaternions
            cosine, end = -cosine, -end
        half = np.arccos(min(cosine, 1.0))
        if half > MAX_STEP_RAD / 2.0:  # towards half a turn, rounding would choose the way
            return np.pi * np.minimum(fraction, 1.0 - fraction)[:, 0]
        if half < 1e-9:
            arc = np.broadcast_to(start, (len(fraction), 4))
        else:
            arc = (
                np.sin((1.0 - fraction) * half) * start + np.sin(fraction * half) * end
            ) / np.sin(half)
        nearness = np.abs(np.einsum("ij,ij->i", values[first : last + 1], arc))
        return np.asarray(2.0 * np.arccos(np.minimum(nearness, 1.0)))

    return _keep(len(times), deviation, ROTATION_TOLERANCE_RAD)


def _fractions(times: Array, first: int, last: int) -> Array:
    return np.asarray((times[first : last + 1] - times[first]) / (times[last] - times[first]))


def _keep(count: int, deviation: Deviation, tolerance: float) -> NDArray[np.int64]:
    """Return first and last frame and, recursively, the worst of each interval."""
    kept, stretches = {0, count - 1}, [(0, count - 1)]
    while stretches:
        first, last = stretches.pop()
        if last - first < 2:
            continue
        away = deviation(first, last)
        worst = first + int(away.argmax())
        if away[worst - first] > tolerance:
            kept.add(worst)
            stretches += [(first, worst), (worst, last)]
    return np.array(sorted(kept))


def motion_tracks(name: str, times: Array, motion: Array) -> list[threejs.Json]:
    """Return the tracks of a node's position and quaternion.

    Args:
        name: The node.
        times: Of the frames (n,), s.
        motion: Its poses (n, 7): position, m, and quaternion x, y, z, w.
    """
    places, turns = motion[:, :3], motion[:, 3:]
    kept = position_keyframes(times, places)
    tracks = [threejs.track(f"{name}.position", "vector3", times[kept], places[kept])]
    kept = rotation_keyframes(times, turns)
    return [*tracks, threejs.track(f"{name}.quaternion", "quaternion", times[kept], turns[kept])]


def joint_poses(robot: Robot, q: Array, roots: Array | None = None) -> Array:
    """Return the poses (n, njoints, 7) of all joints at configurations (n, nq).

    A pose is the position in the world, m, and the unit quaternion (x, y, z, w).

    Args:
        robot: The robot.
        q: Configurations (n, nq).
        roots: Poses of the root link (n, 7) over the ground, where it may tilt and hop; (n, 0) or
            None: it stays level.
    """
    tilted = roots is not None and roots.shape[1] > 0
    data = robot.model.createData()
    poses = np.empty((len(q), robot.model.njoints, 7))
    for k, configuration in enumerate(q):
        pin.forwardKinematics(robot.model, data, configuration)
        moved = pin.SE3.Identity()
        if tilted and roots is not None:
            root = pin.XYZQUATToSE3(roots[k])
            root.translation[2] += robot.drive.ground
            moved = root * data.oMi[ROOT_JOINT].inverse()
        for j, placement in enumerate(data.oMi):
            poses[k, j] = pin.SE3ToXYZQUAT(moved * placement if j and tilted else placement)
    return poses


def base_poses(q: Array) -> Array:
    """Return the poses (n, 2, 7) of the universe and the root link at configurations (n, nq).

    A pose is the position in the world, m, and the unit quaternion (x, y, z, w).
    """
    poses = np.zeros((len(q), ROOT_JOINT + 1, 7))
    poses[:, :, 6] = 1.0
    half = 0.5 * np.arctan2(q[:, 3], q[:, 2])
    poses[:, ROOT_JOINT, :2] = q[:, :2]
    poses[:, ROOT_JOINT, 5:] = np.column_stack([np.sin(half), np.cos(half)])
    return poses
