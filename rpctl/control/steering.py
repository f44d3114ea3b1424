"""Convert a desired twist of the base into its quasi-velocities: speeds and steering rates."""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.control.error import Twist
from rpctl.drive.steering import steer
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import ReferenceState
from rpctl.reference.quasi_velocities import direction, steering

SLOW_SPEED = 0.1  # m/s: well below it steering follows the reference, well above it the twist
STEERING_HORIZON_RATIO = 0.25  # of the law's horizon: steering has to be faster than the base
# Largest deviation of the steering direction from the reference's unit direction.
AXLE_MAX_DEVIATION = 1.0  # of bases with an axle
STEERED_MAX_DEVIATION = 0.8  # of other bases, as a fraction of the largest possible one, ...
MIN_DEVIATION = 0.2  # ... but at least this
RATE_FRACTION = 0.9  # of a steered joint's fastest rate: the largest one commanded
BRAKE_TIME = 0.3  # s: approach to a steering limit, twice the dynamic law's horizon
ANGLE_MARGIN = 0.02  # rad between a commanded steering angle and the joint's limits


def base_command(
    dynamics: ReducedDynamics, state: ReferenceState, q: Array, nu: Array, twist: Twist, h: float
) -> tuple[Array, Array]:
    """Return the base's part of ν_d and of ν̇_d, for a twist that it follows as far as it can.

    Without steered wheels these are the twist's own entries. Steered wheels turn towards
    m = ĝ + u t⊥/(u² + ρ²): ĝ is the reference's direction, u and t⊥ are the twist's parts along
    and across it. At speed m is the twist's own direction; near standstill, where the direction of
    a small twist says nothing, m tends to ĝ; far off ĝ it is drawn back smoothly. The angles δ*
    and their rates are exact; then

        δ̇_d = δ̇* + (δ* − δ)/h_s,    δ̈_d = δ̈_r + (δ̇* − δ̇)/h_s,    h_s = h/4,

    predictive laws of first order, whose one approximation is the reference's δ̈_r for δ̈*.

    Args:
        twist: Desired twist of the base.
        h: Prediction time of the law, s.
    """
    drive = dynamics.robot.drive
    if not drive.steered:
        keep = [0, 2] if drive.has_axle else list(range(len(drive.base_speeds)))
        return twist.value[keep], twist.rate[keep]
    rates, accelerations = _steering(dynamics, state, q, nu, twist, STEERING_HORIZON_RATIO * h)
    speed = twist.value[0], twist.rate[0]
    if not drive.has_axle:
        speed = _rolling(dynamics, q, nu, accelerations, twist)
    return np.array([speed[0], *rates]), np.array([speed[1], *accelerations])


def _rolling(
    dynamics: ReducedDynamics, q: Array, nu: Array, accelerations: Array, twist: Twist
) -> tuple[float, float]:
    """Return the base's speed ν₁, and its rate, whose twist is nearest to the desired one.

    With the present steering the twist is T = n ν₁ + T_δ, T_δ the part due to steering rates of
    wheels beside their axis: ν₁ = n·(t − T_δ)/n·n. Ṡ is linear in the steering rates and does not
    depend on ν₁, so ṅ is the difference of two drifts.

    Args:
        accelerations: Commanded accelerations of the steered joints (n_steered,).
        twist: Desired twist of the base.
    """
    robot, count = dynamics.robot, len(dynamics.robot.drive.steered)
    weights = twist_weights(dynamics)
    unit, turning, turned = np.eye(robot.dof)[0], np.zeros(robot.dof), np.zeros(robot.dof)
    turning[1 : 1 + count], turned[1 : 1 + count] = nu[1 : 1 + count], accelerations
    drift = dynamics.basis_drift(q, turning)
    n = dynamics.twist(q, unit)
    n_dot = robot.point_velocity @ (dynamics.basis_drift(q, turning + unit) - drift)[:3]
    t = twist.value - dynamics.twist(q, turning)
    t_dot = twist.rate - dynamics.twist(q, turned) - robot.point_velocity @ drift[:3]
    square = n @ (weights * n)
    speed = float(n @ (weights * t) / square)
    rate = n_dot @ (weights * t) + n @ (weights * t_dot)
    return speed, float((rate - 2.0 * speed * (n @ (weights * n_dot))) / square)


