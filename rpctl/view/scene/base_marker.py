"""What is drawn of a run whose robot cannot be had: a wedge at its base, which points forward."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.description.mesh_shading import shade
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.simulation.run import Run
from rpctl.view.scene.robot_meshes import Bodies, BodyPart

RGBA = (0.45, 0.52, 0.62, 1.0)
DEFAULT_LENGTH_M = 0.5  # m; of a wedge where no contact tells how large the robot is
HEIGHT_RATIO = 0.2  # of the wedge's length
OUTLINE = ((0.6, 0.0), (-0.4, 0.3), (-0.4, -0.3))  # from above, forward along x, of length 1
TRIANGLES = ((0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5))


def base_marker(run: Run, reason: str) -> Bodies:
    """Return a wedge on the ground, as long as the run's contacts lie apart.

    Args:
        run: The run.
        reason: Why its robot cannot be had.
    """
    drive = run.robot.drive
    points = np.array(run.ground.points).reshape(-1, 2)
    length = float(np.ptp(points, axis=0).max(initial=0.0)) or DEFAULT_LENGTH_M
    cos, sin = np.cos(drive.heading), np.sin(drive.heading)
    outline = np.array(OUTLINE) @ np.array([[cos, sin], [-sin, cos]])
    centre = points.mean(axis=0) if len(points) else np.zeros(2)
    heights = np.repeat([drive.ground, drive.ground + HEIGHT_RATIO * length], 3)
    corners = np.column_stack([np.tile(centre + length * outline, (2, 1)), heights])
    surface = shade(corners, np.array(TRIANGLES))
    part = BodyPart(ROOT_JOINT, np.eye(4), 0, RGBA)
    note = f"the robot cannot be drawn, and a wedge stands for its base: {reason}"
    return Bodies((part,), (surface,), (note,), size=length)


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
