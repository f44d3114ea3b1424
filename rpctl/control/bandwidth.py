"""Prediction times and gains of base and joints, from the bandwidth that lateness leaves them."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, require_positive

USUAL_PERIOD = 0.002  # s: of a controller whose own nobody knows
PHASE_LOSS = 0.8  # rad (46°) that lateness may take of the phase margin of 74°
LATENESS_S = 0.05  # s: that nobody declares: a network, a drive's own loop, elasticity
# s, and of a delay: what is late beside a delay that is told, and by how much that may be wrong.
TOLD_LATENESS_S, DELAY_ERROR = 0.016, 0.3
MOST_GAIN = 15.0  # 1/s, k of a base: on contact more leaves it no nearer, and shakes it
PROPORTIONS = np.array([1.0, 4.0, 6.0])  # of 1/h : 1/h1 : k
MAX_BANDWIDTH = 1e4  # Hz; of a setting


class Gains(NamedTuple):
    """Prediction times and gains of a bandwidth."""

    bandwidth: float  # Hz, where the open loop crosses over
    horizon: float  # h of the kinematic law, s
    horizon_dyn: float  # h1 of the dynamic law, s
    gain: float  # k of the integral action, 1/s


def usual_gains(period: float) -> Gains:
    """Return the gains of base and joints where none are set: they withstand a delay of 50 ms.

    The dynamic law decouples the quasi-velocities, so that the loop of each is, whatever its
    inertia,

        e⃛ = −(a + b + k) ë − (ab + bk + ak) ė − abk e,    a = 1/h,    b = 1/h1,

    with the poles −a, −b, −k. Its open loop falls as Ω/s beyond the poles, Ω = a + b + k, so it
    crosses over near Ω; a : b : k = 1 : 4 : 6 has a phase margin of 74°. The bandwidth is Ω/2π.

    - Sampling and delay: efforts that are held for a period T and come δ late turn the phase at Ω
      by Ω (T/2 + δ). With δ = 50 ms that nobody declares, that may take 46° of the 74°:
      Ω = 0.8/(T/2 + 50 ms), 2.5 Hz at 2 ms. A bus, a computer and a drive's own loop together are
      seldom later; from 80 ms on the loop is unstable.
    - Efforts: 0.1 rad (or m) off at rest, a joint or the base is asked for ν̇ = a b e, 0.8 rad/s²
      (or m/s²) at 2 ms, which hardly any motor cannot give.
    - Inertia: along the direction of least inertia, as of wrist axes that are nearly in line, the
      stiffness is only m a b; no lower gain of one joint can mend that, a higher one of all does.
      The loop is stable up to ten times the model's inertia, as a rotor behind a gear may make it.

    Args:
        period: Control period T, s.
    """
    require_positive("period", period)
    return gains_of(PHASE_LOSS / (0.5 * period + LATENESS_S) / (2.0 * math.pi))


def gains_of(bandwidth: float) -> Gains:
    """Return the gains of a bandwidth, Hz.

    Raises:
        RpctlError: It is not positive.
    """
    if not 0.0 < bandwidth <= MAX_BANDWIDTH:
        raise RpctlError(
            f"a bandwidth of {bandwidth} Hz; give more than 0 and at most {MAX_BANDWIDTH:g}"
        )
    a, b, k = (2.0 * math.pi * bandwidth * PROPORTIONS / PROPORTIONS.sum()).tolist()
    return Gains(bandwidth, 1.0 / a, 1.0 / b, k)


def by_velocity(dynamics: ReducedDynamics, base: float, joints: float) -> Array:
    """Return a setting of the base and of the arm's joints by quasi-velocity (dof,)."""
    count = len(dynamics.robot.joints)
    return np.repeat([base, joints], [dynamics.robot.dof - count, count])


def knowing_delay(law: Any, period: float, delay: float | None) -> Any:
    """Return a law whose joints have what a delay that is told and foretold leaves them.

    It is 7.5 Hz at 2 ms without a delay, and 4 Hz at one of 50 ms, of which 30 % may be missing.
    The base's k is that of the same bandwidth, 15 1/s at most; its prediction times stay, by which
    it steers, and what is set stays.

    Args:
        law: A kinematic or a dynamic law, or None.
        period: Control period T, s.
        delay: Time from a measurement to the efforts it leads to, s; None where nobody tells it.
    """
    if delay is None:
        return law
    if getattr(law, "lateness", 0.0) is None:  # that of a robot that leans foretells it itself
        return dataclasses.replace(law, lateness=delay)
    late = 0.5 * period + TOLD_LATENESS_S + DELAY_ERROR * delay
    gains = gains_of(PHASE_LOSS / late / (2.0 * math.pi))
    found = at_bandwidth(law, gains.bandwidth, only_unset=True)
    if getattr(law, "gain", 0.0) is None:
        found = dataclasses.replace(found, gain=min(gains.gain, MOST_GAIN))
    if hasattr(law, "leaning"):
        regulator = knowing_delay(law.leaning.regulator, period, delay)
        leaning = dataclasses.replace(law.leaning, regulator=regulator)
        found = dataclasses.replace(found, leaning=leaning)
    return found


def at_bandwidth(law: Any, bandwidth: float, only_unset: bool = False) -> Any:
    """Return a law, and those within it, whose joints have a bandwidth (Hz) instead of their own.

    Args:
        law: A kinematic or a dynamic law; one without settings of the joints comes back as it is.
        only_unset: Whether settings stay that are set.

    Raises:
        RpctlError: The bandwidth is not positive.
    """
    settings = {f"joint_{name}": x for name, x in gains_of(bandwidth)._asdict().items()}
    if not dataclasses.is_dataclass(law) or isinstance(law, type):
        return law
    changes: dict[str, Any] = {}
    for item in dataclasses.fields(law):
        value = getattr(law, item.name)
        if item.name in settings and not (only_unset and value is not None):
            changes[item.name] = settings[item.name]
        elif item.name in ("inner", "base", "fallback"):
            changes[item.name] = at_bandwidth(value, bandwidth, only_unset)
    return dataclasses.replace(law, **changes)
