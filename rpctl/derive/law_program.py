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
from rpctl.derive.equations import position_symbols, rational
from rpctl.derive.law_kinematic import Measured, base_twist, measure, wrapped
from rpctl.derive.law_sheet import Sheet
from rpctl.derive.law_steering import (
    RollingInputs,
    Steered,
    reference_direction,
    rolling_inputs,
    steered_command,
)
from rpctl.derive.program import CasadiScalar, LawDynamics, clean, law_dynamics
from rpctl.derive.steps import Node, Operations, Steps, Translator, count_operations, without_idle
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import printable
from rpctl.robot.model import BASE_NV, Robot

BASE_UNITS = {"v": "m/s", "vx": "m/s", "vy": "m/s", "omega": "rad/s"}


@dataclass(frozen=True)
class LawSheet:
    """A law on one robot in symbols.

    Attributes:
        robot: The robot.
        sheet: Settings, inputs and definitions.
        positions: Joints whose positions are inputs of the sheet: the arm's, then the steered.
        nu: Quasi-velocities (dof,), measured.
        nu_d: Desired quasi-velocities (dof,).
        nu_d_dot: Their derivatives along the motion (dof,).
        nu_dot: Desired accelerations ν̇* (dof,), of which the efforts follow.
        period: Control period that it is for, s.
        rolling: Of a steered base, what rolling makes of ν.
    """

    robot: Robot
    sheet: Sheet
    positions: tuple[str, ...]
    nu: tuple[sp.Expr, ...]
    nu_d: tuple[sp.Expr, ...]
    nu_d_dot: tuple[sp.Expr, ...]
    nu_dot: tuple[sp.Expr, ...]
    period: float
    rolling: RollingInputs | None = None


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
    """Write the paper's or the unified law on a robot in symbols, for a control period (s)."""
    sheet = Sheet()
    nu = _rates(sheet, robot)
    rolling = rolling_inputs(sheet, robot) if robot.drive.steered else None
    twist = _twist(robot, nu, rolling)
    wanted: list[sp.Expr] = []
    rates: list[sp.Expr] = []
    if robot.drive.base_speeds:
        at = measure(sheet, robot, twist, kinematic)
        asked = base_twist(sheet, robot, kinematic, at)
        if rolling is None:
            keep = [0, 2] if robot.drive.has_axle else range(len(robot.drive.base_speeds))
            wanted = [asked[k] for k in keep]
            rates = [sheet.rate(each) for each in wanted]
        else:
            wanted, rates = _steered(sheet, robot, nu, asked, at, rolling)
    arm = _arm(sheet, robot, nu, kinematic.joint_horizons(ReducedDynamics(robot), period))
    wanted, rates = wanted + arm, rates + [sheet.rate(each) for each in arm]
    h1 = _dynamic_horizons(sheet, robot, dynamic)
    star = [
        sheet.define(f"a{i}", rate - (speed - each) / h1[i - 1])
        for i, (speed, each, rate) in enumerate(zip(nu, wanted, rates, strict=True), start=1)
    ]
    positions = (*robot.joint_names, *(swivel.joint for swivel in robot.drive.steered))
    return LawSheet(
        robot,
        sheet,
        positions,
        tuple(nu),
        tuple(wanted),
        tuple(rates),
        tuple(star),
        period,
        rolling,
    )


