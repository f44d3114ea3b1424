"""The reduced equations of a robot of any size in CasADi's symbols, and as scalar steps."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.derive.folding import cyclic_joints, fold
from rpctl.derive.steps import Node, Steps
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.gibbs_appell import (
    GRAVITY,
    UP,
    GibbsAppell,
    JointRates,
    LinkKinematics,
    Terms,
)
from rpctl.equivalence.planar import base_motion
from rpctl.equivalence.tree import Scalars, cross
from rpctl.robot.model import Robot


class CasadiScalar:
    """One ``casadi.SX`` that NumPy takes for a scalar.

    CasADi's own type looks like an array to NumPy and refuses to be an element of one.
    """

    __slots__ = ("sx",)

    def __init__(self, value: Any) -> None:
        self.sx: Any = value.sx if isinstance(value, CasadiScalar) else casadi.SX(float(value))

    @classmethod
    def of(cls, sx: Any) -> CasadiScalar:
        """Return an element that holds a scalar ``casadi.SX``."""
        element = cls(0.0)
        element.sx = sx
        return element

    def __neg__(self) -> CasadiScalar:
        return CasadiScalar.of(-self.sx)

    def __pow__(self, exponent: int) -> CasadiScalar:
        return CasadiScalar.of(self.sx**exponent)

    def __bool__(self) -> bool:
        return not (self.sx.is_constant() and float(self.sx) == 0.0)


def _operator(compute: Callable[[Any, Any], Any], swapped: bool) -> Callable[..., Any]:
    def apply(self: CasadiScalar, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # NumPy then takes this element for each of the array's
        left, right = self.sx, CasadiScalar(other).sx
        return CasadiScalar.of(compute(right, left) if swapped else compute(left, right))

    return apply


for _name in ("add", "sub", "mul", "truediv"):
    setattr(CasadiScalar, f"__{_name}__", _operator(getattr(operator, _name), False))
    setattr(CasadiScalar, f"__r{_name}__", _operator(getattr(operator, _name), True))


CASADI = Scalars(
    number=lambda value, kind, label: CasadiScalar(value),
    cos=lambda angle: CasadiScalar.of(casadi.cos(CasadiScalar(angle).sx)),
    sin=lambda angle: CasadiScalar.of(casadi.sin(CasadiScalar(angle).sx)),
    sqrt=lambda value: CasadiScalar.of(casadi.sqrt(CasadiScalar(value).sx)),
)


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
    dynamics = law_dynamics(robot)
    names, q, nu, terms = dynamics.joints, dynamics.q, dynamics.nu, dynamics.terms
    n = robot.dof
    upper = [(i, j) for i in range(n) for j in range(i, n)]
    entries = [terms.M[i, j] for i, j in upper] + [*terms.h, *terms.B.ravel()]
    steps, results = _steps(q, nu, entries)
    M = np.zeros((n, n), dtype=int)
    for (i, j), node in zip(upper, results, strict=False):
        M[i, j] = M[j, i] = node
    h, B = results[len(upper) : len(upper) + n], results[len(upper) + n :]
    found = _pruned(robot, names, steps.nodes, M.tolist(), h, np.reshape(B, terms.B.shape).tolist())
    if not dynamics.oracle.tree.losses:
        return found
    lost, results = _steps(q, nu, dynamics.oracle.losses(terms.rates, _elements(nu)))
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


ROUNDING = 1e-14  # of the largest entry of a constant matrix: below it an entry is 0


@dataclass(frozen=True)
class LawDynamics:
    """A robot's dynamics in symbols of q, ν and ν̇: its terms, and what a law's code needs.

    ∂G/∂ν̇ of the Gibbs function *is* M ν̇ + h ([MS21, Eq. 1-5]). The gradient is taken backwards,
    so it costs a few times what G does, and M is never formed.

    Attributes:
        robot: The robot.
        oracle: Its Gibbs-Appell equations in CasADi's symbols.
        joints: Moving joints but mimics, in the order of ``q``.
        q: Their positions.
        nu: Quasi-velocities.
        nu_dot: Their derivatives.
        nu_d: Those wanted, at which losses are compensated.
    """

    robot: Robot
    oracle: GibbsAppell
    joints: tuple[str, ...]
    q: Any
    nu: Any
    nu_dot: Any
    nu_d: Any

    @property
    def symbols(self) -> list[Any]:
        """q, ν, ν̇ and ν_d."""
        return [self.q, self.nu, self.nu_dot, self.nu_d]

    @cached_property
    def terms(self) -> Terms:
        """M, h and B, and the rates of joints."""
        return self.oracle.terms(self._positions, _elements(self.nu), *self._start())

    @cached_property
    def quasi_force(self) -> list[Any]:
        """M ν̇ + h − ℓ (dof,), the losses ℓ at ν_d."""
        root, rates = self._start()
        oracle = self.oracle
        speeds = _elements(self.nu)
        acceleration = _elements(self.nu_dot)
        root = replace(
            root,
            alpha=root.alpha + root.J_w @ acceleration,
            a=root.a + root.J_v @ acceleration,
        )
        drifts = {name: rates.drifts[name] + row @ acceleration for name, row in rates.rows.items()}
        rates = JointRates(rates.rows, drifts, rates.R)
        G = CasadiScalar(0.0)
        for body, motion in oracle.links(self._positions, speeds, root, rates):
            _, a = motion.at(motion.R @ body.com)
            turn = motion.R @ body.R
            inertia = turn @ body.inertia @ turn.T
            alpha, omega = motion.alpha, motion.omega
            G = G + 0.5 * body.mass * (a @ a) + body.mass * GRAVITY * (a @ UP)
            G = G + 0.5 * (alpha @ inertia @ alpha) + alpha @ cross(omega, inertia @ omega)
        for name, drift in rates.drifts.items():  # a rotor that turns with its joint
            armature = float(self.robot.model.armature[self.robot.velocity_index(name)])
            if armature:
                G = G + 0.5 * armature * drift**2
        gradient = casadi.gradient(G.sx, self.nu_dot)
        losses = self._losses(rates.rows)
        return [gradient[i] + losses[i].sx for i in range(self.robot.dof)]

    def _losses(self, rows: Mapping[str, Array]) -> Array:
        """Return −ℓ (dof,): what damping and friction take of the motion that is wanted."""
        robot, speeds = self.robot, _elements(self.nu_d)
        total = np.array([CasadiScalar(0.0)] * robot.dof, dtype=object)
        if robot.losses is None:
            return total
        for name, row in rows.items():
            i = robot.velocity_index(name)
            rate: Any = row @ speeds
            damping, friction, slow = (
                float(part[i])
                for part in (robot.losses.damping, robot.losses.friction, robot.losses.rate)
            )
            force = damping * rate
            if friction:
                length = CasadiScalar.of(casadi.sqrt((rate * rate + slow**2).sx))
                force = force + friction * rate / length
            if damping or friction:
                total = total + force * row
        return total

    @cached_property
    def actuation(self) -> Array:
        """B (dof, n_act), of CasADi scalars."""
        root, rates = self._start()
        for _ in self.oracle.links(self._positions, _elements(self.nu), root, rates):
            pass  # the rates of rolling wheels join on the way
        rows = [rates.rows[name] for name in self.robot.actuators]
        return np.array(rows).T.reshape(self.robot.dof, -1)

    @cached_property
    def rolling(self) -> Any:
        """What rolling makes of a steered base's ν, in the order of ``RollingInputs.symbols``."""
        robot, tree = self.robot, self.oracle.tree
        drive, count = tree.reading.drive, len(robot.drive.base_speeds)
        zero = CasadiScalar(0.0)
        speeds = _elements(self.nu)
        turning = np.array([zero, *speeds[1:count], *[zero] * (robot.dof - count)], dtype=object)
        unit = np.array([CasadiScalar(1.0), *turning[1:]], dtype=object)
        at, beside = (base_motion(tree, drive, self._positions, each) for each in (turning, unit))
        P = clean(robot.point_velocity)
        entries = [*(P @ at.J[:, :count]).ravel(), *(P @ at.drift), *(P @ beside.drift)]
        return casadi.cse(casadi.vertcat(*(CasadiScalar(entry).sx for entry in entries)))

    def efforts(self, force: Sequence[Any]) -> list[Any]:
        """Return τ (n_act,) of least effort relative to the limits with B τ = ``force``."""
        dynamics = ReducedDynamics(self.robot)
        if dynamics.constant:
            allocation = clean(dynamics.at(self.robot.configuration()).allocation)
            terms = ([CasadiScalar(x) * f for x, f in zip(row, force, strict=True) if x]
                     for row in allocation)  # fmt: skip
            return [sum(row[1:], row[0]) if row else CasadiScalar(0.0) for row in terms]
        limits = self.robot.effort_limits
        square = np.where(np.isfinite(limits), limits, 1.0) ** 2
        B = self.actuation
        weighted = B * square
        return list(weighted.T @ np.array(_solved(weighted @ B.T, force), dtype=object))

    @cached_property
    def _positions(self) -> dict[str, Any]:
        robot = self.robot
        positions: dict[str, Any] = {
            name: CasadiScalar.of(self.q[i]) for i, name in enumerate(self.joints)
        }
        positions |= dict.fromkeys(cyclic_joints(robot), CasadiScalar(0.0))
        positions |= {name: CasadiScalar(value) for name, value in robot.locked.items()}
        for joint in robot.mimics:
            assert joint.mimic is not None
            followed = positions[joint.mimic.joint]
            positions[joint.name] = joint.mimic.multiplier * followed + joint.mimic.offset
        return positions

    def _start(self) -> tuple[LinkKinematics, JointRates]:
        R = CASADI.identity(3)
        return self.oracle.rolling_root(R, self._positions, _elements(self.nu))


