"""Steered bases in symbols: from a desired twist to speeds and steering rates.

The formulas are those of :mod:`rpctl.control.steering` and :mod:`rpctl.drive.steering`; rates are
by the chain rule. What rolling makes of ν at the present steering comes from the dynamics' steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, isfinite, sin
from typing import Any, NamedTuple

import sympy as sp

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
from rpctl.derive.equations import rational
from rpctl.derive.law_sheet import Sheet, choice
from rpctl.derive.program import clean
from rpctl.drive.drive import Swivel
from rpctl.drive.steering import MIN_SPEED, NEWTON_STEPS
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot

PLANE = range(3)
Vector = Sequence[sp.Expr]


class Steered(NamedTuple):
    """A steered joint, measured: its position, its rate, and δ̈ of the reference's."""

    position: sp.Expr
    rate: sp.Expr


@dataclass(frozen=True)
class RollingInputs:
    """What rolling makes of ν, as inputs that the dynamics' steps compute.

    Attributes:
        map: P's twist by the base's quasi-velocities, (3, 1 + n_steered).
        drift: The drift of P's twist that the steering rates make (3,),
        unit_drift: and with the base's speed 1 beside them (3,).
    """

    map: tuple[tuple[sp.Symbol, ...], ...]
    drift: tuple[sp.Symbol, ...]
    unit_drift: tuple[sp.Symbol, ...]

    @property
    def symbols(self) -> tuple[sp.Symbol, ...]:
        """All of them, the map row by row."""
        return (*(s for row in self.map for s in row), *self.drift, *self.unit_drift)


def rolling_inputs(sheet: Sheet, robot: Robot) -> RollingInputs:
    """Name what rolling makes of ν."""
    count = len(robot.drive.base_speeds)

    def named(letter: str, i: int, of: str) -> sp.Symbol:
        return sheet.given(f"{letter}{i + 1}", "", "", of)

    entries = [named("N", i, "the twist of P by nu, row by row") for i in range(3 * count)]
    return RollingInputs(
        tuple(tuple(entries[count * i : count * (i + 1)]) for i in PLANE),
        tuple(named("E", i, "drift of P's twist under the steering rates") for i in PLANE),
        tuple(named("F", i, "the same beside a unit of speed") for i in PLANE),
    )


def reference_direction(
    sheet: Sheet, given: Sequence[Vector], twist: Vector, twist_dot: Vector
) -> Vector:
    """Write the reference's direction of travel; without any, wheels point ahead.

    Args:
        sheet: Where to write.
        given: The direction and its first two derivatives (3, 3); all 0 stands for none.
        twist: The reference's twist (3,).
        twist_dot: Its derivative (3,).
    """
    has_direction = sheet.define("g_any", sp.Add(*(each**2 for each in given[0])))
    has_twist = sheet.define("t_any", sp.Add(*(each**2 for each in twist)))
    ahead = (1, 0, 0)
    found = []
    for i in PLANE:
        levels = [
            sheet.define(
                f"G{i + 1}{'_dot' * (k == 1)}{'_ddot' * (k == 2)}",
                choice(0, has_direction, given[k][i], choice(0, has_twist, other, rest)),
            )
            for k, (other, rest) in enumerate(((twist[i], ahead[i]), (twist_dot[i], 0), (0, 0)))
        ]
        sheet.rates[levels[0]], sheet.rates[levels[1]] = levels[1:]
        found.append(levels[0])
    return found


def steered_command(
    sheet: Sheet,
    robot: Robot,
    twist: Vector,
    g: Vector,
    measured: Sequence[Steered],
    rolling: RollingInputs,
    h: sp.Symbol,
) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """Write the base's part of ν_d and of ν̇_d.

    Args:
        sheet: Where to write.
        robot: The robot.
        twist: Desired twist (3,), with its rate known to the sheet.
        g: The reference's direction of travel (3,).
        measured: The steered joints.
        rolling: What rolling makes of ν.
        h: Prediction time of the law.
    """
    weights = [rational(float(w)) for w in twist_weights(robot.drive)]
    m = _direction(sheet, twist, g, weights, ReducedDynamics(robot))
    root = robot.root_velocity
    along = [sheet.follow(f"m{i + 1}", _row(root[i], m)) for i in PLANE]
    targets = _steer(sheet, robot, "d", along)
    feed = _steer(sheet, robot, "f", [_twice(sheet, f"G{i + 4}", _row(root[i], g)) for i in PLANE])
    hs = sheet.define("h_s", rational(STEERING_HORIZON_RATIO) * h)
    rates, changes = [], []
    for i, joint in enumerate(measured):
        rate, change = _joint_command(sheet, robot, i, joint, targets[i], feed[i][2], hs)
        rates.append(rate)
        changes.append(change)
    speed, speed_rate = twist[0], sheet.rate(twist[0])
    if not robot.drive.has_axle:
        speed, speed_rate = _rolling(sheet, twist, measured, changes, rolling, weights)
    return [speed, *rates], [speed_rate, *changes]


