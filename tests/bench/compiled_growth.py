"""Forward dynamics as machine code: of every drive, and how they grow with the arm.

``python -m tests.bench.compiled_growth`` prints both. Each row of the second table is a base on two
wheels that carries a chain of revolute joints in general frames. Its last line fits y = c · dof^k
by least squares in logarithms, over rows of at least ``FIT_FROM`` dof.
"""

from __future__ import annotations

import os
import tempfile
import time
import timeit
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import casadi
import numpy as np

import rpctl
from rpctl import Robot
from rpctl.simulation.compiled.machine.code import compile_program
from rpctl.simulation.compiled.machine.program import Buffer, Call, Program, Repeat
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics
from tests import urdf
from tests.bench.test_speed import DRIVES, projected, state_of
from tests.robots import SET_A, platform, write

SIZES = (4, 6, 8, 12, 16, 20, 25, 30)
FIT_FROM = 8  # dof: below, what is constant counts
REPEATS = 1000  # evaluations in one step of the program
ROUNDS = 5  # of which the fastest counts


class Row(NamedTuple):
    """One robot's forward dynamics."""

    dof: int
    operations: int
    graph: float  # s
    compilation: float  # s
    step: float  # µs, one lane


def chain(folder: Path, joints: int, seed: int = 5) -> Robot:
    """Return a differential base with a chain of revolute joints in general frames.

    Args:
        folder: Where its file is written.
        joints: How many.
        seed: Of its numbers.
    """
    rng, parts = np.random.default_rng(seed), []
    for k in range(joints):
        carrier = f"link_{k - 1}" if k else "base"
        place = rng.uniform(-0.2, 0.2, 3)
        place[2] += 0.0 if k else 0.8
        limit = urdf.limit(-2.0, 2.0, 50.0, 2.0)
        moments = rng.uniform(0.01, 0.012, 3)
        inertia = urdf.inertial(
            2.0, moments, rng.uniform(-1e-3, 1e-3, 3), rng.uniform(-0.1, 0.1, 3)
        )
        parts.append(urdf.link(f"link_{k}", inertia))
        ends, turn = (carrier, f"link_{k}"), rng.uniform(-1.5, 1.5, 3)
        parts.append(urdf.joint(f"joint_{k}", "revolute", ends, place, (0, 0, 1), limit, turn))
    return rpctl.load(
        write(folder, platform(SET_A, extra="\n".join(parts)), f"chain_{joints}.urdf")
    )


def measure(robot: Robot, lanes: int = 1) -> Row:
    """Return what the forward dynamics of a robot take."""
    start = time.process_time()
    dynamics = SymbolicDynamics(robot)
    sizes = {"q": robot.nq, "nu": robot.dof, "tau": len(robot.actuators)}
    given = [casadi.SX.sym(name, size) for name, size in sizes.items()]
    forward = casadi.Function("forward", given, [dynamics.forward(*given)], {"cse": True})
    graph = time.process_time() - start
    buffers = [Buffer(name, size) for name, size in sizes.items()]
    call = Call(forward, tuple(buffers), (Buffer("nu_dot", robot.dof),))
    start = time.process_time()
    code = compile_program(Program((Repeat(REPEATS, (call,)),)), lanes)
    compilation = time.process_time() - start
    workspace, rng = code.workspace(), np.random.default_rng(1)
    values = (
        robot.random_configuration(rng),
        *(rng.normal(size=n) for n in list(sizes.values())[1:]),
    )
    for buffer, value in zip(buffers, values, strict=True):
        workspace[buffer][:] = value[:, None]
    took = []
    for _ in range(ROUNDS):
        start = time.process_time()
        code.run(0, 1, workspace, {})
        took.append(time.process_time() - start)
    kinds = (forward.instruction_id(k) for k in range(forward.n_instructions()))
    none = {casadi.OP_INPUT, casadi.OP_OUTPUT, casadi.OP_CONST}
    operations = sum(kind not in none for kind in kinds)
    return Row(robot.dof, operations, graph, compilation, 1e6 * min(took) / REPEATS)


def exponent(dof: Sequence[float], values: Sequence[float]) -> float:
    """Return k of values = c · dof^k, fitted in logarithms."""
    return float(np.polyfit(np.log(dof), np.log(values), 1)[0])


def main() -> None:
    """Print forward dynamics of every drive, then how those of chains grow."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RPCTL_CACHE_DIR"] = folder  # nothing that an earlier run compiled
        _print_drives()
        _print_growth([measure(chain(Path(folder), size - 2)) for size in SIZES])


def _print_drives() -> None:
    print("forward dynamics, CPU time, µs: Pinocchio, machine code of 1 lane, of 8 lanes for each")
    print(f"{'':14}{'dof':>4}{'operations':>12}{'Pinocchio':>11}{'1 lane':>8}{'8 lanes':>9}")
    for name in DRIVES:
        robot = rpctl.load(name)
        times = timeit.repeat(projected(state_of(robot)), timer=time.thread_time, number=REPEATS)
        one, eight = measure(robot), measure(robot, 8)
        pinocchio = 1e6 * min(times) / REPEATS
        print(f"{name:14}{one.dof:4}{one.operations:12}{pinocchio:11.1f}"
              f"{one.step:8.3f}{eight.step / 8:9.3f}")  # fmt: skip


def _print_growth(rows: Sequence[Row]) -> None:
    print(f"{'dof':>4}{'operations':>12}{'graph, s':>10}{'compile, s':>12}{'step, µs':>10}")
    for row in rows:
        print(f"{row.dof:4}{row.operations:12}{row.graph:10.2f}{row.compilation:12.2f}"
              f"{row.step:10.2f}")  # fmt: skip
    large = [row for row in rows if row.dof >= FIT_FROM]
    fits = [exponent([r.dof for r in large], [r[k] for r in large]) for k in range(1, 5)]
    print(f"dof^{fits[0]:12.2f}{fits[1]:10.2f}{fits[2]:12.2f}{fits[3]:10.2f}")


if __name__ == "__main__":
    main()
