"""A program interpreted, statement by statement: slow, and what machine code must agree with."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress

import casadi
import numpy as np

from rpctl.arrays import Array
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


class _Left(Exception):
    """A step was left."""


class Interpreted:
    """A kernel that evaluates its program's functions in CasADi's own machine.

    Args:
        program: The program.
        lanes: How many runs go side by side.
    """

    def __init__(self, program: Program, lanes: int = 1) -> None:
        self.program, self.lanes = program, lanes

    def workspace(self) -> Mapping[Buffer, Array]:
        """Return buffers (size, lanes) of zeros."""
        return {buffer: np.zeros((buffer.size, self.lanes)) for buffer in self.program.buffers}

    def run(
        self,
        first: int,
        steps: int,
        workspace: Mapping[Buffer, Array],
        streams: Mapping[RowStream, Rows],
    ) -> int:
        """Do steps and return how many were done.

        Args:
            first: Number of the first step.
            steps: How many.
            workspace: The values to start from; changed.
            streams: The rows of each stream.
        """
        done = 0
        with suppress(_Left):
            for done in range(steps):
                self._do(self.program.body, first, first + done, workspace, streams)
            done = steps
        return done

    def _do(
        self,
        body: Iterable[Statement],
        first: int,
        step: int,
        workspace: Mapping[Buffer, Array],
        streams: Mapping[RowStream, Rows],
    ) -> None:
        for statement in body:
            match statement:
                case Call(function, inputs, outputs):
                    found = function.call([casadi.DM(workspace[x]) for x in inputs])
                    for into, values in zip(outputs, found, strict=True):
                        workspace[into][:] = values.full()
                case Read(stream, into):
                    row = streams[stream].values[_row(streams[stream], step, first)]
                    workspace[into][:] = row if stream.laned else row[:, None]
                case ReadBack(stream, back, into):
                    ring = streams[stream].values
                    for lane, count in enumerate(workspace[back][0].astype(int)):
                        workspace[into][:, lane] = ring[(step - count) % len(ring), :, lane]
                case Write(source, stream):
                    rows = streams[stream]
                    if step % rows.every == 0:
                        rows.values[_row(rows, step, first)] = workspace[source]
                case Repeat(times, inner):
                    for _ in range(times):
                        self._do(inner, first, step, workspace, streams)
                case Until(going, most, inner):
                    for _ in range(most):
                        if not workspace[going].any():
                            break
                        self._do(inner, first, step, workspace, streams)
                case When(flag, inner):
                    if workspace[flag].any():
                        self._do(inner, first, step, workspace, streams)
                case Leave(flag):
                    if workspace[flag].any():
                        raise _Left


def _row(rows: Rows, step: int, first: int) -> int:
    return step % len(rows.values) if rows.ring else (step - first) // rows.every