def _row(row: Array, vector: Vector) -> sp.Expr:
    return sp.Add(*(rational(float(a)) * x for a, x in zip(clean(row), vector, strict=True)))


def _twice(sheet: Sheet, name: str, value: sp.Expr) -> sp.Expr:
    """Name an expression and its first two derivatives along the motion."""
    symbol = sheet.follow(name, value)
    rate = sheet.rates[symbol]
    if rate not in sheet.rates:
        sheet.rates[rate] = sheet.define(f"{name}_ddot", sheet.rate(sheet.rate(value)))
    return symbol


def _dot(weights: Vector, a: Vector, b: Vector) -> sp.Expr:
    return sp.Add(*(w * x * y for w, x, y in zip(weights, a, b, strict=True)))


def _direction(
    sheet: Sheet, t: Vector, g: Vector, weights: Vector, dynamics: ReducedDynamics
) -> Vector:
    """Write m, the direction in which the wheels steer the base."""
    size = sheet.follow("g_size", sp.sqrt(_dot(weights, g, g)))
    unit = [sheet.follow(f"gh{i + 1}", g[i] / size) for i in PLANE]
    u = sheet.follow("along", _dot(weights, unit, t))
    gain = sheet.follow("gain", u / (u**2 + rational(SLOW_SPEED) ** 2))
    off = [sheet.follow(f"dev{i + 1}", gain * (t[i] - u * unit[i])) for i in PLANE]
    most = rational(max_deviation(dynamics.robot.drive))
    level = sheet.follow("level", sp.sqrt(1 + _dot(weights, off, off) / most**2))
    return [sheet.follow(f"mh{i + 1}", unit[i] + off[i] / level) for i in PLANE]


def _steer(sheet: Sheet, robot: Robot, letter: str, twist: Vector) -> list[tuple[sp.Expr, ...]]:
    """Write positions, rates and accelerations of the steered joints along a twist of the root."""
    found = []
    drive = robot.drive
    for k, swivel in enumerate(drive.steered, start=1):
        name = f"{letter}{k}"
        group = [s for s in drive.swivels if s.role == "mimic" and s.shares == swivel.joint]
        places = [(swivel, 1.0, 0.0), *((s, s.ratio, s.offset) for s in group)]
        V = [
            _pivot_velocity(sheet, f"{name}_V{i}", each, twist)
            for i, (each, _, _) in enumerate(places)
        ]
        angle = sp.atan2(V[0][0][1], V[0][0][0]) - rational(swivel.heading)
        turned = sheet.define(f"{name}_raw", rational(swivel.sign) * angle)
        position = sheet.define(f"{name}_0", turned - sp.pi * rounded(turned / sp.pi))
        for step in range(NEWTON_STEPS if group else 0):
            across, along, *_ = _rows(places, V, position)
            inverse = _safe_inverse(sheet, f"{name}_{step}s", along)
            position = sheet.define(f"{name}_{step + 1}", position + across * inverse)
        _, along, across_dot, along_dot, across_ddot, second = _rows(places, V, position)
        inverse = _safe_inverse(sheet, f"{name}_s", along)
        rate = sheet.define(f"{name}_dot", across_dot * inverse)
        bend = (across_ddot - 2 * rate * along_dot - rate**2 * second) * inverse
        angles = (position, rate, sheet.define(f"{name}_ddot", bend))
        if swivel.trail:
            lag = _caster_angle(sheet, name, swivel, V[0], twist)
            angles = tuple(
                sheet.define(f"{name}_t{i}", each + rational(swivel.sign) * more)
                for i, (each, more) in enumerate(zip(angles, lag, strict=True))
            )
        found.append(angles)
    return found


