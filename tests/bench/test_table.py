"""What the benchmark table claims, on the cells of the paper's robot that tell most."""

from __future__ import annotations

from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpctl import Robot
from rpctl.study.benchmark import Benchmark, grid, run_grid
from rpctl.study.scenarios import PAPER, PROPOSED
from rpctl.study.verdicts import verdicts

NOTHING = 1e-3  # m: what is left of the lateral error on a line


@pytest.mark.benchmark(group="benchmark table")
def test_table(benchmark: BenchmarkFixture, paper: Robot) -> None:
    cells = grid(["nominal", "wheel-bias"], ["line", "spin", "circle"], [PAPER, PROPOSED])
    once: Any = benchmark.pedantic
    rows = once(run_grid, (Benchmark(paper, 12.0), cells), rounds=1)
    for row in rows:
        if row.cell.controller == PROPOSED:
            assert row.figures is not None
            assert not row.figures.violations
            assert row.cell.reference != "line" or row.figures.final_lateral < NOTHING
    found = verdicts(rows, PROPOSED)
    assert len(found) == 12
    assert [verdict for verdict in found if verdict.worse_than_paper] == []
