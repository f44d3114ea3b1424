"""The base's part of ν_d and ν̇_d in CasADi's symbols; see :mod:`rpctl.control.steering`."""

from __future__ import annotations

import math
from typing import Any

import casadi

from rpctl.arrays import Array
from rpctl.control.steering import (
    ANGLE_MARGIN,
    BRAKE_TIME,
    RATE_FRACTION,
    SLOW_SPEED,
    STEERING_HORIZON_RATIO,
    max_deviation,
    twist_weights,
)
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import BASE_NV, Robot
from rpctl.simulation.compiled.laws.kinematic_laws import SymbolicTwist
from rpctl.simulation.compiled.laws.steered_angles import Directions, steered_angles
from rpctl.simulation.compiled.laws.tracking import Moving, ReferenceEntries
from rpctl.simulation.compiled.symbols.choices import any_nonzero, clipped, rounded
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics


def symbolic_base_command(
    dynamics: SymbolicDynamics,
    reference: ReferenceEntries,
    q: Any,
    nu: Any,
    twist: SymbolicTwist,
    h: Any,
) -> tuple[Any, Any]:
    """Return the base's part of ν_d and of ν̇_d, as :func:`rpctl.control.steering.base_command`.

    Args:
        dynamics: The robot's dynamics.
        reference: The reference.
        q: Configuration (nq, 1).
        nu: Quasi-velocities (dof, 1).
        twist: Desired twist of the base.
        h: Prediction time of the law, s.
    """
    drive = dynamics.robot.drive
    if not drive.steered:
        keep = [0, 2] if drive.has_axle else list(range(len(drive.base_speeds)))
        return twist.value[keep], twist.rate[keep]
    known = ReducedDynamics(dynamics.robot)
    rates, accelerations = _steering(known, dynamics, reference, q, nu, twist, h)
    speed, change = twist.value[0], twist.rate[0]
    if not drive.has_axle:
        speed, change = _rolling(dynamics, twist_weights(known), q, nu, accelerations, twist)
    return casadi.vertcat(speed, rates), casadi.vertcat(change, accelerations)


def _rolling(
    dynamics: SymbolicDynamics,
    weights: Array,
    q: Any,
    nu: Any,
    accelerations: Any,
    twist: SymbolicTwist,
) -> tuple[Any, Any]:
    """Return the base's speed ν₁, and its rate, whose twist is nearest to the desired one.

    Args:
        dynamics: The robot's dynamics.
        weights: Of a twist's entries (3,).
        q: Configuration (nq, 1).
        nu: Quasi-velocities (dof, 1).
        accelerations: Commanded accelerations of the steered joints (n_steered, 1).
        twist: Desired twist of the base.
    """
    robot, count = dynamics.robot, len(dynamics.robot.drive.steered)
    W, point = casadi.DM(weights), casadi.DM(robot.point_velocity)
    unit = casadi.SX.eye(robot.dof)[:, 0]
    turning, turned = casadi.SX.zeros(robot.dof, 1), casadi.SX.zeros(robot.dof, 1)
    turning[1 : 1 + count], turned[1 : 1 + count] = nu[1 : 1 + count], accelerations
    at = dynamics.at(q)
    drift = at.drift(turning)[:BASE_NV]
    n = dynamics.twist(q, unit)
    n_dot = point @ (at.drift(turning + unit)[:BASE_NV] - drift)
    t = twist.value - dynamics.twist(q, turning)
    t_dot = twist.rate - dynamics.twist(q, turned) - point @ drift
    square = casadi.dot(n, W * n)
    speed = casadi.dot(n, W * t) / square
    rate = casadi.dot(n_dot, W * t) + casadi.dot(n, W * t_dot)
    return speed, (rate - 2.0 * speed * casadi.dot(n, W * n_dot)) / square


