"""Machine code does what the interpreter does, bit for bit in any number of lanes."""

from __future__ import annotations

import os
from pathlib import Path

import casadi
import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.kernels import cache, functions, machine_code
from rpctl.kernels.machine_code import (
    MachineCode,
    compile_program,
    module_text,
    object_code,
    this_processor,
)
from rpctl.kernels.program import (
    Buffer,
    Call,
    Leave,
    Program,
    Read,
    ReadBack,
    Repeat,
    Rows,
    RowStream,
    Statement,
    Until,
    When,
    Write,
)
from tests.kernels.interpreted import Interpreted

X, Y = casadi.SX.sym("x", 2), casadi.SX.sym("y", 2)
SWAP_ADD = casadi.Function("swap_add", [X, Y], [Y + X, X, X[0] * Y[1] - 0.3])
STEP = casadi.Function(
    "step",
    [X, Y],
    [casadi.vertcat(0.9 * X[1] + casadi.sin(Y[0]), casadi.cos(X[0]) - Y[1] * X[1])],
)
SHRINK = casadi.Function("shrink", [X], [casadi.if_else(X[0] > 0.5, 0.7 * X, X), X[0] > 0.5])
BELOW = casadi.Function("below", [X], [X[0] < X[1]])
COUNT = casadi.Function("count", [X], [X + 1.0])


class EveryStatement:
    """A program with all kinds of statements, and rows for it."""

    def __init__(self) -> None:
        self.x, self.y, self.back = Buffer("x", 2), Buffer("y", 2), Buffer("back", 1)
        self.late, self.flag, self.count = Buffer("late", 2), Buffer("flag", 1), Buffer("count", 2)
        self.given, self.shared = RowStream("given", 2), RowStream("shared", 2, laned=False)
        self.ring, self.log, self.late_log = (RowStream(x, 2) for x in ("ring", "log", "late"))
        x, y, late, flag = self.x, self.y, self.late, self.flag
        going = Buffer("going", 1)
        shrink = Call(SHRINK, (x,), (x, going))
        body: tuple[Statement, ...] = (
            Read(self.given, x),
            Read(self.shared, y),
            Write(x, self.ring),
            ReadBack(self.ring, self.back, late),
            Call(SWAP_ADD, (x, late), (x, late, flag)),  # outputs that are inputs
            Repeat(3, (Call(STEP, (x, y), (y,)), Repeat(2, (Call(STEP, (y, late), (x,)),)))),
            shrink,
            Until(going, 4, (shrink,)),
            Call(BELOW, (x,), (flag,)),
            When(flag, (Call(COUNT, (self.count,), (self.count,)),)),
            Write(x, self.log),
            Write(late, self.late_log),
        )
        self.program = Program(body)

    def run(self, kernel: MachineCode | Interpreted, lanes: slice) -> tuple[Array, ...]:
        """Take ten steps, from the fourth on; return all that is written."""
        rng = np.random.default_rng(4)
        given = rng.normal(size=(10, 2, 8))[:, :, lanes].copy()
        rows = {
            self.given: Rows(given),
            self.shared: Rows(rng.normal(size=(5, 2)), every=2),
            self.ring: Rows(np.zeros((3, *given.shape[1:])), ring=True),
            self.log: Rows(np.zeros((5, *given.shape[1:])), every=2),
            self.late_log: Rows(np.zeros((10, *given.shape[1:]))),
        }
        workspace = kernel.workspace()
        workspace[self.back][:] = np.arange(8)[lanes] % 3
        assert kernel.run(4, 10, workspace, rows) == 10
        found = [rows[x].values for x in (self.ring, self.log, self.late_log)]
        return (*found, workspace[self.count], workspace[self.flag])


@pytest.mark.parametrize("lanes", [1, 2, 8])
def test_all_statements_do_what_the_interpreter_does(lanes: int) -> None:
    case = EveryStatement()
    found = case.run(compile_program(case.program, lanes), slice(lanes))
    for got, wanted in zip(
        found, case.run(Interpreted(case.program, lanes), slice(lanes)), strict=True
    ):
        np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-12)
        assert wanted.all() or len(wanted) == 1


def test_a_lane_has_the_same_bits_alone_and_beside_others() -> None:
    case = EveryStatement()
    together = case.run(compile_program(case.program, 8), slice(8))[:3]
    for lanes in (1, 4):
        kernel = compile_program(case.program, lanes)
        for start in range(0, 8, lanes):
            part = slice(start, start + lanes)
            for alone, among in zip(case.run(kernel, part)[:3], together, strict=True):
                assert alone.tobytes() == np.ascontiguousarray(among[..., part]).tobytes()


def test_many_blocks_are_one_function(monkeypatch: pytest.MonkeyPatch) -> None:
    case = EveryStatement()
    whole = case.run(compile_program(case.program, 2), slice(2))
    text = module_text(case.program, 2)
    monkeypatch.setattr(functions, "BLOCK_LINES", 5)
    assert module_text(case.program, 2).count("\nblock_") > text.count("\nblock_") + 10
    cut = MachineCode(case.program, 2, object_code(module_text(case.program, 2), this_processor()))
    for one, other in zip(whole, case.run(cut, slice(2)), strict=True):
        assert one.tobytes() == other.tobytes()


