"""What merits need of samples, folded while a compiled loop runs; see `merits/measures.py`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import (
    Buffer,
    Call,
    Read,
    RowStream,
    Statement,
    statement,
    symbolic,
)
from rpctl.simulation.merits.measures import (
    START,
    SampleMeasures,
    folding,
    position_limits,
    sample_measures,
)
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
    gap, rates = casadi.SX(0, 1), dynamics.at(q).B.T @ nu
    if wanted is not None:
        gap = dynamics.placement(q, str(robot.end_effector))[1] - wanted
    names = (*robot.joint_names, *steered_joints(robot))
    found = sample_measures(
        casadi.vertsplit(e),
        casadi.vertsplit(gap),
        zip(casadi.vertsplit(tau), robot.effort_limits.tolist(), strict=True),
        zip(casadi.vertsplit(rates), robot.velocity_limits.tolist(), strict=True),
        zip([dynamics.position(q, name) for name in names], position_limits(robot), strict=True),
        casadi.vertsplit(limits),
    )
    return casadi.vertcat(*found)
