"""Why a logged motion is none that the robot can make: it tips, folds, falls short, chatters.

Only what is certain counts, and what lasts: a wheel that lifts or slides for a moment comes back.
What could be, for one split of the load among many, stays a note (``ground.py``).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.end_effector import EndEffector
from rpctl.control.horizon.law import Horizon
from rpctl.control.safeguards import EFFORT_RATE, Watchdog, falls_short
from rpctl.dynamics.ground_reaction import ON_ONE_LINE
from rpctl.robot.leaning import MAX_TILT
from rpctl.simulation.merits.ground import slip_ranges, tilts
from rpctl.simulation.merits.outcome import (
    CANNOT_HOLD,
    CHATTERS,
    FELL,
    JACK_KNIFED,
    LOST,
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
CHATTER = 0.5  # of the limit, or of what its rate allows: an effort that leaps by more to and fro
FAST = 1.5  # of its limit: a joint that turns faster is thrown


def impossible(run: Run) -> Outcome | None:
    """Return what makes a run impossible, the worst first; None if nothing does."""
    falls = _fell if run.robot.drive.leans else _tips
    found = _jack_knifed(run) or falls(run) or _slips(run) or _cannot_hold(run)
    return found or _lost(run) or _chatters(run)


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
            limits = (
                f"{math.degrees(max(lower, -FOLDED)):.3g}° to "
                f"{math.degrees(min(upper, FOLDED)):.3g}°"
            )
            return Outcome(
                JACK_KNIFED, f"{swivel.joint} leaves {limits} at {run.t[at]:.3g} s: the trailer "
                f"has folded, {math.degrees(np.abs(angle).max()):.3g}° at most"
            )  # fmt: skip
    return None


def _fell(run: Run) -> Outcome | None:
    """Return that a robot that leans has leant so far that it lies on the ground."""
    lean = 2.0 * np.arcsin(np.minimum(np.hypot(*run.q[:, 3:5].T), 1.0))
    if lean.max() <= MAX_TILT:
        return None
    when = run.t[int(np.argmax(lean > MAX_TILT))]
    return Outcome(
        FELL, f"it leans {math.degrees(lean.max()):.2g}° at {when:.3g} s, and has fallen"
    )


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
        TIPS, f"it tips over at {first:.3g} s: its weight falls up to {off} outside its contacts"
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
    much = f"{100.0 * least.max():.0f} %" if least.max() < 10.0 else "more than ten times"
    return Outcome(
        SLIPS, f"it slips at {first:.3g} s: it needs {much} of the grip at friction "
               f"{run.ground.friction:g}, however the contacts share the load"
    )  # fmt: skip


def joint_speeds(run: Run) -> Array:
    """Return the largest speed of each joint of the arm over its limit (n_joints,), else 0."""
    robot, rates = run.robot, np.abs(run.log.rates).max(axis=0)
    ratios = dict(zip(robot.actuators, rates / robot.velocity_limits, strict=True))
    return np.array([ratios.get(name, 0.0) for name in robot.joint_names])


def _cannot_hold(run: Run) -> Outcome | None:
    """Return that a joint is thrown, off its reference or beyond its speed, or sinks from it."""
    robot = run.robot
    for name, ratio in zip(robot.joint_names, joint_speeds(run), strict=True):
        if ratio > FAST:
            return Outcome(CANNOT_HOLD, f"{name} moves at {ratio:.3g} times its speed limit")
    if not robot.joint_names or isinstance(run.config.kinematic, EndEffector | Horizon):
        return None  # for them a joint's reference gives way to the end effector's
    away = np.abs(run.log.e[:, 3:])
    bounds = np.maximum([THROWN[unit] for unit in robot.units], GROWN * away[0])
    j = int((away.max(axis=0) / bounds).argmax())
    name, unit, error, bound = robot.joint_names[j], robot.units[j], away[:, j], float(bounds[j])
    if float(error.max()) <= bound:
        return None
    when = run.t[int(np.argmax(error > bound))]
    full = name in robot.actuators and _full(run, robot.actuators.index(name))
    why = ", its motor at its limit" if full else ""
    return Outcome(
        CANNOT_HOLD, f"{name} is {error.max():.2g} {unit} off its reference, beyond {bound:.2g} "
        f"{unit} from {when:.3g} s on{why}"
    )  # fmt: skip


def _lost(run: Run) -> Outcome | None:
    """Return that limits kept the robot from what its law wanted while its error did not fall."""
    log, guards = run.log, run.config.guards
    if run.config.output is None:
        efforts = [k for k, (_, kind) in enumerate(log.bound_limits) if kind == "effort"]
        at_limit = log.active_limits[:, efforts].any(axis=1)
    else:
        at_limit = falls_short(log.nu, log.nu_cmd)
    at = Watchdog(guards.lost_after).first_lost(run.t, np.asarray(at_limit), log.e)
    if at is None:
        return None
    return Outcome(
        LOST, f"at its limits for {guards.lost_after:g} s, {np.abs(log.e[at]).max():.2g} m or rad "
              f"from its reference without coming nearer, at {run.t[at]:.3g} s"
    )  # fmt: skip


def _full(run: Run, k: int) -> bool:
    """Return whether an actuator ever gave all that it has."""
    limit = run.robot.effort_limits[k]
    return bool(math.isfinite(limit) and np.abs(run.tau[:, k]).max() >= 0.999 * limit)


def chatter(run: Run) -> Array:
    """Return by how much of its limit each effort (n_act,) leaps to and fro each sample.

    It is the mean over the second half, where none leaps that only grows or falls; 0 without a
    limit, and of runs of too few samples.
    """
    tau, limits = run.tau[len(run.tau) // 2 :], np.asarray(run.robot.effort_limits)
    if len(tau) < FEW:
        return np.zeros(len(limits))
    return np.asarray(np.abs(np.diff(tau, n=2, axis=0)).mean(axis=0) / 2.0 / limits)


def _chatters(run: Run) -> Outcome | None:
    """Return that an effort leaps to and fro by half its limit, or half of what its rate allows."""
    leaps = chatter(run)
    worst = int(leaps.argmax())
    most = (run.config.guards.effort_rate or EFFORT_RATE) * float(np.diff(run.t[:2]).sum())
    if leaps[worst] <= CHATTER * min(most, 1.0):
        return None
    name = run.robot.actuators[worst]
    return Outcome(
        CHATTERS, f"the effort of {name} jumps by {100.0 * leaps[worst]:.0f} % of its limit "
                  "between samples"
    )  # fmt: skip


def _lasting(run: Run, true: NDArray[np.bool_]) -> float | None:
    """Return when (s) something begins that then lasts; None if nothing does."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(int)))
    begins, ends = run.t[edges[::2]], run.t[np.minimum(edges[1::2], len(run.t) - 1)]
    lasting = begins[ends - begins >= LASTING_S]
    return float(lasting[0]) if len(lasting) else None
