"""The speeds that losses leave, see :func:`rpctl.dynamics.losses.braked`, as statements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.dynamics.losses import CONVERGED, NEWTON_STEPS, OVERSHOOT, SURE_STEPS
from rpctl.robot.losses import SLIDING_RATE, TURNING_RATE
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.law_fragment import Place, statement
from rpctl.simulation.compiled.plant import places
from rpctl.simulation.compiled.program import Statement, Until

NEWTON, SURE = 0.0, 1.0  # which step is next


@dataclass(frozen=True, eq=False)
class BrakedPlaces:
    """What the search for the speeds works on.

    Attributes:
        p: Parameters of the simulated robot.
        place: Configuration at which S is taken (nq,).
        M: Inertia there (dof · dof,).
        free: ν₀, the speeds without losses (dof,).
        found: In the guess, out ν (dof,).
    """

    p: Place
    place: Place
    M: Place
    free: Place
    found: Place


def braked(dynamics: SymbolicDynamics, at: BrakedPlaces, weight: float) -> tuple[Statement, ...]:
    """Return the statements that find the ν of M (ν − ν₀) = w ℓ(ν).

    A trip of the loop tries one step: Newton's, or the sure one where the last trip's Newton step
    went too far. A lane that has converged stays as it is.

    Args:
        dynamics: Of the simulated robot.
        at: What they work on.
        weight: w, s.
    """
    flags = places("newton", kind=1, trips=1, going=1)
    kind, trips, going = (symbol for _, symbol in flags.values())
    step = _TriedStep(dynamics, at, weight, kind == SURE)
    done, newton = going == 0.0, kind == NEWTON
    small = casadi.logic_and(newton, step.small)
    overshot = casadi.logic_or(trips >= NEWTON_STEPS, step.overshoots)
    again = casadi.logic_and(newton, casadi.logic_and(casadi.logic_not(small), overshot))
    stays = casadi.logic_or(again, done)
    following = {
        "kind": casadi.if_else(again, SURE, NEWTON),
        "trips": trips + casadi.if_else(again, 0.0, 1.0),
        "going": casadi.if_else(casadi.logic_or(done, small), 0.0, 1.0),
    }
    outputs = [(flags[name][0], value) for name, value in following.items()]
    outputs.append((at.found[0], casadi.if_else(stays, at.found[1], step.ahead)))
    inputs = [at.place, at.M, at.free, at.found, at.p, *flags.values()]
    trip = statement("trip", inputs, outputs)
    first = {"kind": NEWTON, "trips": 0.0, "going": 1.0}
    begin = statement("begin", [], [(flags[name][0], x) for name, x in first.items()])
    return begin, Until(flags["going"][0], 2 * (NEWTON_STEPS + SURE_STEPS), (trip,))


class _TriedStep:
    """One step from the speeds found so far.

    Args:
        dynamics: Of the simulated robot.
        at: What it works on.
        weight: w, s.
        sure: Whether it is the sure step.

    Attributes:
        ahead: Speeds after it (dof, 1).
        small: Whether a Newton step is so small that its end is the solution.
        overshoots: Whether it ends where the slope along it is too large.
    """

    def __init__(
        self, dynamics: SymbolicDynamics, at: BrakedPlaces, weight: float, sure: Any
    ) -> None:
        n = dynamics.robot.dof
        M, free, found = casadi.reshape(at.M[1], n, n), at.free[1], at.found[1]
        S = dynamics.at(at.place[1]).S
        lossy = _lossy(dynamics)
        rows = S[lossy, :]

        def gradient(nu: Any, v: Any) -> Any:
            return M @ (nu - free) - weight * (S.T @ dynamics.loss_force(v))

        v = S @ found
        slope, secant = (each[lossy] for each in (dynamics.loss_slope(v), dynamics.loss_secant(v)))
        curvature = casadi.diag(weight * casadi.if_else(sure, secant, slope))
        step = dynamics.solve_positive(M + rows.T @ curvature @ rows, -gradient(found, v))
        self.ahead = found + step
        v_ahead = S @ self.ahead
        size = _least_rate(dynamics.robot) + casadi.mmax(casadi.fabs(v))
        self.small = casadi.mmax(casadi.fabs(v_ahead - v)) <= CONVERGED * size
        end, begin = (
            casadi.dot(g, step) for g in (gradient(self.ahead, v_ahead), gradient(found, v))
        )
        self.overshoots = casadi.fabs(end) > OVERSHOOT * casadi.fabs(begin)


def _lossy(dynamics: SymbolicDynamics) -> list[int]:
    """Return the entries of v at which something is or may be lost."""
    slope = dynamics.loss_slope(casadi.SX.sym("v", dynamics.robot.nv))
    return [i for i in range(slope.numel()) if not slope[i].is_zero()]


def _least_rate(robot: Robot) -> float:
    """Return the least rate ε at which friction is smooth, as ``make_losses`` gives them."""
    if robot.losses is not None:
        return float(robot.losses.rate.min())
    kinds = {robot.description.joint[name].kind for name in robot.entries}
    return SLIDING_RATE if "prismatic" in kinds else TURNING_RATE
