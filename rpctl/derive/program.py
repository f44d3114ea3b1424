"""The reduced equations of a robot of any size as scalar steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from rpctl.derive.equations import position_symbols
from rpctl.derive.steps import Node, Steps
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.robot.model import Robot


@dataclass(frozen=True)
class ScalarProgram:
    """Steps that compute M, h and B; every step is a node, no two are the same.

    Attributes:
        positions: Joints whose positions the results depend on, and every joint of the arm.
        nodes: See :class:`Steps`; operands before what needs them.
        M: Node of each entry (dof, dof).
        h: Node of each entry (dof,).
        B: Node of each entry (dof, n_act).
        loss_nodes: Steps of the losses ℓ alone, as ``nodes``.
        losses: Of these, the node of each entry (dof,); none where nothing is lost.
    """

    positions: tuple[str, ...]
    nodes: tuple[Node, ...]
    M: tuple[tuple[int, ...], ...]
    h: tuple[int, ...]
    B: tuple[tuple[int, ...], ...]
    loss_nodes: tuple[Node, ...] = ()
    losses: tuple[int, ...] = ()


def program(robot: Robot) -> ScalarProgram:
    """List the steps of M ν̇ + h = B τ + ℓ; the angle of a round wheel is in none of them."""
    dynamics, places = SymbolicDynamics(robot), joint_symbols(robot)
    q, nu = symbolic_configuration(robot, places), casadi.SX.sym("nu", robot.dof)
    n, width = robot.dof, len(robot.actuators)
    parts = dynamics.inertia(q), dynamics.bias(q, nu), dynamics.at(q).B.T
    terms = casadi.cse(casadi.vertcat(*(casadi.vec(casadi.densify(part)) for part in parts)))
    losses = casadi.cse(casadi.densify(dynamics.losses(q, nu)))
    read = {symbol.name() for symbol in casadi.symvar(casadi.vertcat(terms, losses))}
    positions = joints_of_code(robot, {name for name in places if places[name].name() in read})
    given = [casadi.vertcat(*(places[name] for name in positions), casadi.SX(0, 1)), nu]
    nodes, found = _steps(given, terms)
    M, h = np.reshape(found[: n * n], (n, n)), found[n * n : n * n + n]
    B = np.reshape(np.array(found[n * n + n :], dtype=int), (n, width))
    return ScalarProgram(
        positions,
        nodes,
        tuple(map(tuple, M.tolist())),
        tuple(h),
        tuple(map(tuple, B.tolist())),
        *_steps(given, losses) if dynamics.lossy else ((), ()),
    )


def _steps(given: list[Any], outputs: Any) -> tuple[tuple[Node, ...], tuple[int, ...]]:
    """Return steps from positions and ν to some entries, and the nodes of these."""
    steps = Steps()
    leaves = [lambda i, x=x: steps.add("input", f"{x}[{i}]") for x in ("q", "nu")]
    found = steps.evaluate(casadi.Function("terms", given, [outputs]), leaves)
    return tuple(steps.nodes), tuple(found)


def joint_symbols(robot: Robot) -> dict[str, Any]:
    """Return a symbol for the position of each joint that is neither locked nor a mimic."""
    return {name: casadi.SX.sym(str(symbol)) for name, symbol in position_symbols(robot).items()}


def symbolic_configuration(robot: Robot, places: Mapping[str, Any]) -> Any:
    """Return q (nq, 1) at positions; the base, on whose place nothing depends, is at the origin."""
    q = casadi.SX.zeros(robot.nq, 1)
    q[2] = 1.0
    known = {**robot.locked, **places}
    mimics = {joint.name: joint.mimic for joint in robot.mimics}
    for name, entry in robot.entries.items():
        mimic = mimics.get(name)
        position = casadi.SX(
            known[name] if mimic is None else mimic.multiplier * known[mimic.joint] + mimic.offset
        )
        if entry.is_pair:
            q[entry.index], q[entry.index + 1] = casadi.cos(position), casadi.sin(position)
        else:
            q[entry.index] = position
    return q


def joints_of_code(robot: Robot, read: set[str]) -> tuple[str, ...]:
    """Return the joints whose positions code takes: those it reads and all of the arm.

    The actuated ones come first.
    """
    order = dict.fromkeys((*robot.actuators, *robot.moving_joint_names))
    return tuple(name for name in order if name in read or name in robot.joint_names)
