"""The Pfaffian constraint A(q) v = 0: wheels that roll without slipping, joints that follow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.description.records import Array
from rpctl.robot.drive import Wheel
from rpctl.robot.model import BASE_NV, Robot

ROOT_JOINT = 1  # Pinocchio's index of the planar root
UP = np.array([0.0, 0.0, 1.0])


def constraint(robot: Robot, data: pin.Data, q: Array) -> Array:
    """Return the constraint matrix A(q), rows possibly redundant.

    A wheel's rows are of the velocity of its material contact point, v_c + ω × (−r ẑ), with c its
    centre and ω its angular velocity ([MS21, Eq. 1-5]'s rolling conditions for any wheel). A wheel
    that the root link carries has one row, along :attr:`Wheel.direction`; that P does not move
    sideways is one more row for all of them, as files round the angles and places of wheels, and
    two axles a hair apart would let the base move nowhere. Any other wheel has two rows, along
    and across its rolling direction. Mimic joints have one row each, a fixed base has three.

    Args:
        robot: The robot.
        data: Pinocchio's workspace; overwritten.
        q: Configuration (nq,).

    Returns:
        A (rows, nv); m/s per unit of v for wheels.
    """
    model = robot.model
    rows = [_mimic_rows(robot)]
    if robot.drive.type == "fixed":
        rows.append(np.eye(BASE_NV, robot.nv))
    if robot.drive.wheels:
        pin.computeJointJacobians(model, data, q)
    for wheel in robot.drive.wheels:
        joint = model.getJointId(wheel.joint)
        J = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)  # (6, nv)
        axle, centre = _axle(data, joint, wheel)
        x, y, z = centre - wheel.radius * UP  # the contact point, seen from the joint's origin
        turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # turn @ ω = ω × (x, y, z)
        contact = J[:3] + turn @ J[3:]
        if carried_by_root(robot, wheel):
            local = data.oMi[ROOT_JOINT].rotation[:2, :2].T @ contact[:2]
            rows.append((np.array(wheel.direction) @ local)[None])
        else:
            rows.append(_directions(axle) @ contact)
    if robot.drive.has_axle:
        rows.append(_axle_row(robot))
    return np.vstack(rows)


def constraint_drift(robot: Robot, data: pin.Data, q: Array, v: Array) -> Array:
    """Return Ȧ v (rows,): what A v̇ must cancel; same order as :func:`constraint`.

    Args:
        robot: The robot.
        data: Pinocchio's workspace; overwritten.
        q: Configuration (nq,).
        v: Velocity (nv,).
    """
    model = robot.model
    drift = [np.zeros(len(robot.mimics))]
    if robot.drive.type == "fixed":
        drift.append(np.zeros(BASE_NV))
    if robot.drive.wheels:
        pin.forwardKinematics(model, data, q, v, np.zeros(robot.nv))
    for wheel in robot.drive.wheels:
        if carried_by_root(robot, wheel):
            drift.append(np.zeros(1))  # in the root's axes nothing of this row moves
            continue
        joint = model.getJointId(wheel.joint)
        axle, centre = _axle(data, joint, wheel)
        down = -wheel.radius * UP
        velocity = pin.getVelocity(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
        acceleration = pin.getClassicalAcceleration(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
        omega, alpha = velocity.angular, acceleration.angular
        # The contact point moves along with the wheel's centre, not with the wheel's material.
        rate = velocity.linear + np.cross(omega, centre) + np.cross(omega, down)
        change = (
            acceleration.linear + np.cross(alpha, centre) + np.cross(omega, np.cross(omega, centre))
        )
        change += np.cross(alpha, down)
        turning = _direction_rates(axle, np.cross(omega, axle))
        drift.append(_directions(axle) @ change + turning @ rate)
    if robot.drive.has_axle:
        drift.append(np.zeros(1))
    return np.concatenate(drift)


def carried_by_root(robot: Robot, wheel: Wheel) -> bool:
    """Return whether a wheel's joint is held by the root link."""
    return bool(robot.model.parents[robot.model.getJointId(wheel.joint)] == ROOT_JOINT)


def _axle_row(robot: Robot) -> Array:
    """Return the row (1, nv) of P's speed to the left."""
    drive = robot.drive
    left = np.array([-math.sin(drive.heading), math.cos(drive.heading)])
    row = np.zeros((1, robot.nv))
    row[0, :BASE_NV] = *left, left @ [-drive.point[1], drive.point[0]]
    return row


@dataclass(frozen=True)
class Layout:
    """Which rows of A are whose.

    Attributes:
        along: Row of each wheel, along its direction.
        across: Row of each lateral force, and the wheels (indices) that share it.
    """

    along: tuple[int, ...]
    across: tuple[tuple[int, tuple[int, ...]], ...]


def layout(robot: Robot) -> Layout:
    """Return which rows of :func:`constraint` are whose."""
    row = len(robot.mimics) + (BASE_NV if robot.drive.type == "fixed" else 0)
    along: list[int] = []
    across: list[tuple[int, tuple[int, ...]]] = []
    shared: list[int] = []
    for index, wheel in enumerate(robot.drive.wheels):
        along.append(row)
        row += 1
        if carried_by_root(robot, wheel):
            shared.append(index)
        else:
            across.append((row, (index,)))
            row += 1
    if robot.drive.has_axle:
        across.append((row, tuple(shared)))
    return Layout(tuple(along), tuple(across))


def contact_point(robot: Robot, data: pin.Data, wheel: Wheel) -> tuple[Array, Array]:
    """Return a wheel's lowest point and its unit axle (3,), world; ``data`` holds its placement."""
    joint = robot.model.getJointId(wheel.joint)
    axle, centre = _axle(data, joint, wheel)
    return data.oMi[joint].translation + centre - wheel.radius * UP, axle


def _mimic_rows(robot: Robot) -> Array:
    """Return one row a mimic joint: its rate less the multiplier times the followed one's."""
    rows = np.zeros((len(robot.mimics), robot.nv))
    for row, joint in zip(rows, robot.mimics, strict=True):
        row[robot.velocity_index(joint.name)] = 1.0
        if joint.mimic is not None and joint.mimic.joint not in robot.locked:
            row[robot.velocity_index(joint.mimic.joint)] -= joint.mimic.multiplier
    return rows


def _axle(data: pin.Data, joint: int, wheel: Wheel) -> tuple[Array, Array]:
    """Return the axle and the wheel centre's offset from the joint's origin, world axes (3,)."""
    axle = data.oMi[joint].rotation @ np.array(wheel.axis)
    return axle, wheel.offset * axle


def _directions(axle: Array) -> Array:
    """Return the rolling direction and the lateral one (2, 3): level, unit, right-handed."""
    x, y = axle[:2] / math.hypot(axle[0], axle[1])
    return np.array([[y, -x, 0.0], [x, y, 0.0]])


def _direction_rates(axle: Array, axle_rate: Array) -> Array:
    """Return the time derivative (2, 3) of the directions, for an axle that turns."""
    lateral = _directions(axle)[1]
    level_rate = np.array([axle_rate[0], axle_rate[1], 0.0]) / np.hypot(axle[0], axle[1])
    lateral_rate = level_rate - (lateral @ level_rate) * lateral
    return np.array([np.cross(lateral_rate, UP), lateral_rate])
