"""How forward dynamics and their machine code grow with the arm, 4 to 100 quasi-velocities."""

from __future__ import annotations

import tempfile
from pathlib import Path

from rpctl.simulation.backend import BUILD_EXPONENT, BUILD_S, MOST_DOF
from tests.bench.compiled_growth import FIT_FROM, chain, exponent, measure
from tests.bench.rows import Row, Section, cpu_seconds
from tests.bench.test_speed import projected, state_of

COMMAND = "python -m tests.bench.table --only growth"
SIZES, QUICK = (4, 6, 8, 12, 16, 20, 25, 30), (4, 8, 12, 20)  # dof that are compiled
LARGE = (50, 100)  # dof that are not


def section(quick: bool) -> Section:
    """Return a step's time, instructions and time to build by size, and their exponents."""
    sizes = QUICK if quick else SIZES
    rows, compiled, python = [], [], {}
    with tempfile.TemporaryDirectory() as folder:
        for dof in (*sizes, *LARGE):
            robot = chain(Path(folder), dof - 2)
            python[dof] = 1e6 * cpu_seconds(projected(state_of(robot)), 300, 5)
            if dof <= MOST_DOF:
                found = measure(robot)
                compiled.append(found)
                rows += [
                    Row(f"{dof} dof: step of machine code, 1 lane", found.step, "µs", COMMAND,
                        "`ReducedDynamics.forward`", python[dof]),
                    Row(f"{dof} dof: instructions", found.operations, "", COMMAND),
                    Row(f"{dof} dof: graph and code are built", found.graph + found.compilation,
                        "s", COMMAND),
                ]  # fmt: skip
            else:
                rows.append(
                    Row(f"{dof} dof: `ReducedDynamics.forward`", python[dof], "µs", COMMAND)
                )
    large = [row for row in compiled if row.dof >= FIT_FROM]
    dof = [row.dof for row in large]
    fits: dict[str, list[float]] = {
        "step of machine code": [row.step for row in large],
        "instructions": [row.operations for row in large],
        "time to build": [row.graph + row.compilation for row in large],
    }
    rows += [
        Row(f"{name} grows with dof to the power", exponent(dof, values), "", COMMAND)
        for name, values in fits.items()
    ]
    every = [size for size in python if size >= FIT_FROM]
    power = exponent(every, [python[size] for size in every])
    rows.append(Row("`ReducedDynamics.forward` grows with dof to the power", power, "", COMMAND))
    note = (
        "A differential base with a chain of revolute joints in general frames. Exponents are "
        f"fitted from {FIT_FROM} dof on. Whole loops are compiled up to {MOST_DOF} dof: there one "
        f"takes about {_build(MOST_DOF):.0f} s to build, at 100 it would take "
        f"{_build(100) / 60:.0f} minutes; beyond that size the loop is closed in Python."
    )
    return Section("Growth with degrees of freedom", tuple(rows), note)


def _build(dof: int) -> float:
    """Return how long a loop is taken to build, s."""
    return float(BUILD_S * dof**BUILD_EXPONENT)
