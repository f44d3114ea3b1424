"""A kinematic and a dynamic law on one robot as a sheet to read, and as one list of steps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any, NamedTuple

import casadi

from rpctl.control.bandwidth import USUAL_PERIOD
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.steering import Measured, Rolling
from rpctl.control.twist_law import BaseLaw, desired
from rpctl.derive.program import (
    FUNCTIONS,
    Node,
    Operations,
    Steps,
    count_operations,
    joint_symbols,
    joints_of_code,
    symbolic_configuration,
    without_idle,
)
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import RpctlError, printable
from rpctl.files.records import settings_of
from rpctl.kernels.scalars import cleaned, product
from rpctl.kernels.sheet import Sheet
from rpctl.reference.motion import row_symbols
from rpctl.robot.model import BASE_NV, Robot

BASE_UNITS = {"v": "m/s", "vx": "m/s", "vy": "m/s", "omega": "rad/s"}
POSE_UNITS, TWIST_UNITS = ("m", "m", "rad"), ("m/s", "m/s", "rad/s")
TWIST_WORDS = ("speed forward", "speed to the left", "turning rate")
DIRECTIONS = {
    "g": "direction of travel; all 0: none",
    "gdot": "its derivative",
    "gddot": "its second derivative",
}
SETTINGS = {  # symbols of the laws' settings, and what they are
    "horizon": ("h", "prediction time"),
    "beta": ("beta", "weight of the lateral error"),
    "smoothing": ("omega_0", "smoothing of the sign"),
    "bend": ("kappa", "curvature from which on a path is a turn"),
    "weight": ("w", "weight of the heading error"),
    "leash.distance": ("L", "leash of the position error"),
    "leash.heading": ("T", "leash of the heading error"),
}
C_WORDS = (
    "auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|goto|if|int|"
    "long|register|return|short|signed|sizeof|static|struct|switch|typedef|union|unsigned|void|"
    "volatile|while|inline|restrict"
)
ARGUMENTS = ("pose", "q", "nu", "r", "tau", "nu_d", "nu_d_dot")
SYMBOL = re.compile(rf"(?!(t\d+|{C_WORDS})$)[A-Za-z]\w*", re.ASCII)  # t0, t1, … are steps


class LawSymbol(NamedTuple):
    """An input of a law, or a named constant, and what it is.

    Attributes:
        place: Where code finds an input (a joint's position by the joint's name), or the value of a
            constant.
    """

    symbol: Any
    place: str | float
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
    settings: tuple[LawSymbol, ...]
    inputs: tuple[LawSymbol, ...]
    rolling: frozenset[str]
    nu_d: list[Any]
    nu_d_dot: list[Any]
    nu_dot: list[Any]
    tau: Any
    period: float

    @cached_property
    def read(self) -> set[str]:
        """Names of all symbols that ν_d, ν̇_d and ν̇* depend on, as far as what rolling makes."""
        read = self._names([*self.nu_d, *self.nu_d_dot, *self.nu_dot])
        for name, (_, value) in reversed(self.sheet.definitions.items()):
            if name in read and name not in self.rolling:
                read |= self._names([value])
        return read

    @property
    def shown(self) -> dict[str, Any]:
        """The definitions among these, without those of rolling."""
        shown = self.read - self.rolling
        return {name: value for name, (_, value) in self.sheet.definitions.items() if name in shown}

    @staticmethod
    def _names(values: Sequence[Any]) -> set[str]:
        return {symbol.name() for symbol in casadi.symvar(casadi.vertcat(*values))}


@dataclass(frozen=True)
class LawProgram:
    """Steps that compute τ, ν_d and ν̇_d.

    Attributes:
        law: The law in symbols.
        positions: Joints whose positions are inputs, in the order of ``q``.
        nodes: The steps; see :class:`~rpctl.derive.program.Steps`.
        named: Names of steps that the sheet defines.
        results: Nodes of the efforts ``tau`` (n_act,), of the desired quasi-velocities ``nu_d``
            (dof,), and of their derivatives ``nu_d_dot`` (dof,).
    """

    law: LawSheet
    positions: tuple[str, ...]
    nodes: tuple[Node, ...]
    named: dict[int, str]
    results: dict[str, list[int]]

    @cached_property
    def operations(self) -> Operations:
        """Worst-case operation count."""
        return count_operations(self.nodes)


def law_sheet(
    robot: Robot, kinematic: BaseLaw, dynamic: PaperDynamic, period: float = USUAL_PERIOD
) -> LawSheet:
    """Write a kinematic law and the paper's dynamic one on a robot, for a control period (s)."""
    robot.require_level()
    sheet, places = Sheet(), joint_symbols(robot)
    speeds, reference = _rates(robot, places), _reference(robot, places)
    pose = [
        LawSymbol(casadi.SX.sym(name), f"pose[{i}]", POSE_UNITS[i], f"{word} of the root link")
        for i, (name, word) in enumerate({"x": "x", "y": "y", "theta": "heading"}.items())
    ]
    positions = [
        LawSymbol(symbol, name, "m" if symbol.name().startswith("eta") else "rad", name)
        for name, symbol in places.items()
    ]
    dynamics, q = SymbolicDynamics(robot), symbolic_configuration(robot, places)
    nu = [each.symbol for each in speeds]
    measured = _measured(sheet, dynamics, q, [each.symbol for each in pose], places, nu)
    rolling = frozenset(sheet.definitions)
    settings = _settings(kinematic, period)
    law = kinematic.with_numbers({name: each.symbol for name, each in settings.items()})
    horizons = _horizons(robot, kinematic, places, period)
    state = row_symbols(robot, casadi.vertcat(*(each.symbol for each in reference)))
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
    symbols = [*(each.symbol for each in used), *(each.symbol for each in inputs)]
    names = [*sheet.definitions, *(symbol.name() for symbol in symbols)]
    _require_symbols(kinematic, [each.symbol.name() for each in settings.values()], names)
    results = found.nu_d, found.nu_d_dot, star, tau
    return LawSheet(robot, sheet, used, inputs, rolling, *results, period)


