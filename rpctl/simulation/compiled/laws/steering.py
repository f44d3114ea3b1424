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
from rpctl.drive.drive import Drive, Swivel
from rpctl.drive.steering import MIN_SPEED, NEWTON_STEPS, SteeringLimits
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.kernels.scalars import any_nonzero, clipped, rounded
from rpctl.robot.model import BASE_NV, Robot
from rpctl.simulation.compiled.laws.tracking import Moving, ReferenceEntries, SymbolicTwist
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
    known, time = ReducedDynamics(dynamics.robot), STEERING_HORIZON_RATIO * h
    g = reference_direction(reference)
    towards, towards_rate = _direction(known, g, twist)
    wanted = _steered(dynamics.robot, (towards, towards_rate, casadi.SX.zeros(3, 1)))
    feedforward = _steered(dynamics.robot, g)
    commands = []
    for k, swivel in enumerate(drive.steered):
        measured = dynamics.position(q, swivel.joint), nu[1 + k]
        angle = *wanted[k][:2], feedforward[k][2]
        commands.append(_steering(dynamics.robot.steering_limits, k, measured, angle, time))
    rates, accelerations = (casadi.vertcat(*column) for column in zip(*commands, strict=True))
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
    limits: SteeringLimits,
    k: int,
    measured: tuple[Any, Any],
    wanted: tuple[Any, Any, Any],
    time: Any,
) -> tuple[Any, Any]:
    """Return the commanded rate and acceleration of a steered joint.

    Args:
        limits: Of all steered joints.
        k: Which joint.
        measured: Its position and rate.
        wanted: Position, rate and, on the reference, acceleration.
        time: Prediction time, s.
    """
    lower, upper = float(limits.lower[k]) + ANGLE_MARGIN, float(limits.upper[k]) - ANGLE_MARGIN
    fastest = RATE_FRACTION * float(limits.fastest[k])
    (actual, rate), (angle, angle_rate, feedforward) = measured, wanted
    # A wheel may as well roll backwards: δ* counts modulo π.
    angle += math.pi * rounded((actual - angle) / math.pi)
    within = clipped(angle, lower, upper)
    held = angle != within
    angle_rate = casadi.if_else(held, 0.0, angle_rate)
    asked = angle_rate + (within - actual) / time
    change = casadi.if_else(held, 0.0, feedforward) + (angle_rate - rate) / time
    # The nearer a limit, the slower towards it: (limit − δ)/BRAKE_TIME, which never passes it.
    least, most = casadi.SX(-fastest), casadi.SX(fastest)
    if math.isfinite(lower):
        least = casadi.fmax(least, (lower - actual) / BRAKE_TIME)
    if math.isfinite(upper):
        most = casadi.fmin(most, (upper - actual) / BRAKE_TIME)
    bound = casadi.fmin(casadi.fmax(asked, least), most)
    cut = bound != asked
    braking = casadi.logic_and(cut, casadi.fabs(bound) < fastest)
    change = casadi.if_else(cut, 0.0, change)
    return bound, casadi.if_else(braking, -rate / BRAKE_TIME, change)


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


Directions = tuple[Any, Any, Any]  # a twist (3, 1) and its first two derivatives by time
Place = tuple[Swivel, float, float]  # a swivel, its ratio to a leader's position, its offset


def steered_angles(drive: Drive, direction: Directions) -> list[tuple[Any, Any, Any]]:
    """Return position, rate and acceleration of each steered joint along a twist of the root link.

    Args:
        drive: A drive with steered wheels.
        direction: A twist of any length but zero, and its first two derivatives.
    """
    return [_angle(drive, swivel, direction) for swivel in drive.steered]


