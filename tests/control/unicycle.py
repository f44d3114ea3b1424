"""The error kinematics of [MS21, Eq. 10] alone: a base that does at once what it is asked."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from rpctl.arrays import Array
from rpctl.control.error import Tracking, Twist, error_rate
from rpctl.reference.motion import ReferenceState
from rpctl.reference.paths import Path

NO_JOINTS = np.empty(0)
TwistLaw = Callable[[Tracking], Twist]
StateOverTime = Callable[[float], ReferenceState]


def steady(v: float, omega: float) -> ReferenceState:
    """Return a reference of constant speeds; the pose does not matter to the errors."""
    twist = np.array([v, 0.0, omega])
    return ReferenceState(np.zeros(3), twist, np.zeros(3), NO_JOINTS, NO_JOINTS, NO_JOINTS)


def along(path: Path, rate: float) -> StateOverTime:
    """Return a base path as a motion of steady pace from the first moment on."""

    def at(t: float) -> ReferenceState:
        point = path(rate * t)
        twist, bend, _ = point.direction
        return ReferenceState(
            point.pose, twist * rate, bend * rate**2, NO_JOINTS, NO_JOINTS, NO_JOINTS
        )

    return at


def asked(law: TwistLaw, reference: ReferenceState, e: Array) -> Array:
    """Return the twist (3,) that a law asks of a base at rest."""
    return law(Tracking(reference, e, error_rate(e, reference, np.zeros(3), NO_JOINTS))).value


def follow(
    law: TwistLaw,
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
        return error_rate(x, state, asked(law, state, x), NO_JOINTS)

    rtol, atol = accuracy
    solution = solve_ivp(rate, (0.0, times[-1]), e, t_eval=times, rtol=rtol, atol=atol)
    return np.asarray(solution.y.T)


def jacobian(law: TwistLaw, reference: ReferenceState, step: float = 1e-6) -> Array:
    """Return the Jacobian (3, 3) of ė on the reference, by central differences."""

    def rate(x: Array) -> Array:
        return error_rate(x, reference, asked(law, reference, x), NO_JOINTS)

    return np.column_stack([(rate(e) - rate(-e)) / (2.0 * step) for e in step * np.eye(3)])


def sampled_step(law: TwistLaw, reference: ReferenceState, e: Array, period: float) -> Array:
    """Return the error one period on, the law's speeds held (exact circular arcs)."""
    v_d, _, omega_d = asked(law, reference, e)
    actual = _arc(np.zeros(3), v_d, omega_d, period)
    v_r, _, omega_r = reference.twist
    ahead = _arc(e, v_r, omega_r, period)
    dx, dy, turn = ahead - actual
    cos, sin = math.cos(actual[2]), math.sin(actual[2])
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx, turn])


def _arc(pose: Array, v: float, omega: float, time: float) -> Array:
    half = 0.5 * omega * time
    chord = v * time * np.sinc(half / math.pi)
    x, y, heading = pose
    middle = heading + half
    return np.array(
        [x + chord * math.cos(middle), y + chord * math.sin(middle), heading + 2 * half]
    )
