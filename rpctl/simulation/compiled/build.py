"""Closed loops built, checked against Python's, and kept while they are of use."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

from rpctl.robot.model import Robot
from rpctl.simulation.compiled.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.laws import law_fragment
from rpctl.simulation.compiled.loop import LoopProgram, LoopShape, loop_program
from rpctl.simulation.compiled.machine import compile_program
from rpctl.simulation.compiled.parameters import NOTHING, Varied
from rpctl.simulation.compiled.program import Kernel


@dataclass(frozen=True, eq=False)
class CompiledLoop:
    """A closed loop as machine code.

    Attributes:
        robot: The simulated robot.
        program: Its program.
        start: What is done once before the first sample.
        sample: A sample, and the plant until the next.
    """

    robot: Robot
    program: LoopProgram
    start: Kernel
    sample: Kernel


def build_loop(
    known: Robot,
    simulated: Robot,
    kinematic: Any,
    dynamic: Any,
    shape: LoopShape,
    lanes: int = 1,
    varied: Varied = NOTHING,
) -> CompiledLoop:
    """Return a closed loop as machine code.

    Args:
        known: The robot that the controller computes with.
        simulated: The simulated robot.
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        shape: What else is compiled in.
        lanes: How many runs go side by side.
        varied: What is a parameter of the simulated robot instead of a constant.
    """
    law = law_fragment(kinematic, dynamic, SymbolicDynamics(known), shape.period)
    program = loop_program(law, SymbolicDynamics(simulated, varied), shape)
    return CompiledLoop(
        simulated,
        program,
        compile_program(program.start, lanes),
        compile_program(program.sample, lanes),
    )
