"""From a twist that the base should have to what its wheels can do: speeds and steering."""

from __future__ import annotations

import math

import numpy as np

from rpctl.control.twist import Twist
from rpctl.description.records import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import ReferenceState
from rpctl.reference.rates import direction, steering
from rpctl.robot.steering import steer

SLOW = 0.1  # m/s: well below it steering keeps to the reference, well above it to the twist
SHARE = 0.25  # of the law's horizon: steering has to be faster than what it serves
ROOM = 0.02  # rad that a commanded steering angle keeps from the joint's limits


def base_command(
    dynamics: ReducedDynamics, state: ReferenceState, q: Array, nu: Array, twist: Twist, h: float
) -> tuple[Array, Array]:
    """Return the base's part of ν_d and of ν̇_d, which give it a twist as far as it can have it.

    Without steered wheels these are the twist's own entries. Steered wheels turn towards
    m = ĝ + u t⊥/(u² + ρ²): ĝ is the reference's direction, u and t⊥ are the twist's parts along
    and across it. At speed m is the twist's own direction; near standstill, where the direction of
    a small twist says nothing, m tends to ĝ. The angles δ* and their rates are exact; then

        δ̇_d = δ̇* + (δ* − δ)/h_s,    δ̈_d = δ̈_r + (δ̇* − δ̇)/h_s,    h_s = h/4,

    predictive laws of first order, whose one approximation is the reference's δ̈_r for δ̈*.

    Args:
        dynamics: The robot's dynamics.
        state: The reference.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        twist: What to ask of the base.
        h: Prediction time of the law, s.
    """
    drive = dynamics.robot.drive
    if not drive.steered:
        keep = [0, 2] if drive.has_axle else list(range(len(drive.base_speeds)))
        return twist.value[keep], twist.rate[keep]
    speed = (twist.value[0], twist.rate[0]) if drive.has_axle else _rolling(dynamics, q, nu, twist)
    rates, accelerations = _steering(dynamics, state, q, nu, twist, SHARE * h)
    return np.array([speed[0], *rates]), np.array([speed[1], *accelerations])


def _rolling(dynamics: ReducedDynamics, q: Array, nu: Array, twist: Twist) -> tuple[float, float]:
    """Return the base's speed, and its rate, whose twist is nearest to the one asked for.

    T = n ν₁ with the steering as it is: ν₁ = n·t/n·n. Ṡ is linear in the rates of steering, of
    which ν₁ has none, so ṅ is the difference of two drifts.
    """
    robot = dynamics.robot
    weights = _weights(dynamics)
    unit = np.eye(robot.dof)[0]
    n = dynamics.twist(q, unit)
    change = dynamics.basis_drift(q, nu + unit) - dynamics.basis_drift(q, nu)
    n_dot = robot.point_velocity @ change[:3]
    square = n @ (weights * n)
    speed = float(n @ (weights * twist.value) / square)
    rate = n_dot @ (weights * twist.value) + n @ (weights * twist.rate)
    return speed, float((rate - 2.0 * speed * (n @ (weights * n_dot))) / square)


def _steering(
    dynamics: ReducedDynamics, state: ReferenceState, q: Array, nu: Array, twist: Twist, h: float
) -> tuple[Array, Array]:
    """Return the steered joints' rates and accelerations (n_steered,) to ask for."""
    robot = dynamics.robot
    towards = _direction(dynamics, state, twist) @ robot.root_velocity.T
    wanted, wanted_rate, _ = steer(robot.drive, towards)
    feedforward = steering(robot, state)[2]
    steered = robot.drive.steered
    actual = np.array([robot.joint_position(q, swivel.joint) for swivel in steered])
    rates = nu[1 : 1 + len(steered)]
    wanted = wanted + math.pi * np.round((actual - wanted) / math.pi)  # heading back is as good
    joints = [robot.description.joint[swivel.joint] for swivel in steered]
    lower = np.array([joint.lower + ROOM for joint in joints])
    upper = np.array([joint.upper - ROOM for joint in joints])
    fastest = np.array([joint.velocity for joint in joints])
    held = (wanted < lower) | (wanted > upper)
    wanted = np.clip(wanted, lower, upper)
    wanted_rate = np.where(held, 0.0, wanted_rate)
    asked = wanted_rate + (wanted - actual) / h
    change = np.where(held, 0.0, feedforward) + (wanted_rate - rates) / h
    limited = np.abs(asked) > fastest
    return np.clip(asked, -fastest, fastest), np.where(limited, 0.0, change)


def _direction(dynamics: ReducedDynamics, state: ReferenceState, twist: Twist) -> Array:
    """Return m, ṁ and zeros (3, 3): where steered wheels are to take the base."""
    weights = _weights(dynamics)
    g, g_dot, _ = direction(state)
    size = math.sqrt(g @ (weights * g))
    g_hat = g / size
    g_hat_dot = (g_dot - g_hat * (g_hat @ (weights * g_dot))) / size
    t, t_dot = twist
    u = g_hat @ (weights * t)
    u_dot = g_hat_dot @ (weights * t) + g_hat @ (weights * t_dot)
    across = t - u * g_hat
    across_dot = t_dot - u_dot * g_hat - u * g_hat_dot
    square = u**2 + SLOW**2
    trust, trust_dot = u / square, u_dot * (SLOW**2 - u**2) / square**2
    rate = g_hat_dot + trust_dot * across + trust * across_dot
    return np.array([g_hat + trust * across, rate, np.zeros(3)])


def _weights(dynamics: ReducedDynamics) -> Array:
    """Return the weights (3,) of a twist's entries: turning counts by the steered wheels' reach."""
    drive = dynamics.robot.drive
    reach = max(math.dist(drive.point, swivel.pivot) for swivel in drive.steered)
    return np.array([1.0, 1.0, reach**2])
