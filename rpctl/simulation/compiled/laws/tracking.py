"""The kinematic laws on a robot in CasADi's symbols, and the numbers among laws' settings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.error import base_error, joint_errors
from rpctl.control.integral import IntegralDynamic
from rpctl.control.steering import Measured, Rolling
from rpctl.control.twist_law import BaseLaw, desired, reference_symbols
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.sheet import Sheet
from rpctl.robot.model import BASE_NV

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
    horizons = kinematic.joint_horizons(known, period)
    found = kinematic.numbers() | _each("joint_horizon", known.robot.joint_names, horizons)
    found |= _dynamic(dynamic, known, period)
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


def symbolic_error(dynamics: SymbolicDynamics, row: Any, q: Any) -> Any:
    """Return the tracking error (3 + n_joints, 1), as ``tracking_error``.

    Args:
        dynamics: The robot's dynamics.
        row: Row of a reference table.
        q: Configuration (nq, 1).
    """
    robot = dynamics.robot
    state = reference_symbols(robot, row)
    base = base_error(state.pose, casadi.vertsplit(dynamics.base_pose(q)))
    positions = [dynamics.position(q, name) for name in robot.joint_names]
    return casadi.vertcat(*base, *joint_errors(robot, state.joints, positions))


def measured(dynamics: SymbolicDynamics, q: Any, nu: Any) -> Measured:
    """Return what laws read of a state, q (nq, 1) and ν (dof, 1)."""
    robot = dynamics.robot
    pose = q[0], q[1], casadi.atan2(q[3], q[2])
    joints = [dynamics.position(q, name) for name in robot.joint_names]
    rates = casadi.vertsplit(nu)[robot.dof - len(joints) :]
    found = Measured(pose, casadi.vertsplit(dynamics.twist(q, nu)), joints, rates)
    steered = robot.drive.steered
    if not steered:
        return found
    found = found._replace(
        steered=[dynamics.position(q, swivel.joint) for swivel in steered],
        steering_rates=casadi.vertsplit(nu)[1 : 1 + len(steered)],
    )
    if robot.drive.has_axle:
        return found
    return found._replace(rolling=_rolling(dynamics, q, nu))


def _rolling(dynamics: SymbolicDynamics, q: Any, nu: Any) -> Rolling:
    robot, count = dynamics.robot, len(dynamics.robot.drive.base_speeds)
    point, at = casadi.DM(robot.point_velocity), dynamics.at(q)
    turning, unit = casadi.SX.zeros(robot.dof, 1), casadi.SX.eye(robot.dof)[:, 0]
    turning[1:count] = nu[1:count]
    rows = casadi.densify(point @ at.S[:BASE_NV, :count])
    drifts = [point @ at.drift(each)[:BASE_NV] for each in (turning, turning + unit)]
    drift, unit_drift = (casadi.vertsplit(casadi.densify(each)) for each in drifts)
    split = [casadi.horzsplit(row) for row in casadi.vertsplit(rows)]
    return Rolling(split, drift, unit_drift)


class SymbolicCommand(NamedTuple):
    """What a kinematic law makes of a sample."""

    e: Any  # (3 + n_joints, 1)
    nu_d: Any  # (dof, 1)
    nu_d_dot: Any  # (dof, 1) along the motion
    failed: Any  # whether the law has no answer (1, 1)


def symbolic_command(
    law: BaseLaw, dynamics: SymbolicDynamics, row: Any, q: Any, nu: Any, s: Settings
) -> SymbolicCommand:
    """Return what a kinematic law asks for, as :class:`rpctl.control.twist_law.BaseController`.

    Args:
        law: The law.
        dynamics: The robot's dynamics, as far as the controller knows them.
        row: Row of a reference table.
        q: Configuration (nq, 1).
        nu: Quasi-velocities (dof, 1).
        s: Settings by name.
    """
    robot, sheet = dynamics.robot, Sheet()
    state, at = reference_symbols(robot, row), measured(dynamics, q, nu)
    horizons = [s[f"joint_horizon.{name}"] for name in robot.joint_names]
    found = desired(sheet, law.with_numbers(s), robot, state, at, horizons)
    parts = [casadi.vertcat(*part, casadi.SX(0, 1)) for part in found[:3]]
    return SymbolicCommand(*sheet.resolved([*parts, found.refused]))
