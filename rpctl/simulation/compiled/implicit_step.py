"""The step ARS(2,2,2) of a plant with losses, implicit in these, and what every plant works on.

Equations and tolerances are those of `dynamics/motion.py`; the numbers of both agree to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.dynamics.motion import (
    CONVERGED,
    DELTA,
    GAMMA,
    NEWTON_STEPS,
    OVERSHOOT,
    SURE_STEPS,
)
from rpctl.dynamics.projection import dexpinv
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Buffer, Place, Statement, Until, When, statement, symbolic
from rpctl.kernels.scalars import (
    Layout,
    PositiveFactors,
    Scalar,
    column,
    entries,
    factored,
    solve_factored,
)
from rpctl.robot.losses import SLIDING_RATE, TURNING_RATE
from rpctl.robot.model import Robot


class ImplicitStep:
    """A step in two explicit parts, each followed by an implicit one.

    Args:
        dynamics: Of the simulated robot.
        at: What it works on.
        dt: Length of the step, s.

    Attributes:
        memory: What the end of a step leaves for the next: M at the state (n_M,), and by how much
            the speeds changed (dof,).
    """

    def __init__(self, dynamics: SymbolicDynamics, at: PlantBuffers, dt: float) -> None:
        n, nv, nq = dynamics.robot.dof, dynamics.robot.nv, dynamics.robot.nq
        self._dynamics, self._dt = dynamics, dt
        self._layout = inertia_layout(dynamics)
        self._plant = plant_places(dynamics, at)
        size = self._layout.size
        self._parts = places(
            "ars", place=nq, v=nv, a=n, power=1, M=size, free=n, found=n, impulse=nv, change=n
        )
        self.memory = self._parts["M"][0], self._parts["change"][0]

    def start(self) -> tuple[Statement, ...]:
        """Return what is done before the first step."""
        plant = self._plant
        found = {
            "M": self._inertia(plant["q"][1]),
            "change": casadi.SX(self._dynamics.robot.dof, 1),
        }
        return (statement("inertia", [plant["q"], plant["p"]], self._outputs(found)),)

    def statements(self) -> tuple[Statement, ...]:
        """Return the statements of a step."""
        names = ("place", "M", "free", "found")
        at = BrakedPlaces(self._plant["p"], *(self._parts[name] for name in names))
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
        """Return B τ − h, with the stops' reaction (dof, 1)."""
        pushing = self._dynamics.at(q).B @ self._plant["tau"][1] + self._plant["reaction"][1]
        return pushing - self._dynamics.bias(q, nu)

    def _outputs(self, found: Mapping[str, Any]) -> list[Place]:
        return [(self._parts[name][0], value) for name, value in found.items()]

    def _inputs(self, *names: str) -> list[Place]:
        return [self._parts[name] for name in names]

    def _begin(self) -> Statement:
        """Go to the middle, without losses."""
        dynamics, plant, own = self._dynamics, self._plant, GAMMA * self._dt
        q, nu = plant["q"][1], plant["nu"][1]
        projection = dynamics.at(q)
        v, a = projection.S @ nu, self._solved(self._push(q, nu))
        place = dynamics.integrate(q, own * v)
        found = {
            "v": v,
            "a": a,
            "power": casadi.dot(projection.B @ plant["tau"][1] + plant["reaction"][1], nu),
            "place": place,
            "M": self._inertia(place),
            "free": nu + own * a,
            "found": nu + GAMMA * self._parts["change"][1],  # as if it went on
        }
        inputs = [plant[name] for name in ("q", "nu", "tau", "reaction", "p")]
        inputs += self._inputs("M", "change")
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
        end = dynamics.integrate(plant["q"][1], dt * way)
        found = {
            "place": end,
            "M": self._inertia(end),
            "free": plant["nu"][1] + dt * (DELTA * a + self._solved(right)),
            "found": plant["nu"][1] + (middle - plant["nu"][1]) / GAMMA,
            "impulse": dt * (1.0 - GAMMA) * brake,
        }
        inputs = [plant[name] for name in ("q", "nu", "tau", "reaction", "p")]
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
        pushing = projection.B @ plant["tau"][1] + plant["reaction"][1]
        work = 0.5 * dt * (power + casadi.dot(pushing, after))
        lost = -0.5 * casadi.dot(whole, v + v_end)
        results = [
            (plant["q"][0], place),
            (plant["nu"][0], after),
            (self._parts["change"][0], after - plant["nu"][1]),
            (plant["energy"][0], plant["energy"][1] + casadi.vertcat(work, lost)),
        ]
        inputs = [plant[name] for name in ("nu", "tau", "reaction", "p", "energy")]
        inputs += self._inputs(*names)
        return statement("finish", inputs, results)


