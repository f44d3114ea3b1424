"""How a scene's nodes move: poses of all joints, and their tracks."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.view.scene import threejs

STILL = 1e-6  # m and entries of a quaternion: what moves less stands still


def motion_tracks(name: str, times: Array, motion: Array) -> list[threejs.Json]:
    """Return the tracks of a node's position and quaternion; of one that stands still its first.

    Args:
        name: The node.
        times: Of the frames (n,), s.
        motion: Its poses (n, 7): position, m, and quaternion x, y, z, w.
    """
    tracks = []
    for key, kind, values in (
        ("position", "vector3", motion[:, :3]),
        ("quaternion", "quaternion", motion[:, 3:]),
    ):
        count = len(times) if np.ptp(values, axis=0).max() > STILL else 1
        tracks.append(threejs.track(f"{name}.{key}", kind, times[:count], values[:count]))
    return tracks


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
