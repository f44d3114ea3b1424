"""Figures of merit of a run: how well it tracked, and whether it stayed within the limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.simulation.run import Run
from rpctl.simulation.slip_and_tip import ground

LIMIT_NAMES = {"lower": "lower position", "upper": "upper position"}  # in words
LIMIT_TOLERANCE = 1e-9  # of a limit: touching it is not breaking it


def summarize(run: Run) -> dict[str, Any]:
    """Return the figures of merit of a run.

    Errors are distances in m, joint errors in each joint's unit; ``settled`` figures are the
    largest over the second half. ``limits_violated`` lists every limit of the URDF that was
    broken, as :func:`violations` does, and ``limits_bound`` every one that the dynamic law had to
    heed, as :func:`binding_limits` does. A robot without an arm has None for its end
    effector; one without effort limits has None for ``max_effort_ratio``. What a kinematic law
    counts is in ``kinematic_report``, None for a law that counts nothing. What the ground does is
    in the keys of :func:`ground`.
    """
    base = np.hypot(run.log.e[:, 0], run.log.e[:, 1])
    joints = run.log.e[:, 3:]
    arm = np.linalg.norm(run.log.ee - run.log.ee_ref, axis=1) if run.robot.end_effector else None
    half = len(run.t) // 2
    tau = np.abs(run.tau).max(axis=0)
    limited = np.isfinite(run.robot.effort_limits)
    peaks = np.where(
        limited, tau / np.array(run.robot.effort_limits), -1.0
    )  # -1: never the largest
    duration = float(run.t[-1])
    return {
        "duration": duration,
        "rms_base_error": _rms(base),
        "final_base_error": float(base[-1]),
        "settled_base_error": float(base[half:].max()),
        "final_lateral_error": float(abs(run.log.e[-1, 1])),
        "joint_errors": [
            {"joint": name, "unit": unit, **_errors(error, half)}
            for name, unit, error in zip(
                run.robot.joint_names, run.robot.units, joints.T, strict=True
            )
        ],
        "rms_end_effector_error": None if arm is None else _rms(arm),
        "final_end_effector_error": None if arm is None else float(arm[-1]),
        "settled_end_effector_error": None if arm is None else float(arm[half:].max()),
        "efforts": [
            {"actuator": name, "peak": peak, "limit": limit, "ratio": peak / limit}
            for name, peak, limit in zip(
                run.robot.actuators, tau.tolist(), run.robot.effort_limits, strict=True
            )
        ],
        "max_effort_ratio": float(peaks.max()) if limited.any() else None,
        "max_effort_joint": run.robot.actuators[int(peaks.argmax())] if limited.any() else None,
        "limits_violated": violations(run),
        "limits_bound": binding_limits(run),
        **ground(run),
        "kinematic_report": run.settings.get("kinematic_report"),
        "energy_residual": _energy_residual(run),
        "constraint_residual": float(run.log.constraint_residual.max()),
        "wall_time": run.wall_time,
        "realtime_factor": duration / run.wall_time,
    }


def violations(run: Run) -> list[dict[str, Any]]:
    """Return the limits of the URDF that a run broke: which, how far, when first, for how long.

    ``value`` is the furthest beyond the limit ``allowed``, both as the joint counts: of a lower
    limit the least position; of efforts and rates the size.
    """
    found = []
    for name, tau, rate, effort_limit, velocity_limit in zip(
        run.robot.actuators,
        run.tau.T,
        run.log.rates.T,
        run.robot.effort_limits,
        run.robot.velocity_limits,
        strict=True,
    ):
        found += _violation(run, name, "effort", np.abs(tau), effort_limit)
        found += _violation(run, name, "velocity", np.abs(rate), velocity_limit)
    for name, position, lower, upper in zip(
        run.robot.joint_names,
        run.log.joints.T,
        run.robot.lower_limits,
        run.robot.upper_limits,
        strict=True,
    ):
        found += _position_violations(run, name, position, lower, upper)
    for name, position, (lower, upper) in zip(
        run.robot.steering_names, run.log.steering.T, run.robot.steering_limits, strict=True
    ):
        found += _position_violations(run, name, position, lower, upper)
    for name, position, rate, (lower, upper, fastest) in zip(
        run.robot.other_names,
        run.log.others.T,
        run.log.other_rates.T,
        run.robot.other_limits,
        strict=True,
    ):
        if name not in run.robot.actuators:
            found += _violation(run, name, "velocity", np.abs(rate), fastest)
        if name not in run.robot.steering_names:
            found += _position_violations(run, name, position, lower, upper)
    return found


def binding_limits(run: Run) -> list[dict[str, Any]]:
    """Return the limits that bound the efforts: which, when and where first, for how long.

    ``first_place`` is where P was (x, y), m; ``told`` says it all in one sentence.
    """
    found = []
    for (joint, kind), active in zip(run.log.bound_limits, run.log.active_limits.T, strict=True):
        first, duration = int(np.argmax(active)), float(active.mean() * run.t[-1])
        x, y = run.log.base[first, :2].tolist()
        at, limit_name = float(run.t[first]), LIMIT_NAMES.get(kind, kind)
        found.append(
            {
                "joint": joint,
                "limit": kind,
                "first_time": at,
                "first_place": [x, y],
                "duration": duration,
                "told": f"{joint} {limit_name} limit bound from {at:.3g} s, at ({x:.2f}, {y:.2f}) "
                f"m, {duration:.2g} s in all",
            }
        )
    return found


def _position_violations(
    run: Run, joint: str, position: Array, lower: float, upper: float
) -> list[dict[str, Any]]:
    """Return the position limits that a joint broke."""
    below = _violation(run, joint, "lower", -position, -lower)
    for broken in below:  # found as an upper limit of the negative; told as the joint counts
        broken |= {"value": -broken["value"], "allowed": -broken["allowed"]}
    return [*below, *_violation(run, joint, "upper", position, upper)]


def _violation(run: Run, joint: str, kind: str, value: Array, limit: float) -> list[dict[str, Any]]:
    broken = value > limit + LIMIT_TOLERANCE * max(abs(limit), 1.0)
    if not broken.any():
        return []
    return [
        {
            "joint": joint,
            "limit": kind,
            "value": float(value.max()),
            "allowed": float(limit),
            "first_time": float(run.t[int(np.argmax(broken))]),
            "duration": float(broken.mean() * run.t[-1]),
        }
    ]


def _energy_residual(run: Run) -> float:
    """Return the largest gap between energy and work, relative to the work's swing."""
    gap = run.log.energy - run.log.energy[0] - run.log.work
    return float(np.abs(gap).max() / max(float(np.ptp(run.log.work)), 1e-12))


def _errors(error: Array, half: int) -> dict[str, float]:
    size = np.abs(error)
    return {
        "rms": _rms(error),
        "final": float(size[-1]),
        "settled": float(size[half:].max()),
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
