"""What laws read: the tracking error, its rate, and the numbers among their settings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.error import BASE_ERRORS
from rpctl.control.integral import IntegralDynamic
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics

DIRECTIONS = 3  # a direction of travel and its first two derivatives


def reference_width(n_joints: int) -> int:
    """Return how many numbers a row of a reference table has."""
    return 3 * (BASE_ERRORS + n_joints + DIRECTIONS)


@dataclass(frozen=True, eq=False)
class ReferenceEntries:
    """A row of a reference table, taken apart, as :class:`~rpctl.reference.motion.ReferenceState`.

    Attributes:
        pose: Of P (3, 1).
        twist: (3, 1).
        twist_dot: (3, 1).
        joints: (n_joints, 1).
        joint_rates: (n_joints, 1).
        joint_accelerations: (n_joints, 1).
        direction: The direction of travel and its first two derivatives, (3, 1) each.
    """

    pose: Any
    twist: Any
    twist_dot: Any
    joints: Any
    joint_rates: Any
    joint_accelerations: Any
    direction: tuple[Any, Any, Any]


def reference_entries(row: Any, n_joints: int) -> ReferenceEntries:
    """Return the parts of a row ``casadi.SX`` (9 + 3 n_joints + 9, 1) of a reference table.

    Args:
        row: The row.
        n_joints: Number of the arm's joints.
    """
    sizes = [BASE_ERRORS] * 3 + [n_joints] * 3 + [3] * DIRECTIONS
    ends = [sum(sizes[: k + 1]) for k in range(len(sizes))]
    pose, twist, twist_dot, *parts = casadi.vertsplit(row, [0, *ends])
    joints, rates, accelerations, *direction = parts
    along, once, twice = direction
    return ReferenceEntries(
        pose, twist, twist_dot, joints, rates, accelerations, (along, once, twice)
    )


@dataclass(frozen=True, eq=False)
class SymbolicTracking:
    """The tracking error and its rate, (3 + n_joints, 1) each; see :mod:`rpctl.control.error`."""

    e: Any
    e_dot: Any


def symbolic_tracking(
    dynamics: SymbolicDynamics, reference: ReferenceEntries, q: Any, nu: Any
) -> SymbolicTracking:
    """Return the tracking error of a robot and its rate, as :func:`rpctl.control.error.observe`.

    Args:
        dynamics: The robot's dynamics.
        reference: The reference.
        q: Configuration (nq, 1).
        nu: Quasi-velocities (dof, 1).
    """
    robot, e = dynamics.robot, symbolic_error(dynamics, reference, q)
    cos, sin = casadi.cos(e[2]), casadi.sin(e[2])
    vx, vy, omega = casadi.vertsplit(dynamics.twist(q, nu))
    vx_r, vy_r, omega_r = casadi.vertsplit(reference.twist)
    rates = nu[robot.dof - len(robot.joints) :]
    e_dot = casadi.vertcat(
        vx_r * cos - vy_r * sin - vx + e[1] * omega,
        vx_r * sin + vy_r * cos - vy - e[0] * omega,
        omega_r - omega,
        reference.joint_rates - rates,
    )
    return SymbolicTracking(e, e_dot)


def symbolic_error(dynamics: SymbolicDynamics, reference: ReferenceEntries, q: Any) -> Any:
    """Return the tracking error (3 + n_joints, 1), as ``tracking_error``.

    Args:
        dynamics: The robot's dynamics.
        reference: The reference.
        q: Configuration (nq, 1).
    """
    return casadi.vertcat(
        _base_error(reference.pose, dynamics.base_pose(q)),
        _joint_errors(dynamics.robot, reference.joints - dynamics.joint_positions(q)),
    )


def _base_error(wanted: Any, pose: Any) -> Any:
    dx, dy = wanted[0] - pose[0], wanted[1] - pose[1]
    cos, sin = casadi.cos(pose[2]), casadi.sin(pose[2])
    turn = wrapped(wanted[2] - pose[2])
    return casadi.vertcat(cos * dx + sin * dy, cos * dy - sin * dx, turn)


def _joint_errors(robot: Robot, gaps: Any) -> Any:
    continuous = (joint.kind == "continuous" for joint in robot.joints)
    found = [wrapped(gaps[i]) if turns else gaps[i] for i, turns in enumerate(continuous)]
    return casadi.vertcat(*found, casadi.SX(0, 1))


def wrapped(angle: Any) -> Any:
    """Return an angle (rad) wrapped into (−π, π]."""
    turn = 2.0 * math.pi
    rest = math.pi - angle
    return math.pi - (rest - turn * casadi.floor(rest / turn))


class SymbolicTwist(NamedTuple):
    """P's speed forward and to the left and the turning rate (3, 1), and their rates."""

    value: Any
    rate: Any


