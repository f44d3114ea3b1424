"""Merits: figures of one closed loop, folded sample by sample so that no log has to be kept.

:func:`measures` finds what counts in each sample, :func:`fold` takes all samples together, and
:func:`merits_of` makes figures of what was folded. The arrays have leading axes of runs, so that
many are taken at once; ``compiled/merit_fold.py`` does the same a sample at a time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.model import Robot
from rpctl.simulation.merits.outcome import ON_PATH_M
from rpctl.simulation.run.facts import steered_joints
from rpctl.simulation.run.run import Run


def position_limits(robot: Robot) -> list[tuple[float, float]]:
    """Return the limits (lower, upper) of the arm's joints, then of those that steer; rad or m."""
    described = robot.description.joint
    joints = [*robot.joints, *(described[name] for name in steered_joints(robot))]
    return [(joint.lower, joint.upper) for joint in joints]


class SampleMeasures(NamedTuple):
    """What the merits need of samples: an array (..., samples) each, 0 where a robot has none."""

    base: Array  # distance of P from its reference, m
    lateral: Array  # size of its lateral part, m
    tip: Array  # distance of the end effector from its reference, m
    joint: Array  # largest distance of a joint from its reference, rad or m
    effort: Array  # largest effort over its limit
    speed: Array  # largest rate of an actuator's joint over its limit
    excess: Array  # largest excess beyond a position limit, rad or m; −inf without limits
    limited: Array  # 1 where a limit bound the efforts, else 0


def measures(run: Run) -> SampleMeasures:
    """Return what the merits need of a run's samples."""
    log, robot = run.log, run.robot
    count = len(log.t)
    lower = [*robot.lower_limits, *(low for low, _ in robot.steering_limits)]
    upper = [*robot.upper_limits, *(high for _, high in robot.steering_limits)]
    positions = np.hstack([log.joints, log.steering])
    beyond = np.maximum(np.array(lower) - positions, positions - np.array(upper))
    return SampleMeasures(
        base=np.hypot(log.e[:, 0], log.e[:, 1]),
        lateral=np.abs(log.e[:, 1]),
        tip=np.linalg.norm(log.ee - log.ee_ref, axis=1) if robot.end_effector else np.zeros(count),
        joint=np.abs(log.e[:, 3:]).max(axis=1, initial=0.0),
        effort=(np.abs(log.tau) / robot.effort_limits).max(axis=1, initial=0.0),
        speed=(np.abs(log.rates) / robot.velocity_limits).max(axis=1, initial=0.0),
        excess=beyond.max(axis=1, initial=-math.inf),
        limited=log.active_limits.any(axis=1).astype(float),
    )


class Totals(NamedTuple):
    """What has been folded of samples: an array (...,) each, in the units of the measures."""

    base_squares: Array  # sum over all samples
    late_squares: Array  # over the second half
    base_last: Array  # sum of the distances over the last quarter
    base_max: Array
    base_final: Array
    lateral_final: Array
    tip_squares: Array
    tip_last: Array
    tip_final: Array
    joint_max: Array
    effort_max: Array
    speed_max: Array
    excess_max: Array
    limited: Array  # number of samples
    settled: Array  # number of the first sample from which on P is within ON_PATH_M


START = Totals(*[0.0] * len(Totals._fields))._replace(excess_max=-math.inf)  # type: ignore[arg-type]


def fold(measured: SampleMeasures, count: int) -> Totals:
    """Return what is folded of all samples of runs.

    Args:
        measured: Of each sample (..., count).
        count: Number of samples of a whole run.
    """
    half, last = count // 2, 3 * count // 4
    away = ~(measured.base <= ON_PATH_M)
    behind = np.argmax(away[..., ::-1], axis=-1)  # samples since the last that was away
    return Totals(
        base_squares=np.square(measured.base).sum(axis=-1),
        late_squares=np.square(measured.base[..., half:]).sum(axis=-1),
        base_last=measured.base[..., last:].sum(axis=-1),
        base_max=measured.base.max(axis=-1),
        base_final=measured.base[..., -1],
        lateral_final=measured.lateral[..., -1],
        tip_squares=np.square(measured.tip).sum(axis=-1),
        tip_last=measured.tip[..., last:].sum(axis=-1),
        tip_final=measured.tip[..., -1],
        joint_max=measured.joint.max(axis=-1),
        effort_max=measured.effort.max(axis=-1),
        speed_max=measured.speed.max(axis=-1),
        excess_max=measured.excess.max(axis=-1),
        limited=measured.limited.sum(axis=-1),
        settled=np.where(away.any(axis=-1), count - behind, 0),
    )


def merits_of(
    totals: Totals, work: Array, lost: Array, count: int, period: float
) -> dict[str, Array]:
    """Return the merits (...,) of runs that came to their end, by name.

    Args:
        totals: What was folded of their samples.
        work: Of the actuators in all (...,), J.
        lost: What damping and friction took (...,), J.
        count: Number of samples of a run.
        period: Between two samples, s.
    """
    return {
        "rms_base_error": np.sqrt(totals.base_squares / count),
        "final_base_error": totals.base_final,
        "max_base_error": totals.base_max,
        "settled_rms_base_error": np.sqrt(totals.late_squares / (count - count // 2)),
        "final_lateral_error": totals.lateral_final,
        "rms_end_effector_error": np.sqrt(totals.tip_squares / count),
        "final_end_effector_error": totals.tip_final,
        "max_joint_error": totals.joint_max,
        "max_effort_ratio": totals.effort_max,
        "max_speed_ratio": totals.speed_max,
        "max_position_excess": totals.excess_max,
        "work": work,
        "lost": lost,
        "settling_time": np.where(totals.settled < count, totals.settled * period, np.inf),
        "samples_at_limits": totals.limited,
    }  # fmt: skip
