"""Forces from outside that act on links, and what the ground does to a robot that is pushed."""

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
    """Return the quasi-force Σ Jᵀ (f, n) (dof,) of forces from outside at q (nq,).

    Raises:
        UnknownNameError: One is on no link.
    """
    total = np.zeros(dynamics.robot.dof)
    for each in wrenches:
        total += dynamics.jacobian(q, each.link).T @ np.array([*each.force, *each.moment])
    return total


def outside_at(dynamics: ReducedDynamics, q: Array, wrenches: Sequence[LinkWrench]) -> OutsideForce:
    """Return what forces from outside do to the tree at q (nq,).

    Raises:
        UnknownNameError: One is on no link.
    """
    push, wrench = np.zeros(dynamics.robot.nv), np.zeros(6)
    for each in wrenches:
        one = push_at(dynamics, q, each.link, np.array(each.force), np.array(each.moment))
        push += one.push
        wrench += one.wrench
    return OutsideForce(push, wrench)


def push_at(
    dynamics: ReducedDynamics, q: Array, link: str, force: Array, moment: Array
) -> OutsideForce:
    """Return what a force (3,), N, at the origin of a link's frame and a moment (3,), N·m, do.

    Both are along the world's axes.

    Raises:
        UnknownNameError: The link is not known.
    """
    model = dynamics.robot.model
    push = dynamics.tree_jacobian(q, link).T @ np.concatenate([force, moment])
    data = dynamics.placements(q)
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    root = data.oMi[ROOT_JOINT]
    arm = data.oMi[frame.parentJoint].act(frame.placement.translation) - root.translation
    wrench = root.rotation.T @ np.column_stack([force, moment + np.cross(arm, force)])
    return OutsideForce(push, wrench.T.ravel())


def pushed_efforts(
    dynamics: ReducedDynamics, q: Array, nu: Array, nu_dot: Array, push: OutsideForce
) -> Array:
    """Return the efforts τ (n_act,), N·m or N, with which a pushed robot moves as it is told.

    Raises:
        ActuationError: Nothing drives one of the quasi-velocities.
    """
    needed = dynamics.inverse(q, nu, nu_dot) - dynamics.basis(q).T @ push.push
    return dynamics.efforts(q, needed)
