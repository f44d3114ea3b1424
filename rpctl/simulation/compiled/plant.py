"""Which step a plant takes: one that is implicit in its losses, or the explicit one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Buffer, Place, Repeat, Statement, statement
from rpctl.simulation.compiled.implicit_step import (
    ImplicitStep,
    PlantBuffers,
    dexpinv,
    places,
    plant_places,
)

STAGES = ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0))  # how far ahead the next is; the weight of this one


def explicit_step(dynamics: SymbolicDynamics, at: PlantBuffers, dt: float) -> tuple[Statement, ...]:
    """Return the statements of a step; its four stages call one function.

    Args:
        dynamics: Of the simulated robot.
        at: What they work on.
        dt: Length of the step, s.
    """
    n, nv = dynamics.robot.dof, dynamics.robot.nv
    plant, b = plant_places(dynamics, at), places("rk4", slide=nv, speed=n)
    k, sums = places("stage", v=nv, a=n, power=1), places("sum", v=nv, a=n, power=1)
    (q, nu), ahead = (plant["q"][1], plant["nu"][1]), (b["slide"][0], b["speed"][0])
    stage = _stage(dynamics, plant["q"], plant["tau"], plant["p"], b, k)
    body: list[Statement] = [
        statement("start", [plant["nu"]], [(ahead[0], casadi.SX(nv, 1)), (ahead[1], nu)]), stage
    ]  # fmt: skip
    for i, (fraction, weight) in enumerate(STAGES):
        added = [
            (buffer, (total if i else 0.0) + weight * k[name][1])
            for name, (buffer, total) in sums.items()
        ]
        step = fraction * dt
        following = (ahead[0], step * k["v"][1]), (ahead[1], nu + step * k["a"][1])
        inputs = [plant["nu"], *k.values(), *sums.values()]
        body += [statement(f"follow{i}", inputs, [*following, *added]), stage]
    v, a, power = (dt / 6.0 * (sums[name][1] + k[name][1]) for name in sums)
    results = [
        (at.q, dynamics.integrate(q, v)),
        (at.nu, nu + a),
        (at.energy, plant["energy"][1] + casadi.vertcat(power, 0.0)),
    ]
    inputs = [plant["q"], plant["nu"], plant["energy"], *k.values(), *sums.values()]
    return *body, statement("end", inputs, results)


def _stage(
    dynamics: SymbolicDynamics, q: Place, tau: Place, p: Place, b: dict[str, Place], k: Any
) -> Statement:
    """Return the call that evaluates the motion at a stage.

    Args:
        dynamics: Of the simulated robot.
        q: Configuration at the start of the step.
        tau: Efforts.
        p: Parameters.
        b: How far from q the stage is, and its speed.
        k: Gets velocity, acceleration and power.
    """
    slide, speed = b["slide"][1], b["speed"][1]
    place = dynamics.integrate(q[1], slide)
    projection = dynamics.at(place)
    M, push = dynamics.lossless(place, speed, tau[1])
    found = {
        "v": dexpinv(slide, projection.S @ speed),
        "a": dynamics.solve_positive(M, push),
        "power": casadi.dot(projection.B @ tau[1], speed),
    }
    outputs = [(k[name][0], value) for name, value in found.items()]
    return statement("stage", [q, b["slide"], b["speed"], tau, p], outputs)


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
    return PlantFragment(step.start(), (Repeat(steps, step.statements()),), step.memory)