def _steering(
    dynamics: ReducedDynamics, state: ReferenceState, q: Array, nu: Array, twist: Twist, h: float
) -> tuple[Array, Array]:
    """Return the commanded rates and accelerations (n_steered,) of the steered joints."""
    robot = dynamics.robot
    wanted, wanted_rate = steering_targets(dynamics, state, twist)
    feedforward = steering(robot, state)[2]
    steered = robot.drive.steered
    actual = np.array([robot.joint_position(q, swivel.joint) for swivel in steered])
    rates = nu[1 : 1 + len(steered)]
    # A wheel may as well roll backwards: δ* counts modulo π.
    wanted = wanted + math.pi * np.round((actual - wanted) / math.pi)
    limits = robot.steering_limits
    lower, upper, fastest = (
        limits.lower + ANGLE_MARGIN,
        limits.upper - ANGLE_MARGIN,
        RATE_FRACTION * limits.fastest,
    )
    held = (wanted < lower) | (wanted > upper)
    wanted = np.clip(wanted, lower, upper)
    wanted_rate = np.where(held, 0.0, wanted_rate)
    asked = wanted_rate + (wanted - actual) / h
    change = np.where(held, 0.0, feedforward) + (wanted_rate - rates) / h
    # The nearer a limit, the slower towards it: (limit − δ)/BRAKE_TIME, which never passes it.
    least = np.maximum(-fastest, (lower - actual) / BRAKE_TIME)
    most = np.minimum(fastest, (upper - actual) / BRAKE_TIME)
    bound = np.clip(asked, least, most)
    braking = (bound != asked) & (np.abs(bound) < fastest)
    change = np.where(bound != asked, 0.0, change)
    return bound, np.where(braking, -rates / BRAKE_TIME, change)


def steering_targets(dynamics: ReducedDynamics, state: ReferenceState, twist: Twist) -> Array:
    """Return the angles δ* that take the base along m, and their rates, (2, n_steered).

    Args:
        twist: Desired twist of the base.
    """
    robot = dynamics.robot
    return steer(robot.drive, _direction(dynamics, state, twist) @ robot.root_velocity.T)[:2]


def _direction(dynamics: ReducedDynamics, state: ReferenceState, twist: Twist) -> Array:
    """Return m, ṁ and zeros (3, 3): the direction in which the wheels steer the base."""
    weights = twist_weights(dynamics)
    g, g_dot, _ = direction(state)
    size = math.sqrt(g @ (weights * g))
    g_hat = g / size
    g_hat_dot = (g_dot - g_hat * (g_hat @ (weights * g_dot))) / size
    t, t_dot = twist
    u = g_hat @ (weights * t)
    u_dot = g_hat_dot @ (weights * t) + g_hat @ (weights * t_dot)
    across = t - u * g_hat
    across_dot = t_dot - u_dot * g_hat - u * g_hat_dot
    square = u**2 + SLOW_SPEED**2
    direction_gain, direction_gain_dot = u / square, u_dot * (SLOW_SPEED**2 - u**2) / square**2
    deviation, deviation_dot = (
        direction_gain * across,
        direction_gain_dot * across + direction_gain * across_dot,
    )
    most = max_deviation(dynamics)
    scale = 1.0 / math.sqrt(1.0 + deviation @ (weights * deviation) / most**2)
    scale_dot = -(scale**3) * (deviation @ (weights * deviation_dot)) / most**2
    rate = g_hat_dot + scale * deviation_dot + scale_dot * deviation
    return np.array([g_hat + scale * deviation, rate, np.zeros(3)])


def max_deviation(dynamics: ReducedDynamics) -> float:
    """Return the largest deviation of m from ĝ that leaves the steering well defined.

    Where only steered wheels carry the base, its centre of rotation must not lie on the line
    through the first two steered pivots: there their axles do not determine it.
    """
    drive = dynamics.robot.drive
    if drive.has_axle:
        return AXLE_MAX_DEVIATION
    first, second = (np.array(swivel.pivot) for swivel in drive.steered[:2])
    along, off = second - first, np.array(drive.point) - first
    apart = abs(along[0] * off[1] - along[1] * off[0]) / float(np.linalg.norm(along))
    reach = math.sqrt(twist_weights(dynamics)[2])
    return max(STEERED_MAX_DEVIATION * apart / reach, MIN_DEVIATION)


def twist_weights(dynamics: ReducedDynamics) -> Array:
    """Return the weights (3,) of a twist's entries: turning counts by the steered wheels' reach."""
    drive = dynamics.robot.drive
    reach = max(math.dist(drive.point, swivel.pivot) for swivel in drive.steered)
    return np.array([1.0, 1.0, reach**2])
