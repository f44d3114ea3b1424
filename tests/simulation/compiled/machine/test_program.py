"""Programs: what each statement does, in the interpreter that machine code is compared with."""

from __future__ import annotations

import casadi
import numpy as np

from rpctl.simulation.compiled.machine.interpreted import Interpreted
from rpctl.simulation.compiled.machine.program import (
    Buffer,
    Call,
    Leave,
    Program,
    Read,
    ReadBack,
    Repeat,
    Rows,
    RowStream,
    Until,
    When,
    Write,
)

X = casadi.SX.sym("x")
ADD_ONE = casadi.Function("add_one", [X], [X + 1.0])
HALVE = casadi.Function("halve", [X], [casadi.if_else(X > 1.0, 0.5 * X, X)])
ABOVE_ONE = casadi.Function("above_one", [X], [X > 1.0])


def test_a_step_reads_computes_and_writes() -> None:
    x, y = Buffer("x", 1), Buffer("y", 1)
    given, shared, log = (
        RowStream("given", 1),
        RowStream("shared", 1, laned=False),
        RowStream("log", 1),
    )
    add = casadi.Function("add", [X, X2 := casadi.SX.sym("y")], [X + X2])
    twice = Repeat(2, (Call(ADD_ONE, (x,), (x,)),))
    program = Program(
        (Read(given, x), Read(shared, y), Call(add, (x, y), (x,)), twice, Write(x, log))
    )
    kernel = Interpreted(program, 2)
    rows = {
        given: Rows(np.arange(8.0).reshape(4, 1, 2)),
        shared: Rows(np.array([[10.0], [20.0], [30.0], [40.0]])),
        log: Rows(np.zeros((2, 1, 2)), every=2),
    }
    assert kernel.run(4, 4, kernel.workspace(), rows) == 4
    assert rows[log].values[:, 0].tolist() == [[12.0, 13.0], [36.0, 37.0]]


def test_lanes_go_on_until_all_are_done() -> None:
    x, going = Buffer("x", 1), Buffer("going", 1)
    judge = Call(ABOVE_ONE, (x,), (going,))
    program = Program((judge, Until(going, 10, (Call(HALVE, (x,), (x,)), judge))))
    kernel = Interpreted(program, 3)
    workspace = kernel.workspace()
    workspace[x][:] = [0.5, 3.0, 8.0]
    kernel.run(0, 1, workspace, {})
    assert workspace[x].tolist() == [[0.5, 0.75, 1.0]]


def test_a_flag_of_one_lane_leaves_the_loop_or_enters_a_branch() -> None:
    x, flag, count = Buffer("x", 1), Buffer("flag", 1), Buffer("count", 1)
    branch = When(flag, (Call(ADD_ONE, (count,), (count,)),))
    program = Program(
        (Call(ABOVE_ONE, (x,), (flag,)), branch, Leave(flag), Call(ADD_ONE, (x,), (x,)))
    )
    kernel = Interpreted(program, 2)
    workspace = kernel.workspace()
    workspace[x][:] = [-5.0, -0.5]
    assert kernel.run(0, 9, workspace, {}) == 2
    assert workspace[x].tolist() == [[-3.0, 1.5]]
    assert workspace[count].tolist() == [[1.0, 1.0]]


def test_a_ring_gives_each_lane_what_it_wrote_some_steps_ago() -> None:
    x, back, late = Buffer("x", 1), Buffer("back", 1), Buffer("late", 1)
    ring, log = RowStream("ring", 1), RowStream("log", 1)
    program = Program(
        (Call(ADD_ONE, (x,), (x,)), Write(x, ring), ReadBack(ring, back, late), Write(late, log))
    )
    kernel = Interpreted(program, 2)
    workspace = kernel.workspace()
    workspace[back][:] = [0.0, 2.0]
    rows = {ring: Rows(np.zeros((3, 1, 2)), ring=True), log: Rows(np.zeros((5, 1, 2)))}
    kernel.run(0, 5, workspace, rows)
    assert rows[log].values[:, 0].T.tolist() == [
        [1.0, 2.0, 3.0, 4.0, 5.0],
        [0.0, 0.0, 1.0, 2.0, 3.0],
    ]
