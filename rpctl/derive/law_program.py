"""A kinematic and a dynamic law on one robot as a sheet to read, and as one list of steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi

from rpctl.control.dynamic import USUAL_PERIOD, PaperDynamic
from rpctl.control.error import Leash
from rpctl.control.steering import Measured, Rolling
from rpctl.control.twist_law import BaseLaw, desired, reference_symbols
from rpctl.derive.program import joint_symbols, joints_of_code, symbolic_configuration
from rpctl.derive.steps import Node, Operations, Steps, count_operations, without_idle
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import printable
from rpctl.files.records import fields_of
from rpctl.kernels.scalars import cleaned, product
from rpctl.kernels.sheet import Sheet
from rpctl.robot.model import BASE_NV, Robot

BASE_UNITS = {"v": "m/s", "vx": "m/s", "vy": "m/s", "omega": "rad/s"}
POSE_UNITS, TWIST_UNITS = ("m", "m", "rad"), ("m/s", "m/s", "rad/s")
TWIST_WORDS = ("speed forward", "speed to the left", "turning rate")
SETTINGS = {  # symbols of the laws' settings, and what they are
    "horizon": ("h", "prediction time"),
    "beta": ("beta", "weight of the lateral error"),
    "smoothing": ("omega_0", "smoothing of the sign"),
    "bend": ("kappa", "curvature from which on a path is a turn"),
    "weight": ("w", "weight of the heading error"),
    "leash.distance": ("L", "leash of the position error"),
    "leash.heading": ("T", "leash of the heading error"),
}


class LawSetting(NamedTuple):
    """A named constant of a law."""

    symbol: Any
    value: float
    unit: str
    of: str


class Given(NamedTuple):
    """An input: where code finds it (a joint's position by the joint's name), and what it is."""

    symbol: Any
    path: str
    unit: str
    of: str


@dataclass(frozen=True, eq=False)
class LawSheet:
    """A law on one robot in CasADi's symbols.

    Attributes:
        robot: The robot.
        sheet: Definitions, in order.
        settings: The laws' constants.
        inputs: What is measured, and the reference.
        rolling: Names of definitions that rolling makes of ν, of no interest to a reader.
        nu_d: Desired quasi-velocities (dof,).
        nu_d_dot: Their derivatives along the motion (dof,).
        nu_dot: Desired accelerations ν̇* (dof,), of which the efforts follow.
        tau: Efforts (n_act, 1).
        period: Control period that it is for, s.
    """

    robot: Robot
    sheet: Sheet
    settings: tuple[LawSetting, ...]
    inputs: tuple[Given, ...]
    rolling: frozenset[str]
    nu_d: list[Any]
    nu_d_dot: list[Any]
    nu_dot: list[Any]
    tau: Any
    period: float

    @cached_property
    def shown(self) -> dict[str, tuple[Any, Any]]:
        """The definitions that ν_d, ν̇_d and ν̇* depend on, without those of rolling."""
        read = self._names([*self.nu_d, *self.nu_d_dot, *self.nu_dot])
        found = {}
        for name, (symbol, value) in reversed(self.sheet.definitions.items()):
            if name in read and name not in self.rolling:
                found[name] = symbol, value
                read |= self._names([value])
        return dict(reversed(found.items()))

    @cached_property
    def read(self) -> set[str]:
        """Names of all symbols that what is shown depends on."""
        values = [value for _, value in self.shown.values()]
        return self._names([*values, *self.nu_d, *self.nu_d_dot, *self.nu_dot])

    @staticmethod
    def _names(values: Sequence[Any]) -> set[str]:
        return {symbol.name() for symbol in casadi.symvar(casadi.vertcat(*values))}


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
    """Write a kinematic law and the paper's dynamic one on a robot, for a control period (s)."""
    sheet, places = Sheet(), joint_symbols(robot)
    speeds, pose, reference = _rates(robot, places), _pose(), _reference(robot, places)
    positions = [
        Given(symbol, name, "m" if symbol.name().startswith("eta") else "rad", name)
        for name, symbol in places.items()
    ]
    dynamics, q = SymbolicDynamics(robot), symbolic_configuration(robot, places)
    nu = [each.symbol for each in speeds]
    measured = _measured(sheet, dynamics, q, [each.symbol for each in pose], places, nu)
    rolling = frozenset(sheet.definitions)
    settings = _settings(kinematic)
    law = kinematic.with_numbers({name: each.symbol for name, each in settings.items()})
    times = kinematic.joint_horizons(ReducedDynamics(robot), period)
    horizons = [
        LawSetting(casadi.SX.sym(f"h_{places[name].name()}"), float(time), "s",
                   f"prediction time of {printable(name)}")
        for name, time in zip(robot.joint_names, times, strict=True)
    ]  # fmt: skip
    state = reference_symbols(robot, casadi.vertcat(*(each.symbol for each in reference)))
    found = desired(sheet, law, robot, state, measured, [each.symbol for each in horizons])
    h1 = _dynamic_horizons(robot, dynamic)
    star = [
        sheet.named(f"a{i}", rate - (speed - wanted) / each.symbol)
        for i, (rate, speed, wanted, each) in enumerate(
            zip(found.nu_d_dot, nu, found.nu_d, h1, strict=True), start=1
        )
    ]
    columns = (casadi.vertcat(*part, casadi.SX(0, 1)) for part in (nu, star, found.nu_d))
    tau = dynamics.efforts(q, dynamics.inverse(q, *columns))
    used = (*settings.values(), *horizons, *dict.fromkeys(h1))
    inputs = (*speeds, *pose, *reference, *positions)
    parts = found.nu_d, found.nu_d_dot, star
    return LawSheet(robot, sheet, used, inputs, rolling, *parts, tau, period)


