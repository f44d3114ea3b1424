"""Every operation of an expression: its figures, its special cases, its bits in any lanes."""

from __future__ import annotations

import math
import re
import struct
import sys
from collections.abc import Callable, Iterator
from typing import Any

import casadi
import llvmlite.binding as binding
import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.kernels.machine_code import (
    MachineCode,
    Processor,
    compile_program,
    module_text,
    object_code,
    this_processor,
)
from rpctl.kernels.operations import BINARY, COMPARISONS, UNARY
from rpctl.kernels.program import (
    Buffer,
    Call,
    Program,
    Read,
    Rows,
    RowStream,
    Write,
)
from tests.kernels.interpreted import Interpreted

NAMES = "sin cos tan asin atan tanh floor sqrt fabs sign"
ONE: dict[str, Callable[[Any], Any]] = {
    **{name: getattr(casadi, name) for name in NAMES.split()},
    "neg": lambda x: -x,
    "sq": lambda x: x * x,
    "twice": lambda x: 2.0 * x,
    "inv": lambda x: 1.0 / x,
    "not": casadi.logic_not,
}
PAIRED = "atan2 fmin fmax copysign"
TWO: dict[str, Callable[[Any, Any], Any]] = {
    **{name: getattr(casadi, name) for name in PAIRED.split()},
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
    "eq": lambda x, y: x == y,
    "ne": lambda x, y: x != y,
    "and": casadi.logic_and,
    "or": casadi.logic_or,
    "if_else": lambda x, y: casadi.if_else(x, y, 1.0 / y),
}
# Units in the last place; twice what was seen over 100 000 points or more, where not exact.
ULPS = {"sin": 1.0, "cos": 1.0, "tan": 3.0, "asin": 3.0, "atan": 3.0, "tanh": 3.0, "atan2": 3.0}
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 1.5, 2.0, -2.0, 3.0, -3.0, math.pi, 1e5, -1e5]
SPECIAL += [math.inf, -math.inf, math.nan, 5e-324, -5e-324, 1e-310, 709.7, 709.9, -745.0, -746.5]
SPECIAL += [1.0 - 2**-53, 1.0 + 2**-52, -1.0 - 2**-52, 1e300, 1e-300, -1e-300]
PLAIN = Processor("x86-64", "")
NARROW = Processor("x86-64-v3", "")


class Everything:
    """A program that applies every operation to two numbers."""

    def __init__(self) -> None:
        x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
        values = [f(x) for f in ONE.values()] + [f(x, y) for f in TWO.values()]
        function = casadi.Function("all", [x, y], [casadi.vertcat(*values)])
        self.names = (*ONE, *TWO)
        self.given, self.found = RowStream("given", 2), RowStream("found", len(values))
        both, out = Buffer("both", 2), Buffer("out", len(values))
        split = casadi.Function("split", [xy := casadi.SX.sym("xy", 2)], [xy[0], xy[1]])
        one, two = Buffer("x", 1), Buffer("y", 1)
        self.program = Program(
            (
                Read(self.given, both),
                Call(split, (both,), (one, two)),
                Call(function, (one, two), (out,)),
                Write(out, self.found),
            )
        )

    def of(self, kernel: MachineCode | Interpreted, x: Array, y: Array) -> Array:
        """Return (points, operations)."""
        points = np.stack([x, y], 1).reshape(-1, kernel.lanes, 2).swapaxes(1, 2)
        found = Rows(np.zeros((len(points), len(self.names), kernel.lanes)))
        rows = {self.given: Rows(np.ascontiguousarray(points)), self.found: found}
        assert kernel.run(0, len(points), kernel.workspace(), rows) == len(points)
        return found.values.swapaxes(1, 2).reshape(-1, len(self.names))


@pytest.fixture(scope="module")
def everything() -> Everything:
    return Everything()


@pytest.fixture(scope="module")
def points() -> tuple[Array, Array]:
    """All pairs of special numbers, and random ones of many sizes."""
    rng = np.random.default_rng(5)
    x, y = (z.ravel() for z in np.meshgrid(SPECIAL, SPECIAL))
    near = rng.normal(size=(2, 1000)) * 3.0
    far = np.exp(rng.uniform(-12.0, 12.0, (2, 1000))) * rng.choice([-1.0, 1.0], (2, 1000))
    x, y = np.concatenate([x, *near, *far]), np.concatenate([y, *near[::-1], *far[::-1]])
    whole = -len(x) % 8  # lanes
    return np.append(x, np.ones(whole)), np.append(y, np.ones(whole))


