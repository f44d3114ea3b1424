"""Machine code beside NumPy and CasADi's own machine.

Each case takes as many numbers or states as its peers of a group do: compare their times.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpctl.arrays import Array
from rpctl.kernels.machine_code import MachineCode, module_text, object_code, this_processor
from rpctl.kernels.program import (
    Buffer,
    Call,
    Program,
    Read,
    Rows,
    RowStream,
    Write,
)

ENTRIES, INSTRUCTIONS = 40, 4000
STATES, ANGLES = 800, 16000  # a multiple of all lanes
LANES = (1, 4, 8)


def long_function(instructions: int) -> casadi.Function:
    """Return a function of sums and products, each of values not long before."""
    rng = np.random.default_rng(1)
    x = casadi.SX.sym("x", ENTRIES)
    values = [x[k] for k in range(ENTRIES)]
    for kind in rng.integers(0, 4, instructions):
        a, b = (values[-k] for k in rng.integers(1, ENTRIES, 2))
        values.append(a * b if kind < 2 else a + b if kind == 2 else a - 0.7 * b)
    return casadi.Function("long", [x], [0.1 * casadi.vertcat(*values[-ENTRIES:])])


def compiled(function: casadi.Function, lanes: int) -> Callable[[Array], Array]:
    """Return what maps points (n, entries) by machine code."""
    x, y = Buffer("x", function.numel_in(0)), Buffer("y", function.numel_out(0))
    given, found = RowStream("given", x.size), RowStream("found", y.size)
    program = Program((Read(given, x), Call(function, (x,), (y,)), Write(y, found)))
    kernel = MachineCode(program, lanes, object_code(module_text(program, lanes), this_processor()))
    workspace = kernel.workspace()

    def run(points: Array) -> Array:
        steps = len(points) // lanes
        rows = Rows(np.empty((steps, y.size, lanes)))
        shaped = Rows(points.reshape(steps, x.size, lanes))
        kernel.run(0, steps, workspace, {given: shaped, found: rows})
        return rows.values

    return run


def mapped(function: casadi.Function, points: Array) -> Callable[[Array], object]:
    """Return what maps points by CasADi's machine, in one call."""
    every = function.map(len(points))
    return lambda points: every(points.T)


@pytest.mark.benchmark(group=f"{ANGLES} sines")
@pytest.mark.parametrize("lanes", [*LANES, "numpy", "casadi"])
def test_sines(benchmark: BenchmarkFixture, lanes: int | str) -> None:
    x = casadi.SX.sym("x")
    angles = np.random.default_rng(0).uniform(-9.0, 9.0, (ANGLES, 1))
    function = casadi.Function("sine", [x], [casadi.sin(x)])
    run = {"numpy": np.sin, "casadi": mapped(function, angles)}.get(str(lanes))
    benchmark(run or compiled(function, int(lanes)), angles)


@pytest.mark.benchmark(group=f"{INSTRUCTIONS} instructions of {STATES} states")
@pytest.mark.parametrize("lanes", [*LANES, "casadi"])
def test_long_function(benchmark: BenchmarkFixture, lanes: int | str) -> None:
    function = long_function(INSTRUCTIONS)
    states = np.random.default_rng(0).normal(size=(STATES, ENTRIES))
    run = mapped(function, states) if lanes == "casadi" else compiled(function, int(lanes))
    benchmark(run, states)
