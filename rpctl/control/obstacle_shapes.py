"""Obstacles on the floor as shapes among which a robot's links move."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np

from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.robot.collision import (
    CollisionModel,
    CollisionShape,
    arm_joints,
    collision_model,
    standing,
)
from rpctl.robot.model import Robot

HEIGHT_M = 1e3  # m: of an obstacle without end


def links_among(
    robot: Robot, base: Sequence[Disc | HalfPlane], tip: Sequence[Disc | HalfPlane]
) -> CollisionModel:
    """Return the shapes of a robot, the ground, and obstacles, in this order.

    What the base avoids no link may touch; what the end effector avoids no link of the arm may.

    Args:
        tip: Obstacles of the end effector; they come after the base's.
    """
    model = collision_model(robot)
    links, moved = model.shapes[:-1], arm_joints(robot)  # the last is the ground
    everything = list(range(len(links)))
    arm = [k for k in everything if links[k].joint in moved]
    against = [*([everything] * len(base)), *([arm] * len(tip))]
    return model.with_obstacles([_standing(each, robot) for each in (*base, *tip)], against)


def _standing(obstacle: Disc | HalfPlane, robot: Robot) -> CollisionShape:
    """Return an obstacle as a shape that stands in the world."""
    pose = np.eye(4)
    if isinstance(obstacle, Disc):
        pose[:3, 3] = obstacle.x, obstacle.y, robot.drive.ground
        return standing("disc", pose, coal.Cylinder(obstacle.radius, HEIGHT_M))
    normal = np.append(obstacle.normal, 0.0)
    pose[:3, 3] = obstacle.offset * normal
    return standing("half-plane", pose, coal.Halfspace(normal, 0.0))
