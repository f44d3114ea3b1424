"""The kinematic laws in symbols: from pose, speeds and reference to ν_d, and ν̇_d by chain rule."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import sympy as sp

from rpctl.control.error import SERIES_RADIUS, Leash
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.twist_law import BaseLaw
from rpctl.control.unified import UnifiedKinematic
from rpctl.derive.equations import rational
from rpctl.derive.law_sheet import Sheet, choice
from rpctl.robot.model import Robot

AXES = ("x", "y", "theta")
POSE_WORDS = ("x of the root link", "y of the root link", "heading of the root link")
TWIST_WORDS = ("speed forward", "speed to the left", "turning rate")
TWIST_UNITS = ("m/s", "m/s", "rad/s")
HALF = sp.Rational(1, 2)


class Measured(NamedTuple):
    """The reference's motion and the robot's, in symbols."""

    twist_r: Sequence[sp.Expr]  # (3,) forward, left, turning
    direction: Sequence[sp.Expr]  # (3,) along the twist, or along the path at standstill
    given: Sequence[Sequence[sp.Expr]]  # (3, 3) that direction and two derivatives, as they come
    error: Sequence[sp.Expr]  # x1, x2, x3


def measure(sheet: Sheet, robot: Robot, twist: Sequence[sp.Expr], law: BaseLaw) -> Measured:
    """Write the inputs and the tracking error of the base; [MS21, Eq. 6-10].

    Its twist (3,) is P's speed forward and to the left and the turning rate.
    """
    x, y, theta = (
        sheet.given(name, f"pose[{i}]", unit, of)
        for i, (name, unit, of) in enumerate(zip(AXES, ("m", "m", "rad"), POSE_WORDS, strict=True))
    )
    x_r, y_r, theta_r = (
        sheet.given(f"{name}_r", f"r->pose[{i}]", unit, f"{name} of P on the reference")
        for i, (name, unit) in enumerate(zip(AXES, ("m", "m", "rad"), strict=True))
    )
    twist_r = _twist_inputs(sheet)
    direction: Sequence[sp.Expr] = twist_r
    by_direction = isinstance(law, UnifiedKinematic) and not robot.drive.omnidirectional
    given = _directions(sheet) if by_direction or robot.drive.steered else []
    if by_direction:
        direction = _direction(sheet, given, twist_r)
    px, py = map(rational, robot.drive.point)
    cos, sin = sp.cos(theta), sp.sin(theta)
    x_P = sheet.define("x_P", x + cos * px - sin * py)
    y_P = sheet.define("y_P", y + sin * px + cos * py)
    turn = sheet.define("theta_P", theta + rational(robot.drive.heading))
    dx, dy = sheet.define("dx", x_r - x_P), sheet.define("dy", y_r - y_P)
    x1 = sheet.define("x1", sp.cos(turn) * dx + sp.sin(turn) * dy)
    x2 = sheet.define("x2", sp.cos(turn) * dy - sp.sin(turn) * dx)
    x3 = sheet.define("x3", wrapped(theta_r - turn))
    v_r, vl_r, omega_r = twist_r
    v, vl, omega = twist
    cos, sin = sp.cos(x3), sp.sin(x3)
    sheet.rates |= {
        x1: sheet.define("x1_dot", v_r * cos - vl_r * sin - v + x2 * omega),
        x2: sheet.define("x2_dot", v_r * sin + vl_r * cos - vl - x1 * omega),
        x3: sheet.define("x3_dot", omega_r - omega),
    }
    return Measured(twist_r, direction, given, (x1, x2, x3))


def wrapped(angle: sp.Expr) -> sp.Expr:
    """Return an angle wrapped into (−π, π]."""
    return angle - 2 * sp.pi * sp.ceiling((angle - sp.pi) / (2 * sp.pi))


def _twist_inputs(sheet: Sheet) -> tuple[sp.Symbol, ...]:
    """Name the reference's twist and its derivative."""
    symbols = []
    for i, (name, unit) in enumerate(zip(("v_r", "vl_r", "omega_r"), TWIST_UNITS, strict=True)):
        symbol = sheet.given(name, f"r->twist[{i}]", unit, f"{TWIST_WORDS[i]} of the reference")
        rate = sheet.given(f"{name}_dot", f"r->twist_dot[{i}]", f"{unit}^2", "its derivative")
        sheet.rates[symbol] = rate
        symbols.append(symbol)
    return tuple(symbols)


