"""A force from outside on a link, and what the ground does to a robot that is pushed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.many_states import Reactions
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import UnknownNameError
from rpctl.robot.coordinates import ROOT_JOINT


class Push(NamedTuple):
    """A force on a link, as the robot's coordinates feel it at one configuration."""

    force: Array  # (nv,) generalised: Jᵀ f
    wrench: Array  # (6,) force (N), moment (N·m) about the root link's origin, root link's axes


def push_at(dynamics: ReducedDynamics, q: Array, link: str, force: Array, moment: Array) -> Push:
    """Return a push on a link.

    Args:
        dynamics: The reduced dynamics.
        q: Configuration (nq,).
        link: The link.
        force: At the origin of its frame (3,), world axes, N.
        moment: (3,), world axes, N·m.

    Raises:
        UnknownNameError: The link is not known.
    """
    model, data = dynamics.robot.model, dynamics.data
    if not model.existBodyName(link):
        raise UnknownNameError("link", link, dynamics.robot.description.link)
    frame = model.getFrameId(link, pin.FrameType.BODY)
    axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = pin.computeFrameJacobian(model, data, q, frame, axes)
    pin.updateFramePlacements(model, data)
    root = data.oMi[ROOT_JOINT]
    lever = data.oMf[frame].translation - root.translation
    turned = root.rotation.T @ np.column_stack([force, moment + np.cross(lever, force)])
    return Push(J.T @ np.concatenate([force, moment]), turned.T.ravel())


def pushed_efforts(
    dynamics: ReducedDynamics, q: Array, nu: Array, nu_dot: Array, push: Push
) -> Array:
    """Return the efforts τ (n_act,), N·m or N, with which a pushed robot moves as it is told.

    Args:
        dynamics: The reduced dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        nu_dot: Their derivatives (dof,).
        push: The push.

    Raises:
        ActuationError: Nothing drives one of the quasi-velocities.
    """
    needed = dynamics.inverse(q, nu, nu_dot) - dynamics.basis(q).T @ push.force
    return dynamics.efforts(q, needed)


def pushed_reaction(
    dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array, push: Push
) -> Reactions:
    """Return what the ground does to a robot that moves under τ and is pushed, as of one state.

    It is :meth:`ReducedDynamics.reaction` with the push: the ground gives what the motion takes
    and the push does not.

    Args:
        dynamics: The reduced dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,), N·m or N.
        push: The push.
    """
    at, model, data = dynamics.at(q), dynamics.robot.model, dynamics.data
    M = dynamics.inertia(q)
    unpushed = M @ dynamics.forward(q, nu, tau)
    nu_dot = np.linalg.solve(M, unpushed + at.S.T @ push.force)
    force = pin.rnea(model, data, q, at.S @ nu, at.S @ nu_dot + at.drift(nu))
    wrench = data.f[ROOT_JOINT].vector - push.wrench
    residual = force - at.projector.columns @ tau - push.force
    if dynamics.robot.losses is not None:
        residual -= dynamics.robot.losses.force(at.S @ nu)
    energy = np.array([dynamics.energy(q, nu)])
    return Reactions(residual[None], wrench[None], energy)
