"""The twist that each kinematic law asks of the base, in CasADi's symbols, and its rate.

Each law is written once, as in its class in :mod:`rpctl.control`; its rate along the motion is the
derivative of that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.control.error import BASE_ERRORS, SERIES_RADIUS
from rpctl.control.feedback_linearization import SPIN_RADIUS, FeedbackLinearization
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.twist_law import BaseLaw
from rpctl.control.unified import UnifiedKinematic
from rpctl.simulation.compiled.laws.steering import symbolic_base_command
from rpctl.simulation.compiled.laws.tracking import (
    Moving,
    ReferenceEntries,
    Settings,
    SymbolicTracking,
    SymbolicTwist,
    by_name,
    reference_entries,
    symbolic_tracking,
)
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics


@dataclass(frozen=True, eq=False)
class _Observed:
    """What a law reads, in symbols whose rates are known.

    Attributes:
        x: The base's error (3, 1), on the leash where the law has one.
        twist: The reference's (3, 1).
        direction: The reference's direction of travel (3, 1).
        s: Settings by name.
    """

    x: Any
    twist: Any
    direction: Any
    s: Settings


def base_twist(
    law: BaseLaw,
    omnidirectional: bool,
    reference: ReferenceEntries,
    tracking: SymbolicTracking,
    s: Settings,
) -> SymbolicTwist:
    """Return the twist that a law asks of the base.

    Args:
        law: Which law; the numbers among its settings are in ``s``.
        omnidirectional: Whether the base can move in any direction.
        reference: The reference.
        tracking: The tracking error.
        s: Settings by name.
    """
    moving = Moving()
    x = moving.add(tracking.e[:BASE_ERRORS], tracking.e_dot[:BASE_ERRORS])
    twist = moving.add(reference.twist, reference.twist_dot)
    direction = moving.add(reference.direction[0], reference.direction[1])
    held = x if law.leash is None else _leashed(x, s)
    if omnidirectional:
        asked = _omnidirectional(held, x[2], twist, s)
    elif isinstance(law, FeedbackLinearization):
        asked = _linearizing(moving, _Observed(held, twist, x[2], s), reference, tracking)
    elif isinstance(law, Kanayama):
        asked = _kanayama(_Observed(held, twist, direction, s))
    elif isinstance(law, UnifiedKinematic):
        asked = _unified(_Observed(held, twist, direction, s))
    else:
        assert isinstance(law, PaperKinematic)
        asked = _paper(_Observed(held, twist, direction, s), bool(law.smoothing))
    return SymbolicTwist(*moving.with_rate(asked))


def refuses(law: BaseLaw, omnidirectional: bool, reference: ReferenceEntries) -> Any:
    """Return whether (0 or 1) a law cannot follow a reference at a time.

    Args:
        law: The law.
        omnidirectional: Whether the base can move in any direction.
        reference: The reference.
    """
    if omnidirectional or not isinstance(law, FeedbackLinearization):
        return casadi.SX(0)
    v_r, _, omega_r = casadi.vertsplit(reference.twist)
    return casadi.fabs(v_r) < SPIN_RADIUS * casadi.fabs(omega_r)


def _leashed(x: Any, s: Settings) -> Any:
    """Return the base's error on the leash; :class:`rpctl.control.error.Leash`."""
    square = (x[0] ** 2 + x[1] ** 2) / s["leash.distance"] ** 2  # u²
    u = casadi.sqrt(casadi.fmax(square, SERIES_RADIUS**2))
    series = 1.0 - square / 3.0 + 2.0 * square**2 / 15.0
    scale = casadi.if_else(square < SERIES_RADIUS**2, series, casadi.tanh(u) / u)
    heading = s["leash.heading"]
    return casadi.vertcat(scale * x[:2], heading * casadi.tanh(x[2] / heading))


def _omnidirectional(x: Any, heading_error: Any, twist: Any, s: Settings) -> Any:
    """See :func:`rpctl.control.error.omnidirectional_twist`."""
    vx_r, vy_r, omega_r = casadi.vertsplit(twist)
    h = s["horizon"]
    cos, sin = casadi.cos(heading_error), casadi.sin(heading_error)
    omega_d = omega_r + x[2] / h
    return casadi.vertcat(
        vx_r * cos - vy_r * sin + x[1] * omega_d + x[0] / h,
        vx_r * sin + vy_r * cos - x[0] * omega_d + x[1] / h,
        omega_d,
    )


def _paper(at: _Observed, smooth: bool) -> Any:
    omega_r = at.twist[2]
    sign = casadi.sign(omega_r)
    if smooth:
        sign = omega_r / casadi.sqrt(omega_r**2 + at.s["smoothing"] ** 2)
    return _coupled(at, omega_r + at.x[2] / at.s["horizon"], at.s["beta"] * sign)


def _unified(at: _Observed) -> Any:
    h, w, v = at.s["horizon"], at.s["weight"], at.twist[0]
    cos, sin = casadi.cos(at.x[2]), casadi.sin(at.x[2])
    p2 = at.x[1] + h * v * sin
    a = casadi.if_else(cos > 0.0, 0.5 * h**2 * v * cos, 0.0)
    d = (a * p2 + w * h * at.x[2]) / (a**2 + w * h**2)
    along, _, turn = casadi.vertsplit(at.direction)
    square = turn**2 + (at.s["bend"] * along) ** 2
    known = square > 0.0
    size = casadi.sqrt(casadi.if_else(known, square, 1.0))
    sign = casadi.if_else(known, turn / size, 0.0)
    return _coupled(at, at.twist[2] + d, at.s["beta"] * sign)


