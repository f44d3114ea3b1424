"""The equations of a robot that leans as a graph of CasADi's scalars: of its tree, and of rolling.

Nothing is solved in symbols: what holds between q, ν, τ and z = (v, v̇, ν̇, λ) is written down,

    [A; W] v = [0; ν],   [A; W] v̇ + d/dt[A; W] v = [0; ν̇],   rnea(q, v, v̇) = B τ + ℓ(v) + Aᵀ λ,

and how z changes with q, ν and τ follows from its derivatives, exactly.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import Array
from rpctl.dynamics.leaning import find_formulas
from rpctl.dynamics.projection import effort_columns
from rpctl.dynamics.symbols.basis import SymbolicConfiguration
from rpctl.dynamics.symbols.bodies import felt, inertias_of, moving_bodies
from rpctl.dynamics.symbols.rigid_body import FREE_ROOT, moving_tree, rnea
from rpctl.kernels.scalars import cleaned, column, entries
from rpctl.robot.leaning import LeaningRobot


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
        force = self._tree_force(robot, q, v, v_dot) - f.A.T @ multipliers
        force -= casadi.SX(effort_columns(robot)) @ tau
        if robot.losses is not None:
            known = robot.losses
            force += (known.damping + known.friction / casadi.sqrt(v * v + known.rate**2)) * v
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

    @staticmethod
    def _tree_force(robot: LeaningRobot, q: Any, v: Any, v_dot: Any) -> Any:
        """Return the generalised force (nv, 1) of a motion of the tree."""
        bodies = moving_bodies(robot)
        numbers = cleaned(felt(bodies, inertias_of(robot), grounded=True)).tolist()
        lift = (-np.array(robot.model.gravity.linear)).tolist()
        tree = moving_tree(bodies, numbers, lift, SymbolicConfiguration(q), FREE_ROOT)
        return column(rnea(tree, entries(v), entries(v_dot))[0])

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