def _angle(drive: Drive, swivel: Swivel, direction: Directions) -> tuple[Any, Any, Any]:
    group = [s for s in drive.swivels if s.role == "mimic" and s.shares == swivel.joint]
    places: list[Place] = [(swivel, 1.0, 0.0), *((s, s.ratio, s.offset) for s in group)]
    position = _heading_along(swivel, direction[0])
    for _ in range(NEWTON_STEPS if group else 0):
        position += _newton_step(places, direction, position)[0]
    _, rate, acceleration = _newton_step(places, direction, position)
    if not swivel.trail:
        return position, rate, acceleration
    lag, lag_rate, lag_bend = (swivel.sign * x for x in _caster_angle(swivel, direction))
    return position + lag, rate + lag_rate, acceleration + lag_bend


def _heading_along(swivel: Swivel, twist: Any) -> Any:
    """Return the joint position (rad), within ±π/2 of 0, at which a swivel heads along a twist."""
    V = _pivot_velocity(swivel, twist)
    position = swivel.sign * (casadi.atan2(V[1], V[0]) - swivel.heading)
    return position - math.pi * rounded(position / math.pi)


def _pivot_velocity(swivel: Swivel, twist: Any) -> Any:
    """Return the velocity (2, 1) of a swivel's pivot under a twist."""
    x, y = swivel.pivot
    return casadi.vertcat(twist[0] - twist[2] * y, twist[1] + twist[2] * x)


def _newton_step(places: list[Place], direction: Directions, position: Any) -> tuple[Any, Any, Any]:
    """Return Newton's step of a steered position, its rate and its acceleration.

    Args:
        places: The swivels that turn with it.
        direction: A twist and its first two derivatives.
        position: The steered position, rad.
    """
    across, along = [casadi.SX(0)] * 3, [casadi.SX(0)] * 3  # Σ n·V⁽ⁱ⁾ and Σ g d·V⁽ⁱ⁾, φ̇ = g δ̇
    second = casadi.SX(0)  # Σ g² n·V
    for swivel, ratio, offset in places:
        gain = swivel.sign * ratio
        angle = swivel.heading + swivel.sign * (ratio * position + offset)
        cos, sin = casadi.cos(angle), casadi.sin(angle)
        for k, twist in enumerate(direction):
            V = _pivot_velocity(swivel, twist)
            n_V = cos * V[1] - sin * V[0]
            across[k] += n_V
            along[k] += gain * (cos * V[0] + sin * V[1])
            second += gain**2 * n_V if k == 0 else 0.0
    moves = casadi.fabs(along[0]) > MIN_SPEED  # a place that stands still keeps its angle
    inverse = casadi.if_else(moves, 1.0 / casadi.if_else(moves, along[0], 1.0), 0.0)
    rate = across[1] * inverse
    bend = (across[2] - 2.0 * rate * along[1] - rate**2 * second) * inverse
    return across[0] * inverse, rate, bend


def _caster_angle(swivel: Swivel, direction: Directions) -> tuple[Any, Any, Any]:
    """Return asin(k ω/|V|) of a swivel with trail k, and its first two derivatives."""
    once, twice = Moving(), Moving()
    twist, change = casadi.SX.sym("twist", 3), casadi.SX.sym("change", 3)
    once.follow(twist, twist, change)
    angle, rate = once.with_rate(_lag(swivel, twist))
    twice.follow(twist, direction[0], direction[1])
    twice.follow(change, direction[1], direction[2])
    _, bend = twice.with_rate(rate)
    angle, rate = casadi.substitute([angle, rate], [twist, change], list(direction[:2]))
    return angle, rate, bend


def _lag(swivel: Swivel, twist: Any) -> Any:
    V = _pivot_velocity(swivel, twist)
    size = casadi.sqrt(casadi.fmax(casadi.dot(V, V), MIN_SPEED**2))
    u = swivel.trail * twist[2] / size
    tight = casadi.fabs(u) >= 1.0  # the bend is tighter than the trail: no steady angle
    right = casadi.if_else(u < 0.0, -0.5 * math.pi, 0.5 * math.pi)
    return casadi.if_else(tight, right, casadi.asin(casadi.if_else(tight, 0.0, u)))
