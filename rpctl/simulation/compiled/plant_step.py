"""Which step a plant takes: one that is implicit in its losses, or the explicit one."""

from __future__ import annotations

from rpctl.simulation.compiled.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.explicit_step import explicit_step
from rpctl.simulation.compiled.implicit_step import implicit_step
from rpctl.simulation.compiled.plant import PlantBuffers
from rpctl.simulation.compiled.program import Repeat, Statement


def plant_step(
    dynamics: SymbolicDynamics, at: PlantBuffers, dt: float, steps: int
) -> tuple[Statement, ...]:
    """Return the statements that advance a plant by some steps.

    Args:
        dynamics: Of the simulated robot.
        at: What they work on.
        dt: Length of a step, s.
        steps: How many.
    """
    step = implicit_step if dynamics.lossy else explicit_step
    return (Repeat(steps, step(dynamics, at, dt)),)