def law_program(law: LawSheet) -> LawProgram:
    """Return the steps of a law."""
    steps, robot, definitions = Steps(), law.robot, law.sheet.definitions
    rates = {"nu_d": casadi.vertcat(*law.nu_d), "nu_d_dot": casadi.vertcat(*law.nu_d_dot)}
    results = {"tau": law.tau, **rates}
    *defined, tau, nu_d, nu_d_dot = law.sheet.resolved(
        [*(value for _, value in definitions.values()), *results.values()]
    )
    wanted = casadi.vertcat(tau, nu_d, nu_d_dot)
    read = {symbol.name() for symbol in casadi.symvar(wanted)}
    needed = {str(each.place) for each in law.inputs if each.symbol.name() in read}
    needed |= {swivel.joint for swivel in robot.drive.steered}
    positions = joints_of_code(robot, needed)
    leaves = [*law.inputs, *law.settings]
    symbols = casadi.vertcat(*(each.symbol for each in leaves))
    function = casadi.Function("law", [symbols], [casadi.vertcat(*defined, wanted)])
    nodes = steps.evaluate(function, [lambda i: steps.add("input", _leaf(leaves[i], positions))])
    count = len(defined)
    kept, moved = without_idle(steps.nodes, nodes[count:])
    named = dict(zip(reversed(nodes[:count]), reversed(definitions), strict=True))
    ends = iter(moved[node] for node in nodes[count:])
    return LawProgram(
        law,
        positions,
        tuple(kept),
        {moved[node]: name for node, name in named.items() if node in moved},
        {name: [*islice(ends, result.numel())] for name, result in results.items()},
    )


def _leaf(each: LawSymbol, positions: Sequence[str]) -> str:
    """Return what code calls a setting or an input."""
    if not isinstance(each.place, str):
        return str(each.symbol.name())
    return f"q[{positions.index(each.place)}]" if each.place in positions else each.place


def _rates(robot: Robot, places: dict[str, Any]) -> list[LawSymbol]:
    """Name the quasi-velocities."""
    names, base = robot.quasi_velocities, len(robot.drive.base_speeds)
    labels = [
        name if i < base and name in BASE_UNITS else f"{places[name].name()}_dot"
        for i, name in enumerate(names)
    ]
    units = [BASE_UNITS.get(x, "m/s" if x.startswith("eta") else "rad/s") for x in labels]
    return [
        LawSymbol(casadi.SX.sym(label), f"nu[{i}]", unit, f"quasi-velocity {name}")
        for i, (name, label, unit) in enumerate(zip(names, labels, units, strict=True))
    ]


