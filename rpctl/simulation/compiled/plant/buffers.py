"""What the plant of a compiled loop works on: a step of `dynamics/motion.py` as statements.

Equations and tolerances are those of that file and of `dynamics/losses.py`; the numbers of both
agree to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.simulation.compiled.machine.program import Buffer
from rpctl.simulation.compiled.machine.statements import Place, symbolic
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics

ROOT_NV = 3  # velocities of the planar root


@dataclass(frozen=True, eq=False)
class PlantBuffers:
    """What a plant works on.

    Attributes:
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Efforts that act (n_act,), N·m or N, what pushes besides the controller included.
        energy: Work of the efforts and what losses took so far (2,), J.
        p: Parameters of the simulated robot, see :class:`SymbolicDynamics`; may be empty.
    """

    q: Buffer
    nu: Buffer
    tau: Buffer
    energy: Buffer
    p: Buffer


def plant_buffers(dynamics: SymbolicDynamics) -> PlantBuffers:
    """Return buffers for the plant of a robot."""
    robot = dynamics.robot
    return PlantBuffers(
        Buffer("q", robot.nq),
        Buffer("nu", robot.dof),
        Buffer("pushing", len(robot.actuators)),
        Buffer("energy", 2),
        Buffer("p", dynamics.p.numel()),
    )


@dataclass(frozen=True, eq=False)
class PlantPlaces:
    """The same buffers, each with the symbols that stand for what is in it."""

    q: Place
    nu: Place
    tau: Place
    energy: Place
    p: Place


def plant_places(dynamics: SymbolicDynamics, at: PlantBuffers) -> PlantPlaces:
    """Return the buffers of a plant with symbols.

    Args:
        dynamics: Of the simulated robot, whose parameters have symbols already.
        at: The buffers.
    """
    q, nu, tau, energy = (symbolic(buffer) for buffer in (at.q, at.nu, at.tau, at.energy))
    return PlantPlaces(q, nu, tau, energy, (at.p, dynamics.p))


def places(prefix: str, **sizes: int) -> dict[str, Place]:
    """Return new buffers with symbols, by name.

    Args:
        prefix: Of the buffers' names.
        sizes: Their sizes by name.
    """
    return {name: symbolic(Buffer(f"{prefix} {name}", size)) for name, size in sizes.items()}


def dexpinv(slide: Any, v: Any) -> Any:
    """Return dexp⁻¹ of the planar root to second order, see ``dynamics.motion.dexpinv``."""
    x, y, turn = (slide[i] for i in range(ROOT_NV))
    bx, by = turn * -v[1] + v[2] * y, turn * v[0] - v[2] * x
    change = casadi.vertcat(0.5 * bx - turn * by / 12.0, 0.5 * by + turn * bx / 12.0)
    return v + casadi.vertcat(change, casadi.SX(v.numel() - 2, 1))
