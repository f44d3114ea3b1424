"""The basis S(q): every admissible velocity is v = S(q) ν, with A S = 0."""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from rpctl.description.records import Array
from rpctl.dynamics.rolling import Rolling
from rpctl.errors import SingularBasisError
from rpctl.robot.model import BASE_NV, Robot

RANK_MARGIN = 1e-9  # of the largest singular value: below it a direction of v is undetermined


def selection(robot: Robot, rolling: Rolling) -> Array:
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
            W[0, index] = -rolling.constant[rolling.along[wheel], index] / len(wheels)
    else:
        W[:own, :BASE_NV] = np.eye(own, BASE_NV)
    joints = [swivel.joint for swivel in drive.steered] + [joint.name for joint in robot.joints]
    for row, name in enumerate(joints, start=own):
        W[row, robot.velocity_index(name)] = 1.0
    return W


def basis(A: Array, W: Array) -> Array:
    """Return S (nv, dof) with A S = 0 and W S = I.

    Args:
        A: Constraint matrix (rows, nv); redundant rows are welcome.
        W: Selection of the quasi-velocities (dof, nv).

    Raises:
        SingularBasisError: A and W together leave a direction of v free, or contradict.
    """
    return _solve(A, W, np.vstack([np.zeros((len(A), len(W))), np.eye(len(W))]))


def basis_drift(A: Array, W: Array, drift: Array) -> Array:
    """Return Ṡ ν (nv,) from [A; W] Ṡν = −[Ȧ; 0] v; ``drift`` is Ȧ v (rows,)."""
    return _solve(A, W, np.concatenate([-drift, np.zeros(len(W))]))


def _solve(A: Array, W: Array, right: Array) -> Array:
    """Solve the consistent system [A; W] X = right."""
    left = np.vstack([A, W])
    if left.shape[0] == left.shape[1]:
        return _solve_square(left, right)
    solution, _, rank, singular = np.linalg.lstsq(left, right, rcond=RANK_MARGIN)
    if rank < left.shape[1]:
        raise SingularBasisError(
            f"the constraints and quasi-velocities determine {rank} of {left.shape[1]} velocities; "
            "the wheels leave a motion of the base free"
        )
    # A second pass on what is left brings the solve's 1e-13 to rounding.
    solution += np.linalg.lstsq(left, right - left @ solution, rcond=RANK_MARGIN)[0]
    scale = singular[0] * max(1.0, float(np.abs(solution).max()))
    if np.abs(left @ solution - right).max() > RANK_MARGIN * scale:
        raise SingularBasisError(
            "the rolling constraints contradict each other: no motion has the quasi-velocities "
            "asked for; are the wheels' axles on one line?"
        )
    return np.asarray(solution)


def _solve_square(left: Array, right: Array) -> Array:
    """Solve as many equations as there are velocities, which they determine or do not."""
    factor, pivots, _ = dgetrf(left)
    condition, _ = dgecon(factor, np.abs(left).sum(axis=0).max())
    if not condition > RANK_MARGIN:
        raise SingularBasisError("the wheels and quasi-velocities determine no one motion")
    return np.asarray(dgetrs(factor, pivots, right)[0])
