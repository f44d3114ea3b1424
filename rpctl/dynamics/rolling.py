"""The Pfaffian constraint A(q) v = 0: wheels that roll without slipping, joints that follow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.drive import Swivel, Wheel
from rpctl.robot.model import BASE_NV, Robot

ROOT_JOINT = 1  # Pinocchio's index of the planar root
UP = np.array([0.0, 0.0, 1.0])
RIGHT_ANGLE = 0.5 * math.pi


@dataclass(frozen=True)
class TurningRow:
    """A row whose direction turns with a swivel.

    With p the swivel's pivot, φ its angle, d the direction and ρ the contact seen from p, the
    contact's velocity along d is d·(v + ω ẑ × p) + k (ω + φ̇), with k = d·(ẑ × ρ) constant.
    """

    row: int
    swivel: Swivel
    index: int  # of the swivel in v
    angle: float  # of d at position 0, in the root link's frame, rad
    lever: float  # k, m


@dataclass(frozen=True)
class FollowerRow:
    """The row that keeps three lateral rows l (3,) dependent: d/dt det(l₁, l₂, l₃) = 0."""

    row: int
    swivels: tuple[Swivel | None, ...]  # None: the fixed axle
    indices: tuple[int, ...]  # of the swivels in v


@dataclass(frozen=True)
class RollingConstraints:
    """The rows of A, and which are whose.

    A wheel has one row, along :attr:`Wheel.direction`. That P does not move sideways is one row
    for all fixed wheels, as files round the angles and places of wheels, and two axles a hair
    apart would let the base move nowhere. A swivel has one lateral row for all its wheels; one
    that follows has a row that keeps its axle on the common centre. Mimic joints have one row
    each, a fixed base has three.

    Attributes:
        constant: What no motion changes of A (rows, nv).
        turning: Rows that turn with a swivel.
        followers: Rows of swivels that follow.
        along: Row of each wheel.
        across: Row of each lateral force, and the wheels (indices) that share it.
    """

    constant: Array
    turning: tuple[TurningRow, ...]
    followers: tuple[FollowerRow, ...]
    along: tuple[int, ...]
    across: tuple[tuple[int, tuple[int, ...]], ...]


def find_rolling(robot: Robot) -> RollingConstraints:
    """Return the rolling constraints of a robot."""
    drive = robot.drive
    rows = [_mimic_rows(robot)]
    if drive.type == "fixed":
        rows.append(np.eye(BASE_NV, robot.nv))
    first = sum(map(len, rows))
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, pin.neutral(robot.model))
    swivels = {swivel.joint: swivel for swivel in drive.swivels}
    turning = []
    for row, wheel in enumerate(drive.wheels, start=first):
        rows.append(_wheel_row(robot, data, wheel)[None])
        if wheel.swivel is not None:
            swivel = swivels[wheel.swivel]
            index = robot.velocity_index(swivel.joint)
            turning.append(TurningRow(row, swivel, index, swivel.heading, -wheel.lateral))
    along = tuple(range(first, first + len(drive.wheels)))
    row = first + len(drive.wheels)
    across: dict[int, list[int]] = {}
    if drive.has_axle:
        rows.append(_axle_row(robot))
        held = (i for i, wheel in enumerate(drive.wheels) if wheel.swivel is None)
        across[row] = [i for i in held if not drive.wheels[i].slides]
        row += 1
    lateral: dict[str, int] = {}
    followers = []
    for swivel in drive.swivels:
        index, carried = robot.velocity_index(swivel.joint), list(drive.carried(swivel))
        if swivel.shares is not None:
            lateral[swivel.joint] = lateral[swivel.shares]
            across[lateral[swivel.shares]] += carried
        else:
            lateral[swivel.joint] = row
            rows.append(np.zeros((1, robot.nv)))
            row += 1
        if swivel.role == "follower":
            followers.append(_follower_row(robot, swivel, lateral[swivel.joint]))
            nearest = min(drive.steered, key=lambda s: math.dist(s.pivot, swivel.pivot))
            across[lateral[nearest.joint]] += carried
            continue
        across.setdefault(lateral[swivel.joint], []).extend(carried)
        angle = swivel.heading + RIGHT_ANGLE
        turning.append(TurningRow(lateral[swivel.joint], swivel, index, angle, swivel.trail))
    constant = np.vstack(rows)
    for part in turning:
        constant[part.row, 2] += part.lever
        constant[part.row, part.index] += part.swivel.sign * part.lever
    constant.setflags(write=False)
    shared = tuple((row, tuple(wheels)) for row, wheels in across.items())
    return RollingConstraints(constant, tuple(turning), tuple(followers), along, shared)


def constraint(robot: Robot, rolling: RollingConstraints, q: Array) -> Array:
    """Return the constraint matrix A(q) (rows, nv); m/s per unit of v for wheels.

    These are [MS21, Eq. 1-5]'s rolling conditions for any wheel: its material contact point stands
    still along the row's direction.
    """
    A = rolling.constant.copy()
    for part in rolling.turning:
        cos, sin = _direction(robot, part, q)
        x, y = part.swivel.pivot
        A[part.row, 0] += cos
        A[part.row, 1] += sin
        A[part.row, 2] += sin * x - cos * y
    for follower in rolling.followers:
        rows, derivatives = _lateral_rows(robot, follower, q)
        for i, (index, derivative) in enumerate(zip(follower.indices, derivatives, strict=True)):
            if index >= 0:
                A[follower.row, index] += _determinant(rows, {i: derivative})
    return A


def constraint_drift(robot: Robot, rolling: RollingConstraints, q: Array, v: Array) -> Array:
    """Return Ȧ v (rows,): what A v̇ must cancel; same order as :func:`constraint`.

    Args:
        robot: The robot.
        rolling: Its constraints.
        q: Configuration (nq,).
        v: Velocity (nv,).
    """
    drift = np.zeros(len(rolling.constant))
    vx, vy, omega = v[:BASE_NV]
    for part in rolling.turning:
        cos, sin = _direction(robot, part, q)
        x, y = part.swivel.pivot
        rate = part.swivel.sign * v[part.index]
        drift[part.row] += rate * (cos * (vy + omega * x) - sin * (vx - omega * y))
    for follower in rolling.followers:
        rows, derivatives = _lateral_rows(robot, follower, q)
        rates = [v[index] if index >= 0 else 0.0 for index in follower.indices]
        for i, rate in enumerate(rates):
            drift[follower.row] -= _determinant(rows, {}) * rate**2  # l″ = −l
            for j in range(i):
                mixed = _determinant(rows, {i: derivatives[i], j: derivatives[j]})
                drift[follower.row] += 2.0 * mixed * rate * rates[j]
    return drift


def contact_point(robot: Robot, data: pin.Data, wheel: Wheel) -> Array:
    """Return a wheel's lowest point (3,), world; ``data`` holds the joints' placements."""
    placement = data.oMi[robot.model.getJointId(wheel.joint)]
    return placement.act(wheel.offset * np.array(wheel.axis)) - wheel.radius * UP


def _direction(robot: Robot, part: TurningRow, q: Array) -> tuple[float, float]:
    angle = part.angle + part.swivel.sign * robot.joint_position(q, part.swivel.joint)
    return math.cos(angle), math.sin(angle)


def _lateral_rows(robot: Robot, follower: FollowerRow, q: Array) -> tuple[list[Array], list[Array]]:
    """Return three lateral rows l (3,), and their derivatives by the swivels' positions."""
    rows, derivatives = [], []
    for swivel in follower.swivels:
        angle, sign, (x, y) = robot.drive.heading, 0.0, robot.drive.point
        if swivel is not None:
            position = robot.joint_position(q, swivel.joint)
            angle, sign, (x, y) = swivel.heading + swivel.sign * position, swivel.sign, swivel.pivot
        cos, sin = math.cos(angle), math.sin(angle)
        rows.append(np.array([-sin, cos, cos * x + sin * y]))
        derivatives.append(-sign * np.array([cos, sin, sin * x - cos * y]))
    return rows, derivatives