def rounded(value: sp.Expr) -> sp.Expr:
    """Return the nearest whole number."""
    return sp.ceiling(value - sp.Rational(1, 2))


def _pivot_velocity(sheet: Sheet, name: str, swivel: Swivel, twist: Vector) -> list[Vector]:
    """Write the velocity of a swivel's pivot and its first two derivatives (3, 2)."""
    x, y = map(rational, swivel.pivot)
    parts: list[Vector] = [(twist[0] - twist[2] * y, twist[1] + twist[2] * x)]
    for _ in range(2):
        parts.append(tuple(sheet.rate(each) for each in parts[-1]))
    return [
        tuple(sheet.define(f"{name}{axis}{'_dot' * (k == 1)}{'_ddot' * (k == 2)}", each)
              for axis, each in zip("xy", part, strict=True))
        for k, part in enumerate(parts)
    ]  # fmt: skip


def _rows(places: Any, velocities: Sequence[Any], position: sp.Expr) -> tuple[sp.Expr, ...]:
    """Return Σ n·V, Σ g d·V, Σ n·V̇, Σ g d·V̇, Σ n·V̈ and Σ g² n·V."""
    sums = [sp.Integer(0)] * 6
    for (swivel, ratio, offset), V in zip(places, velocities, strict=True):
        gain = rational(swivel.sign * ratio)
        angle = rational(swivel.sign) * (rational(ratio) * position + rational(offset))
        c, s = sp.cos(angle), sp.sin(angle)
        ch, sh = rational(cos(swivel.heading)), rational(sin(swivel.heading))
        d = c * ch - s * sh, s * ch + c * sh
        across = [v[1] * d[0] - v[0] * d[1] for v in V]
        along = [v[0] * d[0] + v[1] * d[1] for v in V]
        parts = (across[0], gain * along[0], across[1], gain * along[1], across[2],
                 gain**2 * across[0])  # fmt: skip
        sums = [total + part for total, part in zip(sums, parts, strict=True)]
    return tuple(sums)


def _safe_inverse(sheet: Sheet, name: str, value: sp.Expr) -> sp.Expr:
    """Write 1/value, 0 where the value is as good as 0: nothing heads along a place at rest."""
    least = sp.Float(MIN_SPEED)
    value = sheet.define(name, value)
    size = sheet.define(f"{name}_size", sp.Abs(value))
    safe = choice(least, size, value, 1)
    return sheet.define(f"{name}_inv", choice(least, size, 1, 0) / safe)


def _caster_angle(sheet: Sheet, name: str, swivel: Swivel, V: Any, twist: Vector) -> Vector:
    """Write asin(k ω/|V|) of a swivel with trail k, and its first two derivatives (3,)."""
    least, k = sp.Float(MIN_SPEED), rational(swivel.trail)
    turn = [twist[2]]
    for _ in range(2):
        turn.append(sheet.rate(turn[-1]))
    length = sheet.define(f"{name}_len", sp.sqrt(V[0][0] ** 2 + V[0][1] ** 2))
    size = sheet.define(f"{name}_size", choice(length, least, least, length))
    pace = sheet.define(f"{name}_pace", (V[0][0] * V[1][0] + V[0][1] * V[1][1]) / size**2)
    spread = (V[1][0] ** 2 + V[1][1] ** 2 + V[0][0] * V[2][0] + V[0][1] * V[2][1]) / size**2
    u = sheet.define(f"{name}_u", k * turn[0] / size)
    u_dot = sheet.define(f"{name}_u_dot", k * turn[1] / size - u * pace)
    u_ddot = k * (turn[2] - turn[1] * pace) / size - u_dot * pace - u * (spread - 2 * pace**2)
    inside = sheet.define(f"{name}_in", choice(sp.Abs(u), 1, 1, 0))
    held = sheet.define(f"{name}_uc", inside * u)
    level = sheet.define(f"{name}_lvl", 1 / sp.sqrt(1 - held**2))
    right = choice(0, u, sp.pi / 2, -sp.pi / 2)
    return (
        choice(0, inside, sp.asin(held), right),
        inside * level * u_dot,
        inside * (level * u_ddot + level**3 * held * u_dot**2),
    )


