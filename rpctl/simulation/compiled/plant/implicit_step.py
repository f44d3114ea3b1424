"""The step ARS(2,2,2) of a plant with losses, implicit in these, see ``imex_step``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi

from rpctl.dynamics.motion import DELTA, GAMMA
from rpctl.simulation.compiled.machine.program import Statement
from rpctl.simulation.compiled.machine.statements import Place, statement
from rpctl.simulation.compiled.plant.braked import BrakedPlaces, braked, inertia_layout, lower_half
from rpctl.simulation.compiled.plant.buffers import (
    PlantBuffers,
    dexpinv,
    places,
    plant_places,
)
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics


class ImplicitStep:
    """A step in two explicit parts, each followed by an implicit one.

    Args:
        dynamics: Of the simulated robot.
        at: What it works on.
        dt: Length of the step, s.

    Attributes:
        inertia: M at the state (n_M,), which the end of a step leaves for the next.
    """

    def __init__(self, dynamics: SymbolicDynamics, at: PlantBuffers, dt: float) -> None:
        n, nv, nq = dynamics.robot.dof, dynamics.robot.nv, dynamics.robot.nq
        self._dynamics, self._dt = dynamics, dt
        self._layout = inertia_layout(dynamics)
        self._plant = plant_places(dynamics, at)
        size = self._layout.size
        self._parts = places(
            "ars", place=nq, v=nv, a=n, power=1, M=size, free=n, found=n, impulse=nv
        )
        self.inertia = self._parts["M"][0]

    def start(self) -> tuple[Statement, ...]:
        """Return what is done before the first step."""
        plant = self._plant
        inertia = (self.inertia, self._inertia(plant.q[1]))
        return (statement("inertia", [plant.q, plant.p], [inertia]),)

    def statements(self) -> tuple[Statement, ...]:
        """Return the statements of a step."""
        names = ("place", "M", "free", "found")
        at = BrakedPlaces(self._plant.p, *(self._parts[name] for name in names))
        newton = braked(self._dynamics, at, GAMMA * self._dt)
        return self._begin(), *newton, self._middle(), *newton, self._end()

    def _inertia(self, q: Any) -> Any:
        """Return M at q (nq, 1) as the buffer has it."""
        return lower_half(self._dynamics.inertia(q)).nz[:]

    def _solved(self, right: Any) -> Any:
        """Return M⁻¹ right (dof, 1), M that of the buffer."""
        M = casadi.tril2symm(self._layout.parts(self._parts["M"][1])["M"])
        return self._dynamics.solve_positive(M, right)

    def _push(self, q: Any, nu: Any) -> Any:
        """Return B τ − h (dof, 1)."""
        pushing = self._dynamics.at(q).B @ self._plant.tau[1]
        return pushing - self._dynamics.bias(q, nu)

    def _outputs(self, found: Mapping[str, Any]) -> list[Place]:
        return [(self._parts[name][0], value) for name, value in found.items()]

    def _inputs(self, *names: str) -> list[Place]:
        return [self._parts[name] for name in names]

    def _begin(self) -> Statement:
        """Go to the middle, without losses."""
        dynamics, plant, own = self._dynamics, self._plant, GAMMA * self._dt
        q, nu = plant.q[1], plant.nu[1]
        projection = dynamics.at(q)
        v, a = projection.S @ nu, self._solved(self._push(q, nu))
        place = dynamics.integrate(q, own * v)
        found = {
            "v": v,
            "a": a,
            "power": casadi.dot(projection.B @ plant.tau[1], nu),
            "place": place,
            "M": self._inertia(place),
            "free": nu + own * a,
            "found": nu,
        }
        inputs = [plant.q, plant.nu, plant.tau, plant.p, *self._inputs("M")]
        return statement("explicit", inputs, self._outputs(found))

    def _middle(self) -> Statement:
        """Go from the middle to the end, but for the losses there."""
        dynamics, plant, dt = self._dynamics, self._plant, self._dt
        place, middle, v, a = (self._parts[name][1] for name in ("place", "found", "v", "a"))
        S = dynamics.at(place).S
        v_middle = S @ middle
        brake = dynamics.loss_force(v_middle)
        right = (1.0 - DELTA) * self._push(place, middle) + (1.0 - GAMMA) * (S.T @ brake)
        slide = GAMMA * dt * v
        way = DELTA * v + (1.0 - DELTA) * dexpinv(slide, v_middle)
        end = dynamics.integrate(plant.q[1], dt * way)
        found = {
            "place": end,
            "M": self._inertia(end),
            "free": plant.nu[1] + dt * (DELTA * a + self._solved(right)),
            "impulse": dt * (1.0 - GAMMA) * brake,
        }
        inputs = [plant.q, plant.nu, plant.tau, plant.p]
        inputs += self._inputs("place", "M", "found", "v", "a")
        return statement("middle", inputs, self._outputs(found))

    def _end(self) -> Statement:
        """Take the state at the end, and the energies of the step."""
        dynamics, plant, dt = self._dynamics, self._plant, self._dt
        names = ("place", "found", "v", "power", "impulse")
        place, after, v, power, impulse = (self._parts[name][1] for name in names)
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
        inputs = [plant.tau, plant.p, plant.energy, *self._inputs(*names)]
        return statement("finish", inputs, results)
