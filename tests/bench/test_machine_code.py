"""Machine code beside NumPy and CasADi's own machine; ``python -m`` prints how building grows.

Each case takes as many numbers or states as its peers of a group do: compare their times.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpctl.arrays import Array
from rpctl.simulation.compiled.machine.code import MachineCode, module_text
from rpctl.simulation.compiled.machine.program import (
    Buffer,
    Call,
    Program,
    Read,
    Rows,
    RowStream,
    Write,
)
from rpctl.simulation.compiled.machine.target import object_code, this_processor

ENTRIES, INSTRUCTIONS = 40, 4000
STATES, ANGLES = 800, 16000  # a multiple of all lanes
LANES = (1, 4, 8)
SIZES = (1000, 4000, 16000, 64000)  # instructions


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


def vectorised(function: casadi.Function, _: Array) -> Callable[[Array], object]:
    """Return what maps points by NumPy, an operation of all points at a time."""
    names = {getattr(casadi, x): x[3:] for x in dir(casadi) if x.startswith("OP_")}
    steps = [
        (
            names[function.instruction_id(k)],
            function.instruction_input(k),
            function.instruction_output(k),
            function.instruction_constant(k) if names[function.instruction_id(k)] == "CONST" else 0,
        )
        for k in range(function.n_instructions())
    ]
    operations: dict[str, Callable[..., Any]] = {
        "ADD": np.add,
        "SUB": np.subtract,
        "MUL": np.multiply,
    }
    operations |= {"SQ": np.square, "TWICE": lambda x: x + x, "NEG": np.negative}

    @np.errstate(all="ignore")
    def run(points: Array) -> object:
        columns, held, found = np.ascontiguousarray(points.T), {}, {}
        for name, read, written, constant in steps:
            if name == "INPUT":
                held[written[0]] = columns[read[1]]
            elif name == "CONST":
                held[written[0]] = constant
            elif name == "OUTPUT":
                found[written[1]] = held[read[0]]
            else:
                held[written[0]] = operations[name](*(held[x] for x in read))
        return found

    return run


@pytest.mark.benchmark(group=f"{ANGLES} sines")
@pytest.mark.parametrize("lanes", [*LANES, "numpy", "casadi"])
def test_sines(benchmark: BenchmarkFixture, lanes: int | str) -> None:
    x = casadi.SX.sym("x")
    angles = np.random.default_rng(0).uniform(-9.0, 9.0, (ANGLES, 1))
    function = casadi.Function("sine", [x], [casadi.sin(x)])
    run = {"numpy": np.sin, "casadi": mapped(function, angles)}.get(str(lanes))
    benchmark(run or compiled(function, int(lanes)), angles)


@pytest.mark.benchmark(group=f"{INSTRUCTIONS} instructions of {STATES} states")
@pytest.mark.parametrize("lanes", [*LANES, "numpy", "casadi"])
def test_long_function(benchmark: BenchmarkFixture, lanes: int | str) -> None:
    function = long_function(INSTRUCTIONS)
    states = np.random.default_rng(0).normal(size=(STATES, ENTRIES))
    peers = {"numpy": vectorised, "casadi": mapped}
    peer = peers.get(str(lanes))
    benchmark(peer(function, states) if peer else compiled(function, int(lanes)), states)


def main() -> None:
    """Print how building and running grow with the size of a function."""
    print("lanes  instructions  text s  code s  ns/(instruction lane)")
    for lanes in LANES:
        seconds = []
        for size in SIZES:
            function, x = long_function(size), Buffer("x", ENTRIES)
            program = Program((Call(function, (x,), (x,)),))
            begun = time.process_time()
            text = module_text(program, lanes)
            lowered = time.process_time()
            code = object_code(text, this_processor())
            built = time.process_time()
            kernel = MachineCode(program, lanes, code)
            workspace, steps = kernel.workspace(), 4_000_000 // size
            running = time.process_time()
            kernel.run(0, steps, workspace, {})
            each = (time.process_time() - running) / steps / size / lanes
            seconds.append(built - begun)
            times = f"{lowered - begun:6.3f}  {built - lowered:6.3f}  {each * 1e9:.4f}"
            print(f"{lanes:5}  {size:12}  {times}")
        exponent = np.polyfit(np.log(SIZES), np.log(seconds), 1)[0]
        print(f"{lanes:5}  building grows with instructions^{exponent:.2f}")


if __name__ == "__main__":
    main()