def _joint_command(
    sheet: Sheet,
    robot: Robot,
    i: int,
    joint: Steered,
    target: tuple[sp.Expr, ...],
    feed: sp.Expr,
    hs: sp.Expr,
) -> tuple[sp.Expr, sp.Expr]:
    """Write the commanded rate and acceleration of a steered joint, within its limits."""
    name, limits = f"s{i + 1}", robot.steering_limits
    lower, upper = limits.lower[i] + ANGLE_MARGIN, limits.upper[i] - ANGLE_MARGIN
    fastest = RATE_FRACTION * limits.fastest[i]
    gap = (joint.position - target[0]) / sp.pi
    wanted = sheet.define(f"{name}_any", target[0] + sp.pi * rounded(gap))
    free = sheet.define(f"{name}_free", _within(wanted, lower, upper))
    wanted = sheet.define(f"{name}_goal", _clipped(wanted, lower, upper))
    rate = sheet.define(f"{name}_rate", free * target[1])
    asked = sheet.define(f"{name}_ask", rate + (wanted - joint.position) / hs)
    change = sheet.define(f"{name}_chg", free * feed + (rate - joint.rate) / hs)
    brake = rational(BRAKE_TIME)
    least = _largest(sheet, f"{name}_min", -fastest, lower, joint.position, brake, -1)
    most = _largest(sheet, f"{name}_max", fastest, upper, joint.position, brake, 1)
    kept = sheet.define(f"{name}_kept", _within(asked, least, most))
    bound = sheet.define(f"{name}_d", _clipped(asked, least, most))
    braking = sp.Integer(1) if not isfinite(fastest) else choice(sp.Abs(bound), fastest, 1, 0)
    braking = sheet.define(f"{name}_brk", (1 - kept) * braking)
    return bound, sheet.define(f"{name}_d_dot", kept * change - braking * joint.rate / brake)


def _largest(
    sheet: Sheet, name: str, speed: float, limit: float, position: sp.Expr, time: sp.Expr, sign: int
) -> Any:
    """Write the fastest rate towards a limit; infinite without any."""
    if not isfinite(limit):
        return float(speed)
    near = sheet.define(f"{name}_gap", (sp.Float(limit) - position) / time)
    if not isfinite(speed):
        return near
    fast = sp.Float(speed)
    return sheet.define(
        name, choice(near, fast, near, fast) if sign > 0 else choice(near, fast, fast, near)
    )


def _finite(value: Any) -> bool:
    return isinstance(value, sp.Expr) or isfinite(value)


def _within(value: sp.Expr, lower: Any, upper: Any) -> sp.Expr:
    """Return 1 between two bounds, else 0."""
    inside: sp.Expr = sp.Integer(1)
    if _finite(upper):
        inside = choice(upper, value, 0, inside)
    return choice(value, lower, 0, inside) if _finite(lower) else inside


def _clipped(value: sp.Expr, lower: Any, upper: Any) -> sp.Expr:
    """Return a value within two bounds; the upper one prevails."""
    raised = choice(value, lower, lower, value) if _finite(lower) else value
    return choice(upper, raised, upper, raised) if _finite(upper) else raised


def _rolling(
    sheet: Sheet,
    t: Vector,
    measured: Sequence[Steered],
    changes: Vector,
    rolling: RollingInputs,
    weights: Vector,
) -> tuple[sp.Expr, sp.Expr]:
    """Write the base's speed, and its rate, whose twist is nearest to the desired one."""
    n = [row[0] for row in rolling.map]
    n_dot = [a - b for a, b in zip(rolling.unit_drift, rolling.drift, strict=True)]
    rest, rest_dot = [], []
    for i in PLANE:
        turning, turned = (
            sp.Add(*(each * x for each, x in zip(rolling.map[i][1:], vector, strict=True)))
            for vector in ([joint.rate for joint in measured], changes)
        )
        rest.append(sheet.define(f"r{i + 1}", t[i] - turning))
        rate = sheet.rate(t[i]) - turned - rolling.drift[i]
        rest_dot.append(sheet.define(f"r{i + 1}_dot", rate))
    square = sheet.define("n_square", _dot(weights, n, n))
    speed = sheet.define("v_d1", _dot(weights, n, rest) / square)
    rate = _dot(weights, n_dot, rest) + _dot(weights, n, rest_dot)
    rate -= 2 * speed * _dot(weights, n, n_dot)
    return speed, sheet.define("v_d1_dot", rate / square)
