"""The Pfaffian constraint A(q) v = 0 of wheels that roll and joints that follow; its basis S(q).

Every admissible velocity is v = S(q) ν, with A S = 0.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.drive.rows import TurningMatrix, drive_rows
from rpctl.errors import SingularBasisError
from rpctl.robot.model import BASE_NV, Robot

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class RollingConstraints:
    """The rows of A, and which are whose.

    Mimic joints have one row each, a fixed base has three. Those of
    :class:`rpctl.drive.rows.DriveRows` follow; a wheel's is along :attr:`Wheel.direction`.

    Attributes:
        matrix: A (rows, nv) by the swivels' positions.
        along: Row of each wheel.
        across: Row of each lateral force, and the wheels (indices) that share it.
        gliding: Rows of swivels that glide, and of their wheels.
        index: Each swivel's index in v.
        entry: Each swivel's index in q.
        pairs: Which of the swivels are a pair (cos, sin) in q.
        cosines_sines: Where in q (2, n_pairs) those are.
    """

    matrix: TurningMatrix
    along: tuple[int, ...]
    across: tuple[tuple[int, tuple[int, ...]], ...]
    gliding: tuple[int, ...]
    index: NDArray[np.intp]
    entry: NDArray[np.intp]
    pairs: NDArray[np.intp]
    cosines_sines: NDArray[np.intp]

    def turn(self, q: Array) -> Array:
        """Return the cosines and sines of which A is linear (..., 2m), at q (..., nq)."""
        positions = q.take(self.entry, -1)
        if self.pairs.size:
            cosines, sines = (q.take(place, -1) for place in self.cosines_sines)
            positions[..., self.pairs] = np.arctan2(sines, cosines)
        return self.matrix.turn(positions)

    def drift(self, u: Array, v: Array) -> Array:
        """Return Ȧ v (rows,) at such cosines and sines, and v (nv,): what A v̇ must cancel."""
        drift: Array = self.matrix.rate(u, v.take(self.index)).dot(v)
        return drift


def find_rolling(robot: Robot, gliding: Collection[str] = ()) -> RollingConstraints:
    """Return the rolling constraints of a robot, some of whose swivels (joints) may glide.

    The ground does nothing to those: they keep their angle, and their wheels do not roll.
    """
    robot.require_level()
    drive, model = robot.drive, robot.model
    rows = drive_rows(drive, gliding)
    names = [swivel.joint for swivel in drive.swivels]
    index = np.array([robot.velocity_index(name) for name in names], dtype=np.intp)
    above = [mimic_rows(robot), np.eye(BASE_NV if drive.type == "fixed" else 0, robot.nv)]
    first = sum(map(len, above))

    def whole(part: Array) -> Array:
        """Return rows (..., rows, 3 + n_swivels) of the drive as rows of A."""
        found = np.zeros((*part.shape[:-2], first + part.shape[-2], robot.nv))
        found[..., first:, :BASE_NV] = part[..., :BASE_NV]
        found[..., first:, index] = part[..., BASE_NV:]
        return found

    matrix = rows.matrix.map(whole)
    constant = matrix.constant.copy()
    constant[:first] = np.vstack(above)
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for row, wheel in enumerate(drive.wheels, start=first):
        constant[row] += _wheel_row(robot, data, wheel)
    entry = np.array([robot.entries[name].index for name in names], dtype=np.intp)
    pairs = np.flatnonzero([robot.entries[name].is_pair for name in names])
    return RollingConstraints(
        matrix=replace(matrix, constant=constant),
        along=tuple(range(first, first + len(drive.wheels))),
        across=tuple((first + row, wheels) for row, wheels in rows.across),
        gliding=tuple(first + row for row in rows.gliding),
        index=index,
        entry=entry,
        pairs=pairs,
        cosines_sines=np.array([entry[pairs], entry[pairs] + 1]),
    )


def constraint(rolling: RollingConstraints, q: Array) -> Array:
    """Return the constraint matrix A(q) (..., rows, nv) at q (..., nq), m/s per unit of v.

    These are [MS21, Eq. 1-5]'s rolling conditions for any wheel: its material contact point stands
    still along the row's direction.
    """
    return rolling.matrix.at(rolling.turn(q))


def contact_point(robot: Robot, data: pin.Data, wheel: Wheel) -> Array:
    """Return a wheel's lowest point (3,) in the world frame, m.

    Args:
        robot: The robot.
        data: Pinocchio's workspace, which holds the joints' placements.
        wheel: The wheel.
    """
    placement = data.oMi[robot.model.getJointId(wheel.joint)]
    return placement.act(wheel.offset * np.array(wheel.axis)) - wheel.radius * UP


def _wheel_row(robot: Robot, data: pin.Data, wheel: Wheel) -> Array:
    """Return a wheel's row (nv,); of one that swivels, the part of its own rate.

    ``data`` holds the joints' placements and Jacobians at the neutral configuration.
    """
    model = robot.model
    joint = model.getJointId(wheel.joint)
    row, direction = np.zeros(robot.nv), np.array([*wheel.direction, 0.0])
    axle = data.oMi[joint].rotation @ np.array(wheel.axis)
    if wheel.swivel is not None:
        forward = direction @ np.cross(axle, UP)
        row[robot.velocity_index(wheel.joint)] = -math.copysign(wheel.radius, forward)
        return row
    J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)  # (6, nv)
    contact = wheel.offset * axle - wheel.radius * UP  # seen from the joint's origin
    row = direction @ (J[:3] + np.cross(J[3:], contact, axisa=0, axisc=0))
    left = np.array([-math.sin(robot.drive.heading), math.cos(robot.drive.heading), 0.0])
    row[2] += direction @ np.cross(UP, wheel.shift * left)
    return np.asarray(row)


def mimic_rows(robot: Robot) -> Array:
    """Return one row a mimic joint: its rate less the multiplier times the followed one's."""
    rows = np.zeros((len(robot.mimics), robot.nv))
    for row, joint in zip(rows, robot.mimics, strict=True):
        row[robot.velocity_index(joint.name)] = 1.0
        if joint.mimic is not None and joint.mimic.joint not in robot.locked:
            row[robot.velocity_index(joint.mimic.joint)] -= joint.mimic.multiplier
    return rows


RANK_MARGIN = 1e-9  # of the largest singular value: below it a direction of v is undetermined
UNDETERMINED = "the wheels and quasi-velocities do not determine the motion"


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
    inverse = square_inverse(left) if left.shape[0] == left.shape[1] else _pseudoinverse(left)
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
