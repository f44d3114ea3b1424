"""The step ARS(2,2,2) of a plant with losses, implicit in these, see ``imex_step``."""

from __future__ import annotations

import casadi

from rpctl.dynamics.motion import DELTA, GAMMA
from rpctl.simulation.compiled.braked import BrakedPlaces, braked
from rpctl.simulation.compiled.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.law_fragment import Place, statement
from rpctl.simulation.compiled.plant import (
    PlantBuffers,
    PlantPlaces,
    dexpinv,
    places,
    plant_places,
)
from rpctl.simulation.compiled.program import Statement


def implicit_step(dynamics: SymbolicDynamics, at: PlantBuffers, dt: float) -> tuple[Statement, ...]:
    """Return the statements of a step: two explicit parts, each followed by an implicit one.

    Args:
        dynamics: Of the simulated robot.
        at: What they work on.
        dt: Length of the step, s.
    """
    n, nv, nq = dynamics.robot.dof, dynamics.robot.nv, dynamics.robot.nq
    plant = plant_places(dynamics, at)
    b = places("ars", place=nq, v=nv, a=n, power=1, M=n * n, free=n, found=n, impulse=nv)
    newton = braked(
        dynamics,
        BrakedPlaces(plant.p, b["place"], b["M"], b["free"], b["found"]),
        GAMMA * dt,
    )
    return (
        _start(dynamics, plant, b, dt),
        *newton,
        _middle(dynamics, plant, b, dt),
        *newton,
        _end(dynamics, plant, b, dt),
    )


def _start(
    dynamics: SymbolicDynamics, plant: PlantPlaces, b: dict[str, Place], dt: float
) -> Statement:
    """Go to the middle without losses.

    Args:
        dynamics: Of the simulated robot.
        plant: Its state.
        b: What the parts of the step hand on.
        dt: Length of the step, s.
    """
    q, nu, tau, own = plant.q[1], plant.nu[1], plant.tau[1], GAMMA * dt
    projection = dynamics.at(q)
    v = projection.S @ nu
    M, push = dynamics.lossless(q, nu, tau)
    a = dynamics.solve_positive(M, push)
    place = dynamics.integrate(q, own * v)
    found = {
        "v": v,
        "a": a,
        "power": casadi.dot(projection.B @ tau, nu),
        "place": place,
        "M": casadi.vec(dynamics.inertia(place)),
        "free": nu + own * a,
        "found": nu,
    }
    inputs = [plant.q, plant.nu, plant.tau, plant.p]
    return statement("start", inputs, [(b[name][0], value) for name, value in found.items()])


def _middle(
    dynamics: SymbolicDynamics, plant: PlantPlaces, b: dict[str, Place], dt: float
) -> Statement:
    """Go from the middle to the end, but for the losses there.

    Args:
        dynamics: Of the simulated robot.
        plant: Its state.
        b: What the parts of the step hand on.
        dt: Length of the step, s.
    """
    q, nu, tau, n = plant.q[1], plant.nu[1], plant.tau[1], dynamics.robot.dof
    place, middle, v, a = (b[name][1] for name in ("place", "found", "v", "a"))
    S = dynamics.at(place).S
    v_middle = S @ middle
    brake = dynamics.loss_force(v_middle)
    _, push = dynamics.lossless(place, middle, tau)
    right = (1.0 - DELTA) * push + (1.0 - GAMMA) * (S.T @ brake)
    later = dynamics.solve_positive(casadi.reshape(b["M"][1], n, n), right)
    slide = GAMMA * dt * v
    end = dynamics.integrate(q, dt * (DELTA * v + (1.0 - DELTA) * dexpinv(slide, v_middle)))
    found = {
        "place": end,
        "M": casadi.vec(dynamics.inertia(end)),
        "free": nu + dt * (DELTA * a + later),
        "impulse": dt * (1.0 - GAMMA) * brake,
    }
    inputs = [plant.q, plant.nu, plant.tau, plant.p]
    inputs += [b[name] for name in ("place", "M", "found", "v", "a")]
    return statement("middle", inputs, [(b[name][0], value) for name, value in found.items()])


def _end(
    dynamics: SymbolicDynamics, plant: PlantPlaces, b: dict[str, Place], dt: float
) -> Statement:
    """Take the state at the end, and the energies of the step.

    Args:
        dynamics: Of the simulated robot.
        plant: Its state.
        b: What the parts of the step hand on.
        dt: Length of the step, s.
    """
    place, after, v, power, impulse = (
        b[name][1] for name in ("place", "found", "v", "power", "impulse")
    )
    projection = dynamics.at(place)
    v_end = projection.S @ after
    whole = impulse + dt * GAMMA * dynamics.loss_force(v_end)
    work = 0.5 * dt * (power + casadi.dot(projection.B @ plant.tau[1], after))
    lost = -0.5 * casadi.dot(whole, v + v_end)
    results = [
        (plant.q[0], place),
        (plant.nu[0], after),
        (plant.energy[0], plant.energy[1] + casadi.vertcat(work, lost)),
    ]
    inputs = [plant.tau, plant.p, plant.energy]
    inputs += [b[name] for name in ("place", "found", "v", "power", "impulse")]
    return statement("finish", inputs, results)
