"""The basis S(q): every admissible velocity is v = S(q) ν, with A S = 0."""

from __future__ import annotations

import math

import numpy as np

from rpctl.description.records import Array
from rpctl.errors import SingularBasisError
from rpctl.robot.model import BASE_NV, Robot

RANK_MARGIN = 1e-9  # of the largest singular value: below it a direction of v is undetermined


def selection(robot: Robot) -> Array:
    """Return W (dof, nv), constant: ν = W v picks the quasi-velocities out of a velocity.

    For a drive with a fixed axle the first two rows are the forward speed of P and the turning
    rate, for a holonomic one the first three are the base's speeds; the others pick the arm's.
    """
    W = np.zeros((robot.dof, robot.nv))
    base = len(robot.drive.base_speeds)
    if robot.drive.has_axle:
        W[:2, :BASE_NV] = point_velocity(robot)[[0, 2]]
    elif base:
        W[:base, :BASE_NV] = np.eye(BASE_NV)
    for row, joint in enumerate(robot.joints, start=base):
        W[row, robot.velocity_index(joint.name)] = 1.0
    return W


def point_velocity(robot: Robot) -> Array:
    """Return the map (3, 3) from the root link's velocity in its own axes to the twist of P.

    The twist is P's speed along the heading and to its left (m/s), and the turning rate.
    """
    px, py = robot.drive.point
    cos, sin = math.cos(robot.drive.heading), math.sin(robot.drive.heading)
    return np.array([[cos, sin, sin * px - cos * py], [-sin, cos, cos * px + sin * py], [0, 0, 1]])


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
