"""What merits need of samples, folded while a compiled loop runs; see `merits/measures.py`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import (
    Buffer,
    Call,
    Read,
    RowStream,
    Statement,
    dense_function,
    statement,
    symbolic,
)
from rpctl.simulation.merits.measures import START, SampleMeasures, Totals, position_limits
from rpctl.simulation.merits.outcome import ON_PATH_M
from rpctl.simulation.run.facts import steered_joints

TIP = 3  # numbers of a place


@dataclass(frozen=True, eq=False)
class MeritFold:
    """Statements that fold a sample.

    Attributes:
        statements: What is done at each sample, once its buffers are full.
        measures: Gets what counts in the sample, in the order of :class:`SampleMeasures`.
        totals: What was folded so far, in the order of :class:`Totals`; begins as :data:`FIRST`.
        spans: Number of the first sample of the second half, and of the last quarter (2,).
        tip: Where the end effector should be, (3,) by sample, of all lanes the same; None without
            an end effector.
    """

    statements: tuple[Statement, ...]
    measures: Buffer
    totals: Buffer
    spans: Buffer
    tip: RowStream | None


FIRST = np.array(START)


def spans_of(count: int) -> Array:
    """Return what the buffer of spans holds in a run of so many samples."""
    return np.array([count // 2, 3 * count // 4], dtype=float)


def merit_fold(
    dynamics: SymbolicDynamics, sample: Sequence[Buffer], p: Buffer, count: Buffer
) -> MeritFold:
    """Return statements that fold samples of a loop.

    Args:
        dynamics: Of the simulated robot.
        sample: What has, of the simulated robot as it is, q (nq,), ν (dof,), the tracking error
            (3 + n_joints,), the efforts from now on (n_act,), and (n_limits,) not 0 where a limit
            binds.
        p: Parameters of the simulated robot (n_p,).
        count: Number of samples so far, this one included (1,).
    """
    robot = dynamics.robot
    names = SampleMeasures._fields
    tip = None if robot.end_effector is None else RowStream("tip", TIP, laned=False)
    found = MeritFold(
        (), Buffer("measures", len(names)), Buffer("merits", len(FIRST)), Buffer("spans", 2), tip
    )
    places = [symbolic(buffer) for buffer in sample]
    place, wanted = symbolic(Buffer("tip", TIP))
    measured = _measured(dynamics, [x for _, x in places], None if tip is None else wanted)
    inputs = [*places, (p, dynamics.p), (place, wanted)]
    statements: list[Statement] = [] if tip is None else [Read(tip, place)]
    statements += [
        statement("measure", inputs, [(found.measures, measured)]),
        Call(folding(), (found.totals, found.measures, count, found.spans), (found.totals,)),
    ]
    return MeritFold(tuple(statements), found.measures, found.totals, found.spans, tip)


def _measured(dynamics: SymbolicDynamics, sample: Sequence[Any], wanted: Any) -> Any:
    """Return what counts in a sample.

    Args:
        dynamics: Of the simulated robot.
        sample: q, ν, e, τ and limits.
        wanted: Where the end effector should be (3, 1), or None.
    """
    robot, (q, nu, e, tau, limits) = dynamics.robot, sample
    rates = dynamics.at(q).B.T @ nu
    names = (*robot.joint_names, *steered_joints(robot))
    beyond = [
        each
        for name, (lower, upper) in zip(names, position_limits(robot), strict=True)
        for each in _beyond(dynamics.position(q, name), lower, upper)
    ]
    found: dict[str, Any] = {
        "base": _length(e[:2]),
        "lateral": casadi.fabs(e[1]),
        "tip": 0.0,
        "joint": _largest([casadi.fabs(e[k]) for k in range(3, e.numel())], 0.0),
        "effort": _largest(_ratios(tau, robot.effort_limits), 0.0),
        "speed": _largest(_ratios(rates, robot.velocity_limits), 0.0),
        "excess": _largest(beyond, -math.inf),
        "limited": _largest([limits[k] != 0.0 for k in range(limits.numel())], 0.0),
    }
    if wanted is not None:
        found["tip"] = _length(dynamics.placement(q, str(robot.end_effector))[1] - wanted)
    return casadi.vertcat(*(found[name] for name in SampleMeasures._fields))


def folding() -> Any:
    """Return the ``casadi.Function`` of totals, measures, count of samples and spans."""
    totals = casadi.SX.sym("totals", len(Totals._fields))
    measured = casadi.SX.sym("measures", len(SampleMeasures._fields))
    t = dict(zip(Totals._fields, casadi.vertsplit(totals), strict=True))
    m = dict(zip(SampleMeasures._fields, casadi.vertsplit(measured), strict=True))
    count, spans = casadi.SX.sym("count"), casadi.SX.sym("spans", 2)
    number, base, square = count - 1.0, m["base"], m["base"] * m["base"]
    late, last = number >= spans[0], number >= spans[1]
    away = casadi.logic_not(base <= ON_PATH_M)
    folded: dict[str, Any] = {
        "base_squares": t["base_squares"] + square,
        "late_squares": t["late_squares"] + casadi.if_else(late, square, 0.0),
        "base_last": t["base_last"] + casadi.if_else(last, base, 0.0),
        "base_final": base,
        "lateral_final": m["lateral"],
        "tip_squares": t["tip_squares"] + m["tip"] * m["tip"],
        "tip_last": t["tip_last"] + casadi.if_else(last, m["tip"], 0.0),
        "tip_final": m["tip"],
        "limited": t["limited"] + m["limited"],
        "settled": casadi.if_else(away, count, t["settled"]),
    }
    for name in ("base", "joint", "effort", "speed", "excess"):
        folded[f"{name}_max"] = casadi.fmax(t[f"{name}_max"], m[name])
    after = casadi.vertcat(*(folded[name] for name in Totals._fields))
    return dense_function("fold", [totals, measured, count, spans], [after])


def _length(vector: Any) -> Any:
    return casadi.sqrt(casadi.sumsqr(vector))


def _ratios(values: Any, limits: Array) -> list[Any]:
    """Return the sizes of values over their limits, where there are any."""
    sizes = enumerate(limits.tolist())
    return [casadi.fabs(values[k]) / limit for k, limit in sizes if math.isfinite(limit)]


def _beyond(position: Any, lower: float, upper: float) -> list[Any]:
    """Return how far a position is beyond those of its limits that are finite."""
    found = [lower - position] if math.isfinite(lower) else []
    return [*found, position - upper] if math.isfinite(upper) else found


def _largest(values: Sequence[Any], least: float) -> Any:
    """Return the largest of values, or what stands for none."""
    found = casadi.SX(least) if not values else casadi.SX(values[0])
    for value in values[1:]:
        found = casadi.fmax(found, value)
    return found
