"""The length of a robot, by which its references are scaled."""

from __future__ import annotations

import math

import numpy as np

from rpctl.robot.model import Robot

BASE_FACTOR = 4.0 / 3.0  # the robot of [MS21], half a track of 0.75 m, counts as 1 m long
SMALLEST_LENGTH = 1e-3  # m: no robot is shorter


def robot_length(robot: Robot) -> float:
    """Return the length (m) of a robot: 4/3 of its base's radius, or its arm if that is longer.

    The base's radius is the distance from P to its farthest wheel contact, or the largest wheel's
    radius; the arm's length that of its links in a line. Rounded to one digit, so that the sizes
    of references are easy to read.
    """
    length = max(BASE_FACTOR * _base_radius(robot), _arm_length(robot))
    return float(f"{max(length, SMALLEST_LENGTH):.1g}") if length else 1.0


def _base_radius(robot: Robot) -> float:
    drive, radii = robot.drive, [0.0]
    for wheel in drive.wheels:
        pose = robot.tree.pose(robot.description.joint[wheel.joint].child)
        centre = pose[:3, 3] + wheel.offset * pose[:3, :3] @ wheel.axis
        radii += [math.dist(centre[:2], drive.point), wheel.radius]
    return max(radii)


def _arm_length(robot: Robot) -> float:
    """Return the sum of the distances between the joints up to the end effector, m."""
    if robot.end_effector is None:
        return 0.0
    chain = robot.description.chain(robot.end_effector)
    names = set(robot.joint_names)
    first = next((i for i, joint in enumerate(chain) if joint.name in names), len(chain))
    return float(sum(np.linalg.norm(joint.origin[:3, 3]) for joint in chain[first + 1 :]))
