"""The basis S(q): every admissible velocity is v = S(q) ν, with A S = 0."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.rolling import RollingConstraints
from rpctl.errors import SingularBasisError
from rpctl.robot.model import BASE_NV, Robot

RANK_MARGIN = 1e-9  # of the largest singular value: below it a direction of v is undetermined
UNDETERMINED = "the wheels and quasi-velocities determine no one motion"


def selection(robot: Robot, rolling: RollingConstraints) -> Array:
    """Return W (dof, nv), constant: ν = W v picks the quasi-velocities out of a velocity.

    The base's own speeds come first: with a fixed axle the forward speed of P and, unless a wheel
    is steered, the turning rate; of a holonomic base all three; with steered wheels only, the
    rolling speed of the first. The steered joints' rates and the arm's follow.
    """
    W = np.zeros((robot.dof, robot.nv))
    drive = robot.drive
    own = len(drive.base_speeds) - len(drive.steered)
    if drive.has_axle:
        W[:own, :BASE_NV] = robot.point_velocity[[0, 2][:own]]
    elif drive.steered:
        wheels = drive.carried(drive.steered[0])
        for wheel in wheels:
            index = robot.velocity_index(drive.wheels[wheel].joint)
            W[0, index] = -rolling.matrix.constant[rolling.along[wheel], index] / len(wheels)
    else:
        W[:own, :BASE_NV] = np.eye(own, BASE_NV)
    joints = [*(swivel.joint for swivel in drive.steered), *robot.joint_names]
    for row, name in enumerate(joints, start=own):
        W[row, robot.velocity_index(name)] = 1.0
    return W


def basis(A: Array, W: Array) -> Array:
    """Return S (nv, dof) with A S = 0 and W S = I, from [A; W] S = [0; I].

    Args:
        A: Constraint matrix (rows, nv); redundant rows are welcome.
        W: Selection of the quasi-velocities (dof, nv).

    Raises:
        SingularBasisError: A and W together leave a direction of v free, or contradict.
    """
    left, rows = np.vstack([A, W]), len(A)
    square = left.shape[0] == left.shape[1]
    inverse = square_inverse(left) if square else _pseudoinverse(left)
    wanted = np.vstack([np.zeros((rows, len(W))), np.eye(len(W))])
    S = inverse[:, rows:]
    S = S + inverse @ (wanted - left @ S)  # brings 1e-13 to rounding
    if np.abs(left @ S - wanted).max() > RANK_MARGIN:  # of what is wanted, zeros and ones
        raise SingularBasisError(
            "the rolling constraints contradict each other: no motion has the quasi-velocities "
            "asked for; are the wheels' axles on one line?"
        )
    return S


def square_inverse(left: Array) -> Array:
    """Return the inverse of as many equations as there are velocities."""
    try:
        inverse = np.linalg.inv(left)
    except np.linalg.LinAlgError:
        inverse = np.full(left.shape, np.inf)
    condition = np.abs(left).sum(axis=0).max() * np.abs(inverse).sum(axis=0).max()
    if not condition * RANK_MARGIN < 1.0:
        raise SingularBasisError(UNDETERMINED)
    return np.asarray(inverse)


def _pseudoinverse(left: Array) -> Array:
    """Return the pseudoinverse of equations that are redundant, or too few."""
    U, singular, Vt = np.linalg.svd(left, full_matrices=False)
    rank = np.count_nonzero(singular > RANK_MARGIN * singular[0])
    if rank < left.shape[1]:
        raise SingularBasisError(
            f"the constraints and quasi-velocities determine {rank} of {left.shape[1]} velocities; "
            "the wheels leave a motion of the base free"
        )
    return np.asarray((Vt.T / singular) @ U.T)
