"""Arm motions and paces that keep to a share of a robot's limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference
from rpctl.reference.path_reference import PathReference
from rpctl.reference.sizing import LIMIT_SHARE
from rpctl.reference.timed_path import TimedPath, slowed
from rpctl.reference.usage import (
    MotionSample,
    Usage,
    base_joints,
    effort_usage,
    holding_efforts,
    largest,
    rate_usage,
    sample,
)
from rpctl.reference.waves import Waves, waves

STEP = 0.8  # factor by which an arm's motion is reduced until its efforts fit
MAX_STEPS = 24  # of reducing swings, to half a percent, and of slowing down
LAP_SAMPLES, RAMP_SAMPLES = 72, 7  # times at which a lap and its soft start are looked at
ARM_PERIODS = 5.0  # of its slowest wave: an arm's waves meet in most ways within it
TIMED_SAMPLES = 200  # times at which a planned reference is looked at
MAX_TIMED_STEPS = 6  # of slowing down a planned reference: its posture may leave little of a limit
MOVING_SHARE = 0.5 * LIMIT_SHARE  # of what holding leaves: what an arm's accelerations may take


def fit_arm(dynamics: ReducedDynamics, arm: Waves) -> tuple[Waves, str]:
    """Return an arm's motion within a share of what holding it at home leaves of the efforts.

    Args:
        dynamics: The robot's dynamics.
        arm: The motion, within the limits of positions and velocities.

    Returns:
        The motion, all its swings reduced by one factor where it needs that, and what for.
    """
    robot = dynamics.robot
    if not arm.amplitude.any() or not np.isfinite(robot.effort_limits).any():
        return arm, ""
    full = arm.amplitude
    times = np.linspace(0.0, ARM_PERIODS * 2.0 * math.pi / arm.rate.min(), LAP_SAMPLES)
    note = ""
    for step in range(MAX_STEPS + 1):
        factor = STEP**step if step < MAX_STEPS else 0.0
        arm = replace(arm, amplitude=factor * full)
        worst = _arm_usage(dynamics, sample(robot, PathReference(None, 0.0, arm, 0.0), times))
        if worst is None or worst.ratio <= LIMIT_SHARE:
            break
        note = f"{STEP * 100.0 * factor:.0f} % of its swing for {worst.text(robot)}"
    return arm, note


def _arm_usage(dynamics: ReducedDynamics, samples: list[MotionSample]) -> Usage | None:
    """Return the most that an arm's motion takes, relative to what it may.

    All of it counts against what holding leaves at the first sample, accelerations on their own
    against what holding leaves where the arm then is.
    """
    holding = _holding(dynamics, samples)
    gentle = [
        usage._replace(ratio=usage.ratio * LIMIT_SHARE / MOVING_SHARE)
        for usage in effort_usage(dynamics, samples, holding)
    ]
    return largest([*effort_usage(dynamics, samples, holding[0]), *gentle])


def _holding(dynamics: ReducedDynamics, samples: list[MotionSample]) -> Array:
    """Return what holds the robot still (N, n_act); inf for what is too weak for it at first."""
    holding = holding_efforts(dynamics, samples)
    holding[:, holding[0] >= dynamics.robot.effort_limits] = np.inf
    return holding


def too_weak(dynamics: ReducedDynamics, reference: Reference | None = None) -> str:
    """Return in words which actuator gravity overcomes, and what to do; empty if none.

    Args:
        dynamics: The robot's dynamics.
        reference: Where it starts, the robot stands; None: at home.
    """
    robot = dynamics.robot
    at_home = PathReference(None, 0.0, waves(robot), 0.0)
    held = holding_efforts(dynamics, sample(robot, reference or at_home, [0.0]))[0]
    weak = [
        Usage(name, "effort", float(limit), float(effort / limit))
        for name, limit, effort in zip(robot.actuators, robot.effort_limits, held, strict=True)
        if effort >= limit
    ]
    if not weak:
        return ""
    worst = max(weak, key=lambda usage: usage.ratio)
    unit = "N" if robot.description.joint[worst.joint].kind == "prismatic" else "N m"
    place = "at home" if reference is None else "where the reference starts"
    return (
        f"gravity {place} exceeds the effort limit of {worst.joint}: "
        f"{worst.ratio * worst.limit:.3g} of {worst.limit:.3g} {unit}; give --home, --payload or "
        "a larger limit"
    )


def slow_down(
    dynamics: ReducedDynamics, reference: PathReference, lap: float
) -> tuple[PathReference, Usage | None]:
    """Return a reference at a pace that keeps to a share of all limits, and what slowed it down.

    Args:
        dynamics: The robot's dynamics.
        reference: The reference at the fastest pace that is wanted.
        lap: By how much the path's parameter grows in a lap.
    """
    samples, names = _lap_samples(dynamics, reference, lap), base_joints(dynamics.robot)
    bound = largest(rate_usage(dynamics, samples, names))
    if bound is not None and bound.ratio > LIMIT_SHARE:
        reference = replace(reference, rate=reference.rate * LIMIT_SHARE / bound.ratio)
        samples = _lap_samples(dynamics, reference, lap)
    else:
        bound = None
    for _ in range(MAX_STEPS):
        effort = _effort(dynamics, samples)
        if effort is None or effort.ratio <= LIMIT_SHARE:
            break
        reference, bound = replace(reference, rate=_slower(effort) * reference.rate), effort
        samples = _lap_samples(dynamics, reference, lap)
    return reference, bound


def slow_down_timed(
    dynamics: ReducedDynamics, reference: TimedPath
) -> tuple[TimedPath, Usage | None]:
    """Return a planned reference slowed down to a share of all limits, and what for."""
    samples, bound = _timed_samples(dynamics, reference), None
    fast = largest(rate_usage(dynamics, samples, dynamics.robot.moving_joint_names))
    if fast is not None and fast.ratio > LIMIT_SHARE:
        reference, bound = slowed(reference, fast.ratio / LIMIT_SHARE), fast
        samples = _timed_samples(dynamics, reference)
    for _ in range(MAX_TIMED_STEPS):
        effort = _effort(dynamics, samples)
        if effort is None or effort.ratio <= LIMIT_SHARE:
            break
        reference, bound = slowed(reference, 1.0 / _slower(effort)), effort
        samples = _timed_samples(dynamics, reference)
    return reference, bound


def _slower(effort: Usage) -> float:
    """Return a factor of the pace that brings an effort down to its share, or nearer to it.

    What motion takes falls with the pace or with its square: by the root no step goes too far.
    """
    return min(0.97, math.sqrt(LIMIT_SHARE / effort.ratio))


def usage_of(dynamics: ReducedDynamics, reference: PathReference, lap: float) -> Usage | None:
    """Return the limit of which a reference takes the most, or None of a robot without limits.

    Args:
        dynamics: The robot's dynamics.
        reference: The reference.
        lap: By how much the path's parameter grows in a lap.
    """
    return _most(dynamics, _lap_samples(dynamics, reference, lap), base_joints(dynamics.robot))


def usage_of_timed(dynamics: ReducedDynamics, reference: TimedPath) -> Usage | None:
    """Return the limit of which a planned reference takes the most, or None without limits."""
    samples = _timed_samples(dynamics, reference)
    return _most(dynamics, samples, dynamics.robot.moving_joint_names)


def _most(
    dynamics: ReducedDynamics, samples: list[MotionSample], joints: Sequence[str]
) -> Usage | None:
    effort = _effort(dynamics, samples)
    return largest([*rate_usage(dynamics, samples, joints), *([effort] if effort else [])])


def _effort(dynamics: ReducedDynamics, samples: list[MotionSample]) -> Usage | None:
    """Return the most that a motion takes of what holding leaves of the effort limits."""
    if not np.isfinite(dynamics.robot.effort_limits).any():
        return None
    return largest(effort_usage(dynamics, samples, _holding(dynamics, samples)))


def _lap_samples(
    dynamics: ReducedDynamics, reference: PathReference, lap: float
) -> list[MotionSample]:
    """Return the motion along the soft start and a lap."""
    ramp = reference.ramp
    times = np.linspace(0.0, ramp, RAMP_SAMPLES, endpoint=False)
    times = np.append(times, np.linspace(ramp, 0.5 * ramp + lap / reference.rate, LAP_SAMPLES))
    return sample(dynamics.robot, reference, times.tolist())


def _timed_samples(dynamics: ReducedDynamics, reference: TimedPath) -> list[MotionSample]:
    times = np.linspace(0.0, reference.duration, TIMED_SAMPLES)
    return sample(dynamics.robot, reference, times.tolist())