def _coupled(at: _Observed, omega_d: Any, b: Any) -> Any:
    """See :func:`rpctl.control.kinematic.coupled`."""
    x1, x2, x3 = casadi.vertsplit(at.x)
    v_r = at.twist[0]
    drift = v_r * casadi.sin(x3) - x1 * omega_d
    v_d = v_r * casadi.cos(x3) + x2 * omega_d - b * drift + (x1 - b * x2) / at.s["horizon"]
    return casadi.vertcat(v_d, 0.0, omega_d)


def _kanayama(at: _Observed) -> Any:
    (v_r, _, omega_r), (x1, x2, x3) = casadi.vertsplit(at.twist), casadi.vertsplit(at.x)
    gain = at.s["ky"] * x2 + casadi.sign(v_r) * at.s["ktheta"] * casadi.sin(x3)
    return casadi.vertcat(v_r * casadi.cos(x3) + at.s["kx"] * x1, 0.0, omega_r + v_r * gain)


def _linearizing(
    moving: Moving, at: _Observed, reference: ReferenceEntries, tracking: SymbolicTracking
) -> Any:
    """Return the twist of :class:`FeedbackLinearization`, whose own speed has the rate u₁.

    Args:
        moving: Gets the robot's own speed and the reference's acceleration.
        at: What the law reads; its direction is the heading error (1, 1) off the leash.
        reference: The reference.
        tracking: The tracking error, without the symbols of ``moving``.
    """
    v_r, _, omega_r = casadi.vertsplit(at.twist)
    (x1, x2, _), s = casadi.vertsplit(at.x), at.s
    cos, sin = casadi.cos(at.direction), casadi.sin(at.direction)
    a_r = moving.add(reference.twist_dot[0], _jerk(reference))
    v = casadi.SX.sym("own_speed")
    across = v_r * omega_r
    u1 = a_r * cos - across * sin + s["kd"] * (v_r * cos - v) + s["kp"] * x1
    u2 = a_r * sin + across * cos + s["kd"] * v_r * sin + s["kp"] * x2
    moving.follow(v, _own_speed(reference, tracking), u1)
    slow = casadi.fabs(v) < s["slowest"]
    inverse = casadi.if_else(
        slow, v / s["slowest"] ** 2, 1.0 / casadi.if_else(slow, s["slowest"], v)
    )
    return casadi.vertcat(v, 0.0, u2 * inverse)


def _own_speed(reference: ReferenceEntries, tracking: SymbolicTracking) -> Any:
    """Return the robot's own speed ahead, which ẋ1 tells."""
    e, e_dot = tracking.e, tracking.e_dot
    omega = reference.twist[2] - e_dot[2]
    return reference.twist[0] * casadi.cos(e[2]) + e[1] * omega - e_dot[0]


def _jerk(reference: ReferenceEntries) -> Any:
    """Return v̈_r of a reference that keeps its pace along its direction."""
    along, _, twice = reference.direction
    square = casadi.dot(along, along)
    pace = casadi.dot(reference.twist, along) / casadi.if_else(square > 0.0, square, 1.0)
    return twice[0] * pace


@dataclass(frozen=True, eq=False)
class SymbolicCommand:
    """What a kinematic law makes of a sample.

    Attributes:
        e: Tracking error (3 + n_joints, 1).
        nu_d: Desired quasi-velocities (dof, 1).
        nu_d_dot: Their derivatives along the motion (dof, 1).
        failed: Whether the law has no answer (1, 1).
    """

    e: Any
    nu_d: Any
    nu_d_dot: Any
    failed: Any


def symbolic_command(
    law: BaseLaw, dynamics: SymbolicDynamics, row: Any, q: Any, nu: Any, s: Settings
) -> SymbolicCommand:
    """Return what a kinematic law asks for, as :class:`rpctl.control.twist_law.BaseController`.

    Args:
        law: The law.
        dynamics: The robot's dynamics, as far as the controller knows them.
        row: Row of a reference table.
        q: Configuration (nq, 1).
        nu: Quasi-velocities (dof, 1).
        s: Settings by name.
    """
    robot = dynamics.robot
    drive = robot.drive
    reference = reference_entries(row, len(robot.joints))
    tracking = symbolic_tracking(dynamics, reference, q, nu)
    h = by_name(s, "joint_horizon", robot.joint_names)
    wanted = reference.joint_rates + tracking.e[BASE_ERRORS:] / h
    rates = reference.joint_accelerations + tracking.e_dot[BASE_ERRORS:] / h
    failed = casadi.SX(0)
    if drive.base_speeds:
        twist = base_twist(law, drive.omnidirectional, reference, tracking, s)
        base = symbolic_base_command(dynamics, reference, q, nu, twist, s["horizon"])
        wanted, rates = casadi.vertcat(base[0], wanted), casadi.vertcat(base[1], rates)
        failed = refuses(law, drive.omnidirectional, reference)
    return SymbolicCommand(tracking.e, wanted, rates, failed)
