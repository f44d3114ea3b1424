"""The equations of a robot that leans as a graph of CasADi's scalars: of its tree, and of rolling.

Nothing is solved in symbols: what holds between q, ν, τ and z = (v, v̇, ν̇, λ) is written down,

    [A; W] v = [0; ν],   [A; W] v̇ + d/dt[A; W] v = [0; ν̇],   rnea(q, v, v̇) = B τ + ℓ(v) + Aᵀ λ,

and how z changes with q, ν and τ follows from its derivatives, exactly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import Array
from rpctl.dynamics.leaning import MAX_SETTLING, SETTLED_M, find_formulas
from rpctl.dynamics.projection import effort_columns
from rpctl.dynamics.symbols.basis import SymbolicConfiguration, joints_moved
from rpctl.dynamics.symbols.bodies import felt, inertias_of, moving_bodies
from rpctl.dynamics.symbols.rigid_body import FREE_ROOT, MovingTree, crba, moving_tree, rnea
from rpctl.kernels.calls import Layout, compiled
from rpctl.kernels.program import Buffer, Call, Program, Until, When, dense_function
from rpctl.kernels.scalars import cleaned, column, entries, solve_positive
from rpctl.robot.inspection import robot_identity
from rpctl.robot.leaning import FREE_NQ, FREE_NV, LeaningRobot

LARGEST = 1e12  # m² and rad²: of S; beyond it the wheels all but fix no one motion


class LeaningEquations:
    """What holds between q, ν, τ and z, differentiated.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: LeaningRobot) -> None:
        f, nv, dof = find_formulas(robot), robot.nv, robot.dof
        rows, n_act = f.A.shape[0], len(robot.actuators)
        self._rows, self._f = rows, f
        q, nu, tau = f.q, casadi.SX.sym("nu", dof), casadi.SX.sym("tau", n_act)
        v, v_dot = casadi.SX.sym("v", nv), casadi.SX.sym("v_dot", nv)
        nu_dot, multipliers = casadi.SX.sym("nu_dot", dof), casadi.SX.sym("lambda", rows)
        still = casadi.SX.zeros(rows)
        force = tree_force(robot, tree_at(robot, q), v, v_dot) - f.A.T @ multipliers
        force -= casadi.SX(effort_columns(robot)) @ tau
        left = casadi.vertcat(
            f.L @ v - casadi.vertcat(still, nu),
            f.L @ v_dot + f.L_rate(v) - casadi.vertcat(still, nu_dot),
            force,
        )
        z = casadi.vertcat(v, v_dot, nu_dot, multipliers)
        given = casadi.horzcat(
            casadi.jacobian(left, q) @ f.rate, casadi.jacobian(left, casadi.vertcat(nu, tau))
        )
        self._function = f.function("equations", [q, nu, tau, z], [casadi.jacobian(left, z), given])

    def derivatives(self, q: Array, nu: Array, tau: Array, z: Array) -> Array:
        """Return by how much z (3 nv,) changes with (δq, ν, τ), (3 nv, nv + dof + n_act).

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,).
            z: v, v̇, ν̇ and λ there.
        """
        of_z, given = self._function(q, nu, tau, z)
        return np.asarray(-np.linalg.solve(of_z, given))


def tree_at(robot: LeaningRobot, q: Any) -> MovingTree:
    """Return a robot's bodies at q (nq, 1), as the ground feels them."""
    bodies = moving_bodies(robot)
    numbers = cleaned(felt(bodies, inertias_of(robot), grounded=True)).tolist()
    lift = (-np.array(robot.model.gravity.linear)).tolist()
    return moving_tree(bodies, numbers, lift, SymbolicConfiguration(q), FREE_ROOT)


def tree_force(robot: LeaningRobot, tree: MovingTree, v: Any, v_dot: Any) -> Any:
    """Return the generalised force (nv, 1) that a motion of the tree takes, its losses included."""
    return column(rnea(tree, entries(v), entries(v_dot))[0]) - loss_force(robot, v)


def loss_force(robot: LeaningRobot, v: Any) -> Any:
    """Return the generalised force (nv, 1) of the losses: it opposes the motion."""
    if robot.losses is None:
        return casadi.SX(robot.nv, 1)
    known = robot.losses
    return -(known.damping + known.friction / casadi.sqrt(v * v + known.rate**2)) * v


class LeaningMotion(NamedTuple):
    """The equations of motion at a state; arrays that the thread's next call overwrites."""

    q: Array  # (nq,)
    M: Array  # (dof, dof)
    bias: Array  # (dof,) h − ℓ
    B: Array  # (dof, n_act)
    nu_dot: Array  # (dof,)
    twist: Array  # (3,)