def _determinant(rows: list[Array], replaced: dict[int, Array]) -> float:
    a, b, c = (replaced.get(i, row) for i, row in enumerate(rows))
    return float(
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


def _follower_row(robot: Robot, swivel: Swivel, row: int) -> FollowerRow:
    """Return the constraint of a follower to the two lateral rows that fix the centre."""
    fixed = (None,) if robot.drive.has_axle else ()
    swivels = (*fixed, *robot.drive.steered, swivel)
    indices = (-1 if one is None else robot.velocity_index(one.joint) for one in swivels)
    return FollowerRow(row, swivels, tuple(indices))


def _wheel_row(robot: Robot, data: pin.Data, wheel: Wheel) -> Array:
    """Return what is constant of a wheel's row (nv,).

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


def _axle_row(robot: Robot) -> Array:
    """Return the row (1, nv) of P's speed to the left."""
    drive = robot.drive
    left = np.array([-math.sin(drive.heading), math.cos(drive.heading)])
    row = np.zeros((1, robot.nv))
    row[0, :BASE_NV] = *left, left @ [-drive.point[1], drive.point[0]]
    return row


def _mimic_rows(robot: Robot) -> Array:
    """Return one row a mimic joint: its rate less the multiplier times the followed one's."""
    rows = np.zeros((len(robot.mimics), robot.nv))
    for row, joint in zip(rows, robot.mimics, strict=True):
        row[robot.velocity_index(joint.name)] = 1.0
        if joint.mimic is not None and joint.mimic.joint not in robot.locked:
            row[robot.velocity_index(joint.mimic.joint)] -= joint.mimic.multiplier
    return rows
