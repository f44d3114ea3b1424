"""The dynamics in symbols beside Pinocchio's at random states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi
import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.robot.model import Robot

EQUAL = 1e-10  # of a quantity's largest entry; 1e-14 is what is seen
ROUNDING_BY_CONDITION = 100.0  # times eps and M's condition: how far two solves may be apart
SEED = 20210601
# What the terms of a quantity are as large as, at rates of about 1 rad/s and 1 m/s.
MADE_OF = {"bias": "inertia", "inverse": "inertia", "drift": "basis"}


def compared(dynamics: SymbolicDynamics) -> Any:
    """Return a ``casadi.Function`` of (p, q, ν, ν̇, v, τ), dense columns, that has all quantities.

    Its outputs, dense columns, too, are called as the methods of ``SymbolicDynamics``.
    """
    robot = dynamics.robot
    sizes = {"q": robot.nq, "nu": robot.dof, "nu_dot": robot.dof, "v": robot.nv}
    sizes["tau"] = len(robot.actuators)
    q, nu, nu_dot, v, tau = given = [casadi.SX.sym(name, size) for name, size in sizes.items()]
    at = dynamics.at(q)
    found = {
        "basis": at.S,
        "actuation": at.B,
        "drift": at.drift(nu),
        "inertia": dynamics.inertia(q),
    }
    found |= {"bias": dynamics.bias(q, nu), "losses": dynamics.losses(q, nu)}
    found |= {"inverse": dynamics.inverse(q, nu, nu_dot), "efforts": dynamics.efforts(q, nu_dot)}
    found |= {"forward": dynamics.forward(q, nu, tau), "integrate": dynamics.integrate(q, v)}
    found |= {"base_pose": dynamics.base_pose(q), "twist": dynamics.twist(q, nu)}
    found["joint_positions"] = dynamics.joint_positions(q)
    if robot.end_effector is not None:
        axes, origin = dynamics.placement(q, robot.end_effector)
        found |= {"placement": casadi.horzcat(axes, origin)}
    columns = [casadi.vec(casadi.densify(value)) for value in found.values()]
    names = ["p", *sizes], list(found)
    return casadi.Function("compared", [dynamics.p, *given], columns, *names, {"cse": True})


def quantities(truth: ReducedDynamics, state: Sequence[Array]) -> dict[str, Array]:
    """Return the same quantities by Pinocchio.

    Args:
        truth: The robot's dynamics.
        state: q, ν, ν̇, v and τ.
    """
    q, nu, nu_dot, v, tau = state
    robot, at = truth.robot, truth.at(q)
    found = {"basis": at.S, "actuation": at.B, "drift": at.drift(nu), "inertia": truth.inertia(q)}
    found |= {"bias": truth.bias(q, nu), "losses": truth.losses(q, nu)}
    found |= {"inverse": truth.inverse(q, nu, nu_dot), "efforts": truth.efforts(q, nu_dot)}
    found |= {"forward": truth.forward(q, nu, tau), "integrate": pin.integrate(robot.model, q, v)}
    found |= {"base_pose": robot.base_pose(q), "twist": truth.twist(q, nu)}
    found["joint_positions"] = robot.joint_positions(q)
    if robot.end_effector is not None:
        pose = robot.end_effector_pose(robot.model.createData(), q)
        found["placement"] = np.column_stack([pose.rotation, pose.translation])
    return {name: np.asarray(value).ravel(order="F") for name, value in found.items()}


def check(
    dynamics: SymbolicDynamics,
    robot: Robot | None = None,
    samples: int = 3,
    p: Array | None = None,
) -> None:
    """Compare dynamics in symbols with Pinocchio's at random states, of a robot or a variant."""
    robot = dynamics.robot if robot is None else robot
    function = compared(dynamics)
    truth, p = ReducedDynamics(robot), dynamics.parameters_of(robot) if p is None else p
    rng = np.random.default_rng(SEED)
    for _ in range(samples):
        q = robot.random_configuration(rng)
        sizes = robot.dof, robot.dof, robot.nv, len(robot.actuators)
        state = [q, *(rng.normal(size=size) for size in sizes)]
        wanted = quantities(truth, state)
        values = (np.asarray(value, dtype=float).ravel() for value in function(p, *state))
        found = dict(zip(function.name_out(), values, strict=True))
        for name, value in wanted.items():
            size = np.abs(value).max(initial=0.0)
            if name in MADE_OF:  # terms that cancel may leave rounding alone
                size = max(size, np.abs(wanted[MADE_OF[name]]).max(initial=0.0))
            limit = EQUAL
            if name == "forward":
                condition = np.linalg.cond(truth.inertia(q))
                limit = max(limit, ROUNDING_BY_CONDITION * np.finfo(float).eps * condition)
            assert found[name].shape == value.shape, name
            residual = np.abs(found[name] - value).max(initial=0.0) / (size or 1.0)
            assert residual <= limit, (robot.name, name)