def law_program(law: LawSheet) -> LawProgram:
    """Return the steps of a law."""
    steps, robot = Steps(), law.robot
    values = [value for _, value in law.sheet.definitions.values()]
    wanted = [law.tau, *law.nu_d, *law.nu_d_dot]
    *defined, tau, nu_d, nu_d_dot = law.sheet.resolved(
        [*values, law.tau, casadi.vertcat(*law.nu_d), casadi.vertcat(*law.nu_d_dot)]
    )
    outputs = casadi.vertcat(*defined, tau, nu_d, nu_d_dot)
    read = {symbol.name() for symbol in casadi.symvar(casadi.vertcat(tau, nu_d, nu_d_dot))}
    given = {each.path: each for each in law.inputs}
    moving = [name for name in robot.moving_joint_names if name in given]
    needed = {name for name in moving if given[name].symbol.name() in read}
    needed |= {swivel.joint for swivel in robot.drive.steered}
    positions = joints_of_code(robot, needed)
    leaves: list[Given | LawSetting] = [*law.inputs, *law.settings]
    nodes = [_leaf(each, positions) for each in leaves]
    symbols = casadi.vertcat(*(each.symbol for each in leaves))
    function = casadi.Function("law", [symbols], [outputs])
    results = steps.evaluate(function, [lambda i: steps.add(*nodes[i])])
    count = len(values)
    kept, moved = without_idle(steps.nodes, results[count:])
    named = dict(zip(reversed(results[:count]), reversed(law.sheet.definitions), strict=True))
    ends = [moved[node] for node in results[count:]]
    n_act, dof = tau.numel(), len(law.nu_d)
    assert len(ends) == n_act + 2 * dof == len(wanted) - 1 + n_act
    return LawProgram(
        law,
        positions,
        tuple(kept),
        {moved[node]: name for node, name in named.items() if node in moved},
        tuple(ends[:n_act]),
        tuple(ends[n_act : n_act + dof]),
        tuple(ends[n_act + dof :]),
    )


def _leaf(each: Given | LawSetting, positions: Sequence[str]) -> Node:
    """Return the node of a setting or an input."""
    if isinstance(each, LawSetting):
        return "input", each.symbol.name()
    if each.path in positions:
        return "q", positions.index(each.path)
    if each.path.startswith("nu["):
        return "nu", int(each.path[3:-1])
    return "input", each.path


def _rates(robot: Robot, places: dict[str, Any]) -> list[Given]:
    """Name the quasi-velocities."""
    found = []
    for i, name in enumerate(robot.quasi_velocities):
        base = i < len(robot.drive.base_speeds) and name in BASE_UNITS
        label = name if base else f"{places[name].name()}_dot"
        unit = BASE_UNITS[name] if base else "m/s" if label.startswith("eta") else "rad/s"
        found.append(Given(casadi.SX.sym(label), f"nu[{i}]", unit, f"quasi-velocity {name}"))
    return found


def _pose() -> list[Given]:
    names = zip(("x", "y", "theta"), POSE_UNITS, ("x", "y", "heading"), strict=True)
    return [
        Given(casadi.SX.sym(name), f"pose[{i}]", unit, f"{word} of the root link")
        for i, (name, unit, word) in enumerate(names)
    ]


