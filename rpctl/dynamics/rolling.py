"""The Pfaffian constraint A(q) v = 0: wheels that roll without slipping, joints that follow."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rpctl.robot.description import Array
from rpctl.robot.drive import Wheel
from rpctl.robot.model import BASE_NV, Robot

UP = np.array([0.0, 0.0, 1.0])


def constraint(robot: Robot, data: pin.Data, q: Array) -> Array:
    """Return the constraint matrix A(q), rows possibly redundant.

    Two rows a wheel, the velocity of its material contact point along and across its rolling
    direction: v_c + ω × (−r ẑ), with c its centre and ω its angular velocity ([MS21, Eq. 1-5]'s
    rolling conditions for any wheel). One row a mimic joint. A fixed base locks its three speeds.

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
        linear = J[:3] - np.cross(centre, J[3:], axisa=0, axisb=0, axisc=0)  # at the centre
        contact = linear - np.cross(J[3:], wheel.radius * UP, axisa=0, axisc=0)
        rows.append(_directions(axle) @ contact)
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
    return np.concatenate(drift)


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
    lateral = np.array([axle[0], axle[1], 0.0]) / np.hypot(axle[0], axle[1])
    return np.array([np.cross(lateral, UP), lateral])


def _direction_rates(axle: Array, axle_rate: Array) -> Array:
    """Return the time derivative (2, 3) of the directions, for an axle that turns."""
    lateral = _directions(axle)[1]
    level_rate = np.array([axle_rate[0], axle_rate[1], 0.0]) / np.hypot(axle[0], axle[1])
    lateral_rate = level_rate - (lateral @ level_rate) * lateral
    return np.array([np.cross(lateral_rate, UP), lateral_rate])
