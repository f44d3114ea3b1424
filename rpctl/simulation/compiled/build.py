"""Closed loops built, checked against Python's, and kept while they are of use."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.check import require_equal
from rpctl.simulation.compiled.laws.supported import law_fragment
from rpctl.simulation.compiled.loop import CompiledLoop, FarBounds, LoopShape, loop_program
from rpctl.simulation.compiled.machine.code import compile_program
from rpctl.simulation.compiled.stored_loop import LoopCode, loop_key, stored_loop
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics
from rpctl.simulation.config import Config
from rpctl.simulation.periods import delay_periods

MOST_KEPT = 8  # loops of a process: each takes some MB


def build_loop(
    known: Robot,
    simulated: SymbolicDynamics,
    kinematic: Any,
    dynamic: Any,
    shape: LoopShape,
    lanes: int = 1,
) -> CompiledLoop:
    """Return a closed loop as machine code.

    Args:
        known: The robot that the controller computes with.
        simulated: Dynamics of the simulated robot.
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        shape: What else is compiled in.
        lanes: How many runs go side by side.
    """
    law = law_fragment(kinematic, dynamic, SymbolicDynamics(known), shape.period)
    program = loop_program(law, simulated, shape)
    return CompiledLoop(
        simulated.robot,
        simulated.parameters_of(simulated.robot),
        program,
        compile_program(program.start, lanes),
        compile_program(program.sample, lanes),
    )


@dataclass(frozen=True, eq=False)
class _BuiltLoop:
    """A loop that was built, and what it was built for."""

    known: Robot
    simulated: Robot
    structure: str
    loop: CompiledLoop


_kept: deque[_BuiltLoop] = deque(maxlen=MOST_KEPT)


def compiled_loop(
    known: ReducedDynamics, simulated: ReducedDynamics, config: Config
) -> CompiledLoop:
    """Return the loop of one lane for a configuration, checked; it may have been built before.

    Args:
        known: The robot's dynamics as the controller knows them.
        simulated: Those of the simulated robot.
        config: Laws and circumstances.

    Raises:
        DiffersError: The loop's numbers are not Python's.
    """
    shape = shape_of(known, config)
    structure = repr((shape, config.kinematic, config.dynamic))
    for kept in _kept:
        same = kept.known is known.robot and kept.simulated is simulated.robot
        if same and kept.structure == structure:
            return kept.loop
    found = _stored(known.robot, simulated.robot, config, shape)
    require_equal(found, known, simulated, config)
    _kept.append(_BuiltLoop(known.robot, simulated.robot, structure, found))
    return found


def _stored(known: Robot, simulated: Robot, config: Config, shape: LoopShape) -> CompiledLoop:
    """Return the loop of one lane, from disk if it was ever built."""
    laws = config.kinematic, config.dynamic
    key = loop_key(known, simulated, laws, shape)

    def build() -> LoopCode:
        loop = build_loop(known, SymbolicDynamics(simulated), *laws, shape)
        return LoopCode(loop.program, loop.start, loop.sample)

    return CompiledLoop(simulated, np.zeros(0), *stored_loop(key, 1, build))


def shape_of(known: ReducedDynamics, config: Config) -> LoopShape:
    """Return what is compiled into the loop of a configuration."""
    run, plant, far = config.run, config.plant, None
    approach = getattr(config.kinematic, "approach", None)
    if approach is not None and approach.stage(known) is not None:
        far = FarBounds(approach.distance, approach.heading)
    late = delay_periods(plant.delay, run.control_period)
    noisy, saturated = bool(plant.noise or plant.sensor_bias), plant.effort != 1.0
    return LoopShape(run.control_period, run.plant_step, late > 0, noisy, saturated, far)
