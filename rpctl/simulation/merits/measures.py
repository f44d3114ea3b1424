"""Merits: figures of one closed loop, folded sample by sample so that no log has to be kept.

:func:`sample_measures` says what counts in a sample, :func:`folding` takes it to what was folded of
those before, and :func:`merits_of` makes figures of that. A compiled loop does so while it runs
(``compiled/merit_fold.py``), and what is logged is folded afterwards (:func:`fold`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.kernels.program import dense_function
from rpctl.kernels.scalars import Scalar
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
    """What the merits need of samples: a scalar or an array (..., samples) each.

    They are 0 where a robot has none of what they are of.
    """

    base: Scalar  # distance of P from its reference, m
    lateral: Scalar  # size of its lateral part, m
    tip: Scalar  # distance of the end effector from its reference, m
    joint: Scalar  # largest distance of a joint from its reference, rad or m
    effort: Scalar  # largest effort over its limit
    speed: Scalar  # largest rate of an actuator's joint over its limit
    excess: Scalar  # largest excess beyond a position limit, rad or m; −inf without limits
    limited: Scalar  # 1 where a limit bound the efforts, else 0


def sample_measures(
    e: Sequence[Scalar],
    gap: Sequence[Scalar],
    efforts: Iterable[tuple[Scalar, float]],
    rates: Iterable[tuple[Scalar, float]],
    positions: Iterable[tuple[Scalar, tuple[float, float]]],
    limits: Iterable[Scalar],
) -> SampleMeasures:
    """Return what the merits need, of CasADi's scalars or of its columns (samples, 1).

    Args:
        e: The tracking error (3 + n_joints,).
        gap: From the end effector to its reference (3,), m; empty without one.
        efforts: Those of the actuators, each with its limit.
        rates: Likewise.
        positions: Those of the joints that have limits, each with its lower and upper one.
        limits: Not 0 where a limit binds the efforts.
    """
    beyond = [each for x, (lower, upper) in positions for each in ((x, -upper), (-x, lower))]
    return SampleMeasures(
        base=_length(e[:2]),
        lateral=casadi.fabs(e[1]),
        tip=_length(gap),
        joint=_largest([casadi.fabs(x) for x in e[3:]]),
        effort=_largest(_ratios(efforts)),
        speed=_largest(_ratios(rates)),
        excess=_largest([x + least for x, least in beyond if math.isfinite(least)], -math.inf),
        limited=_largest([x != 0.0 for x in limits]),
    )


def _length(vector: Sequence[Scalar]) -> Scalar:
    return casadi.sqrt(sum(x * x for x in vector))


def _ratios(values: Iterable[tuple[Scalar, float]]) -> list[Scalar]:
    """Return the sizes of values over their limits, where there are any."""
    return [casadi.fabs(x) / limit for x, limit in values if math.isfinite(limit)]


def _largest(values: Sequence[Scalar], least: float = 0.0) -> Scalar:
    """Return the largest of values, or what stands for none."""
    return reduce(casadi.fmax, values) if values else least


def measures(run: Run) -> SampleMeasures:
    """Return what the merits need of a run's samples, arrays (samples,)."""
    log, robot = run.log, run.robot
    pairs = [*zip(robot.lower_limits, robot.upper_limits, strict=True), *robot.steering_limits]
    gap = log.ee - log.ee_ref if robot.end_effector else np.empty((len(log.t), 0))
    found = sample_measures(
        _columns(log.e),
        _columns(gap),
        zip(_columns(log.tau), robot.effort_limits, strict=True),
        zip(_columns(log.rates), robot.velocity_limits, strict=True),
        zip(_columns(np.hstack([log.joints, log.steering])), pairs, strict=True),
        _columns(log.active_limits),
    )
    shape = len(log.t)
    return SampleMeasures(*(np.broadcast_to(np.array(x, float).ravel(), shape) for x in found))


def _columns(values: Array) -> list[Scalar]:
    """Return the columns of values (samples, n) as CasADi has them."""
    return [casadi.DM(column) for column in np.asarray(values, float).T]


class Totals(NamedTuple):
    """What has been folded of samples: a scalar each, or an array of runs."""

    base_squares: Scalar  # sum over all samples
    late_squares: Scalar  # over the second half
    base_last: Scalar  # sum of the distances over the last quarter
    base_max: Scalar
    base_final: Scalar
    lateral_final: Scalar
    tip_squares: Scalar
    tip_last: Scalar
    tip_final: Scalar
    joint_max: Scalar
    effort_max: Scalar
    speed_max: Scalar
    excess_max: Scalar
    limited: Scalar  # number of samples
    settled: Scalar  # number of the first sample from which on P is within ON_PATH_M


START = Totals(*[0.0] * len(Totals._fields))._replace(excess_max=-math.inf)


def spans_of(count: int) -> Array:
    """Return the numbers of the first samples of a run's second half and last quarter (2,)."""
    return np.array([count // 2, 3 * count // 4], dtype=float)


def folding() -> Any:
    """Return the ``casadi.Function`` of totals, measures, count of samples and spans.

    It gives the totals after a sample; the count has it in.
    """
    totals, measured = (
        casadi.SX.sym(each.__name__, len(each._fields)) for each in (Totals, SampleMeasures)
    )
    t, m = Totals(*casadi.vertsplit(totals)), SampleMeasures(*casadi.vertsplit(measured))
    count, spans = casadi.SX.sym("count"), casadi.SX.sym("spans", 2)
    late, last = casadi.vertsplit(count > spans)
    after = Totals(
        base_squares=t.base_squares + m.base * m.base,
        late_squares=t.late_squares + casadi.if_else(late, m.base * m.base, 0.0),
        base_last=t.base_last + casadi.if_else(last, m.base, 0.0),
        base_max=casadi.fmax(t.base_max, m.base),
        base_final=m.base,
        lateral_final=m.lateral,
        tip_squares=t.tip_squares + m.tip * m.tip,
        tip_last=t.tip_last + casadi.if_else(last, m.tip, 0.0),
        tip_final=m.tip,
        joint_max=casadi.fmax(t.joint_max, m.joint),
        effort_max=casadi.fmax(t.effort_max, m.effort),
        speed_max=casadi.fmax(t.speed_max, m.speed),
        excess_max=casadi.fmax(t.excess_max, m.excess),
        limited=t.limited + m.limited,
        settled=casadi.if_else(casadi.logic_not(m.base <= ON_PATH_M), count, t.settled),
    )
    return dense_function("fold", [totals, measured, count, spans], [casadi.vertcat(*after)])


def fold(measured: SampleMeasures) -> Totals:
    """Return what is folded of all samples of a run."""
    numbers = 1.0 + np.arange(len(measured.base))
    spans = np.repeat(spans_of(len(numbers))[:, None], len(numbers), axis=1)
    totals = folding().fold(len(numbers))(START, np.array(measured), numbers[None], spans)
    return Totals(*np.array(totals).ravel().tolist())


def merits_of(
    totals: Totals, work: Array, lost: Array, count: int, period: float
) -> dict[str, Array]:
    """Return the merits (...,) of runs that came to their end, by name.

    Args:
        totals: What was folded of their samples.
        work: Of the actuators in all (...,), J.
        lost: What damping, friction and stops took (...,), J.
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