def _directions(sheet: Sheet) -> list[list[sp.Symbol]]:
    """Name the reference's direction of travel and two derivatives (3, 3)."""
    words = ("direction of travel; all 0: none", "its derivative", "its second derivative")
    return [
        [
            sheet.given(f"{letter}_{name}", f"r->direction[{row}][{i}]", "", of)
            for i, name in enumerate(("v", "l", "omega"))
        ]
        for row, (letter, of) in enumerate(zip(("g", "gdot", "gddot"), words, strict=True))
    ]


def _direction(
    sheet: Sheet, given: Sequence[Sequence[sp.Expr]], twist_r: Sequence[sp.Symbol]
) -> list[sp.Expr]:
    """Return the reference's direction of travel; where none is given, its twist."""
    size = sheet.define("g_square", sp.Add(*(g**2 for g in given[0])))
    found = []
    for i, name in ((0, "v"), (2, "omega")):
        symbol = sheet.moving(
            f"m_{name}",
            choice(0, size, given[0][i], twist_r[i]),
            choice(0, size, given[1][i], sheet.rates[twist_r[i]]),
        )
        found.append(symbol)
    return [found[0], sp.Integer(0), found[1]]


def base_twist(sheet: Sheet, robot: Robot, law: BaseLaw, at: Measured) -> list[sp.Expr]:
    """Write the twist that a law asks of the base, and its rate; return the twist (3,).

    Args:
        sheet: Where to write.
        robot: The robot.
        law: A kinematic law.
        at: Reference and error.
    """
    h = sheet.setting("h", law.horizon, "s", "prediction time")
    if robot.drive.omnidirectional:
        return _omnidirectional(sheet, at, h, law.leash)
    error = at.error if law.leash is None else _leashed(sheet, at.error, law.leash)
    if isinstance(law, UnifiedKinematic):
        return _unified(sheet, law, at._replace(error=error), h)
    assert isinstance(law, PaperKinematic)
    return _paper(sheet, law, at._replace(error=error), h)


def _paper(sheet: Sheet, law: PaperKinematic, at: Measured, h: sp.Symbol) -> list[sp.Expr]:
    """[MS21, Eq. 16-20]."""
    omega_r = at.twist_r[2]
    beta = sheet.setting("beta", law.beta, "", "weight of the lateral error")
    omega_d = sheet.follow("omega_d", omega_r + at.error[2] / h)
    if law.smoothing:
        slow = sheet.setting("omega_0", law.smoothing, "rad/s", "smoothing of the sign")
        b = sheet.follow("b", beta * omega_r / sp.sqrt(omega_r**2 + slow**2))
    else:
        b = sheet.define("b", beta * choice(0, omega_r, 1, choice(omega_r, 0, -1, 0)))
    return _coupled(sheet, at, omega_d, b, h)


