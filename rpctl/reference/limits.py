"""Limits of planned references: those that the user sets, and the robot's own."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.steering import heading_radius, turning_radius
from rpctl.dynamics.rolling import find_rolling
from rpctl.files.records import NOT_NEGATIVE, POSITIVE, Record
from rpctl.reference.time_law import Bound
from rpctl.robot.model import BASE_NV, Robot

VELOCITY_LIMIT_FRACTION = 0.9  # of a velocity limit of the URDF: the rest is left to the controller
TURNING_RADIUS_FACTOR = 1.5  # of the least radius that a robot can steer: room for corrections
SPEED_RISE_TIME = 0.5  # s; a joint takes at least this long to its velocity limit


@dataclass(frozen=True)
class Limits(Record):
    """Limits of a reference; the velocity limits of the URDF come on top of them.

    Attributes:
        speed: Speed of P, m/s.
        acceleration: Acceleration of P along its path, m/s².
        turning_speed: Turning rate of the base, rad/s.
        turning_acceleration: Angular acceleration of the base, rad/s².
        lateral_acceleration: Speed times turning speed, m/s².
        turning_radius: Least radius of the base's path, m; 0 lets it turn on the spot.
        end_effector_speed: Speed of the end effector, m/s.
        end_effector_acceleration: Its acceleration along each axis of the world, m/s².
    """

    speed: Annotated[float, POSITIVE] = 0.5
    acceleration: Annotated[float, POSITIVE] = 0.4
    turning_speed: Annotated[float, POSITIVE] = 1.0
    turning_acceleration: Annotated[float, POSITIVE] = 1.0
    lateral_acceleration: Annotated[float, POSITIVE] = 0.4
    turning_radius: Annotated[float, NOT_NEGATIVE] = 0.0
    end_effector_speed: Annotated[float, POSITIVE] = 0.3
    end_effector_acceleration: Annotated[float, POSITIVE] = 0.4

    def steerable(self, robot: Robot) -> Limits:
        """Return limits whose turning radius a robot can steer, with room for corrections."""
        return replace(self, turning_radius=max(self.turning_radius, steerable_radius(robot)))

    def base(self, robot: Robot, direction: Array) -> list[Bound]:
        """Return the bounds of a base path.

        Args:
            direction: Twist by s and its derivative by s, at N points of the path (N, 2, 3).
        """
        twist, bend = direction[:, 0], direction[:, 1]
        speed, swerve = (
            np.hypot(twist[:, 0], twist[:, 1]),
            np.sqrt(np.abs(twist[:, 0] * twist[:, 2])),
        )
        return [
            Bound(speed, np.zeros(len(speed)), self.speed),
            Bound(twist[:, 0], bend[:, 0], self.speed, self.acceleration),
            Bound(twist[:, 1], bend[:, 1], self.speed, self.acceleration),
            Bound(twist[:, 2], bend[:, 2], self.turning_speed, self.turning_acceleration),
            Bound(swerve, np.zeros(len(speed)), math.sqrt(self.lateral_acceleration)),
            *_wheel_bounds(robot, twist),
        ]

    def end_effector(self, slope: Array, bend: Array) -> list[Bound]:
        """Return the bounds of an end effector's path from its derivatives by s, (N, 3) each."""
        speed = np.linalg.norm(slope, axis=1)
        return [
            Bound(speed, np.zeros(len(speed)), self.end_effector_speed),
            *(
                Bound(slope[:, i], bend[:, i], math.inf, self.end_effector_acceleration)
                for i in range(3)
            ),
        ]


def steerable_radius(robot: Robot) -> float:
    """Return the least radius (m) of a path for a robot, with room for corrections."""
    return TURNING_RADIUS_FACTOR * turning_radius(robot.drive, robot.description.joint)


def comfortable_radius(robot: Robot) -> float:
    """Return the least radius (m) of a path on which no wheel of a robot turns past its steering.

    It is that of :func:`steerable_radius`, and counts bases whose wheels all steer.
    """
    return TURNING_RADIUS_FACTOR * heading_radius(robot.drive, robot.description.joint)


def arm_bounds(robot: Robot, slope: Array, bend: Array) -> list[Bound]:
    """Return the bounds that the joints' velocity limits set.

    Args:
        slope: Derivatives of the joints' positions by s (N, n_joints).
        bend: Second derivatives (N, n_joints).
    """
    limits = (VELOCITY_LIMIT_FRACTION * joint.velocity for joint in robot.joints)
    return [
        Bound(slope[:, i], bend[:, i], limit, limit / SPEED_RISE_TIME)
        for i, limit in enumerate(limits)
        if math.isfinite(limit)
    ]


def _wheel_bounds(robot: Robot, twist: Array) -> list[Bound]:
    """Return the bounds that the wheels' velocity limits set to a twist by s (N, 3)."""
    root = twist @ robot.root_velocity.T
    bounds = []
    for wheel, rate in zip(robot.drive.wheels, wheel_rates(robot), strict=True):
        limit = VELOCITY_LIMIT_FRACTION * robot.description.joint[wheel.joint].velocity
        rates = np.abs(twist @ rate)
        if wheel.swivel is not None:  # it heads along its pivot's velocity
            x, y = next(s.pivot for s in robot.drive.swivels if s.joint == wheel.swivel)
            place = np.hypot(root[:, 0] - root[:, 2] * y, root[:, 1] + root[:, 2] * x)
            rates = place / wheel.radius
        if math.isfinite(limit):
            bounds.append(Bound(rates, np.zeros(len(rates)), limit))
    return bounds


def wheel_rates(robot: Robot) -> Array:
    """Return the map (n_wheels, 3) from P's twist to the wheels' rates, rad/s; 0 on swivels."""
    rolling, rows = find_rolling(robot), np.zeros((len(robot.drive.wheels), BASE_NV))
    for row, wheel, at in zip(rows, robot.drive.wheels, rolling.along, strict=True):
        if wheel.swivel is None:
            lever = rolling.matrix.constant[at, robot.velocity_index(wheel.joint)]
            row[:] = -rolling.matrix.constant[at, :BASE_NV] @ robot.root_velocity / lever
    return rows
