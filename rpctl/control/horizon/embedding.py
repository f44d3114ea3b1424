"""A linearised QP from another initial state than the motion's it was linearised about.

The difference of the initial states runs on along the linearised prediction. What is left to the
accelerations are deviations from there: the QP keeps its Hessian and its rows, and gets other
values ([DBS05], initial value embedding).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.cost import wrap_angles
from rpctl.control.horizon.prediction import PoseJacobian
from rpctl.control.horizon.qp import Linearisation, StageValues
from rpctl.control.horizon.structure import CondensedStructure


class StateDifference(NamedTuple):
    """Initial state less that of the motion that a QP is linearised about."""

    pose: Array  # (3,) m, m, rad
    joints: Array  # (n_joints,)
    nu: Array  # (dof,)


def from_another_start(
    structure: CondensedStructure, values: Linearisation, start: StateDifference
) -> Linearisation:
    """Return the QP for deviations from what a difference of the initial states leads to.

    Args:
        structure: Of the robot's QPs.
        values: The QP about its motion.
        start: The difference.
    """
    free = _free_response(structure, values.jacobian, start)
    hessian, base = structure.hessian, structure.model.base
    g_joints = values.gradient.joints + hessian.joints * free.joints
    g_nu = values.gradient.nu + hessian.nu * free.nu
    g_joints[-1] += structure.cross * free.nu[-1, base:]
    g_nu[-1, base:] += structure.cross * free.joints[-1]
    gradient = StageValues(
        values.gradient.nu_dot, values.gradient.pose + hessian.pose * free.pose, g_joints, g_nu
    )
    x = np.hstack(free).ravel()
    costs = zip(structure.extra_unknowns, values.extra_cost, strict=True)
    rows = zip(structure.soft, values.soft, strict=True)
    return Linearisation(
        values.jacobian,
        gradient,
        [cost._replace(residual=cost.residual + cost.jacobian @ x[at]) for at, cost in costs],
        [
            soft._replace(value=soft.value + (soft.jacobian @ x[block.unknowns, None])[..., 0])
            for block, soft in rows
        ],
        StageValues(*(bound - part for bound, part in zip(values.lower, free, strict=True))),
        StageValues(*(bound - part for bound, part in zip(values.upper, free, strict=True))),
    )


def _free_response(
    structure: CondensedStructure, jacobian: PoseJacobian, start: StateDifference
) -> StageValues:
    """Return the deviations that an initial difference leads to under the same accelerations."""
    model, n = structure.model, structure.model.steps
    nu, rates = np.tile(start.nu, (n, 1)), start.nu[model.base :]
    joints = start.joints + model.dt * np.outer(np.arange(n + 1), rates)
    pose = np.empty((n, 0))
    if model.base:
        angles = joints[:-1, : model.steered, None]
        turned = jacobian.nu @ start.nu[: model.base_columns]
        turned += (jacobian.steering @ angles)[:, :, 0]
        first = np.append(start.pose[:2], wrap_angles(start.pose[2:]))
        heading = first[2] + np.concatenate([[0.0], np.cumsum(turned[:, 2])])
        moved = turned[:, :2] + jacobian.heading * heading[:-1, None]
        pose = np.column_stack([first[:2] + np.cumsum(moved, axis=0), heading[1:]])
    return StageValues(np.zeros_like(nu), pose, joints[1:], nu)
