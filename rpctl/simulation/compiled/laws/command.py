"""A kinematic law on one robot in CasADi's symbols: from a reference to ν_d and ν̇_d."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.control.error import BASE_ERRORS
from rpctl.control.twist_law import BaseLaw
from rpctl.simulation.compiled.laws.kinematic_laws import Settings, base_twist, refuses
from rpctl.simulation.compiled.laws.law_settings import by_name
from rpctl.simulation.compiled.laws.steering_command import symbolic_base_command
from rpctl.simulation.compiled.laws.tracking import reference_entries, symbolic_tracking
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics


@dataclass(frozen=True, eq=False)
class SymbolicCommand:
    """What a kinematic law makes of a sample.

    Attributes:
        e: Tracking error (3 + n_joints, 1).
        nu_d: Desired quasi-velocities (dof, 1).
        nu_d_dot: Their derivatives along the motion (dof, 1).
        failed: Whether the law has no answer (1, 1).
    """

    e: Any
    nu_d: Any
    nu_d_dot: Any
    failed: Any


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
    robot = dynamics.robot
    drive = robot.drive
    reference = reference_entries(row, len(robot.joints))
    tracking = symbolic_tracking(dynamics, reference, q, nu)
    h = by_name(s, "joint_horizon", robot.joint_names)
    wanted = reference.joint_rates + tracking.e[BASE_ERRORS:] / h
    rates = reference.joint_accelerations + tracking.e_dot[BASE_ERRORS:] / h
    failed = casadi.SX(0)
    if drive.base_speeds:
        twist = base_twist(law, drive.omnidirectional, reference, tracking, s)
        base = symbolic_base_command(dynamics, reference, q, nu, twist, s["horizon"])
        wanted, rates = casadi.vertcat(base[0], wanted), casadi.vertcat(base[1], rates)
        failed = refuses(law, drive.omnidirectional, reference)
    return SymbolicCommand(tracking.e, wanted, rates, failed)
