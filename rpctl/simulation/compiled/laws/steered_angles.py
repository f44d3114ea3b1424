"""The angles of steered wheels in CasADi's symbols; see :func:`rpctl.drive.steering.steer`."""

from __future__ import annotations

import math
from typing import Any

import casadi

from rpctl.drive.drive import Drive, Swivel
from rpctl.drive.steering import MIN_SPEED, NEWTON_STEPS
from rpctl.simulation.compiled.laws.tracking import Moving
from rpctl.simulation.compiled.symbols.choices import rounded

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
