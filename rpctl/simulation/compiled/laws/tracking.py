"""The tracking error in CasADi's symbols, and the rate of whatever depends on moving quantities."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.control.error import BASE_ERRORS
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