def _reference(robot: Robot, places: dict[str, Any]) -> list[Given]:
    """Name the reference, in the order of a row of a reference table."""
    rows: list[tuple[str, Sequence[str], Sequence[str], Sequence[str]]] = [
        ("pose", ("x_r", "y_r", "theta_r"), POSE_UNITS,
         [f"{name} of P on the reference" for name in ("x", "y", "theta")]),
        ("twist", ("v_r", "vl_r", "omega_r"), TWIST_UNITS,
         [f"{word} of the reference" for word in TWIST_WORDS]),
        ("twist_dot", ("v_r_dot", "vl_r_dot", "omega_r_dot"), [f"{u}^2" for u in TWIST_UNITS],
         ["its derivative"] * BASE_NV),
    ]  # fmt: skip
    labels = [places[name].name() for name in robot.joint_names]
    units = ["m" if joint.kind == "prismatic" else "rad" for joint in robot.joints]
    for field, ending, over, of in (
        ("joints", "_r", "", [f"reference of {name}" for name in robot.joint_names]),
        ("joint_rates", "_r_dot", "/s", ["its rate"] * len(labels)),
        ("joint_accelerations", "_r_ddot", "/s^2", ["its acceleration"] * len(labels)),
    ):
        rows.append((field, [f"{x}{ending}" for x in labels], [f"{u}{over}" for u in units], of))
    words = ("direction of travel; all 0: none", "its derivative", "its second derivative")
    for k, (letter, word) in enumerate(zip(("g", "gdot", "gddot"), words, strict=True)):
        names = [f"{letter}_{axis}" for axis in ("v", "l", "omega")]
        rows.append((f"direction[{k}]", names, [""] * BASE_NV, [word] * BASE_NV))
    return [
        Given(casadi.SX.sym(name), f"r->{field}[{i}]", unit, of)
        for field, *columns in rows
        for i, (name, unit, of) in enumerate(zip(*columns, strict=True))
    ]


def _measured(
    sheet: Sheet,
    dynamics: SymbolicDynamics,
    q: Any,
    pose: list[Any],
    places: dict[str, Any],
    nu: list[Any],
) -> Measured:
    """Return what laws read of a state; what rolling makes of ν is named."""
    robot = dynamics.robot
    joints, steered = robot.joint_names, [swivel.joint for swivel in robot.drive.steered]
    point, count = robot.point_velocity, len(robot.drive.base_speeds)
    rates, rolling = nu[len(nu) - len(joints) :], None
    if steered:
        at = dynamics.at(q)
        rows = [_named(sheet, f"N{i}", row) for i, row in enumerate(_rows(point, at.S, count))]
        if not robot.drive.has_axle:
            turning = casadi.vertcat(0.0, *nu[1:count], casadi.SX.zeros(len(joints), 1))
            unit = casadi.SX.eye(robot.dof)[:, 0]
            drifts = (_rows(point, at.drift(each), 1) for each in (turning, turning + unit))
            ends = [[row[0] for row in drift] for drift in drifts]
            rolling = Rolling(rows, _named(sheet, "E", ends[0]), _named(sheet, "F", ends[1]))
    else:
        S = ReducedDynamics(robot).basis(robot.configuration())
        rows = cleaned(point @ S[:BASE_NV, :count]).tolist()
    twist = product(rows, nu[:count])
    turning_rates = nu[1 : 1 + len(steered)]
    ends = [[places[name] for name in names] for names in (joints, steered)]
    return Measured(pose, twist, ends[0], rates, ends[1], turning_rates, rolling)


def _rows(point: Any, S: Any, count: int) -> list[list[Any]]:
    """Return the rows of P's twist by the first columns of what gives the root link's."""
    found = casadi.densify(casadi.DM(point) @ S[:BASE_NV, :count])
    return [casadi.horzsplit(row) for row in casadi.vertsplit(found)]


def _named(sheet: Sheet, mark: str, values: Sequence[Any]) -> list[Any]:
    return [sheet.named(f"{mark}{i}", value) for i, value in enumerate(values, start=1)]


def _settings(law: BaseLaw) -> dict[str, LawSetting]:
    """Return the numbers among a law's settings, by name."""
    found = {}
    for name, value in law.numbers().items():
        owner, _, inner = name.rpartition(".")
        setting = fields_of(Leash if owner else type(law))[inner].setting
        symbol, of = SETTINGS.get(name, (inner, setting.label or f"setting {inner}"))
        unit = setting.unit.replace("²", "^2")
        found[name] = LawSetting(casadi.SX.sym(symbol), value, unit, of)
    return found


def _dynamic_horizons(robot: Robot, law: PaperDynamic) -> list[LawSetting]:
    """Name the prediction times of the dynamic law (dof,)."""
    joints, time = len(robot.joints), "prediction time of the dynamic law"
    base = LawSetting(casadi.SX.sym("h1"), law.horizon_dyn, "s", time)
    arm = base
    if law.joint_horizon_dyn is not None and joints:
        symbol = casadi.SX.sym("h1_arm")
        arm = LawSetting(symbol, law.joint_horizon_dyn, "s", "the same, of the arm")
    return [base] * (robot.dof - joints) + [arm] * joints