class Moving:
    """Quantities whose rates along the motion are known; what depends on them has one, too.

    A law is written once, as a function of these. The rate of what it asks for is the derivative
    of that function along their rates.
    """

    def __init__(self) -> None:
        self._symbols: list[Any] = []
        self._values: list[Any] = []
        self._rates: list[Any] = []

    def add(self, value: Any, rate: Any) -> Any:
        """Return symbols that stand for a quantity.

        Args:
            value: Its value (n, 1), without such symbols.
            rate: Its rate (n, 1).
        """
        symbols = casadi.SX.sym(f"moving_{len(self._symbols)}", value.numel())
        self.follow(symbols, value, rate)
        return symbols

    def follow(self, symbols: Any, value: Any, rate: Any) -> None:
        """Let symbols stand for a quantity; its rate may contain them.

        Args:
            symbols: (n, 1).
            value: Its value (n, 1), without such symbols.
            rate: Its rate (n, 1).
        """
        self._symbols.append(symbols)
        self._values.append(value)
        self._rates.append(rate)

    def with_rate(self, quantity: Any) -> tuple[Any, Any]:
        """Return a quantity (n, 1) that depends on the others, and its rate (n, 1)."""
        symbols, values = casadi.vertcat(*self._symbols), casadi.vertcat(*self._values)
        rate = casadi.jtimes(quantity, symbols, casadi.vertcat(*self._rates))
        value, rate = casadi.substitute([quantity, rate], [symbols], [values])
        return casadi.densify(value), casadi.densify(rate)


Settings = Mapping[str, Any]  # by name, casadi.SX (1, 1)
ClosedFormDynamic = PaperDynamic | BoundedDynamic | IntegralDynamic


def settings_of(
    kinematic: BaseLaw, dynamic: ClosedFormDynamic, known: ReducedDynamics, period: float
) -> tuple[tuple[str, ...], Array]:
    """Return the names and the values of all numbers among two laws' settings.

    Laws of the same structure have the same names, in the same order.

    Args:
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        known: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Raises:
        RpctlError: A setting does not fit the robot or the period.
    """
    found = {**_kinematic(kinematic, known, period), **_dynamic(dynamic, known, period)}
    return tuple(found), np.array(list(found.values()))


def symbols_of(names: Sequence[str], column: Any) -> Mapping[str, Any]:
    """Return the entries of a column of settings by name.

    Args:
        names: Names of the entries.
        column: ``casadi.SX`` (n, 1).
    """
    return dict(zip(names, casadi.vertsplit(column), strict=True))


def by_name(s: Mapping[str, Any], kind: str, names: Iterable[str]) -> Any:
    """Return a column of settings of one kind.

    Args:
        s: All settings.
        kind: Which.
        names: Whose, in order.
    """
    return casadi.vertcat(*(s[f"{kind}.{name}"] for name in names), casadi.SX(0, 1))


def _kinematic(law: BaseLaw, known: ReducedDynamics, period: float) -> dict[str, float]:
    found = {
        item.name: float(getattr(law, item.name))
        for item in dataclasses.fields(law)
        if item.name not in ("joint_horizon", "leash", "approach")
    }
    if law.leash is not None:
        found |= {f"leash.{name}": value for name, value in dataclasses.asdict(law.leash).items()}
    joints = known.robot.joint_names
    return found | _each("joint_horizon", joints, law.joint_horizons(known, period))


def _dynamic(law: ClosedFormDynamic, known: ReducedDynamics, period: float) -> dict[str, float]:
    names = known.robot.quasi_velocities
    if isinstance(law, PaperDynamic):
        return _each("time", names, law.start(known, period).times)
    if isinstance(law, BoundedDynamic):
        started = law.start(known, period)
        found = {"horizon_dyn": law.horizon_dyn, "along": law.along}
        found |= _each("time", names, started.times)
        return found | _each("root_weight", names, started.root_weights)
    gain = law.start(known, period).gain
    return _dynamic(law.inner, known, period) | _each("gain", names, gain)


def _each(kind: str, names: Sequence[str], values: Array) -> dict[str, float]:
    return {f"{kind}.{name}": float(value) for name, value in zip(names, values, strict=True)}