class MotionCode:
    """The motion of a robot that leans as machine code, from disk if it was built.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: LeaningRobot) -> None:
        dof, actuators = robot.dof, len(robot.actuators)
        self._shapes = (dof, dof), (dof, actuators)
        self._still, self._idle = np.zeros(dof), np.zeros(actuators)
        lay, make = partial(motion_program, robot), partial(motion_functions, robot)
        self._code = compiled(robot_identity(robot), lay, make)

    def along(
        self, q: Array, way: Array, nu: Array, tau: Array | None = None
    ) -> LeaningMotion | None:
        """Return the motion at another place; None near where it is singular.

        Args:
            q: Configuration (nq,) from which it is moved, its wheels on the ground.
            way: Quasi-velocities (dof,), along which it is moved for 1 s.
            nu: Quasi-velocities there (dof,).
            tau: Actuator efforts (n_act,), N·m or N; None: zeros.
        """
        place, _, _, M, bias, B, nu_dot, twist, wrong = self._code(
            q, way, self._idle if tau is None else tau, nu, 0.0
        )
        if wrong[0]:
            return None
        of_M, of_B = self._shapes
        return LeaningMotion(place, M.reshape(of_M), bias, B.reshape(of_B), nu_dot, twist)

    def step(
        self, q: Array, nu: Array, tau: Array, dt: float
    ) -> tuple[Array, Array, float, float] | None:
        """Return q, ν, work and loss after a step; None near where it is singular.

        It is that of :func:`rpctl.dynamics.motion.rk4_step`, which has the arguments.
        """
        place, after, balance, *_, wrong = self._code(q, nu, tau, self._still, dt)
        if wrong[0]:
            return None
        work, lost = balance.tolist()
        return place.copy(), after.copy(), work, lost


STAGES = 4  # of the method of order 4


def motion_program(robot: LeaningRobot, functions: Mapping[str, Any]) -> Layout:
    """Return what advances a robot by a step, or moves it along its ν for 1 s, where dt is 0.

    The latter evaluates the motion where it is then, at other quasi-velocities.

    Args:
        robot: The robot.
        functions: Those of :func:`motion_functions`.
    """
    nq, nv, dof, actuators = robot.nq, robot.nv, robot.dof, len(robot.actuators)
    sizes = {"q": nq, "nu": dof, "tau": actuators, "then": dof, "dt": 1, "place": nq, "slide": nv}
    sizes |= {"speed": dof, "sums": nv + dof + 2, "number": 1, "going": 1, "at_end": 1, "way": nv}
    sizes |= {"M": dof * dof, "bias": dof, "B": dof * actuators, "v": nv, "nu_dot": dof}
    sizes |= {"twist": 3, "balance": 2, "wrong": 1}
    b = {name: Buffer(name, size) for name, size in sizes.items()}

    def call(name: str, given: str, found: str) -> Call:
        ends = (tuple(b[each] for each in names.split()) for names in (given, found))
        return Call(functions[name], *ends)

    motion = "M bias B v nu_dot twist wrong"
    stage = (
        call("moved", "q slide", "place"),
        call("motion", "place speed tau wrong", motion),
        call("stage", "nu tau dt slide v nu_dot sums number", "slide speed sums number going"),
    )
    body = (
        call("start", "nu", "slide speed sums number going wrong"),
        Until(b["going"], STAGES, stage),
        call("end", "nu dt sums", "way nu balance going at_end"),
        Until(
            b["going"],
            MAX_SETTLING,
            (call("moved", "q way", "q"), call("settling", "q", "way going")),
        ),
        call("judged", "wrong going", "wrong"),
        When(b["at_end"], (call("motion", "q then tau wrong", motion),)),
    )
    given, found = "q nu tau then dt", "q nu balance M bias B nu_dot twist wrong"
    return Layout(Program(body), *([b[each] for each in names.split()] for names in (given, found)))


def motion_functions(robot: LeaningRobot) -> dict[str, Any]:
    """Return the functions of :func:`motion_program` by name."""
    nv, dof = robot.nv, robot.dof
    f, move = find_formulas(robot), moved_formula(robot)
    names = {"nu": dof, "tau": len(robot.actuators), "dt": 1, "slide": nv, "v": nv, "nu_dot": dof}
    names |= {"sums": nv + dof + 2, "number": 1, "wrong": 1, "going": 1}
    at = {name: casadi.SX.sym(name, size) for name, size in names.items()}
    nu, tau, dt, slide, v, nu_dot, sums, number, wrong, going = at.values()
    power = v.T @ casadi.SX(effort_columns(robot)) @ tau
    balance = casadi.vertcat(power, -v.T @ loss_force(robot, v))
    k = casadi.vertcat(free_dexpinv(slide, v), nu_dot, balance)
    follows, steps = number + 1, dt > 0.0
    ahead = dt * casadi.if_else(follows < STAGES - 1, 0.5, 1.0)
    inner = casadi.logic_and(follows > 1, follows < STAGES)
    added = sums + casadi.if_else(inner, 2.0, 1.0) * k
    more = casadi.logic_and(steps, follows < STAGES)
    way, change, done = casadi.vertsplit(sums, [0, nv, nv + dof, nv + dof + 2])
    high = casadi.mmax(casadi.fabs(f.heights)) > SETTLED_M
    zero, one = casadi.SX(0), casadi.SX(1)
    return {
        "moved": move,
        "motion": motion_formula(robot),
        "start": dense_function("start", [nu], [zero * slide, nu, zero * sums, zero, one, zero]),
        "stage": dense_function(
            "stage",
            [nu, tau, dt, slide, v, nu_dot, sums, number],
            [ahead * k[:nv], nu + ahead * nu_dot, added, follows, more],
        ),
        "end": dense_function(
            "end",
            [nu, dt, sums],
            [
                casadi.if_else(steps, dt / 6.0, 1.0) * way,
                nu + dt / 6.0 * change,
                dt / 6.0 * done,
                one,
                casadi.logic_not(steps),
            ],
        ),
        "settling": dense_function("settling", [f.q], [high * f.back, high]),
        "judged": dense_function("judged", [wrong, going], [casadi.logic_or(wrong, going)]),
    }


def moved_formula(robot: LeaningRobot) -> Any:
    """Return the ``casadi.Function`` of q and v to q moved along v for 1 s."""
    f, v = find_formulas(robot), casadi.SX.sym("v", robot.nv)
    linear, turn = v[:3], v[3:FREE_NV]
    angle = casadi.sqrt(casadi.sumsqr(turn))
    half, still = casadi.sinc(0.5 * angle), angle == 0.0
    swept = casadi.cross(turn, linear)
    bent = casadi.cross(turn, swept) * (1.0 - casadi.sinc(angle)) / (angle * angle + still)
    place = f.q[:3] + f.root_axes @ (linear + 0.5 * half * half * swept + bent)
    turned = casadi.cos(0.5 * angle) * f.q[3:FREE_NQ] + half * f.rate[3:FREE_NQ, 3:FREE_NV] @ turn
    turned *= 1.5 - 0.5 * casadi.sumsqr(turned)
    found = [*entries(place), *entries(turned), *entries(f.q)[FREE_NQ:]]
    joints = {robot.velocity_index(name): entry for name, entry in robot.entries.items()}
    return dense_function("moved", [f.q, v], [column(joints_moved(found, v, joints))])


def free_dexpinv(slide: Any, v: Any) -> Any:
    """Return dexp⁻¹ of the free-flyer, as :func:`rpctl.dynamics.projection.dexpinv`."""

    def bracket(v: Any) -> Any:
        linear = casadi.cross(turn, v[:3]) + casadi.cross(slide[:3], v[3:FREE_NV])
        return casadi.vertcat(linear, casadi.cross(turn, v[3:FREE_NV]))

    turn = slide[3:FREE_NV]
    once = bracket(v)
    return casadi.vertcat(v[:FREE_NV] + 0.5 * once + bracket(once) / 12.0, v[FREE_NV:])


def motion_formula(robot: LeaningRobot) -> Any:
    """Return the ``casadi.Function`` of q, ν, τ and what was wrong before; its outputs, by rows:

    M, h − ℓ, B, v, ν̇, the twist, and whether it was wrong or is singular here. S and Ṡν solve
    [A; W] by orthogonal factors; what they leave of S is solved for once more.
    """
    f, nv, dof = find_formulas(robot), robot.nv, robot.dof
    names = {"nu": dof, "tau": len(robot.actuators), "wrong": 1, "v": nv}
    nu, tau, wrong, symbols = (casadi.SX.sym(name, size) for name, size in names.items())
    L, wanted = casadi.sparsify(f.L), casadi.SX.eye(nv)[:, nv - dof :]
    S = casadi.solve(L, wanted)
    S += casadi.solve(L, wanted - L @ S)
    v = S @ nu
    drift = -casadi.solve(L, casadi.substitute(f.L_rate(symbols), symbols, v))
    tree = tree_at(robot, f.q)
    inertia = casadi.SX(nv, nv)
    for (i, j), entry in crba(tree).items():
        inertia[i, j] = entry
    M, bias = S.T @ (inertia @ S), S.T @ tree_force(robot, tree, v, drift)
    B = S.T @ casadi.SX(effort_columns(robot))
    rows = [[M[i, j] for j in range(dof)] for i in range(dof)]
    nu_dot = column(solve_positive(rows, entries(B @ tau - bias)))
    sound = casadi.logic_and(casadi.sumsqr(S) < LARGEST, casadi.sumsqr(nu_dot) < math.inf)
    singular = casadi.logic_or(wrong, casadi.logic_not(sound))
    found = [casadi.vec(M.T), bias, casadi.vec(B.T), v, nu_dot, f.twist @ v, singular]
    return dense_function("motion", [f.q, nu, tau, wrong], found)