CHORD_CONVERGED = 1e-2 * CONVERGED  # its error is not the square of the last step, but a share
NEWTON, CHORD, SURE = 0.0, 1.0, 2.0  # which step is next


@dataclass(frozen=True, eq=False)
class BrakedPlaces:
    """What the search for the speeds works on.

    Attributes:
        p: Parameters of the simulated robot.
        place: Configuration at which S is taken (nq,).
        M: Inertia there, as :func:`inertia_layout` lays it out.
        free: ν₀, the speeds without losses (dof,).
        found: In the guess, out ν (dof,).
    """

    p: Place
    place: Place
    M: Place
    free: Place
    found: Place


def inertia_layout(dynamics: SymbolicDynamics) -> Layout:
    """Return where the entries of M stand in a column: those of its lower half."""
    return Layout({"M": lower_half(dynamics.inertia(casadi.SX.sym("q", dynamics.robot.nq)))})


def lower_half(M: Any) -> Any:
    """Return the lower half of a symmetric matrix, sparse where it is constantly 0."""
    return casadi.sparsify(casadi.tril(M))


def braked(dynamics: SymbolicDynamics, at: BrakedPlaces, weight: float) -> tuple[Statement, ...]:
    """Return the statements that find the ν of M (ν − ν₀) = w ℓ(ν).

    A trip tries one step. After Newton's step the next one is taken with the same curvature, a
    chord's, which costs a fraction: mostly it is so small that its end is the solution. Where a
    step went too far, it is tried again, a chord's as Newton's and Newton's as the sure one. A lane
    that has converged stays as it is.

    Args:
        dynamics: Of the simulated robot.
        at: What they work on.
        weight: w, s.
    """
    search = _Search(dynamics, at, weight)
    trip = (*search.factoring(), search.trip())
    return *search.begin(), Until(search.going[0], 3 * (NEWTON_STEPS + SURE_STEPS), trip)