def _steering(
    known: ReducedDynamics,
    dynamics: SymbolicDynamics,
    reference: ReferenceEntries,
    q: Any,
    nu: Any,
    twist: SymbolicTwist,
    h: Any,
) -> tuple[Any, Any]:
    """Return the commanded rates and accelerations (n_steered, 1) of the steered joints."""
    robot, time = dynamics.robot, STEERING_HORIZON_RATIO * h
    g = reference_direction(reference)
    towards, towards_rate = _direction(known, g, twist)
    wanted = _steered(robot, (towards, towards_rate, casadi.SX.zeros(3, 1)))
    feedforward = _steered(robot, g)
    limits = robot.steering_limits
    rates, accelerations = [], []
    for k, swivel in enumerate(robot.drive.steered):
        lower, upper = float(limits.lower[k]) + ANGLE_MARGIN, float(limits.upper[k]) - ANGLE_MARGIN
        fastest = RATE_FRACTION * float(limits.fastest[k])
        actual, rate = dynamics.position(q, swivel.joint), nu[1 + k]
        angle, angle_rate, _ = wanted[k]
        # A wheel may as well roll backwards: δ* counts modulo π.
        angle += math.pi * rounded((actual - angle) / math.pi)
        within = clipped(angle, lower, upper)
        held = angle != within
        angle_rate = casadi.if_else(held, 0.0, angle_rate)
        asked = angle_rate + (within - actual) / time
        change = casadi.if_else(held, 0.0, feedforward[k][2]) + (angle_rate - rate) / time
        # The nearer a limit, the slower towards it: (limit − δ)/BRAKE_TIME, which never passes it.
        least, most = casadi.SX(-fastest), casadi.SX(fastest)
        if math.isfinite(lower):
            least = casadi.fmax(least, (lower - actual) / BRAKE_TIME)
        if math.isfinite(upper):
            most = casadi.fmin(most, (upper - actual) / BRAKE_TIME)
        bound = casadi.fmin(casadi.fmax(asked, least), most)
        cut = bound != asked
        braking = casadi.logic_and(cut, casadi.fabs(bound) < fastest)
        rates.append(bound)
        change = casadi.if_else(cut, 0.0, change)
        accelerations.append(casadi.if_else(braking, -rate / BRAKE_TIME, change))
    return casadi.vertcat(*rates), casadi.vertcat(*accelerations)


def _steered(robot: Robot, twist: Directions) -> list[tuple[Any, Any, Any]]:
    """Return angle, rate and acceleration of each steered joint along P's twist (3, 1) ×3."""
    root = casadi.DM(robot.root_velocity)
    x, y, z = (root @ each for each in twist)
    return steered_angles(robot.drive, (x, y, z))


def reference_direction(reference: ReferenceEntries) -> Directions:
    """Return a reference's direction of travel and its first two derivatives, (3, 1) each.

    That of :func:`rpctl.reference.quasi_velocities.direction`: where a reference gives none, its
    twist, and where there is neither, straight ahead.
    """
    given, twist = any_nonzero(reference.direction[0]), any_nonzero(reference.twist)
    none = casadi.SX.zeros(3, 1)
    ahead = casadi.vertcat(1.0, 0.0, 0.0)
    twists = (
        casadi.if_else(twist, reference.twist, ahead),
        casadi.if_else(twist, reference.twist_dot, none),
        none,
    )
    x, y, z = (
        casadi.if_else(given, own, other)
        for own, other in zip(reference.direction, twists, strict=True)
    )
    return x, y, z


def _direction(known: ReducedDynamics, wanted: Directions, twist: SymbolicTwist) -> tuple[Any, Any]:
    """Return m and ṁ (3, 1): the direction in which the wheels steer the base."""
    moving, W = Moving(), casadi.DM(twist_weights(known))
    g, t = moving.add(wanted[0], wanted[1]), moving.add(twist.value, twist.rate)
    g_hat = g / casadi.sqrt(casadi.dot(g, W * g))
    u = casadi.dot(g_hat, W * t)
    deviation = u / (u**2 + SLOW_SPEED**2) * (t - u * g_hat)
    size = casadi.dot(deviation, W * deviation) / max_deviation(known) ** 2
    return moving.with_rate(g_hat + deviation / casadi.sqrt(1.0 + size))