def _unified(sheet: Sheet, law: UnifiedKinematic, at: Measured, h: sp.Symbol) -> list[sp.Expr]:
    """Write :class:`UnifiedKinematic`'s law."""
    (v_r, _, omega_r), (_, x2, x3) = at.twist_r, at.error
    beta = sheet.setting("beta", law.beta, "", "weight of the lateral error")
    kappa = sheet.setting("kappa", law.bend, "1/m", "curvature from which on a path is a turn")
    w = sheet.setting("w", law.weight, "m^2/rad^2", "weight of the heading error")
    p2 = sheet.follow("p2", x2 + h * v_r * sp.sin(x3))
    facing = sheet.define("facing", choice(0, sp.cos(x3), 1, 0))
    a = sheet.follow("a", facing * HALF * h**2 * v_r * sp.cos(x3))
    turn, size = a * p2 + w * h * x3, sheet.define("D", a**2 + w * h**2)
    d = sheet.define("d", turn / size)
    sheet.rates[d] = sheet.define("d_dot", (sheet.rate(turn) - 2 * d * a * sheet.rate(a)) / size)
    omega_d = sheet.follow("omega_d", omega_r + d)
    g_v, g_omega = at.direction[0], at.direction[2]
    square = sheet.define("s_square", g_omega**2 + (kappa * g_v) ** 2)
    length = sheet.define("s_size", sp.sqrt(choice(0, square, square, 1)))
    g_v_dot, g_omega_dot = sheet.rates[g_v], sheet.rates[g_omega]
    b = sheet.moving(
        "b",
        beta * g_omega / length,
        beta * kappa**2 * g_v * (g_omega_dot * g_v - g_omega * g_v_dot) / length**3,
    )
    return _coupled(sheet, at, omega_d, b, h)


def _coupled(
    sheet: Sheet, at: Measured, omega_d: sp.Expr, b: sp.Expr, h: sp.Symbol
) -> list[sp.Expr]:
    """Write the forward speed that lets x1 − b x2 decay at 1/h."""
    x1, x2, x3 = at.error
    v_r = at.twist_r[0]
    across = sheet.follow("c", v_r * sp.sin(x3) - x1 * omega_d)
    v_d = v_r * sp.cos(x3) + x2 * omega_d - b * across + (x1 - b * x2) / h
    return [sheet.follow("v_d", v_d), sp.Integer(0), omega_d]


def _omnidirectional(
    sheet: Sheet, at: Measured, h: sp.Symbol, leash: Leash | None
) -> list[sp.Expr]:
    """Write the twist that lets x1, x2 and x3 decay, each at 1/h."""
    v_r, vl_r, omega_r = at.twist_r
    turn = at.error[2]
    x1, x2, x3 = at.error if leash is None else _leashed(sheet, at.error, leash)
    omega_d = sheet.follow("omega_d", omega_r + x3 / h)
    cos, sin = sp.cos(turn), sp.sin(turn)
    ahead = sheet.follow("v_d", v_r * cos - vl_r * sin + x2 * omega_d + x1 / h)
    left = sheet.follow("vl_d", v_r * sin + vl_r * cos - x1 * omega_d + x2 / h)
    return [ahead, left, omega_d]


def _leashed(sheet: Sheet, error: Sequence[sp.Expr], leash: Leash) -> list[sp.Expr]:
    """Write the error on the leash: :class:`Leash`."""
    x1, x2, x3 = error
    x1_dot, x2_dot, x3_dot = (sheet.rates[x] for x in error)
    L = sheet.setting("L", leash.distance, "m", "leash of the position error")
    T = sheet.setting("T", leash.heading, "rad", "leash of the heading error")
    near = sp.Float(SERIES_RADIUS)
    u = sheet.define("u", sp.sqrt(x1**2 + x2**2) / L)
    far = sheet.define("u_far", choice(u, near, near, u))  # no quotient of zeros in either branch
    tanh = sp.tanh(far)
    series = 1 - u**2 / 3 + 2 * u**4 / 15, -sp.Rational(2, 3) + 8 * u**2 / 15
    scale = sheet.define("k", choice(u, near, series[0], tanh / far))
    curve = sheet.define("k_bend", choice(u, near, series[1], (1 - tanh**2 - scale) / far**2))
    along = sheet.define("k_dot", curve * (x1 * x1_dot + x2 * x2_dot) / L**2)
    turned = sheet.define("T_turn", sp.tanh(x3 / T))
    return [
        sheet.moving("y1", scale * x1, scale * x1_dot + along * x1),
        sheet.moving("y2", scale * x2, scale * x2_dot + along * x2),
        sheet.moving("y3", T * turned, (1 - turned**2) * x3_dot),
    ]
