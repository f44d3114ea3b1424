"""Stops of joints about a step of the plant, as `stopping_step` of `dynamics/stops.py` has them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi

from rpctl.dynamics.stops import MOST_PIVOTS, Stops, pivot
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Buffer, Call, Place, Statement, Until, When, statement, symbolic
from rpctl.kernels.scalars import any_true
from rpctl.simulation.compiled.implicit_step import (
    PlantBuffers,
    inertia_layout,
    places,
    plant_places,
)


def stop_statements(
    dynamics: SymbolicDynamics,
    stops: Stops,
    at: PlantBuffers,
    memory: Sequence[Buffer],
) -> tuple[tuple[Statement, ...], tuple[Statement, ...]]:
    """Return what is done before a step, and after it; nothing changes in lanes at no stop.

    Args:
        dynamics: Of the simulated robot.
        stops: Its stops.
        at: What the step works on.
        memory: That which keeps M at the state, as :func:`inertia_layout` lays it out, if one does.
    """
    n, plant = dynamics.robot.dof, plant_places(dynamics, at)
    sizes = dict.fromkeys(("low", "high", "m", "s", "held", "x", "push", "next", "kept"), n)
    b = places("stops", M=n * n, going=1, met=1, before=1, after=1, **sizes)
    state = [plant[name] for name in ("q", "nu", "p")]
    (_, q), (_, nu), _ = state
    M, met = casadi.reshape(b["M"][1], n, n), b["met"][1]

    def out(**values: Any) -> list[Place]:
        return [(b[name][0], value) for name, value in values.items()]

    def pivoted(*names: str) -> Call:
        buffers = [b[name][0] for name in names]
        return Call(pivot(n), tuple(buffers[:4]), tuple(buffers[4:]))

    weighed = out(M=casadi.vec(dynamics.inertia(q)), before=dynamics.energy(q, nu))
    weigh = statement("weigh", state, weighed)
    search = pivoted("M", "m", "s", "held", "x", "push", "held", "going")
    until = Until(b["going"][0], MOST_PIVOTS, (search,))
    none, (low, high), limits = casadi.SX.zeros(n), stops.ends(q), (b["low"], b["high"])
    ends = b["low"][1], b["high"][1]
    rest, kept = stops.sides(q, (low, high)), b["kept"][1]
    rest = rest * (rest * nu <= 0.0)
    push = dynamics.at(q).B @ plant["tau"][1] - dynamics.bias(q, nu) + dynamics.losses(q, nu)
    touch = out(low=low, high=high, s=rest, met=any_true(rest), kept=none, held=none, going=1.0)
    leans = out(kept=b["s"][1] * (b["push"][1] != 0.0))
    before = (
        statement("touch", state[:2], [*touch, (at.reaction, none)]),
        When(b["met"][0], (
            weigh,
            statement("press", [*state, plant["tau"]], out(m=push)),
            until,
            statement("lean", [b["push"], b["s"]], [*leans, (at.reaction, b["push"][1])]),
        )),
    )  # fmt: skip
    s = casadi.if_else(kept != 0.0, kept, stops.sides(q, ends))
    back = dynamics.at(q).S @ stops.back(q, ends, b["s"][1], kept)
    put = [(at.q, casadi.if_else(met, dynamics.integrate(q, back), q)),
           (at.nu, casadi.if_else(met, b["x"][1], nu))]  # fmt: skip
    lost = casadi.vertcat(0.0, casadi.if_else(met, b["before"][1] - b["after"][1], 0.0))
    results = [(at.energy, plant["energy"][1] + lost)]
    remembered = [symbolic(buffer) for buffer in memory]
    for buffer, inertia in remembered:
        pattern = inertia_layout(dynamics).parts(inertia)["M"].sparsity()
        results.append((buffer, casadi.if_else(met, casadi.project(M, pattern).nz[:], inertia)))
    after = (
        statement("reach", [plant["q"], *limits, b["kept"]], out(s=s, met=any_true(s))),
        When(b["met"][0], (
            weigh,
            statement("carry", [b["M"], plant["nu"], b["kept"]], out(m=M @ nu, held=kept != 0.0)),
            pivoted("M", "m", "kept", "held", "x", "push", "next", "going"),
            statement("impact", [b["M"], b["x"]], out(m=M @ b["x"][1], going=1.0)),
            until,
            statement("back", [*state, *limits, *(b[name] for name in ("s", "kept", "x", "met"))],
                      put),
            Call(weigh.function, weigh.inputs, (b["M"][0], b["after"][0])),
            statement("lose", [plant["energy"], b["before"], b["after"], b["met"], b["M"],
                               *remembered], results),
        )),
    )  # fmt: skip
    return before, after