def law_dynamics(robot: Robot) -> LawDynamics:
    """Return the dynamics of a robot in symbols."""
    mimics = {joint.name for joint in robot.mimics}
    oracle = GibbsAppell(robot, CASADI)
    oracle.tree = fold(robot, CASADI)
    names = tuple(name for name in oracle.tree.moving if name not in mimics)
    symbols = casadi.SX.sym("q", len(names)), casadi.SX.sym("nu", robot.dof)
    rest = (casadi.SX.sym(name, robot.dof) for name in ("nu_dot", "nu_d"))
    return LawDynamics(robot, oracle, names, *symbols, *rest)


def clean(matrix: Array) -> Array:
    """Return a constant matrix without entries that are rounding, and simple ones exact."""
    size = float(np.abs(matrix).max(initial=0.0))
    nearest = np.round(matrix)
    simple = np.abs(matrix - nearest) <= ROUNDING * max(size, 1.0)
    return np.where(np.abs(matrix) <= ROUNDING * size, 0.0, np.where(simple, nearest, matrix))


def _elements(vector: Any) -> Array:
    return np.array([CasadiScalar.of(vector[i]) for i in range(vector.numel())], dtype=object)


def _solved(matrix: Array, right: Sequence[Any]) -> list[Any]:
    """Return the solution of equations whose matrix is symmetric and positive definite.

    Such a matrix needs no search for pivots while it is solved: none on the diagonal vanishes. Rows
    that have little beside their diagonal, as the arm's, are eliminated first and cost little.
    """
    n = len(matrix)
    rows, values = [list(row) for row in matrix], list(right)
    order: list[int] = []
    rest = list(range(n))
    while rest:
        i = min(rest, key=lambda k: sum(bool(rows[k][m]) for m in rest))
        rest.remove(i)
        order.append(i)
        for k in rest:
            if not rows[k][i]:
                continue
            factor = rows[k][i] / rows[i][i]
            for m in rest:
                if rows[i][m]:
                    rows[k][m] = rows[k][m] - factor * rows[i][m]
            values[k] = values[k] - factor * values[i]
    found: dict[int, Any] = {}
    for i in reversed(order):
        total = values[i]
        for m, value in found.items():
            if rows[i][m]:
                total = total - rows[i][m] * value
        found[i] = total / rows[i][i]
    return [found[i] for i in range(n)]
