"""The reduced equations of a robot of any size as a short list of scalar steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi
import numpy as np

from rpctl.derive.casadi_scalar import CASADI, CasadiScalar
from rpctl.derive.folding import cyclic_joints, fold
from rpctl.derive.steps import Node, Steps
from rpctl.equivalence.gibbs_appell import GibbsAppell, Terms
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
    """Derive M ν̇ + h = B τ + ℓ with CasADi's symbols and list its steps ([MS21, Eq. 1-5]).

    Rigid parts are folded into one body each before, and the angle of a round wheel is left out.
    """
    oracle = GibbsAppell(robot, CASADI)
    oracle.tree = fold(robot, CASADI)
    names = tuple(name for name in oracle.tree.moving if name not in _mimicked(robot))
    q, nu = casadi.SX.sym("q", len(names)), casadi.SX.sym("nu", robot.dof)
    terms = _terms(oracle, names, q, nu)
    n = robot.dof
    upper = [(i, j) for i in range(n) for j in range(i, n)]
    entries = [terms.M[i, j] for i, j in upper] + [*terms.h, *terms.B.ravel()]
    steps, results = _steps(q, nu, entries)
    M = np.zeros((n, n), dtype=int)
    for (i, j), node in zip(upper, results, strict=False):
        M[i, j] = M[j, i] = node
    h, B = results[len(upper) : len(upper) + n], results[len(upper) + n :]
    found = _pruned(robot, names, steps.nodes, M.tolist(), h, np.reshape(B, terms.B.shape).tolist())
    if not oracle.tree.losses:
        return found
    speeds = np.array([CasadiScalar.of(nu[i]) for i in range(n)], dtype=object)
    lost, results = _steps(q, nu, oracle.losses(terms.rates, speeds))
    place = {names.index(name): k for k, name in enumerate(found.positions)}
    return replace(found, loss_nodes=_moved(lost.nodes, place), losses=tuple(results))


def _steps(q: Any, nu: Any, entries: Iterable[Any]) -> tuple[Steps, list[int]]:
    """Return steps from positions and ν to some entries, and the nodes of these."""
    outputs = casadi.vertcat(*(CasadiScalar(entry).sx for entry in entries))
    function = casadi.Function("terms", [q, nu], [casadi.cse(outputs)])
    steps = Steps()
    inputs = [lambda i: steps.add("q", i), lambda i: steps.add("nu", i)]
    return steps, steps.evaluate(function, inputs)


def _moved(nodes: Sequence[Node], place: Mapping[int, int]) -> tuple[Node, ...]:
    """Return nodes that read positions at other places."""
    return tuple(("q", place[node[1]]) if node[0] == "q" else node for node in nodes)


def _mimicked(robot: Robot) -> dict[str, Any]:
    return {joint.name: joint.mimic for joint in robot.mimics}


def _terms(oracle: GibbsAppell, names: Sequence[str], q: Any, nu: Any) -> Terms:
    robot = oracle.robot
    positions = {name: CasadiScalar.of(q[i]) for i, name in enumerate(names)}
    positions |= dict.fromkeys(cyclic_joints(robot), CasadiScalar(0.0))
    positions |= {name: CasadiScalar(value) for name, value in robot.locked.items()}
    for name, mimic in _mimicked(robot).items():
        positions[name] = mimic.multiplier * positions[mimic.joint] + mimic.offset
    u = np.array([CasadiScalar.of(nu[i]) for i in range(robot.dof)], dtype=object)
    root, rates = oracle.rolling_root(CASADI.identity(3), positions, u)
    return oracle.terms(positions, u, root, rates)


def _pruned(
    robot: Robot,
    names: Sequence[str],
    nodes: list[Node],
    M: list[list[int]],
    h: list[int],
    B: list[list[int]],
) -> ScalarProgram:
    """Return the program without the inputs that nothing depends on; the arm's always stay."""
    read = {node[1] for node in nodes if node[0] == "q"}
    arm = set(robot.joint_names)
    order = [name for name in robot.actuators if name in names]
    order = [name for name in order if name in arm or names.index(name) in read]
    order += [name for i, name in enumerate(names) if i in read and name not in order]
    place = {names.index(name): k for k, name in enumerate(order)}
    return ScalarProgram(
        tuple(order), _moved(nodes, place), tuple(map(tuple, M)), tuple(h), tuple(map(tuple, B))
    )
