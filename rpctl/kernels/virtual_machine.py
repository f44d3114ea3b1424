"""A program in CasADi's virtual machine: no machine code to build, some ten times slower."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.kernels.program import Buffer, Call, Leave, Program, Statement, Until, When

Action = Callable[[], bool]  # does a statement; returns whether the step goes on


class VirtualMachine:
    """A program of one lane, for which machine code is not worth building; it has no streams.

    Args:
        program: The program.
    """

    def __init__(self, program: Program) -> None:
        self._body, self._buffers = program.body, program.buffers

    def workspace(self) -> Mapping[Buffer, Array]:
        """Return buffers (size, 1) of zeros."""
        return {buffer: np.zeros((buffer.size, 1)) for buffer in self._buffers}

    def stepper(self, workspace: Mapping[Buffer, Array]) -> Callable[[], bool]:
        """Return what does a step in a workspace, and returns whether it was done to its end.

        The workspace has to live as long as it is used.
        """
        return _all([_action(statement, workspace) for statement in self._body])


def _all(actions: Sequence[Action]) -> Action:
    def act() -> bool:
        return all(action() for action in actions)

    return act


def _action(statement: Statement, at: Mapping[Buffer, Array]) -> Action:
    match statement:
        case Call():
            return _call(statement, at)
        case When(flag, inner):
            body = _all([_action(each, at) for each in inner])
            return lambda: body() if at[flag][0, 0] else True
        case Until(going, most, inner):
            body = _all([_action(each, at) for each in inner])
            return lambda: all(body() for _ in range(most) if at[going][0, 0])
        case Leave(flag):
            return lambda: not at[flag][0, 0]
    raise TypeError(f"{type(statement).__name__} is for machine code only")


def _call(call: Call, at: Mapping[Buffer, Array]) -> Action:
    buffer, run = call.function.buffer()
    for k, source in enumerate(call.inputs):
        buffer.set_arg(k, at[source][:, 0].data)
    # What is read as well is written at the end.
    beside = [into in call.inputs for into in call.outputs]
    found = [
        np.zeros(into.size) if apart else at[into][:, 0]
        for into, apart in zip(call.outputs, beside, strict=True)
    ]
    for k, column in enumerate(found):
        buffer.set_res(k, column.data)
    pairs = zip(call.outputs, found, beside, strict=True)
    copies = [(at[into][:, 0], column) for into, column, apart in pairs if apart]

    def act() -> bool:
        buffer  # noqa: B018  # lives as long as what runs it
        run()
        for into, column in copies:
            into[:] = column
        return True

    return act
