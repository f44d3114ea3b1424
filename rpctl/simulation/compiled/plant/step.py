"""Which step a plant takes: one that is implicit in its losses, or the explicit one."""

from __future__ import annotations

from dataclasses import dataclass

from rpctl.simulation.compiled.machine.program import Buffer, Repeat, Statement
from rpctl.simulation.compiled.plant.buffers import PlantBuffers
from rpctl.simulation.compiled.plant.explicit_step import explicit_step
from rpctl.simulation.compiled.plant.implicit_step import ImplicitStep
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics


@dataclass(frozen=True, eq=False)
class PlantFragment:
    """A plant as statements.

    Attributes:
        start: What is done once, before the first step.
        steps: What advances the plant.
        memory: What it remembers from step to step, besides its state.
    """

    start: tuple[Statement, ...]
    steps: tuple[Statement, ...]
    memory: tuple[Buffer, ...]


def plant_fragment(
    dynamics: SymbolicDynamics, at: PlantBuffers, dt: float, steps: int
) -> PlantFragment:
    """Return the statements that advance a plant by some steps.

    Args:
        dynamics: Of the simulated robot.
        at: What they work on.
        dt: Length of a step, s.
        steps: How many.
    """
    if not dynamics.lossy:
        return PlantFragment((), (Repeat(steps, explicit_step(dynamics, at, dt)),), ())
    step = ImplicitStep(dynamics, at, dt)
    return PlantFragment(step.start(), (Repeat(steps, step.statements()),), (step.inertia,))
