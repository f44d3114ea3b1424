"""A kinematic and a dynamic law on one robot as one list of scalar steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi
import sympy as sp

from rpctl.arrays import Array
from rpctl.control.bandwidth import USUAL_PERIOD
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.error import BASE_ERRORS
from rpctl.control.twist_law import BaseLaw
from rpctl.derive.casadi_scalar import CasadiScalar
from rpctl.derive.equations import position_symbols
from rpctl.derive.law_dynamics import LawDynamics, clean, law_dynamics
from rpctl.derive.law_kinematic import base_twist, measure, wrapped
from rpctl.derive.law_sheet import Sheet
from rpctl.derive.law_steps import Operations, Translator, count_operations, without_idle
from rpctl.derive.parameters import rational
from rpctl.derive.steps import Node, Steps
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import printable
from rpctl.robot.model import Robot


@dataclass(frozen=True)
class LawSheet:
    """A law on one robot in symbols.

    Attributes:
        robot: The robot.
        sheet: Settings, inputs and definitions.
        positions: Joints whose positions are inputs of the sheet: the arm's.
        nu: Quasi-velocities (dof,), measured.
        nu_d: Desired quasi-velocities (dof,).
        nu_d_dot: Their derivatives along the motion (dof,).
        nu_dot: Desired accelerations ν̇* (dof,), of which the efforts follow.
    """

    robot: Robot
    sheet: Sheet
    positions: tuple[str, ...]
    nu: tuple[sp.Expr, ...]
    nu_d: tuple[sp.Expr, ...]
    nu_d_dot: tuple[sp.Expr, ...]
    nu_dot: tuple[sp.Expr, ...]


@dataclass(frozen=True)
class LawProgram:
    """Steps that compute τ, ν_d and ν̇_d.

    Attributes:
        law: The law in symbols.
        positions: Joints whose positions are inputs, in the order of ``q``.
        nodes: The steps; see :class:`~rpctl.derive.steps.Steps`.
        named: Names of steps that the sheet defines.
        tau: Nodes of the efforts (n_act,).
        nu_d: Nodes of the desired quasi-velocities (dof,).
        nu_d_dot: Nodes of their derivatives (dof,).
    """

    law: LawSheet
    positions: tuple[str, ...]
    nodes: tuple[Node, ...]
    named: dict[int, str]
    tau: tuple[int, ...]
    nu_d: tuple[int, ...]
    nu_d_dot: tuple[int, ...]

    @cached_property
    def operations(self) -> Operations:
        """Worst-case operation count."""
        return count_operations(self.nodes)


def law_sheet(
    robot: Robot, kinematic: BaseLaw, dynamic: PaperDynamic, period: float = USUAL_PERIOD
) -> LawSheet:
    """Write a law on a robot in symbols.

    Args:
        robot: The robot.
        kinematic: The paper's or the unified law.
        dynamic: The dynamic law.
        period: Control period, s, on which the joints' prediction times depend.
    """
    sheet = Sheet()
    nu = _rates(sheet, robot)
    twist = _twist(robot, nu)
    wanted: list[sp.Expr] = []
    if robot.drive.base_speeds:
        asked = base_twist(sheet, robot, kinematic, measure(sheet, robot, twist, kinematic))
        keep = [0, 2] if robot.drive.has_axle else range(len(robot.drive.base_speeds))
        wanted = [asked[k] for k in keep]
    wanted += _arm(sheet, robot, nu, kinematic.joint_horizons(ReducedDynamics(robot), period))
    rates = [sheet.rate(each) for each in wanted]
    h1 = _dynamic_horizons(sheet, robot, dynamic)
    star = [
        sheet.define(f"a{i}", rate - (speed - each) / h1[i - 1])
        for i, (speed, each, rate) in enumerate(zip(nu, wanted, rates, strict=True), start=1)
    ]
    return LawSheet(
        robot, sheet, robot.joint_names, tuple(nu), tuple(wanted), tuple(rates), tuple(star)
    )


def law_program(law: LawSheet) -> LawProgram:
    """Return the steps of a law."""
    dynamics = law_dynamics(law.robot)
    force = [CasadiScalar.of(each) for each in dynamics.quasi_force]
    efforts = casadi.cse(casadi.vertcat(*(each.sx for each in dynamics.efforts(force))))
    positions = _positions(law, dynamics, efforts)
    steps = Steps()
    translate = _translator(law, steps, positions)
    named = {}
    for symbol, value in law.sheet.definitions:
        named[translate.node(value)] = str(symbol)
        translate.known[symbol] = translate.node(value)
    outputs = [[translate.node(x) for x in part] for part in (law.nu_d, law.nu_d_dot, law.nu_dot)]
    place = {dynamics.joints.index(name): k for k, name in enumerate(positions)}
    inputs: list[Callable[[int], int]] = [
        lambda i: steps.add("q", place[i]),
        lambda i: steps.add("nu", i),
        lambda i: outputs[2][i],
        lambda i: outputs[0][i],
    ]
    given = [dynamics.q, dynamics.nu, dynamics.nu_dot, dynamics.nu_d]
    function = casadi.Function("efforts", given, [efforts])
    tau = steps.evaluate(function, inputs)
    nodes, moved = without_idle(steps.nodes, [*tau, *outputs[0], *outputs[1]])
    return LawProgram(
        law,
        positions,
        tuple(nodes),
        {moved[node]: name for node, name in named.items() if node in moved},
        tuple(moved[node] for node in tau),
        tuple(moved[node] for node in outputs[0]),
        tuple(moved[node] for node in outputs[1]),
    )


def _positions(law: LawSheet, dynamics: LawDynamics, efforts: Any) -> tuple[str, ...]:
    """Return the joints whose positions are read, and all of the arm, in the file's order."""
    read = {str(symbol) for symbol in casadi.symvar(efforts)}
    needed = {name for i, name in enumerate(dynamics.joints) if str(dynamics.q[i]) in read}
    needed |= set(law.positions)
    return tuple(name for name in law.robot.moving_joint_names if name in needed)


