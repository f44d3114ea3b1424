"""The error kinematics of [MS21, Eq. 10] alone: a base that does at once what it is asked."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from rpctl.control.error import error_rate
from rpctl.control.kinematic import KinematicLaw
from rpctl.description.records import Array
from rpctl.reference.motion import ReferenceState


def steady(v: float, omega: float) -> ReferenceState:
    """Return a reference of constant speeds; the pose does not matter to the errors."""
    return ReferenceState(np.zeros(3), np.empty(0), np.array([v, omega]), np.zeros(2))


def follow(law: KinematicLaw, reference: ReferenceState, e: Array, times: Array) -> Array:
    """Return the errors (len(times), 3) of a base that follows a law without delay."""

    def rate(_: float, x: Array) -> Array:
        return error_rate(x, reference, law(reference, x, np.zeros(2)).nu_d)

    solution = solve_ivp(rate, (0.0, times[-1]), e, t_eval=times, rtol=1e-11, atol=1e-13)
    return np.asarray(solution.y.T)


def sampled_step(law: KinematicLaw, reference: ReferenceState, e: Array, period: float) -> Array:
    """Return the error one period on, the law's speeds held (exact circular arcs)."""
    v_d, omega_d = law(reference, e, np.zeros(2)).nu_d
    actual = _arc(np.zeros(3), v_d, omega_d, period)
    v_r, omega_r = reference.nu
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