def law_program(law: LawSheet) -> LawProgram:
    """Return the steps of a law."""
    dynamics = law_dynamics(law.robot)
    force = [CasadiScalar.of(each) for each in dynamics.quasi_force]
    efforts = casadi.cse(casadi.vertcat(*(each.sx for each in dynamics.efforts(force))))
    positions = _positions(law, dynamics, efforts)
    steps = Steps()
    translate = _translator(law, steps, positions)
    place = {dynamics.joints.index(name): k for k, name in enumerate(positions)}
    inputs: list[Callable[[int], int]] = [
        lambda i: steps.add("q", place[i]),
        lambda i: steps.add("nu", i),
        lambda i: outputs[2][i],
        lambda i: outputs[0][i],
    ]
    if law.rolling is not None:
        function = casadi.Function("rolling", [dynamics.q, dynamics.nu], [dynamics.rolling])
        nodes = steps.evaluate(function, inputs)
        translate.known.update(zip(law.rolling.symbols, nodes, strict=True))
    named = {}
    for symbol, value in law.sheet.definitions:
        named[translate.node(value)] = str(symbol)
        translate.known[symbol] = translate.node(value)
    outputs = [[translate.node(x) for x in part] for part in (law.nu_d, law.nu_d_dot, law.nu_dot)]
    function = casadi.Function("efforts", dynamics.symbols, [efforts])
    tau = steps.evaluate(function, inputs)
    kept, moved = without_idle(steps.nodes, [*tau, *outputs[0], *outputs[1]])
    return LawProgram(
        law,
        positions,
        tuple(kept),
        {moved[node]: name for node, name in named.items() if node in moved},
        tuple(moved[node] for node in tau),
        tuple(moved[node] for node in outputs[0]),
        tuple(moved[node] for node in outputs[1]),
    )


def _positions(law: LawSheet, dynamics: LawDynamics, efforts: Any) -> tuple[str, ...]:
    """Return the joints whose positions are read, and all of the arm: the actuated come first."""
    needs = [efforts] if law.rolling is None else [efforts, dynamics.rolling]
    read = {str(symbol) for symbol in casadi.symvar(casadi.vertcat(*needs))}
    needed = {name for i, name in enumerate(dynamics.joints) if str(dynamics.q[i]) in read}
    needed |= set(law.positions)
    order = dict.fromkeys((*law.robot.actuators, *law.robot.moving_joint_names))
    return tuple(name for name in order if name in needed)


def _translator(law: LawSheet, steps: Steps, positions: Sequence[str]) -> Translator:
    translate = Translator(steps)
    for given in law.sheet.inputs:
        kind, _, index = given.path.rstrip("]").partition("[")
        if kind == "q":
            node = steps.add("q", positions.index(law.positions[int(index)]))
        elif kind == "nu":
            node = steps.add("nu", int(index))
        elif not given.path:
            continue  # the dynamics' steps compute it
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
        label = name if name in BASE_UNITS and base else f"{symbols[name]}_dot"
        unit = BASE_UNITS.get(label, "m/s" if label.startswith("eta") else "rad/s")
        found.append(sheet.given(label, f"nu[{i}]", unit, f"quasi-velocity {name}"))
    return found


def _twist(robot: Robot, nu: Sequence[sp.Symbol], rolling: RollingInputs | None) -> list[sp.Expr]:
    """Return P's speed forward and to the left, and the turning rate."""
    rows: Sequence[Sequence[sp.Expr]]
    if rolling is None:
        S = ReducedDynamics(robot).basis(robot.configuration())
        rows = [[rational(x) for x in row] for row in clean(robot.point_velocity @ S[:BASE_NV])]
    else:
        rows = rolling.map
    return [sp.Add(*(x * speed for x, speed in zip(row, nu, strict=False))) for row in rows]


def _steered(
    sheet: Sheet,
    robot: Robot,
    nu: Sequence[sp.Symbol],
    asked: Sequence[sp.Expr],
    at: Measured,
    rolling: RollingInputs,
) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """Write the command of a steered base, and its rate.

    Args:
        sheet: Where to write.
        robot: The robot.
        nu: Its quasi-velocities (dof,).
        asked: The twist that the law asks for (3,).
        at: Reference and error.
        rolling: What rolling makes of ν.
    """
    symbols, measured = position_symbols(robot), []
    for i, swivel in enumerate(robot.drive.steered):
        path = f"q[{len(robot.joints) + i}]"
        position = sheet.given(str(symbols[swivel.joint]), path, "rad", swivel.joint)
        measured.append(Steered(position, nu[1 + i]))
    twist_dot = [sheet.rates[each] for each in at.twist_r]
    g = reference_direction(sheet, at.given, at.twist_r, twist_dot)
    h = next(s.symbol for s in sheet.settings if str(s.symbol) == "h")
    return steered_command(sheet, robot, asked, g, measured, rolling, h)


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
