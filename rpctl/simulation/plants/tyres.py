"""Tyres: how fast the contact points of wheels slip, and the force that answers.

The law is that of an isotropic brush with a parabolic pressure [P12, Sec. 3.3]: with the slip
σ = |u|/V_r, the velocity u of the contact point over the rolling speed V_r of its wheel,

    |F| = μ N (1 − (1 − C σ/(3μ))³) up to the friction circle |F| = μ N, which it stays on,

against u. C is the slip stiffness: |F| ≈ C N σ where little slips, so a force F is had at the slip
F/(C N), and for C → ∞ the wheel rolls as one that does not slip. V_r² = V₀² + (r θ̇)², with the
creep speed V₀, holds a wheel at rest.

[P12] H. B. Pacejka, "Tire and Vehicle Dynamics", 3rd ed., Butterworth-Heinemann, 2012.
[J85] K. L. Johnson, "Contact Mechanics", Cambridge University Press, 1985.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.drive.rows import TurningMatrix, lateral_row, rolling_row, swivel_motion
from rpctl.dynamics.rolling import RollingConstraints, contact_point
from rpctl.robot.model import BASE_NV, Robot

ROLLER_DRIVES = ("omni", "mecanum")  # whose wheels grip along one direction only


@dataclass(frozen=True)
class ContactVelocities:
    """How the contact points of n wheels move.

    Attributes:
        matrix: Map (3 n, nv) from v: each wheel's slip along the direction in which it grips (m/s),
            then each one's to the left of it (0 of a wheel that grips in one direction), then each
            one's rolling speed, r θ̇.
        along: Cosine and sine (2, n) of the angle from a wheel's rolling direction to that in which
            it grips.
    """

    matrix: TurningMatrix
    along: Array

    @property
    def count(self) -> int:
        """Number of wheels."""
        return self.along.shape[1]


def contact_velocities(robot: Robot, rolling: RollingConstraints) -> ContactVelocities:
    """Return how the contact points of a robot's wheels move.

    They stand where the file puts the wheels: a wheel that slides in the reduced model, to roll
    along bends or on an effective track, is a tyre like the others here. A ball grips along its
    rolling direction only, a roller along its axle.

    Args:
        robot: The robot.
        rolling: Its rolling constraints: the rows along the wheels are theirs.
    """
    wheels, whole = robot.drive.wheels, rolling.matrix
    n, count = len(wheels), len(whole.phase)
    constant, harmonics = np.zeros((3, n, robot.nv)), np.zeros((2, count, 3, n, robot.nv))
    rows = list(rolling.along)
    constant[0] = whole.constant[rows]
    harmonics[:, :, 0] = whole.harmonics[:, rows].reshape(2, count, n, robot.nv)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, pin.neutral(robot.model))
    for i, wheel in enumerate(wheels):
        spin = robot.velocity_index(wheel.joint)
        constant[2, i, spin] = constant[0, i, spin]
        constant[0, i, 2] += _unshifted(robot, wheel)
        if not _grips_one_way(robot, wheel):
            place = contact_point(robot, data, wheel)
            _fill_across(robot, wheel, place, constant[1, i], harmonics[:, :, 1, i])
    matrix = replace(
        whole,
        constant=constant.reshape(3 * n, robot.nv),
        harmonics=harmonics.reshape(2 * count, 3 * n, robot.nv),
    )
    return ContactVelocities(matrix, _grip_angles(robot))


def _fill_across(
    robot: Robot, wheel: Wheel, place: Array, constant: Array, harmonics: Array
) -> None:
    """Fill the row (nv,) and its harmonics (2, m, nv) of a wheel's slip to its left.

    Args:
        robot: The robot.
        wheel: The wheel.
        place: Its contact point (3,) at neutral joints, m.
        constant: Zeros.
        harmonics: Zeros, by wave.
    """
    if wheel.swivel is None:
        angle = math.atan2(wheel.direction[1], wheel.direction[0])
        constant[:BASE_NV] = lateral_row((place[0], place[1]), angle)
        return
    swivels, first = robot.drive.swivels, 0
    for swivel in swivels:
        motion = swivel_motion(robot.drive, swivel)
        count = len(motion.G)
        if swivel.joint == wheel.swivel:
            columns = [*range(BASE_NV), *(robot.velocity_index(each.joint) for each in swivels)]
            harmonics[:, first : first + count, columns] = motion.leftward
            constant[columns] += swivel.trail * motion.turning
        first += count


def _unshifted(robot: Robot, wheel: Wheel) -> float:
    """Return what takes the shift of a wheel's contact out of its row, m: an effective track's."""
    heading = robot.drive.heading
    forward = np.array([math.cos(heading), math.sin(heading)])
    return wheel.shift * float(np.array(wheel.direction) @ forward)


def _grips_one_way(robot: Robot, wheel: Wheel) -> bool:
    """Return whether nothing holds a wheel across its row: it has rollers, or is a ball."""
    if wheel.slides:
        link = robot.description.link[robot.description.joint[wheel.joint].child]
        return any(shape.kind == "sphere" for shape in link.shapes)
    return wheel.swivel is None and robot.drive.type in ROLLER_DRIVES


def _grip_angles(robot: Robot) -> Array:
    """Return cosine and sine (2, n) of the angle from each rolling direction to the row's."""
    found = np.zeros((2, len(robot.drive.wheels)))
    found[0] = 1.0
    if robot.drive.type == "mecanum":
        forward = rolling_row((0.0, 0.0), robot.drive.heading)[:BASE_NV]
        left = lateral_row((0.0, 0.0), robot.drive.heading)[:BASE_NV]
        for column, wheel in zip(found.T, robot.drive.wheels, strict=True):
            if wheel.swivel is None and not wheel.slides:
                direction = np.array([*wheel.direction, 0.0])
                column[:] = direction @ forward, direction @ left
    return found


