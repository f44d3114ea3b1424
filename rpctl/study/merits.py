"""Merits: figures of one closed loop, each a number that is better the smaller it is.

They are folded sample by sample, so that no log has to be kept: :func:`fold` takes what
:func:`measures` finds in a sample, :func:`merits_of` turns what was folded into figures. The arrays
have a leading axis of runs, so that many runs are folded at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import UnknownNameError
from rpctl.robot.model import Robot
from rpctl.simulation.facts import steered_joints
from rpctl.simulation.outcome import DIVERGING, ON_PATH_M, TRACKED
from rpctl.simulation.run import Run
from rpctl.simulation.summary import LIMIT_TOLERANCE

AWAY, OVER_LIMIT, REFUSED = "away", "over limit", "refused"
RUN_OUTCOMES = (TRACKED, AWAY, OVER_LIMIT, DIVERGING, REFUSED)  # from good to bad


@dataclass(frozen=True)
class Merit:
    """A figure of a run.

    Attributes:
        unit: Its unit; empty where it has none.
        what: What it is, in words.
        needs: ``"arm"``, ``"end effector"``, ``"effort limits"``, ``"velocity limits"`` or
            ``"position limits"`` where only robots that have such a thing have the figure.
    """

    unit: str
    what: str
    needs: str = ""


MERITS: dict[str, Merit] = {
    "rms_base_error": Merit("m", "root mean square of P's distance from its reference"),
    "final_base_error": Merit("m", "that distance at the end"),
    "max_base_error": Merit("m", "its largest"),
    "settled_rms_base_error": Merit("m", "its root mean square over the second half"),
    "final_lateral_error": Merit("m", "size of its lateral part at the end"),
    "rms_end_effector_error": Merit(
        "m", "root mean square of the end effector's distance from its reference", "end effector"
    ),
    "final_end_effector_error": Merit("m", "that distance at the end", "end effector"),
    "max_joint_error": Merit(
        "rad or m", "largest distance of a joint of the arm from its reference", "arm"
    ),
    "max_effort_ratio": Merit("", "largest effort over its limit", "effort limits"),
    "max_speed_ratio": Merit(
        "", "largest rate of an actuator's joint over its limit", "velocity limits"
    ),
    "max_position_excess": Merit(
        "rad or m",
        "how far a joint of the arm or one that steers went beyond its limits; negative: it stayed "
        "as far within",
        "position limits",
    ),
    "work": Merit("J", "what the actuators did in all"),
    "lost": Merit("J", "what damping and friction in the joints took of it"),
    "settling_time": Merit("s", f"since when P stays within {ON_PATH_M:g} m; inf: it does not"),
    "samples_at_limits": Merit("", "number of samples at which a limit bound the efforts"),
}
SUCCESS = "success"  # 1 or 0, beside the merits


def merits_for(robot: Robot, chosen: tuple[str, ...] | None = None) -> tuple[str, ...]:
    """Return the names of the merits that a robot has.

    Args:
        robot: The robot.
        chosen: Which of them are wanted; None: all that it has.

    Raises:
        UnknownNameError: One is none of this robot's.
    """
    positions = [each for pair in position_limits(robot) for each in pair]
    has = {
        "": True,
        "arm": bool(robot.joints),
        "end effector": robot.end_effector is not None,
        "effort limits": bool(np.isfinite(robot.effort_limits).any()),
        "velocity limits": bool(np.isfinite(robot.velocity_limits).any()),
        "position limits": bool(np.isfinite(positions).any()),
    }
    names = tuple(name for name, merit in MERITS.items() if has[merit.needs])
    for name in chosen or ():
        if name not in names:
            raise UnknownNameError(f"merit of {robot.name}", name, names)
    return names if chosen is None else tuple(chosen)


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


FIRST = Totals(*[0.0] * len(Totals._fields))._replace(excess_max=-math.inf)  # type: ignore[arg-type]


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


class RunVerdict(NamedTuple):
    """What became of a run: one of :data:`RUN_OUTCOMES`, and why, in words."""

    outcome: str
    reason: str


def verdict(totals: Totals, count: int, tolerance: float = ON_PATH_M) -> RunVerdict:
    """Return what became of a run that came to its end.

    It succeeded if P and the end effector were within the tolerance of their references, on average
    over the last quarter, and no limit of an effort, a rate or a position was broken.

    Args:
        totals: What was folded of its samples, a number each.
        count: Number of its samples.
        tolerance: m.
    """
    samples = count - 3 * count // 4
    broken = {
        "effort": totals.effort_max - 1.0,
        "velocity": totals.speed_max - 1.0,
        "position": totals.excess_max,
    }
    found = [kind for kind, excess in broken.items() if excess > LIMIT_TOLERANCE]
    if found:
        return RunVerdict(OVER_LIMIT, f"it broke limits of {' and '.join(found)}")
    away = {"base": totals.base_last / samples, "end effector": totals.tip_last / samples}
    name, mean = max(away.items(), key=lambda each: float(each[1]))
    sentence = f"{name} is {float(mean):.3g} m from its reference in the last quarter"
    return RunVerdict(TRACKED if mean <= tolerance else AWAY, sentence)


def run_merits(run: Run, tolerance: float = ON_PATH_M) -> tuple[dict[str, float], RunVerdict]:
    """Return the merits of a run that logged every sample, by name, and what became of it.

    Args:
        run: The run.
        tolerance: How far from its reference it may be in the end, m.
    """
    log, count = run.log, len(run.t)
    totals = fold(measures(run), count)
    found = merits_of(totals, log.work[-1], log.lost[-1], count, run.config.run.control_period)
    return {name: float(value) for name, value in found.items()}, verdict(totals, count, tolerance)


def of_failed(names: Mapping[str, object] | tuple[str, ...]) -> dict[str, float]:
    """Return the merits of a run that has none: each is inf, worse than any."""
    return dict.fromkeys(names, math.inf)
