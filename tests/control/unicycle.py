"""The error kinematics of [MS21, Eq. 10] alone: a base that does at once what it is asked."""

from __future__ import annotations

import math as numbers
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.error import Tracking, base_error_rate
from rpctl.control.steering import reference_direction
from rpctl.control.twist_law import BaseLaw
from rpctl.kernels.sheet import Evaluator, Sheet
from rpctl.reference.motion import ReferenceState
from rpctl.reference.paths import Path

NO_JOINTS, STILL = np.empty(0), np.zeros(3)
StateOverTime = Callable[[float], ReferenceState]


def steady(v: float, omega: float) -> ReferenceState:
    """Return a reference of constant speeds; the pose does not matter to the errors."""
    twist = np.array([v, 0.0, omega])
    return ReferenceState(np.zeros(3), twist, np.zeros(3), NO_JOINTS, NO_JOINTS, NO_JOINTS)


def along(path: Path, rate: float) -> StateOverTime:
    """Return a base path as a motion of steady pace from the first moment on."""

    def at(t: float) -> ReferenceState:
        point = path(rate * t)
        twist, bend = point.twist
        return ReferenceState(
            point.pose, twist * rate, bend * rate**2, NO_JOINTS, NO_JOINTS, NO_JOINTS
        )

    return at


class Twist(NamedTuple):
    """Speed forward, to the left and turning rate, and their derivatives along the motion."""

    value: Array  # (3,)
    rate: Array  # (3,)


@cache
def evaluator(law: BaseLaw) -> Evaluator:
    """Return a law without its leash as a function of reference, error and the robot's twist."""
    sheet, column = Sheet(), math.SX.sym("column", 15 + 3 + 3)
    twist, twist_dot, *direction, e, own = (
        math.vertsplit(part) for part in math.vertsplit(column, list(range(0, 22, 3)))
    )
    state = ReferenceState(e, twist, twist_dot, e, e, e, direction)  # type: ignore[arg-type]
    for symbol, rate in zip(
        [*twist, *e], [*twist_dot, *base_error_rate(e, twist, own)], strict=True
    ):
        sheet.moves(symbol, rate)
    at = Tracking(sheet, twist, twist_dot, reference_direction(sheet, state), e, e, own)
    speed, turn = law.with_numbers(law.numbers()).unicycle(at)
    value, rate = (
        math.vertcat(*row) for row in ((speed, turn), (sheet.rate(speed), sheet.rate(turn)))
    )
    return Evaluator(math.Function("twist", [column], sheet.resolved([value, rate])))


def twist_of(law: BaseLaw, reference: ReferenceState, e: Array, own: Array = STILL) -> Twist:
    """Return what a law asks of a base that moves with a twist (3,)."""
    direction = np.zeros(9) if reference.direction is None else np.ravel(reference.direction)
    parts = reference.twist, reference.twist_dot, direction, e, own
    found = evaluator(law)(np.concatenate(parts))
    return Twist(*(np.array([speed, 0.0, turn]) for speed, turn in found))


def asked(law: BaseLaw, reference: ReferenceState, e: Array) -> Array:
    """Return the twist (3,) that a law asks of a base at rest."""
    return twist_of(law, reference, e).value


def error_rate(e: Array, reference: ReferenceState, twist: Array) -> Array:
    """Return the rates (3,) of x1, x2, x3: [MS21, Eq. 10], with speeds to the left."""
    (x1, x2, x3), (vx_r, vy_r, omega_r), (vx, vy, omega) = e, reference.twist, twist
    cos, sin = np.cos(x3), np.sin(x3)
    ahead, left = vx_r * cos - vy_r * sin, vx_r * sin + vy_r * cos
    return np.array([ahead - vx + x2 * omega, left - vy - x1 * omega, omega_r - omega])


def follow(
    law: BaseLaw,
    reference: ReferenceState | StateOverTime,
    e: Array,
    times: Array,
    accuracy: tuple[float, float] = (1e-11, 1e-13),
) -> Array:
    """Return the errors (len(times), 3) of a base that follows a law without delay.

    ``accuracy`` is the integration's, relative and absolute.
    """

    def rate(t: float, x: Array) -> Array:
        state = reference(t) if callable(reference) else reference
        return error_rate(x, state, asked(law, state, x))

    rtol, atol = accuracy
    solution = solve_ivp(rate, (0.0, times[-1]), e, t_eval=times, rtol=rtol, atol=atol)
    return np.asarray(solution.y.T)


def jacobian(law: BaseLaw, reference: ReferenceState, step: float = 1e-6) -> Array:
    """Return the Jacobian (3, 3) of ė on the reference, by central differences."""

    def rate(x: Array) -> Array:
        return error_rate(x, reference, asked(law, reference, x))

    return np.column_stack([(rate(e) - rate(-e)) / (2.0 * step) for e in step * np.eye(3)])


def sampled_step(law: BaseLaw, reference: ReferenceState, e: Array, period: float) -> Array:
    """Return the error one period on, the law's speeds held (exact circular arcs)."""
    v_d, _, omega_d = asked(law, reference, e)
    actual = _arc(np.zeros(3), v_d, omega_d, period)
    v_r, _, omega_r = reference.twist
    ahead = _arc(e, v_r, omega_r, period)
    dx, dy, turn = ahead - actual
    cos, sin = numbers.cos(actual[2]), numbers.sin(actual[2])
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx, turn])


def _arc(pose: Array, v: float, omega: float, time: float) -> Array:
    half = 0.5 * omega * time
    chord = v * time * np.sinc(half / numbers.pi)
    x, y, heading = pose
    middle = heading + half
    return np.array(
        [x + chord * numbers.cos(middle), y + chord * numbers.sin(middle), heading + 2 * half]
    )