def test_a_flag_leaves_the_loop_and_the_step_is_not_counted() -> None:
    x, flag = Buffer("x", 2), Buffer("flag", 1)
    body = (Call(COUNT, (x,), (x,)), Repeat(2, (Call(BELOW, (x,), (flag,)), Leave(flag))))
    log = RowStream("log", 2)
    kernel = compile_program(Program((Read(log, x), *body, Write(x, log))), 2)
    rows = Rows(np.array([[[2.0, 2.0], [1.0, 1.0]]] * 3 + [[[2.0, 1.0], [1.0, 2.0]]] * 2))
    assert kernel.run(0, 5, kernel.workspace(), {log: rows}) == 3
    assert rows.values[:, 0, 0].tolist() == [3.0, 3.0, 3.0, 2.0, 2.0]


def test_rows_and_buffers_that_do_not_fit_are_refused() -> None:
    case = EveryStatement()
    reads = (Read(case.given, case.x), Read(case.given, case.y))
    kernel = compile_program(Program((*reads, Write(case.x, case.log))), 2)
    good = {case.given: Rows(np.zeros((4, 2, 2))), case.log: Rows(np.zeros((2, 2, 2)), every=2)}
    kernel.run(0, 4, kernel.workspace(), good)
    read_only = np.zeros((4, 2, 2))
    read_only.flags.writeable = False
    for stream, bad in (
        (case.given, Rows(np.zeros((3, 2, 2)))),
        (case.given, Rows(np.zeros((4, 2, 1)))),
        (case.given, Rows(np.zeros((4, 2, 2), np.float32))),
        (case.given, Rows(np.zeros((2, 4, 2)).swapaxes(0, 1))),
        (case.log, Rows(np.zeros((1, 2, 2)), every=2)),
        (case.log, Rows(read_only)),
    ):
        with pytest.raises(ValueError, match=stream.name):
            kernel.run(0, 4, kernel.workspace(), good | {stream: bad})
    for strange in (np.zeros((2, 3)), np.zeros((2, 2))):
        workspace = {**kernel.workspace(), case.y: strange}
        with pytest.raises(ValueError, match="y: not of this kernel's workspace"):
            kernel.run(0, 4, workspace, good)


def test_calls_and_functions_that_cannot_be_compiled_are_refused() -> None:
    two, one, other = Buffer("two", 2), Buffer("one", 1), Buffer("other", 2)
    free = casadi.Function("free", [X], [X + Y], {"allow_free": True})
    sparse = casadi.Function("sparse", [X], [casadi.SX(casadi.Sparsity(2, 1))])
    graph = casadi.MX.sym("x", 2)
    wide = casadi.Function("wide", [casadi.SX.sym("x", 1, 2)], [X[0] * 0.0])
    cases: list[tuple[casadi.Function, tuple[Buffer, ...], tuple[Buffer, ...], str]] = [
        (SWAP_ADD, (two, other), (two, two, one), "two outputs have one buffer"),
        (SWAP_ADD, (two, one), (two, other, one), "not of its columns' sizes"),
        (
            casadi.Function("graph", [graph], [graph]),
            (two,),
            (two,),
            "only a casadi.Function of SX",
        ),
        (free, (two,), (two,), "free symbols"),
        (sparse, (two,), (Buffer("none", 2),), "dense columns"),
        (wide, (two,), (one,), "dense columns"),
    ]
    for function, inputs, outputs, message in cases:
        with pytest.raises((RpctlError, ValueError), match=message):
            module_text(Program((Call(function, inputs, outputs),)), 2)
    with pytest.raises(ValueError, match="3 lanes"):
        module_text(Program(()), 3)


def test_what_has_no_machine_code_is_named() -> None:
    x = casadi.SX.sym("x")
    buffer = Buffer("x", 1)
    for expression, name in ((casadi.erf(x), "ERF"), (casadi.log(x), "LOG")):
        call = Call(casadi.Function("f", [x], [expression]), (buffer,), (buffer,))
        with pytest.raises(RpctlError, match=f"operation {name};"):
            compile_program(Program((call,)), 1)


def test_the_key_of_machine_code_names_all_that_it_depends_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Code of another source, CasADi, LLVM, processor or program is not run in its place."""
    other = machine_code.Processor("another", "+feature")
    changes: list[tuple[object, str, object]] = [
        (machine_code, "sources", lambda: "other sources"),
        (casadi.CasadiMeta, "version", staticmethod(lambda: "0.0.0")),
        (machine_code, "compiler_version", lambda: "LLVM 0"),
        (machine_code, "this_processor", lambda: other),
    ]
    keys = [machine_code.code_key("program", 4), machine_code.code_key("program", 2)]
    assert machine_code.code_key("program", 4) == keys[0]
    for place, name, change in changes:
        with monkeypatch.context() as patch:
            patch.setattr(place, name, change)
            keys.append(machine_code.code_key("program", 4))
    assert len(set(keys)) == len(keys)


def test_sources_are_told_apart_by_any_file_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "kernels").mkdir()
    monkeypatch.setattr(cache, "__file__", str(tmp_path / "kernels" / "cache.py"))
    told = [cache.sources.__wrapped__()]
    deep = tmp_path / "control" / "law.py"
    deep.parent.mkdir()
    for text in ("a = 1\n", "a = 10\n"):
        deep.write_text(text)
        os.utime(deep, (2.0, 2.0))
        told.append(cache.sources.__wrapped__())
    os.utime(deep, (1.0, 1.0))
    told.append(cache.sources.__wrapped__())
    assert len(set(told)) == 4
