"""The equations of a robot that leans as a graph of CasADi's scalars: of its tree, and of rolling.

Nothing is solved in symbols: what holds between q, ν, τ and z = (v, v̇, ν̇, λ) is written down,

    [A; W] v = [0; ν],   [A; W] v̇ + d/dt[A; W] v = [0; ν̇],   rnea(q, v, v̇) = B τ + ℓ(v) + Aᵀ λ,

and how z changes with q, ν and τ follows from its derivatives, exactly.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import Array
from rpctl.dynamics.leaning import find_formulas
from rpctl.dynamics.projection import effort_columns
from rpctl.dynamics.symbols.basis import SymbolicConfiguration
from rpctl.dynamics.symbols.bodies import felt, inertias_of, moving_bodies
from rpctl.dynamics.symbols.rigid_body import FREE_ROOT, MovingTree, crba, moving_tree, rnea
from rpctl.kernels.calls import compiled
from rpctl.kernels.program import dense_function
from rpctl.kernels.scalars import cleaned, column, entries, solve_positive
from rpctl.robot.inspection import robot_identity
from rpctl.robot.leaning import LeaningRobot

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
    force = column(rnea(tree, entries(v), entries(v_dot))[0])
    if robot.losses is None:
        return force
    known = robot.losses
    return force + (known.damping + known.friction / casadi.sqrt(v * v + known.rate**2)) * v


class LeaningMotion(NamedTuple):
    """The equations of motion at a state; arrays that the thread's next call overwrites."""

    S: Array  # (nv, dof)
    M: Array  # (dof, dof)
    bias: Array  # (dof,) h − ℓ
    v: Array  # (nv,)
    nu_dot: Array  # (dof,)
    twist: Array  # (3,)


class MotionCode:
    """The equations of motion of a robot that leans as machine code, from disk if it was built.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: LeaningRobot) -> None:
        nv, dof = robot.nv, robot.dof
        self._shapes = (nv, dof), (dof, dof)
        self._unpushed, self._idle = np.zeros(dof), np.zeros(len(robot.actuators))
        given = robot.nq, dof, len(robot.actuators), dof
        found = nv * dof, dof * dof, dof, nv, dof, 3, 2
        make = partial(motion_formula, robot)
        self._code = compiled((given, found), robot_identity(robot), make)

    def __call__(
        self, q: Array, nu: Array, tau: Array | None = None, outside: Array | None = None
    ) -> LeaningMotion | None:
        """Return the motion at q (nq,) and ν (dof,); None near where it is singular.

        Args:
            q: Configuration.
            nu: Quasi-velocities.
            tau: Actuator efforts (n_act,), N·m or N; None: zeros.
            outside: Quasi-force (dof,) of what pushes the robot besides; None: nothing.
        """
        S, M, bias, v, nu_dot, twist, sizes = self._code(
            q,
            nu,
            self._idle if tau is None else tau,
            self._unpushed if outside is None else outside,
        )
        basis, change = sizes.tolist()
        if not (basis < LARGEST and change < math.inf):
            return None
        of_S, of_M = self._shapes
        return LeaningMotion(S.reshape(of_S), M.reshape(of_M), bias, v, nu_dot, twist)


def motion_formula(robot: LeaningRobot) -> Any:
    """Return the ``casadi.Function`` of q, ν, τ and a quasi-force; its outputs, by rows:

    those of :class:`LeaningMotion`, and the squared sizes of S and ν̇. S and Ṡν solve [A; W] by
    orthogonal factors; what they leave of S is solved for once more.
    """
    f, nv, dof = find_formulas(robot), robot.nv, robot.dof
    names = {"nu": dof, "tau": len(robot.actuators), "push": dof, "v": nv}
    nu, tau, push, symbols = (casadi.SX.sym(name, size) for name, size in names.items())
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
    force = S.T @ (casadi.SX(effort_columns(robot)) @ tau) + push - bias
    rows = [[M[i, j] for j in range(dof)] for i in range(dof)]
    nu_dot = column(solve_positive(rows, entries(force)))
    sizes = casadi.vertcat(casadi.sumsqr(S), casadi.sumsqr(nu_dot))
    found = [casadi.vec(S.T), casadi.vec(M.T), bias, v, nu_dot, f.twist @ v, sizes]
    return dense_function("motion", [f.q, nu, tau, push], found)
