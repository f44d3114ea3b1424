"""The plant of a compiled loop: one step of `dynamics/motion.py`, as statements.

Equations and tolerances are those of that file and of `dynamics/losses.py`; the numbers of both
agree to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.dynamics.losses import CONVERGED, NEWTON_STEPS, OVERSHOOT, SURE_STEPS
from rpctl.dynamics.motion import DELTA, GAMMA
from rpctl.robot.losses import SLIDING_RATE, TURNING_RATE
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.program import Buffer, Call, Repeat, Statement, Until

NEWTON, SECANT = 0.0, 1.0  # which step of `braked` is next
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
    make = _implicit if dynamics.lossy else _explicit
    return (Repeat(steps, make(dynamics, at, dt)),)


def _explicit(dynamics: SymbolicDynamics, at: PlantBuffers, dt: float) -> tuple[Statement, ...]:
    """Runge-Kutta-Munthe-Kaas of order 4, see ``rk4_step``."""
    robot, sym = dynamics.robot, casadi.SX.sym
    n, nv = robot.dof, robot.nv
    q, nu, tau = sym("q", robot.nq), sym("nu", n), sym("tau", len(robot.actuators))
    slide, speed, energy = sym("slide", nv), sym("speed", n), sym("energy", 2)
    place = dynamics.integrate(q, slide)
    S, B = (getattr(dynamics.at(place), name) for name in ("S", "B"))
    v = S @ speed
    M, push = dynamics.lossless(place, speed, tau)
    stage = _function(
        "stage",
        [q, slide, speed, tau, dynamics.p],
        [dexpinv(slide, v), dynamics.solve_positive(M, push), casadi.dot(B @ tau, speed)],
    )
    kv, ka, kp = sym("kv", nv), sym("ka", n), sym("kp")
    sums = sym("sum_v", nv), sym("sum_a", n), sym("sum_p")
    buffers = {
        name: Buffer(f"rk4 {name}", size)
        for name, size in (("slide", nv), ("speed", n), ("kv", nv), ("ka", n), ("kp", 1),
                           ("sum_v", nv), ("sum_a", n), ("sum_p", 1))
    }  # fmt: skip
    k = tuple(buffers[name] for name in ("kv", "ka", "kp"))
    total = tuple(buffers[name] for name in ("sum_v", "sum_a", "sum_p"))
    ahead = buffers["slide"], buffers["speed"]
    evaluate = Call(stage, (at.q, *ahead, at.tau, at.p), k)
    start = _function("start", [nu], [casadi.SX(nv, 1), nu])
    body: list[Statement] = [Call(start, (at.nu,), ahead), evaluate]
    for i, (fraction, weight) in enumerate(((0.5, 1.0), (0.5, 2.0), (1.0, 2.0))):
        before = sums if i else tuple(casadi.SX(*x.shape) for x in sums)
        added = [s + weight * x for s, x in zip(before, (kv, ka, kp), strict=True)]
        follow = _function(
            f"follow{i}",
            [nu, kv, ka, kp, *sums],
            [fraction * dt * kv, nu + fraction * dt * ka, *added],
        )
        body += [Call(follow, (at.nu, *k, *total), (*ahead, *total)), evaluate]
    sixth = dt / 6.0
    end = _function(
        "end",
        [q, nu, energy, kv, ka, kp, *sums],
        [
            dynamics.integrate(q, sixth * (sums[0] + kv)),
            nu + sixth * (sums[1] + ka),
            energy + casadi.vertcat(sixth * (sums[2] + kp), 0.0),
        ],
    )
    body.append(Call(end, (at.q, at.nu, at.energy, *k, *total), (at.q, at.nu, at.energy)))
    return tuple(body)


def _implicit(dynamics: SymbolicDynamics, at: PlantBuffers, dt: float) -> tuple[Statement, ...]:
    """ARS(2,2,2), implicit in the losses, see ``imex_step``."""
    robot, sym, own = dynamics.robot, casadi.SX.sym, GAMMA * dt
    n, nv = robot.dof, robot.nv
    q, nu, tau = sym("q", robot.nq), sym("nu", n), sym("tau", len(robot.actuators))
    p, energy = dynamics.p, sym("energy", 2)
    M, found = sym("M", n * n), sym("found", n)
    place, v1, a1, power = sym("place", robot.nq), sym("v1", nv), sym("a1", n), sym("power")
    impulse = sym("impulse", nv)

    begins = dynamics.at(q)
    inertia, push = dynamics.lossless(q, nu, tau)
    first, speeds = dynamics.solve_positive(inertia, push), begins.S @ nu
    halfway = dynamics.integrate(q, own * speeds)
    start = _function(
        "start",
        [q, nu, tau, p],
        [
            speeds, first, casadi.dot(begins.B @ tau, nu), halfway,
            casadi.vec(dynamics.inertia(halfway)), nu + own * first, nu,
        ],
    )  # fmt: skip

    _, push = dynamics.lossless(place, found, tau)
    S = dynamics.at(place).S
    v2 = S @ found
    brake = dynamics.loss_force(v2)
    right = (1.0 - DELTA) * push + (1.0 - GAMMA) * (S.T @ brake)
    a2 = dynamics.solve_positive(casadi.reshape(M, n, n), right)
    end = dynamics.integrate(q, dt * (DELTA * v1 + (1.0 - DELTA) * dexpinv(own * v1, v2)))
    middle = _function(
        "middle",
        [q, nu, tau, p, place, M, found, v1, a1],
        [
            end,
            casadi.vec(dynamics.inertia(end)),
            nu + dt * (DELTA * a1 + a2),
            dt * (1.0 - GAMMA) * brake,
        ],
    )

    at_end = dynamics.at(place)
    v3 = at_end.S @ found
    whole = impulse + dt * GAMMA * dynamics.loss_force(v3)
    work = 0.5 * dt * (power + casadi.dot(at_end.B @ tau, found))
    lost = -0.5 * casadi.dot(whole, v1 + v3)
    finish = _function(
        "finish",
        [tau, p, energy, place, found, v1, power, impulse],
        [place, found, energy + casadi.vertcat(work, lost)],
    )

    named = {
        name: Buffer(f"ars {name}", size)
        for name, size in (("place", robot.nq), ("v1", nv), ("a1", n), ("power", 1), ("M", n * n),
                           ("free", n), ("found", n), ("impulse", nv))
    }  # fmt: skip
    b = named.__getitem__
    newton = _braked(dynamics, at.p, b("place"), b("M"), b("free"), b("found"), own)
    return (
        Call(
            start,
            (at.q, at.nu, at.tau, at.p),
            tuple(map(b, ("v1", "a1", "power", "place", "M", "free", "found"))),
        ),
        *newton,
        Call(
            middle,
            (at.q, at.nu, at.tau, at.p, *map(b, ("place", "M", "found", "v1", "a1"))),
            tuple(map(b, ("place", "M", "free", "impulse"))),
        ),
        *newton,
        Call(
            finish,
            (at.tau, at.p, at.energy, *map(b, ("place", "found", "v1", "power", "impulse"))),
            (at.q, at.nu, at.energy),
        ),
    )  # fmt: skip


def _braked(
    dynamics: SymbolicDynamics,
    p_at: Buffer,
    place_at: Buffer,
    M_at: Buffer,
    free_at: Buffer,
    found_at: Buffer,
    weight: float,
) -> tuple[Statement, ...]:
    """Return the statements of :func:`rpctl.dynamics.losses.braked`, the guess in ``found_at``.

    A trip of the loop tries one step: Newton's, or the sure one where the last trip's Newton step
    went too far. A lane that has converged stays as it is.

    Args:
        dynamics: Of the simulated robot.
        p_at: Its parameters.
        place_at: Configuration at which S is taken.
        M_at: Inertia there, (dof · dof,).
        free_at: ν₀, without losses (dof,).
        found_at: In the guess, out ν (dof,).
        weight: w, s.
    """
    robot, sym = dynamics.robot, casadi.SX.sym
    n = robot.dof
    place, flat, free, found = (
        sym("place", robot.nq),
        sym("M", n * n),
        sym("free", n),
        sym("found", n),
    )
    way, trips, going = sym("way"), sym("trips"), sym("going")
    M, S = casadi.reshape(flat, n, n), dynamics.at(place).S
    lossy = _lossy_rows(dynamics)
    rows = S[lossy, :]

    def gradient(nu: Any, v: Any) -> Any:
        return M @ (nu - free) - weight * (S.T @ dynamics.loss_force(v))

    v = S @ found
    secant = way == SECANT
    curvature = casadi.if_else(
        secant, dynamics.loss_secant(v)[lossy], dynamics.loss_slope(v)[lossy]
    )
    step = dynamics.solve_positive(
        M + rows.T @ casadi.diag(weight * curvature) @ rows, -gradient(found, v)
    )
    ahead = found + step
    v_ahead = S @ ahead
    change = casadi.mmax(casadi.fabs(v_ahead - v))
    size = _least_rate(dynamics.robot) + casadi.mmax(casadi.fabs(v))
    small = casadi.logic_and(casadi.logic_not(secant), change <= CONVERGED * size)
    slope = casadi.fabs(casadi.dot(gradient(ahead, v_ahead), step))
    bound = OVERSHOOT * casadi.fabs(casadi.dot(gradient(found, v), step))
    far = casadi.logic_or(trips >= NEWTON_STEPS, slope > bound)
    sure = casadi.logic_and(
        casadi.logic_not(secant), casadi.logic_and(casadi.logic_not(small), far)
    )
    done = going == 0.0
    following = casadi.if_else(casadi.logic_or(sure, done), found, ahead)
    trip = _function(
        "newton",
        [place, flat, free, found, way, trips, going, dynamics.p],
        [
            following,
            casadi.if_else(sure, SECANT, NEWTON),
            trips + casadi.if_else(sure, 0.0, 1.0),
            casadi.if_else(casadi.logic_or(done, small), 0.0, 1.0),
        ],
    )
    way_at, trips_at, going_at = (Buffer(f"newton {x}", 1) for x in ("way", "trips", "going"))
    flags = way_at, trips_at, going_at
    begin = _function("newton_begin", [], [casadi.SX(NEWTON), casadi.SX(0.0), casadi.SX(1.0)])
    body = Call(trip, (place_at, M_at, free_at, found_at, *flags, p_at), (found_at, *flags))
    most = 2 * (NEWTON_STEPS + SURE_STEPS)
    return Call(begin, (), flags), Until(going_at, most, (body,))


def _lossy_rows(dynamics: SymbolicDynamics) -> list[int]:
    """Return the entries of v at which something is or may be lost."""
    slope = dynamics.loss_slope(casadi.SX.sym("v", dynamics.robot.nv))
    return [i for i in range(slope.numel()) if not slope[i].is_zero()]


def _least_rate(robot: Robot) -> float:
    """Return the least rate ε at which friction is smooth, as ``make_losses`` gives them."""
    if robot.losses is not None:
        return float(robot.losses.rate.min())
    kinds = {robot.description.joint[name].kind for name in robot.entries}
    return SLIDING_RATE if "prismatic" in kinds else TURNING_RATE


def dexpinv(slide: Any, v: Any) -> Any:
    """Return dexp⁻¹ of the planar root to second order, see ``dynamics.motion.dexpinv``."""
    x, y, turn = (slide[i] for i in range(ROOT_NV))
    bx, by = turn * -v[1] + v[2] * y, turn * v[0] - v[2] * x
    change = casadi.vertcat(0.5 * bx - turn * by / 12.0, 0.5 * by + turn * bx / 12.0)
    return v + casadi.vertcat(change, casadi.SX(v.numel() - 2, 1))


def _function(name: str, inputs: list[Any], outputs: list[Any]) -> Any:
    """Return a CasADi function with dense columns, its common subexpressions shared."""
    dense = [casadi.densify(casadi.SX(x)) for x in outputs]
    return casadi.Function(name, inputs, casadi.cse(dense))