def reference(name: str, x: Array, y: Array) -> Any:
    """Return what an operation should give, in long doubles where NumPy has it."""
    long = np.longdouble
    function = getattr(np, re.sub("^a(?=sin|tan)", "arc", name), None)
    with np.errstate(all="ignore"):
        if function is not None and name in ULPS:
            return function(*(z.astype(long) for z in ((x,) if name in ONE else (x, y))))
    return None


def differences(got: Array, wanted: Any) -> Array:
    """Return ulps; 0 where both are NaN, or the same infinity or zero."""
    with np.errstate(over="ignore"):
        rounded = wanted.astype(float)
    same = (got == rounded) & (np.signbit(got) == np.signbit(rounded))
    same |= np.isnan(got) & np.isnan(rounded)
    with np.errstate(invalid="ignore"):
        apart = np.abs(got - wanted) / np.spacing(np.minimum(np.abs(rounded), 1e308))
    return np.asarray(np.where(same, 0.0, np.nan_to_num(apart, nan=np.inf)), float)


def test_every_operation_has_a_case(everything: Everything) -> None:
    call = next(x for x in everything.program.body[2:] if isinstance(x, Call))
    function = call.function
    names = {getattr(casadi, x): x[3:] for x in dir(casadi) if x.startswith("OP_")}
    met = {names[function.instruction_id(k)] for k in range(function.n_instructions())}
    wanted = {*UNARY, *BINARY, *COMPARISONS, "SIN", "COS", "NOT", "AND", "OR"}
    assert met >= wanted - {"ASSIGN"} | {"IF_ELSE_ZERO"}


def test_figures_and_special_cases(everything: Everything, points: tuple[Array, Array]) -> None:
    x, y = points
    got = everything.of(compile_program(everything.program, 8), x, y)
    with np.errstate(all="ignore"):
        interpreted = everything.of(Interpreted(everything.program, 8), x, y)
    slack = 0.0 if np.finfo(np.longdouble).eps < 1e-18 else 2.0
    for k, name in enumerate(everything.names):
        counts = np.ones(len(x), bool)
        if name in ("sin", "cos", "tan"):
            counts = ~(np.abs(x) > 2.0**20) | np.isinf(x)
        wanted = reference(name, x, y)
        wanted = interpreted[:, k] if wanted is None else wanted
        if name in ("fmin", "fmax"):  # of two zeros C lets either be
            counts &= ~((x == 0.0) & (y == 0.0))
        apart = np.where(counts, differences(got[:, k], wanted), 0.0)
        worst = int(np.argmax(apart))
        bound = ULPS[name] + slack if name in ULPS else 0.0
        assert apart[worst] <= bound, (name, x[worst], y[worst], got[worst, k], wanted[worst])
        assert not counts.all() or np.isfinite(got[:, k]).sum() > 100


def test_an_angle_that_is_too_large_gives_nan(everything: Everything) -> None:
    x = np.array([2.0**20, np.nextafter(2.0**20, 3e6), 1e300, -1e300])
    got = everything.of(compile_program(everything.program, 1), x, np.ones(4))
    sine = got[:, everything.names.index("sin")]
    assert np.isnan(sine).tolist() == [False, True, True, True]


def test_angles_nearest_to_quarter_turns_keep_all_digits(everything: Everything) -> None:
    # Multiples n of π/2 that doubles below 2²⁰ come nearest to, for their size.
    turns = np.array([1, 2, 3, 204551, 409102, 554999, 263205, 526410, 321859])
    half_pi = 0x3243F6A8885A308D313198A2E03707344A4093822299F31D0082EFA98EC4E6C8  # times 2²⁵³
    exact = [int(n) * half_pi for n in turns]
    x = np.array([n / 2**253 for n in exact])
    rest = [int(math.ldexp(z, 200)) * 2**53 - n for z, n in zip(x, exact, strict=True)]
    small = np.array([z / 2**253 for z in rest])  # sin or cos of x, but for its sign
    got = everything.of(compile_program(everything.program, 1), x, np.ones(len(x)))
    columns = [everything.names.index("cos"), everything.names.index("sin")]
    found = np.abs(got[np.arange(len(x)), np.take(columns, 1 - turns % 2)])
    assert np.all(np.abs(found - np.abs(small)) <= np.spacing(np.abs(small)))