class Grip(NamedTuple):
    """Forces of n tyres per load, at one velocity, and their derivatives.

    Attributes:
        force: Against slip along the grip and to its left, and against rolling (3, n).
        slope: Derivatives (3, 3, n) of the force by the velocities; symmetric, not negative.
        secant: Force over slip, and over rolling speed (3, n): not less than the slope.
    """

    force: Array
    slope: Array
    secant: Array


@dataclass(frozen=True)
class TyreLaw:
    """The law of the tyres.

    Attributes:
        friction: μ, coefficient between wheels and ground.
        stiffness: C, slip stiffness.
        creep_speed: V₀, m/s.
        rolling_resistance: Force against rolling over load.
    """

    friction: float
    stiffness: float
    creep_speed: float
    rolling_resistance: float = 0.0

    def rolling_speed(self, spin: Array) -> Array:
        """Return V_r (n,), m/s, at rolling speeds r θ̇ (n,)."""
        return np.hypot(self.creep_speed, spin)

    def grip(self, velocity: Array, rolling_speed: Array) -> Grip:
        """Return the forces per load, whose opposites act on the contact points.

        They are the gradient of a convex function of the velocities.

        Args:
            velocity: Of the contact points (3, n), as of :class:`ContactVelocities`, m/s.
            rolling_speed: V_r (n,), m/s; it counts as constant.
        """
        slip = velocity[:2]
        speed = np.hypot(slip[0], slip[1])
        soft = self.stiffness / rolling_speed  # force per load and slip velocity, s/m
        y = soft * speed / (3.0 * self.friction)
        left = np.maximum(1.0 - y, 0.0)
        least = np.finfo(float).tiny
        secant = np.where(
            y < 1.0,
            soft * (1.0 - y + y * y / 3.0),
            self.friction / np.maximum(speed, least),
        )
        bend = soft * left * left - secant
        unit = slip / np.maximum(speed, least)
        slope = np.zeros((3, 3, velocity.shape[1]))
        slope[:2, :2] = bend * unit[:, None] * unit
        slope[0, 0] += secant
        slope[1, 1] += secant
        force, secants = np.empty_like(velocity), np.empty_like(velocity)
        force[:2], secants[:2] = secant * slip, secant
        force[2], slope[2, 2], secants[2] = self._resistance(velocity[2])
        return Grip(force, slope, secants)

    def _resistance(self, spin: Array) -> tuple[Array, Array, Array]:
        """Return the force against rolling per load, its slope and secant (n,) each."""
        squares = self.creep_speed**2 + spin * spin
        secant = self.rolling_resistance / np.sqrt(squares)
        return secant * spin, secant * self.creep_speed**2 / squares, secant
