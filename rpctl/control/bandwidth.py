"""Prediction times and gains of the arm's joints, from the bandwidth that they can have."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, require_positive


def by_velocity(dynamics: ReducedDynamics, base: float, joints: Array) -> Array:
    """Return a setting by quasi-velocity (dof,).

    Args:
        joints: Those of the arm's joints (n_joints,).
    """
    return np.concatenate([np.full(dynamics.robot.dof - len(joints), base), joints])


USUAL_PERIOD = 0.002  # s: of a controller whose own nobody knows
PHASE_LOSS = 0.5  # rad (29°) that lateness may take of the phase margin of 74°
RESERVE_S = 0.01  # s: lateness that nobody declares: a fieldbus, a drive's own loop, elasticity
PROPORTIONS = np.array([1.0, 4.0, 6.0])  # of 1/h : 1/h1 : k; the base's are about these
LINEAR_ERROR = 0.1  # rad or m: from here, at rest, a joint returns within its effort limit
LEAST_BANDWIDTH = 2.5  # Hz: about the base's; no effort limit makes a joint slower
MAX_BANDWIDTH = 1e4  # Hz; of a setting


class JointGains(NamedTuple):
    """Prediction times and gains of the arm's joints, each (n_joints,)."""

    bandwidth: Array  # Hz, where the open loop crosses over
    horizon: Array  # h of the kinematic law, s
    horizon_dyn: Array  # h1 of the dynamic law, s
    gain: Array  # k of the integral action, 1/s


def joint_gains(
    dynamics: ReducedDynamics, period: float = USUAL_PERIOD, delay: float = 0.0
) -> JointGains:
    """Return the gains of the fastest joint loops that sampling, delay and efforts allow.

    The dynamic law decouples the joints, so that the loop of each is, whatever its inertia,

        e⃛ = −(a + b + k) ë − (ab + bk + ak) ė − abk e,    a = 1/h,    b = 1/h1,

    with the poles −a, −b, −k. Its open loop falls as Ω/s beyond the poles, Ω = a + b + k, so it
    crosses over near Ω; a : b : k = 1 : 4 : 6 has a phase margin of 74°. The bandwidth is Ω/2π.

    - Sampling and delay: efforts that are held for a period T and come δ late turn the phase at Ω
      by Ω (T/2 + δ). With 10 ms in reserve for what no setting tells, that may take 29° of the 74°:
      Ω ≤ 0.5/(T/2 + δ + 10 ms). The sampled loop is then far from its limit, about Ω T = 2.
    - Efforts: an error of 0.1 rad (or m) at rest asks ν̇ = a b e. It takes no more than the effort
      limit leaves beside the weight at home, over the joint's own inertia, M_ii of the reduced M.
    - Inertia: along the direction of least inertia, as of wrist axes that are nearly in line, the
      stiffness is only m a b; no lower gain of one joint can mend that, a higher one of all does.
      The loop is stable up to ten times the model's inertia, as a rotor behind a gear may make it.

    The gains are those of the home posture; they do not change during a run.

    Args:
        period: Control period T, s.
        delay: Time δ from a measurement to the efforts it leads to, as far as it is known, s.
    """
    require_positive("period", period)
    robot = dynamics.robot
    late = 0.5 * period + delay + RESERVE_S
    by_phase = PHASE_LOSS / late / (2.0 * math.pi)
    a, b, _ = 2.0 * math.pi * PROPORTIONS / PROPORTIONS.sum()  # for a bandwidth of 1 Hz
    by_effort = np.sqrt(np.maximum(_accelerations(dynamics), 0.0) / (a * b * LINEAR_ERROR))
    found = np.minimum(by_phase, np.maximum(by_effort, LEAST_BANDWIDTH))
    return gains_of(found[: len(robot.joints)])


def gains_of(bandwidth: Array) -> JointGains:
    """Return the gains of a bandwidth by joint (n_joints,), Hz.

    Raises:
        RpctlError: One is not positive.
    """
    if not ((bandwidth > 0.0) & (bandwidth <= MAX_BANDWIDTH)).all():
        raise RpctlError(
            f"a bandwidth of {bandwidth} Hz; give more than 0, {MAX_BANDWIDTH:g} at most"
        )
    a, b, k = np.multiply.outer(PROPORTIONS / PROPORTIONS.sum(), 2.0 * math.pi * bandwidth)
    return JointGains(bandwidth, 1.0 / a, 1.0 / b, k)


def at_bandwidth(law: Any, bandwidth: float) -> Any:
    """Return a law, and those within it, whose joints have a bandwidth (Hz) instead of their own.

    Args:
        law: A kinematic or a dynamic law; one without settings of the joints comes back as it is.

    Raises:
        RpctlError: The bandwidth is not positive.
    """
    _, h, h1, k = (float(part[0]) for part in gains_of(np.array([bandwidth])))
    settings = {"joint_horizon": h, "joint_horizon_dyn": h1, "joint_gain": k}
    if not dataclasses.is_dataclass(law) or isinstance(law, type):
        return law
    changes: dict[str, Any] = {}
    for item in dataclasses.fields(law):
        value = getattr(law, item.name)
        if item.name in settings:
            changes[item.name] = settings[item.name]
        elif item.name in ("inner", "base", "fallback"):
            changes[item.name] = at_bandwidth(value, bandwidth)
    return dataclasses.replace(law, **changes)


def _accelerations(dynamics: ReducedDynamics) -> Array:
    """Return the accelerations (n_joints,) that each joint's own actuator can give it at home."""
    robot = dynamics.robot
    q = robot.configuration(joints=dict(zip(robot.joint_names, robot.home.tolist(), strict=True)))
    first = robot.dof - len(robot.joints)
    inertia = np.diag(dynamics.inertia(q))[first:]
    weight = np.abs(dynamics.bias(q, np.zeros(robot.dof)))[first:]
    limits = dict(zip(robot.actuators, robot.effort_limits.tolist(), strict=True))
    room = np.array([limits.get(name, math.inf) for name in robot.joint_names]) - weight
    return np.asarray(room / inertia)