def _kernels(program: Program) -> Iterator[MachineCode]:
    """Yield kernels of other numbers of lanes, and for other processors."""
    here = this_processor()
    older = (NARROW, PLAIN) if "+avx2" in here.features else (here, here)
    for lanes, processor in ((1, here), (8, older[0]), (4, older[1])):
        yield MachineCode(program, lanes, object_code(module_text(program, lanes), processor))


def test_bits_depend_on_no_lanes_and_no_processor(
    everything: Everything, points: tuple[Array, Array]
) -> None:
    wanted = everything.of(compile_program(everything.program, 8), *points)
    for kernel in _kernels(everything.program):
        got = everything.of(kernel, *points)
        number = ~np.isnan(wanted)
        assert np.array_equal(np.isnan(got), ~number)
        assert np.array_equal(got[number].view(np.int64), wanted[number].view(np.int64))


def _random_choices(rng: np.random.Generator) -> casadi.Function:
    """Return a function of comparisons, conditions and choices, at random."""
    x = casadi.SX.sym("x", 6)
    numbers: list[Any] = [x[k] for k in range(6)] + [casadi.SX(0.0), casadi.SX(-1.5)]
    flags: list[Any] = [x[0] < x[1], x[2]]  # a number is a condition, too
    for _ in range(60):
        a, b, c = (numbers[k] for k in rng.integers(0, len(numbers), 3))
        f, g = (flags[k] for k in rng.integers(0, len(flags), 2))
        flags.append(
            (a <= b, a == b, a != c, casadi.logic_and(f, g), casadi.logic_or(f, g),
             casadi.logic_not(f), casadi.if_else(f, g, a))[rng.integers(0, 7)]
        )  # fmt: skip
        numbers.append(
            (casadi.if_else(f, a, b), casadi.if_else(f, a, 0.0), f + a,
             casadi.if_else(f, a, 0.0) + casadi.if_else(g, b, 0.0),
             casadi.if_else(f, a, b) - casadi.if_else(casadi.logic_not(f), a, b),
             casadi.copysign(a, b))[rng.integers(0, 6)]
        )  # fmt: skip
    return casadi.Function("choices", [x], [casadi.vertcat(*numbers, *flags)])


def test_random_choices_are_the_interpreters_to_the_bit() -> None:
    rng = np.random.default_rng(2)
    values = np.array([0.0, -0.0, 1.0, -1.5, 2.0, math.nan, math.inf, -math.inf])
    for _ in range(5):
        function = _random_choices(rng)
        given, out = Buffer("x", 6), Buffer("y", function.numel_out(0))
        program = Program((Call(function, (given,), (out,)),))
        found = []
        points = rng.choice(values, (6, 8))
        points[:, :4] = rng.choice(values[1:5], (6, 4))
        for kernel in (compile_program(program, 8), Interpreted(program, 8)):
            workspace = kernel.workspace()
            workspace[given][:] = points
            kernel.run(0, 1, workspace, {})
            found.append(np.nan_to_num(workspace[out], nan=7.0))  # a NaN has any sign
        compiled, interpreted = (x.view(np.int64) for x in found)
        assert np.array_equal(compiled, interpreted)


def test_lanes_are_as_wide_as_a_register() -> None:
    for features, lanes in (("", 2), ("+avx,-avx512f", 4), ("+neon", 2), ("+avx,+avx512f", 8)):
        assert Processor("any", features).lanes == lanes


def _undefined(code: bytes) -> set[int]:
    """Return where the names of an ELF object's undefined symbols begin."""
    sections = binding.ObjectFileRef.from_data(code).sections()
    (table,) = (x.data() for x in sections if x.name() == b".symtab")
    symbols = struct.iter_unpack("<IBBHQQ", table)
    return {name for name, _, _, section, _, _ in symbols if name and not section}


@pytest.mark.skipif(sys.platform != "linux", reason="its object files are ELF")
def test_no_library_is_called(everything: Everything) -> None:
    text = "declare double @sin(double)\ndefine double @run(double %x) {\n"
    text += "%y = call double @sin(double %x)\nret double %y\n}\n"
    assert len(_undefined(object_code(text, this_processor()))) == 1
    assert not _undefined(object_code(module_text(everything.program, 8), this_processor()))
