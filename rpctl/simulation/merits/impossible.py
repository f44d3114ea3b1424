"""Why a logged motion is none that the robot can make: it tips, folds, falls short, chatters.

Only what is certain counts, and what lasts: a wheel that lifts or slides for a moment comes back.
What could be, for one split of the load among many, stays a note (``ground.py``).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rpctl.control.end_effector import EndEffector
from rpctl.control.horizon.law import Horizon
from rpctl.dynamics.ground_reaction import ON_ONE_LINE
from rpctl.simulation.merits.ground import slip_ranges, tilts
from rpctl.simulation.merits.outcome import (
    CANNOT_HOLD,
    CHATTERS,
    JACK_KNIFED,
    SLIPS,
    TIPS,
    Outcome,
)
from rpctl.simulation.run.run import Run

LASTING_S = 0.1  # s: in it a wheel whose load is gone lifts by a millimetre or more
FOLDED = 0.5 * math.pi  # rad: beyond it a trailer lies beside what pulls it
NEAR = 0.01  # rad: laws that know the limits of a hitch stop as near to them
FALLEN = math.radians(10.0)  # rad: no soft contact lets a robot lean so far
THROWN = {"rad": 0.2, "m": 0.05}  # a joint so far off its reference is not held
GROWN = 1.5  # times its error at the start, from which it may overshoot
FEW = 20  # samples tell no chatter
CHATTER = 0.25  # of the limit: an effort that leaps by half of it, each sample, to and fro


def impossible(run: Run) -> Outcome | None:
    """Return what makes a run impossible, the worst first; None if nothing does."""
    return _jack_knifed(run) or _tips(run) or _slips(run) or _cannot_hold(run) or _chatters(run)


def _jack_knifed(run: Run) -> Outcome | None:
    """Return that a trailer has folded against what pulls it, or its hitch has met its limits."""
    robot = run.robot
    for swivel in robot.drive.trailers:
        k = robot.other_names.index(swivel.joint)
        lower, upper, _ = robot.other_limits[k]
        angle = np.unwrap(run.log.others[:, k])
        beyond = (angle < max(lower, -FOLDED) + NEAR) | (angle > min(upper, FOLDED) - NEAR)
        if beyond.any():
            at = int(np.argmax(beyond))
            limits = f"{math.degrees(max(lower, -FOLDED)):.3g}° to "
            limits += f"{math.degrees(min(upper, FOLDED)):.3g}°"
            return Outcome(
                JACK_KNIFED, f"{swivel.joint} leaves {limits} at {run.t[at]:.3g} s: the trailer "
                f"has folded, {math.degrees(np.abs(angle).max()):.3g}° at most"
            )  # fmt: skip
    return None


def _tips(run: Run) -> Outcome | None:
    log, robot = run.log, run.robot
    if log.root_pose.size:  # of a plant whose robot can lean
        lean = tilts(log)
        if lean.max() <= FALLEN:
            return None
        when = run.t[int(np.argmax(lean > FALLEN))]
        return Outcome(TIPS, f"it leans {math.degrees(lean.max()):.2g}°, from {when:.3g} s on")
    if not log.tip_margin.size:  # it has contacts on one line alone, or none that are known
        line = [note for note in run.ground.notes if ON_ONE_LINE in note]
        if not line or robot.drive.type == "bicycle":  # which something else holds upright
            return None
        return Outcome(TIPS, f"it does not stand: {line[0].partition(':')[0]}")
    first = _lasting(run, log.tip_margin < 0.0)
    if first is None:
        return None
    off = f"{-log.tip_margin.min():.2g} m"
    return Outcome(
        TIPS, f"it tips over at {first:.3g} s: its weight falls {off} outside its contacts at worst"
    )


def _slips(run: Run) -> Outcome | None:
    if run.log.root_pose.size or not run.log.tip_margin.size:
        return None
    ranges = slip_ranges(run)
    if ranges is None:
        return None
    least = np.nan_to_num(ranges[:, 0])
    first = _lasting(run, least > 1.0)
    if first is None:
        return None
    much = f"{100.0 * least.max():.0f} %" if least.max() < 10.0 else "over ten times"
    return Outcome(
        SLIPS, f"it slips at {first:.3g} s: it needs {much} of the grip at friction "
        f"{run.ground.friction:g}, however the load splits"
    )  # fmt: skip


def _cannot_hold(run: Run) -> Outcome | None:
    """Return that a joint is thrown off its reference, or sinks from it."""
    if isinstance(run.config.kinematic, EndEffector | Horizon):
        return None  # for them a joint's reference gives way to the end effector's
    away = np.abs(run.log.e[:, 3:])
    for name, unit, error in zip(run.robot.joint_names, run.robot.units, away.T, strict=True):
        bound = max(THROWN[unit], GROWN * float(error[0]))
        if float(error.max()) > bound:
            when = run.t[int(np.argmax(error > bound))]
            k = run.robot.actuators.index(name) if name in run.robot.actuators else None
            full = k is not None and _full(run, k)
            why = ", its motor at its limit" if full else ""
            return Outcome(
                CANNOT_HOLD,
                f"{name} is {error.max():.2g} {unit} off its reference, beyond {bound:.2g} {unit} "
                f"from {when:.3g} s on{why}",
            )
    return None


def _full(run: Run, k: int) -> bool:
    """Return whether an actuator ever gave all that it has."""
    limit = run.robot.effort_limits[k]
    return bool(math.isfinite(limit) and np.abs(run.tau[:, k]).max() >= 0.999 * limit)


def _chatters(run: Run) -> Outcome | None:
    """Return that an effort leaps to and fro by half its limit, on average over the second half."""
    tau = run.tau[len(run.tau) // 2 :]
    limited = np.isfinite(run.robot.effort_limits)
    if len(tau) < FEW or not limited.any():
        return None
    leaps = np.abs(np.diff(tau, n=2, axis=0)).mean(axis=0) / 4.0
    ratio = np.where(limited, leaps / run.robot.effort_limits, 0.0)
    worst = int(ratio.argmax())
    if ratio[worst] <= CHATTER:
        return None
    name = run.robot.actuators[worst]
    return Outcome(
        CHATTERS, f"the effort of {name} leaps by {200.0 * ratio[worst]:.0f} % of its limit each "
        "sample"
    )  # fmt: skip


def _lasting(run: Run, true: NDArray[np.bool_]) -> float | None:
    """Return when (s) something begins that then lasts; None if nothing does."""
    begin = None
    for k in np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(int))):
        if begin is None:
            begin = int(k)
            continue
        end = min(int(k), len(run.t) - 1)
        if run.t[end] - run.t[begin] >= LASTING_S:
            return float(run.t[begin])
        begin = None
    return None
