"""The steps of a program as lines of LLVM: what reads and writes rows, repeats, and leaves."""

from __future__ import annotations

from collections.abc import Iterable

from rpctl.kernels.functions import Functions
from rpctl.kernels.program import (
    Buffer,
    Call,
    Leave,
    Program,
    Read,
    ReadBack,
    Repeat,
    RowStream,
    Statement,
    Until,
    When,
    Write,
)

STREAM_FIELDS = ("values", "rows", "every", "ring")  # 64 bits each, of every stream, in a table
HEAD = """define i64 @run(i64 %first, i64 %steps, ptr %workspace, ptr %streams) #0 {
entry:
%done = alloca i64"""


class StepLines:
    """Writes the function that runs the steps of a program.

    Args:
        program: The program.
        functions: What it calls.
    """

    def __init__(self, program: Program, functions: Functions) -> None:
        self.program, self.functions = program, functions
        self.lanes = functions.lanes
        self._streams = {stream: k for k, stream in enumerate(program.streams)}
        self._head: list[str] = [HEAD]
        self._lines: list[str] = []
        self._count = 0

    def text(self) -> str:
        """Return the definition of the function."""
        self._lines += ["store i64 0, ptr %done", "br label %next"]
        self._label("next")
        done = self._emit("load i64, ptr %done")
        more = self._emit(f"icmp slt i64 {done}, %steps")
        self._branch(more, "step", "left")
        self._label("step")
        self._lines.append(f"%number = add i64 %first, {done}")
        self._lines.append(f"%since = add i64 0, {done}")
        self._body(self.program.body)
        following = self._emit("add i64 %since, 1")
        self._lines += [f"store i64 {following}, ptr %done", "br label %next"]
        self._label("left")
        count = self._emit("load i64, ptr %done")
        self._lines += [f"ret i64 {count}", "}"]
        return "\n".join((*self._head, *self._lines))

    def _body(self, body: Iterable[Statement]) -> None:
        for statement in body:
            match statement:
                case Call():
                    self._lines.append(self.functions.call(statement))
                case Read(stream, into):
                    self._copy(self._row(stream), into, stream.laned, out=False)
                case Write(source, stream):
                    self._write(source, stream)
                case ReadBack(stream, back, into):
                    self._read_back(stream, back, into)
                case Repeat(times, inner):
                    self._repeat(times, inner, None)
                case Until(going, most, inner):
                    self._repeat(most, inner, going)
                case When(flag, inner):
                    body_label, after = self._labels("when", "after")
                    self._branch(self._any(flag), body_label, after)
                    self._label(body_label)
                    self._body(inner)
                    self._go(after)
                case Leave(flag):
                    (stay,) = self._labels("stay")
                    self._branch(self._any(flag), "left", stay)
                    self._label(stay)

    def _repeat(self, times: int, body: Iterable[Statement], going: Buffer | None) -> None:
        """Repeat a body so many times, or until a buffer is 0 in all lanes."""
        head, inner, after = self._labels("repeat", "inner", "after")
        counter = f"%counter_{self._count}"
        self._head.append(f"{counter} = alloca i64")
        self._lines.append(f"store i64 0, ptr {counter}")
        self._go(head)
        count = self._emit(f"load i64, ptr {counter}")
        on = self._emit(f"icmp slt i64 {count}, {times}")
        if going is not None:
            on = self._emit(f"and i1 {on}, {self._any(going)}")
        self._branch(on, inner, after)
        self._label(inner)
        self._body(body)
        count = self._emit(f"add i64 {count}, 1")
        self._lines += [f"store i64 {count}, ptr {counter}", f"br label %{head}"]
        self._label(after)

    def _write(self, source: Buffer, stream: RowStream) -> None:
        """Copy a buffer into the row of this step, if the stream has one."""
        write, after = self._labels("write", "after")
        every = self._field(stream, "every")
        rest = self._emit(f"urem i64 %number, {every}")
        self._branch(self._emit(f"icmp eq i64 {rest}, 0"), write, after)
        self._label(write)
        self._copy(self._row(stream), source, True, out=True)
        self._go(after)

    def _row(self, stream: RowStream) -> str:
        """Return the address of the row of this step."""
        rows, every, ring = (self._field(stream, x) for x in STREAM_FIELDS[1:])
        around = self._emit(f"urem i64 %number, {rows}")
        straight = self._emit(f"udiv i64 %since, {every}")
        is_ring = self._emit(f"icmp ne i64 {ring}, 0")
        row = self._emit(f"select i1 {is_ring}, i64 {around}, i64 {straight}")
        return self._address(stream, row)

    def _address(self, stream: RowStream, row: str) -> str:
        size = 8 * stream.width * (self.lanes if stream.laned else 1)
        start = self._emit(f"inttoptr i64 {self._field(stream, 'values')} to ptr")
        return self._emit(
            f"getelementptr i8, ptr {start}, i64 {self._emit(f'mul i64 {row}, {size}')}"
        )

    def _field(self, stream: RowStream, field: str) -> str:
        offset = 8 * (len(STREAM_FIELDS) * self._streams[stream] + STREAM_FIELDS.index(field))
        return self._emit(
            f"load i64, ptr {self._emit(f'getelementptr i8, ptr %streams, i64 {offset}')}"
        )

    def _read_back(self, stream: RowStream, back: Buffer, into: Buffer) -> None:
        """Copy, lane by lane, the row of some steps ago; of a count that is none, of this step."""
        rows = self._field(stream, "rows")
        most = self._emit(f"sitofp i64 {rows} to double")
        now = self._emit(f"urem i64 %number, {rows}")
        for lane in range(self.lanes):
            count = self._emit(f"load double, ptr {self._buffer(back, lane)}")
            low = self._emit(f"fcmp oge double {count}, 0.0")
            high = self._emit(f"fcmp olt double {count}, {most}")
            inside = self._emit(f"and i1 {low}, {high}")
            count = self._emit(f"select i1 {inside}, double {count}, double 0.0")
            ago = self._emit(f"sub i64 {now}, {self._emit(f'fptosi double {count} to i64')}")
            before = self._emit(f"icmp slt i64 {ago}, 0")
            round_ = self._emit(f"add i64 {ago}, {rows}")
            row = self._emit(f"select i1 {before}, i64 {round_}, i64 {ago}")
            source = self._address(stream, row)
            for entry in range(into.size):
                at = 8 * (entry * self.lanes + lane)
                place = self._emit(f"getelementptr i8, ptr {source}, i64 {at}")
                value = self._emit(f"load double, ptr {place}, align 8")
                target = self._buffer(into, entry * self.lanes + lane)
                self._lines.append(f"store double {value}, ptr {target}")

    def _copy(self, row: str, buffer: Buffer, laned: bool, out: bool) -> None:
        """Copy a row from or to a buffer."""
        head, after = self._labels("copy", "after")
        counter = f"%counter_{self._count}"
        self._head.append(f"{counter} = alloca i64")
        self._lines.append(f"store i64 0, ptr {counter}")
        self._go(head)
        entry = self._emit(f"load i64, ptr {counter}")
        wide = self._emit(f"mul i64 {entry}, {8 * self.lanes}")
        inside = self._emit(f"getelementptr i8, ptr {self._buffer(buffer, 0)}, i64 {wide}")
        one = self._emit(f"mul i64 {entry}, 8")
        outside = self._emit(f"getelementptr i8, ptr {row}, i64 {wide if laned else one}")
        self._move(outside, inside, laned, out)
        following = self._emit(f"add i64 {entry}, 1")
        self._lines.append(f"store i64 {following}, ptr {counter}")
        self._branch(self._emit(f"icmp slt i64 {following}, {buffer.size}"), head, after)
        self._label(after)

    def _move(self, outside: str, inside: str, laned: bool, out: bool) -> None:
        """Copy the lanes of one entry."""
        several = "double" if self.lanes == 1 else f"<{self.lanes} x double>"
        source = inside if out else outside
        value = self._emit(f"load {several if laned else 'double'}, ptr {source}, align 8")
        if not laned and self.lanes > 1:
            first = self._emit(f"insertelement {several} poison, double {value}, i32 0")
            zeros = f"<{self.lanes} x i32> zeroinitializer"
            value = self._emit(f"shufflevector {several} {first}, {several} poison, {zeros}")
        self._lines.append(f"store {several} {value}, ptr {outside if out else inside}, align 8")

    def _any(self, flag: Buffer) -> str:
        """Return whether a flag is not 0 in any lane."""
        if self.lanes == 1:
            value = self._emit(f"load double, ptr {self._buffer(flag, 0)}")
            return self._emit(f"fcmp une double {value}, 0.0")
        several = f"<{self.lanes} x double>"
        values = self._emit(f"load {several}, ptr {self._buffer(flag, 0)}, align 8")
        set_ = self._emit(f"fcmp une {several} {values}, zeroinitializer")
        bits = self._emit(f"bitcast <{self.lanes} x i1> {set_} to i{self.lanes}")
        return self._emit(f"icmp ne i{self.lanes} {bits}, 0")

    def _buffer(self, buffer: Buffer, number: int) -> str:
        offset = self.functions.offsets[buffer] + 8 * number
        return self._emit(f"getelementptr i8, ptr %workspace, i64 {offset}")

    def _emit(self, line: str) -> str:
        self._count += 1
        self._lines.append(f"%s{self._count} = {line}")
        return f"%s{self._count}"

    def _labels(self, *names: str) -> list[str]:
        self._count += 1
        return [f"{name}_{self._count}" for name in names]

    def _branch(self, flag: str, yes: str, no: str) -> None:
        self._lines.append(f"br i1 {flag}, label %{yes}, label %{no}")

    def _go(self, label: str) -> None:
        """End a block and begin the next one."""
        self._lines.append(f"br label %{label}")
        self._label(label)

    def _label(self, name: str) -> None:
        self._lines.append(f"{name}:")