class _Search:
    """The search for one ν.

    Args:
        dynamics: Of the simulated robot.
        at: What it works on.
        weight: w, s.
    """

    def __init__(self, dynamics: SymbolicDynamics, at: BrakedPlaces, weight: float) -> None:
        n, nv = dynamics.robot.dof, dynamics.robot.nv
        self._dynamics, self._at, self._weight = dynamics, at, weight
        self._M = casadi.tril2symm(inertia_layout(dynamics).parts(at.M[1])["M"])
        self._S = dynamics.at(at.place[1]).S
        self._lossy = _lossy(dynamics)
        self._flags = places("search", kind=1, trips=1, going=1, stale=1)
        self._state = places("search", gradient=n, v=nv)
        self.going = self._flags["going"]
        self._factors = self._factored()
        self._kept = places("factors", numbers=len(self._numbers(self._factors)))["numbers"]

    def _gradient(self, nu: Any, v: Any) -> Any:
        """Return the slope of the potential (dof, 1) at ν (dof, 1) and v = S ν."""
        force = self._S.T @ self._dynamics.loss_force(v)
        return self._M @ (nu - self._at.free[1]) - self._weight * force

    def begin(self) -> tuple[Statement, ...]:
        """Return what is done before the first trip."""
        at, found = self._at, self._at.found[1]
        v = self._S @ found
        values = {"kind": NEWTON, "trips": 0.0, "going": 1.0, "stale": 1.0}
        outputs = [(self._flags[name][0], value) for name, value in values.items()]
        outputs += [
            (self._state["gradient"][0], self._gradient(found, v)),
            (self._state["v"][0], v),
        ]
        return (statement("search", [at.place, at.M, at.free, at.found, at.p], outputs),)

    def factoring(self) -> tuple[Statement, ...]:
        """Return what factors the curvature in the lanes where it is another one."""
        at, stale = self._at, self._flags["stale"]
        numbers = casadi.vertcat(*self._numbers(self._factors))
        kept = casadi.if_else(stale[1], numbers, self._kept[1])
        inputs = [at.place, at.M, self._state["v"], self._flags["kind"], stale, at.p, self._kept]
        return (When(stale[0], (statement("factor", inputs, [(self._kept[0], kept)]),)),)

    def _factored(self) -> PositiveFactors:
        v, lossy = self._state["v"][1], self._lossy
        slope, secant = (
            each[lossy] for each in (self._dynamics.loss_slope(v), self._dynamics.loss_secant(v))
        )
        sure = self._flags["kind"][1] == SURE
        rows = self._S[lossy, :]
        curvature = casadi.diag(self._weight * casadi.if_else(sure, secant, slope))
        H = casadi.sparsify(self._M + rows.T @ curvature @ rows)
        n = H.shape[0]
        has = H.sparsity().has_nz
        return factored([[H[i, j] if has(i, j) else 0.0 for j in range(n)] for i in range(n)])

    def _numbers(self, factors: PositiveFactors) -> list[Scalar]:
        return [*factors.over, *(each for row in factors.L for each in row.values())]

    def _restored(self) -> PositiveFactors:
        """Return the factors as symbols of the buffer that keeps them."""
        symbols = iter(entries(self._kept[1]))
        over = [next(symbols) for _ in self._factors.over]
        return PositiveFactors([{i: next(symbols) for i in row} for row in self._factors.L], over)

    def trip(self) -> Statement:
        """Return the call that tries a step."""
        at, found = self._at, self._at.found[1]
        kind, trips, going = (self._flags[name][1] for name in ("kind", "trips", "going"))
        gradient, v = self._state["gradient"][1], self._state["v"][1]
        step = column(solve_factored(self._restored(), entries(-gradient)))
        ahead = found + step
        v_ahead = self._S @ ahead
        slope_ahead = self._gradient(ahead, v_ahead)
        size = _least_rate(self._dynamics.robot) + casadi.mmax(casadi.fabs(v))
        limit = casadi.if_else(kind == CHORD, CHORD_CONVERGED, CONVERGED)
        tiny = casadi.mmax(casadi.fabs(v_ahead - v)) <= limit * size
        small = casadi.logic_and(kind != SURE, tiny)
        far = casadi.fabs(casadi.dot(slope_ahead, step)) > OVERSHOOT * casadi.fabs(
            casadi.dot(gradient, step)
        )
        far = casadi.logic_or(far, casadi.logic_and(kind == NEWTON, trips >= NEWTON_STEPS))
        again = casadi.logic_and(kind != SURE, casadi.logic_and(casadi.logic_not(small), far))
        done = going == 0.0
        stays = casadi.logic_or(again, done)
        follows = casadi.if_else(kind == NEWTON, CHORD, NEWTON)
        retried = casadi.if_else(kind == NEWTON, SURE, NEWTON)
        following = casadi.if_else(again, retried, follows)
        goes_on = casadi.logic_not(casadi.logic_or(done, small))
        outputs = [
            (self._flags["kind"][0], following),
            (self._flags["trips"][0], trips + casadi.if_else(again, 0.0, 1.0)),
            (self.going[0], goes_on),
            (self._flags["stale"][0], casadi.logic_and(goes_on, following != CHORD)),
            (at.found[0], casadi.if_else(stays, found, ahead)),
            (self._state["gradient"][0], casadi.if_else(stays, gradient, slope_ahead)),
            (self._state["v"][0], casadi.if_else(stays, v, v_ahead)),
        ]
        inputs = [at.place, at.M, at.free, at.found, at.p, self._kept]
        flags = [self._flags[name] for name in ("kind", "trips", "going")]
        return statement("trip", [*inputs, *flags, *self._state.values()], outputs)


def _lossy(dynamics: SymbolicDynamics) -> list[int]:
    """Return the entries of v at which something is or may be lost."""
    slope = dynamics.loss_slope(casadi.SX.sym("v", dynamics.robot.nv))
    return [i for i in range(slope.numel()) if not slope[i].is_zero()]


def _least_rate(robot: Robot) -> float:
    """Return the least rate ε at which friction is smooth, as ``find_losses`` gives them."""
    if robot.losses is not None:
        return float(robot.losses.rate.min())
    kinds = {robot.description.joint[name].kind for name in robot.entries}
    return SLIDING_RATE if "prismatic" in kinds else TURNING_RATE


@dataclass(frozen=True, eq=False)
class PlantBuffers:
    """What a plant works on.

    Attributes:
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Efforts that act (n_act,), N·m or N, what pushes besides the controller included.
        energy: Work of the efforts and what losses took so far (2,), J.
        reaction: Quasi-force of the stops that joints rest on (dof,).
        p: Parameters of the simulated robot, see :class:`SymbolicDynamics`; may be empty.
    """

    q: Buffer
    nu: Buffer
    tau: Buffer
    energy: Buffer
    reaction: Buffer
    p: Buffer


def plant_places(dynamics: SymbolicDynamics, at: PlantBuffers) -> dict[str, Place]:
    """Return the buffers of a plant by name, each with the symbols that stand for what is in it."""
    return {name: symbolic(buffer) for name, buffer in vars(at).items()} | {"p": (at.p, dynamics.p)}


def places(prefix: str, **sizes: int) -> dict[str, Place]:
    """Return new buffers with symbols, by name."""
    return {name: symbolic(Buffer(f"{prefix} {name}", size)) for name, size in sizes.items()}