def _translator(law: LawSheet, steps: Steps, positions: Sequence[str]) -> Translator:
    translate = Translator(steps)
    for given in law.sheet.inputs:
        kind, _, index = given.path.rstrip("]").partition("[")
        if kind == "q":
            node = steps.add("q", positions.index(law.positions[int(index)]))
        elif kind == "nu":
            node = steps.add("nu", int(index))
        else:
            node = steps.add("input", given.path)
        translate.known[given.symbol] = node
    for setting in law.sheet.settings:
        translate.known[setting.symbol] = steps.add("input", str(setting.symbol))
    return translate


def _rates(sheet: Sheet, robot: Robot) -> list[sp.Symbol]:
    """Name the quasi-velocities."""
    symbols, found = position_symbols(robot), []
    for i, name in enumerate(robot.quasi_velocities):
        base = i < len(robot.drive.base_speeds)
        label = name if base else f"{symbols[name]}_dot"
        unit = "m/s" if name in ("v", "vx", "vy") or label.startswith("eta") else "rad/s"
        found.append(sheet.given(label, f"nu[{i}]", unit, "quasi-velocity" if base else name))
    return found


def _twist(robot: Robot, nu: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """Return P's speed forward and to the left, and the turning rate."""
    S = ReducedDynamics(robot).basis(robot.configuration())
    return [
        sp.Add(*(rational(x) * speed for x, speed in zip(row, nu, strict=True) if x))
        for row in clean(robot.point_velocity @ S[:3])
    ]


def _arm(sheet: Sheet, robot: Robot, nu: Sequence[sp.Symbol], horizons: Array) -> list[sp.Expr]:
    """Write the rates that a law asks of the arm: q̇_r + (q_r − q)/h; [MS21, Eq. 20].

    Args:
        sheet: Where to write.
        robot: The robot.
        nu: Its quasi-velocities (dof,).
        horizons: Prediction times of the joints (n_joints,), s.
    """
    symbols, wanted = position_symbols(robot), []
    for i, joint in enumerate(robot.joints):
        name = str(symbols[joint.name])
        unit = "m" if joint.kind == "prismatic" else "rad"
        position = sheet.given(name, f"q[{i}]", unit, joint.name)
        wished = sheet.given(f"{name}_r", f"r->joints[{i}]", unit, f"reference of {joint.name}")
        rate = sheet.given(f"{name}_r_dot", f"r->joint_rates[{i}]", f"{unit}/s", "its rate")
        sheet.rates[rate] = sheet.given(
            f"{name}_r_ddot", f"r->joint_accelerations[{i}]", f"{unit}/s^2", "its acceleration"
        )
        of = f"prediction time of {printable(joint.name)}"
        horizon = sheet.setting(f"h_{name}", float(horizons[i]), "s", of)
        gap = wished - position
        error = wrapped(gap) if joint.kind == "continuous" else gap
        speed = nu[len(robot.drive.base_speeds) + i]
        error = sheet.moving(f"x{BASE_ERRORS + 1 + i}", error, rate - speed)
        wanted.append(sheet.follow(f"{name}_d", rate + error / horizon))
    return wanted


def _dynamic_horizons(sheet: Sheet, robot: Robot, law: PaperDynamic) -> list[sp.Symbol]:
    """Name the prediction times of the dynamic law (dof,)."""
    base = sheet.setting("h1", law.horizon_dyn, "s", "prediction time of the dynamic law")
    arm, joints = base, len(robot.joints)
    if law.joint_horizon_dyn is not None and joints:
        arm = sheet.setting("h1_arm", law.joint_horizon_dyn, "s", "the same, of the arm")
    return [base] * (robot.dof - joints) + [arm] * joints