def _reference(robot: Robot, places: dict[str, Any]) -> list[LawSymbol]:
    """Name the reference, in the order of a row of a reference table."""
    names, n = robot.joint_names, len(robot.joints)
    labels = [places[name].name() for name in names]
    units = ["m" if joint.kind == "prismatic" else "rad" for joint in robot.joints]
    rows: Sequence[tuple[str, Sequence[str], Sequence[str], Sequence[str]]] = [
        ("pose", ("x_r", "y_r", "theta_r"), POSE_UNITS,
         [f"{name} of P on the reference" for name in ("x", "y", "theta")]),
        ("twist", ("v_r", "vl_r", "omega_r"), TWIST_UNITS,
         [f"{word} of the reference" for word in TWIST_WORDS]),
        ("twist_dot", ("v_r_dot", "vl_r_dot", "omega_r_dot"), [f"{u}^2" for u in TWIST_UNITS],
         ["its derivative"] * BASE_NV),
        ("joints", [f"{x}_r" for x in labels], units, [f"reference of {name}" for name in names]),
        ("joint_rates", [f"{x}_r_dot" for x in labels], [f"{u}/s" for u in units],
         ["its rate"] * n),
        ("joint_accelerations", [f"{x}_r_ddot" for x in labels], [f"{u}/s^2" for u in units],
         ["its acceleration"] * n),
    ] + [
        (f"direction[{k}]", [f"{letter}_{x}" for x in ("v", "l", "omega")], [""] * BASE_NV,
         [word] * BASE_NV)
        for k, (letter, word) in enumerate(DIRECTIONS.items())
    ]  # fmt: skip
    return [
        LawSymbol(casadi.SX.sym(name), f"r->{field}[{i}]", unit, of)
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
    at_joints, at_swivels = ([places[name] for name in names] for names in (joints, steered))
    turning_rates = nu[1 : 1 + len(steered)]
    twist = product(rows, nu[:count])
    return Measured(pose, twist, at_joints, rates, at_swivels, turning_rates, rolling)


def _rows(point: Any, S: Any, count: int) -> list[list[Any]]:
    """Return the rows of P's twist by the first columns of what gives the root link's."""
    found = casadi.densify(casadi.DM(point) @ S[:BASE_NV, :count])
    return [casadi.horzsplit(row) for row in casadi.vertsplit(found)]


def _named(sheet: Sheet, mark: str, values: Sequence[Any]) -> list[Any]:
    return [sheet.named(f"{mark}{i}", value) for i, value in enumerate(values, start=1)]


def _settings(law: BaseLaw, period: float) -> dict[str, LawSymbol]:
    """Return the numbers among a law's settings, by name, at a control period (s)."""
    found, known = {}, settings_of(law)
    for name, value in law.numbers(period).items():
        setting = known[name].setting
        symbol, of = SETTINGS.get(name, (name, setting.label or f"setting {name}"))
        found[name] = LawSymbol(casadi.SX.sym(symbol), value, setting.unit.replace("²", "^2"), of)
    return found


def _require_symbols(law: BaseLaw, settings: Sequence[str], names: Sequence[str]) -> None:
    """Refuse settings of a user's own law that code cannot call so, or that something is called.

    Raises:
        RpctlError: There is one.
    """
    for name in settings:
        if not SYMBOL.fullmatch(name) or name in (*ARGUMENTS, *FUNCTIONS) or names.count(name) > 1:
            raise RpctlError(
                f"{type(law).__name__}: formulas and code have no symbol {name!r} left for its "
                "setting; rename it"
            )


def _horizons(robot: Robot, law: BaseLaw, places: dict[str, Any], period: float) -> list[LawSymbol]:
    """Name the prediction times of the arm's joints."""
    times = law.joint_horizons(ReducedDynamics(robot), period)
    return [
        LawSymbol(casadi.SX.sym(f"h_{places[name].name()}"), float(time), "s",
                   f"prediction time of {printable(name)}")
        for name, time in zip(robot.joint_names, times, strict=True)
    ]  # fmt: skip


def _dynamic_horizons(robot: Robot, law: PaperDynamic) -> list[LawSymbol]:
    """Name the prediction times of the dynamic law (dof,)."""
    words, joints = "prediction time of the dynamic law", len(robot.joints)
    base = arm = LawSymbol(casadi.SX.sym("h1"), law.horizon_dyn, "s", words)
    if (own := law.joint_horizon_dyn) is not None:
        arm = LawSymbol(casadi.SX.sym("h1_arm"), own, "s", "the same, of the arm")
    return [base] * (robot.dof - joints) + [arm] * joints
