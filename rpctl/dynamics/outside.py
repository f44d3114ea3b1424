"""Forces from outside that act on links: somebody pushes or pulls the robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.reduced import OutsideForce, ReducedDynamics
from rpctl.robot.coordinates import ROOT_JOINT


class LinkWrench(Protocol):
    """A force (N) and a moment (N·m) on a link, along the world's axes, at its frame's origin."""

    @property
    def link(self) -> str:
        """Name of the link."""

    @property
    def force(self) -> tuple[float, float, float]:
        """Force (3,), N."""

    @property
    def moment(self) -> tuple[float, float, float]:
        """Moment (3,), N·m."""


def quasi_force(dynamics: ReducedDynamics, q: Array, wrenches: Sequence[LinkWrench]) -> Array:
    """Return the quasi-force Σ Jᵀ (f, n) (dof,) of forces from outside.

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        wrenches: The forces.

    Raises:
        UnknownNameError: One is on no link.
    """
    found = np.zeros(dynamics.robot.dof)
    for each in wrenches:
        found += dynamics.jacobian(q, each.link).T @ np.array([*each.force, *each.moment])
    return found


def outside_at(dynamics: ReducedDynamics, q: Array, wrenches: Sequence[LinkWrench]) -> OutsideForce:
    """Return what forces from outside do to the tree.

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        wrenches: The forces.

    Raises:
        UnknownNameError: One is on no link.
    """
    robot = dynamics.robot
    push, total = np.zeros(robot.nv), np.zeros(6)
    for each in wrenches:
        force, moment = np.array(each.force), np.array(each.moment)
        push += dynamics.tree_jacobian(q, each.link).T @ np.concatenate([force, moment])
        data = dynamics.placements(q)
        frame = robot.model.frames[robot.model.getFrameId(each.link, pin.FrameType.BODY)]
        root = data.oMi[ROOT_JOINT]
        arm = data.oMi[frame.parentJoint].act(frame.placement.translation) - root.translation
        total[:3] += root.rotation.T @ force
        total[3:] += root.rotation.T @ (moment + np.cross(arm, force))
    return OutsideForce(push, total)
