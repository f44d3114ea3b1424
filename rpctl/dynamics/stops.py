"""Stops: at a limit of its position a joint may turn back, but not go on.

An impact is inelastic. Of all speeds x that no stop forbids, those after it are the nearest to the
speeds before, in the measure of the inertia; of a joint that rests on its stop, the accelerations
are those in place of the speeds. With m = M times the speeds before, or the forces without stops,

    M x − m = λ,    0 ≤ s_k x_k  ⊥  s_k λ_k ≥ 0,    x and λ: speeds and impulses, or ν̇ and reactions

s_k is 1 at a lower stop, −1 at an upper one, and 0 of what is at none, whose λ is 0. It is the
projection on a convex cone, which takes ½ (x − M⁻¹m)ᵀ M (x − M⁻¹m) of the kinetic energy [M88]. The
joints that are held are found by principal pivots of the least index, which end for any positive
definite M [M74].

[M88] J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics", in:
Nonsmooth Mechanics and Applications, Springer, 1988.
[M74] K. G. Murty, "Note on a Bard-type scheme for solving the complementarity problem", Opsearch
11, 1974.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from rpctl import math  # CasADi is imported when a function is asked for
from rpctl.arrays import Array
from rpctl.dynamics.motion import Outside, Step, step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.kernels.program import dense_function
from rpctl.kernels.scalars import column, entries, solve_positive
from rpctl.robot.model import Robot

TOUCHING = 1e-9  # rad or m from its stop, a joint is at it
NO_STOP = 1e300  # rad or m: a limit of what has none; 0 times it is 0
ROUNDING = 1e-12  # of a sum of sizes: a speed into a stop, or a pull by it, that is none
MOST_PIVOTS = 256  # of eight joints at their stops at once; it takes one or two


@cache
def pivot(n: int) -> Any:
    """Return the ``casadi.Function`` of M (n²,), m (n,), s (n,) and which joints are held (n,).

    It gives x (n,) and λ (n,) with those held, which are to be held next (n,), and whether these
    are others (1,).
    """
    symbols = [math.SX.sym(name, size) for name, size in zip("Msmh", (n * n, n, n, n), strict=True)]
    (M, s, m, held), free = symbols, 1.0 - symbols[3]
    M = math.reshape(M, n, n)
    rows = M * (free @ free.T) + math.diag(held * math.diag(M))
    x = free * column(solve_positive([entries(rows[i, :].T) for i in range(n)], entries(free * m)))
    push = held * (M @ x - m)
    scale = math.fabs(M) @ math.fabs(x) + math.fabs(m)
    fast = math.mmax(math.fabs(x))
    following, going = [], math.SX(0)
    for k in range(n):
        wrong = math.if_else(
            held[k] != 0.0, s[k] * push[k] < -ROUNDING * scale[k], s[k] * x[k] < -ROUNDING * fast
        )
        turned = math.logic_and(wrong, math.logic_not(going))
        following.append(math.if_else(turned, 1.0 - held[k], held[k]))
        going = math.logic_or(going, wrong)
    return dense_function(
        "pivot", [symbols[k] for k in (0, 2, 1, 3)], [x, push, column(following), going]
    )


def stopped(M: Array, m: Array, s: Array, held: Array) -> tuple[Array, Array]:
    """Return x (n,) and λ (n,).

    Args:
        M: Inertia (n, n).
        m: As above (n,).
        s: Sides of the stops that joints are at (n,).
        held: 1 of those that are held at first (n,), 0 of others.
    """
    x = push = m
    for _ in range(MOST_PIVOTS):
        found = pivot(len(m))(M.ravel(), m, s, held)
        x, push, held, going = (np.asarray(each).ravel() for each in found)
        if not going:
            break
    return x, push


def impact(M: Array, nu: Array, s: Array, held: Array) -> Array:
    """Return the speeds (n,) after an impact, of those before it.

    Args:
        M: Inertia (n, n).
        nu: Speeds (n,).
        s: Sides of the stops that joints are at (n,).
        held: Likewise of those that were held in the step before: they have no speed of their own.
    """
    kept = pivot(len(nu))(M.ravel(), M @ nu, held, held != 0.0)[0]
    return stopped(M, M @ np.asarray(kept).ravel(), s, held != 0.0)[0]


class Stops:
    """The stops of a robot's arm and of its steered joints, at the limits of their positions.

    Its formulas are over NumPy's arrays and over CasADi's columns.

    Args:
        robot: The robot.
        names: Joints whose rates x and λ are of (n,), or other names; None: those of ν.

    Attributes:
        any: Whether there are any.
    """

    def __init__(self, robot: Robot, names: Sequence[str] | None = None) -> None:
        names = robot.quasi_velocities if names is None else names
        limits = {joint.name: (joint.lower, joint.upper) for joint in robot.joints}
        bounds = zip(*robot.steering_limits[:2], strict=True)
        limits |= zip((swivel.joint for swivel in robot.drive.steered), bounds, strict=True)
        pairs = np.array([limits.get(name, (-np.inf, np.inf)) for name in names])
        self._lower, self._upper = np.clip(pairs, -NO_STOP, NO_STOP).reshape(-1, 2).T
        self._places = [robot.entries[name].index if name in limits else 0 for name in names]
        self.any = bool(np.isfinite(pairs).any())

    def places(self, q: Any) -> Any:
        """Return where joints are (n,), at q (nq,); of what has no stop, any number."""
        return q[self._places]

    def ends(self, q: Any) -> tuple[Any, Any]:
        """Return how far down and up (n,) joints can go from q (nq,).

        One that is beyond a limit has its stop where it is: it may come back, and is not put back.
        """
        x = self.places(q)
        below, above = x < self._lower, x > self._upper
        return (self._lower + below * (x - self._lower), self._upper + above * (x - self._upper))

    def sides(self, q: Any, ends: tuple[Any, Any]) -> Any:
        """Return the sides s (n,) of the stops that joints are at, at q (nq,)."""
        x = self.places(q)
        return 1.0 * (x <= ends[0] + TOUCHING) - 1.0 * (x >= ends[1] - TOUCHING)

    def back(self, q: Any, ends: tuple[Any, Any], s: Any, held: Any) -> Any:
        """Return how far (n,) joints are put back: those held, and those beyond their stops.

        Args:
            q: Configuration (nq,).
            ends: Where the stops are, two (n,).
            s: Sides of the stops that joints are at (n,).
            held: Likewise, of those that were held there.
        """
        x = self.places(q)
        gap = (s > 0.0) * (ends[0] - x) + (s < 0.0) * (ends[1] - x)
        return gap * (held * held + (s * gap > 0.0) > 0.0)


def stopping_step(
    dynamics: ReducedDynamics,
    stops: Stops,
    state: tuple[Array, Array],
    tau: Array,
    dt: float,
    outside: Outside | None = None,
) -> Step:
    """Advance as :func:`rpctl.dynamics.motion.step` does, but no joint goes beyond its stops.

    A joint that is pressed against its stop when the step begins is held there, by a constant
    reaction, and at the end by the small impulse that is left. A joint that is then beyond a stop
    has met it: the speeds are those after the impact, and it is put back. What that takes is lost.

    Args:
        dynamics: The reduced dynamics.
        stops: Of its robot.
        state: q (nq,) and ν (dof,).
        tau: Actuator efforts (n_act,), N·m or N.
        dt: Step, s.
        outside: What pushes the robot besides; None: nothing.
    """
    q, nu = state
    ends = stops.ends(q)
    s = stops.sides(q, ends)
    s *= s * nu <= 0.0
    held, reaction, given = np.zeros(len(nu)), np.zeros(len(nu)), outside
    if s.any():
        M, push = dynamics.lossless(q, nu, tau)
        push = push + dynamics.losses(q, nu) + (0.0 if outside is None else outside(q))
        _, reaction = stopped(M, push, s, np.zeros(len(nu)))
        held = s * (reaction != 0.0)
    if held.any():

        def given(q: Array) -> Array:
            return reaction + (0.0 if outside is None else outside(q))

    done = step(dynamics, q, nu, tau, dt, given)
    s = np.where(held != 0.0, held, stops.sides(done.q, ends))
    if not s.any():
        return done
    M = dynamics.inertia(done.q)
    nu = impact(M, done.nu, s, held)
    q = dynamics.integrate(done.q, dynamics.basis(done.q) @ stops.back(done.q, ends, s, held))
    lost = dynamics.energy(done.q, done.nu) - dynamics.energy(q, nu)
    return Step(q, nu, done.work, done.lost + lost)
