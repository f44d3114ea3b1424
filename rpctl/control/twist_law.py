"""Base class of the kinematic laws: the twist of the base, and the arm beside it."""

from __future__ import annotations

import math as numbers
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.approach import Approach
from rpctl.control.bandwidth import USUAL_PERIOD, usual_gains
from rpctl.control.error import (
    BASE_ERRORS,
    Leash,
    Tracking,
    base_error,
    base_error_rate,
    joint_errors,
    omnidirectional_twist,
)
from rpctl.control.fragment import ANSWERED, NO_COMMAND, REFUSED, LawFrame, is_fine, structure
from rpctl.control.law import (
    Command,
    Goal,
    LeaningCommand,
    ReportsNothing,
    Rest,
    TrackingController,
)
from rpctl.control.law_kernel import CommandLaw, RunningLaws, running_laws
from rpctl.control.steering import (
    Measured,
    Rolling,
    base_command,
    leading,
    of_front,
    reference_direction,
)
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import RpctlError, UnfitLawError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.kernels.calls import interpreted
from rpctl.kernels.program import Call, statement
from rpctl.kernels.sheet import Sheet
from rpctl.reference.motion import (
    Reference,
    ReferenceState,
    require_state,
    row_of,
    row_sizes,
    row_symbols,
)
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import BASE_NV, Robot

NUMBERS = (int, float, np.float64)  # types of settings that formulas take for scalars


@dataclass(frozen=True)
class BaseLaw(Record, ABC):
    """Base class of kinematic laws that :meth:`unicycle` defines for a base that moves forward.

    An omnidirectional base gets :func:`~rpctl.control.error.omnidirectional_twist` with every law,
    because its three inputs can correct its three errors. The errors of the arm's joints, predicted
    to first order over the horizon h of each joint, vanish: q̇_d = q̇_r + (q_r − q)/h
    ([MS21, Eq. 20]).

    :meth:`unicycle` is a formula over scalars, with the functions of :mod:`rpctl.math`. Everything
    else follows from it: ν̇_d along the actual motion, the law in Python, its machine code, and the
    text that ``derive --law`` writes.
    """

    refusal: ClassVar[str] = ""  # the message if the law :meth:`refuses` a reference

    horizon: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Horizon h",
            "Prediction time of an omnidirectional base and of steering; default: what period "
            "and delay allow.",
        ),
    ] = None
    joint_horizon: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Joints' horizon h",
            "Prediction time of the arm's joints; default: what period and delay allow.",
        ),
    ] = field(default=None, kw_only=True)
    leash: Annotated[
        Leash | None,
        Setting(
            "",
            "Leash",
            "Leash: bounds the base's error before it enters the law; false: none, as published.",
        ),
    ] = field(default=None, kw_only=True)
    approach: Annotated[
        Approach | None,
        Setting(
            "",
            "Approach from",
            "Approach path for large errors of a base that cannot turn on the spot; false: none.",
        ),
    ] = field(default=None, kw_only=True)

    def start(
        self,
        dynamics: ReducedDynamics,
        period: float,
        rest: Rest | None = None,
        *,
        running: RunningLaws | None = None,
    ) -> TrackingController:
        """Return the controller of one run, with its approach for large errors.

        Args:
            dynamics: The dynamics of the controller's model.
            period: Control period, s; the default prediction times depend on it.
            rest: Not used.
            running: The kernel of both laws, if it exists already.
        """
        if isinstance(dynamics.robot, LeaningRobot):
            return LeaningWish(self, dynamics.robot)
        running = running or running_laws(self, None, dynamics, period, None)
        controller = CommandLaw(running, self.refusal, dynamics.robot)
        return controller if self.approach is None else self.approach.start(dynamics, controller)

    def joint_horizons(self, dynamics: ReducedDynamics, period: float) -> Array:
        """Return the prediction times of the arm's joints (n_joints,), s.

        Args:
            dynamics: The dynamics of the controller's model.
            period: Control period, s.
        """
        h = self.joint_horizon or usual_gains(period).horizon
        return np.full(len(dynamics.robot.joints), h)

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the command at a control period of 2 ms, without the approach.

        Args:
            dynamics: The robot's dynamics.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """
        law = replace(self, approach=None).start(dynamics, USUAL_PERIOD)
        return law(dynamics, reference, t, q, nu)

    def numbers(self, period: float = USUAL_PERIOD) -> dict[str, float]:
        """Return the numeric settings by name, except the joints' prediction times.

        Args:
            period: Control period, s.
        """
        found = {"horizon": usual_gains(period).horizon, **_numbers(self)}
        if self.leash is not None:
            found |= {f"leash.{name}": value for name, value in _numbers(self.leash).items()}
        return found

    def numbers_on(self, known: ReducedDynamics, period: float) -> dict[str, Any]:
        """Return the numeric settings on one robot, by name: floats, or arrays (n_joints,).

        Args:
            known: The dynamics of the controller's model.
            period: Control period, s.
        """
        return {**self.numbers(period), "joint_horizons": self.joint_horizons(known, period)}

    def structure(self, robot: Robot) -> object:
        """Return a value that identifies the law's machine code on a robot, numbers left out."""
        if type(self).__module__.startswith("rpctl."):
            return structure(self)
        symbols = {name: math.SX.sym(name) for name in self.numbers()}
        horizons = math.vertsplit(math.SX.sym("horizons", len(robot.joints)))
        found = formula(self.with_numbers(symbols), robot, horizons, allow_free=True)
        return structure(self), str(found.serialize())

    def command(self, frame: LawFrame) -> Call:
        """Return the call of a kernel that computes the command of a sample.

        Args:
            frame: The kernel's inputs and outputs.
        """
        (_, q), (_, nu), sheet, known = frame.q, frame.nu, Sheet(), frame.known
        s, state = dict(frame.asked), row_symbols(known.robot, frame.reference[1])
        horizons = math.vertsplit(s.pop("joint_horizons"))
        at = measured(known, q, nu)
        found = desired(sheet, self.with_numbers(s), known.robot, state, at, horizons)
        parts = [math.vertcat(*part, math.SX(0, 1)) for part in found[:3]]
        e, nu_d, nu_d_dot, refused = sheet.resolved([*parts, found.refused])
        failed = math.if_else(is_fine(known, q, nu_d, nu_d_dot), ANSWERED, NO_COMMAND)
        failed = math.if_else(refused, REFUSED, failed)
        outputs = [frame.e[0], frame.nu_d[0], frame.nu_d_dot[0], frame.failed[0]]
        values = zip(outputs, (e, nu_d, nu_d_dot, failed), strict=True)
        inputs = [frame.q, frame.nu, frame.reference, frame.settings]
        return statement("law_command", inputs, list(values))

    def with_numbers(self, scalars: Mapping[str, Any]) -> BaseLaw:
        """Return the law with scalars in the place of its numeric settings.

        Args:
            scalars: By the names of :meth:`numbers`.
        """
        found, leash = copy(self), copy(self.leash)
        object.__setattr__(found, "leash", leash)
        for name, scalar in scalars.items():
            owner, _, inner = name.rpartition(".")
            if owner in ("", "leash"):
                object.__setattr__(leash if owner else found, inner, scalar)
        return found

    def refuses(self, at: Tracking) -> Any:
        """Return whether the law cannot follow the reference, a scalar; 0 is false.

        Args:
            at: The reference and the error, in scalars.
        """
        return 0.0

    @abstractmethod
    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the desired speed (m/s) of P and turning rate (rad/s), two scalars.

        Args:
            at: The reference and the error, in scalars.
        """


class LeaningWish(ReportsNothing):
    """A kinematic law on a robot that leans: its leash bounds the errors that are to be mended.

    How is not its own: a robot that leans has to lean first, so speed and turning rate are chosen
    with tilt and posture, by the dynamic law.

    Args:
        law: The law.
        robot: The robot.
    """

    def __init__(self, law: BaseLaw, robot: LeaningRobot) -> None:
        error, sheet = math.SX.sym("e", BASE_ERRORS), Sheet()
        if law.leash is None:
            seen = math.vertsplit(error)
        else:
            seen = sheet.resolved(law.leash(sheet, math.vertsplit(error)))
        ahead, aside, turned = seen
        kept = math.vertcat(ahead, math.sinc(error[2]) * aside, turned)
        leash = math.Function("leash", [error], [kept])
        self._robot, self._leash = robot, interpreted(leash)

    def row(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Array:
        """Return the row of what is tracked at a time (s), of its table."""
        return row_of(reference(t))

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the command: the reference's own quasi-velocities, with the errors beside it.

        Facing away, a robot that turns on the spot neither goes on nor heeds how far it is to the
        side: x2 sin x3/x3 is all that leads it towards its reference.

        Args:
            dynamics: The robot's dynamics.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """
        robot, state = self._robot, require_state(self._robot, reference(t), t)
        whole = base_error(state.pose, robot.base_pose(q))
        error = self._leash(whole)[0].copy()
        nu_d, nu_d_dot = np.zeros(robot.dof), np.zeros(robot.dof)
        for into, base, arm in (
            (nu_d, state.twist, state.joint_rates),
            (nu_d_dot, state.twist_dot, state.joint_accelerations),
        ):
            into[0], into[robot.dof - len(arm) :] = base[0], arm
            if "omega" in robot.quasi_velocities:
                into[1] = base[2]
        if not robot.rolls_sideways:
            nu_d[0] *= np.cos(whole[2])
        return LeaningCommand(nu_d, nu_d_dot, Goal(reference, t, state, error))


def _numbers(record: BaseLaw | Leash) -> dict[str, float]:
    names = (item.name for item in fields(record) if item.name != "joint_horizon")
    values = {name: getattr(record, name) for name in names}
    kinds = {name: type(value) for name, value in values.items()}
    return {name: float(values[name]) for name, kind in kinds.items() if kind in NUMBERS}


class Desired(NamedTuple):
    """What a kinematic law makes of a sample, in scalars."""

    e: list[Any]  # (3 + n_joints,) the tracking error
    nu_d: list[Any]  # (dof,)
    nu_d_dot: list[Any]  # (dof,) along the actual motion
    refused: Any  # whether the law cannot follow the reference


def desired(
    sheet: Sheet,
    law: BaseLaw,
    robot: Robot,
    state: ReferenceState,
    measured: Measured,
    horizons: Sequence[Any],
) -> Desired:
    """Write a law on a robot.

    Args:
        sheet: Where to write.
        law: The law; its settings are numbers or scalars.
        robot: The robot.
        state: The reference, in symbols.
        measured: The robot's state, in scalars.
        horizons: Prediction times of the arm's joints (n_joints,), s.
    """
    drive = robot.drive
    for symbols, rates in (state[1:3], state[4:6]):
        for symbol, rate in zip(symbols, rates, strict=True):
            sheet.moves(symbol, rate)
    pose = _base_pose(sheet, robot, measured)
    error = _base_errors(sheet, state, measured, pose)
    joints = _joint_errors(sheet, robot, state, measured)
    nu_d, nu_d_dot, refused = list[Any](), list[Any](), math.SX(0)
    if drive.base_speeds:
        direction = reference_direction(sheet, state)
        at = Tracking(sheet, state.twist, state.twist_dot, direction, error, error, measured.twist)
        articulated = drive.type == "articulated"
        seen = leading(sheet, robot, at, pose, state, measured) if articulated else at
        if law.leash is not None:
            seen = seen._replace(e=law.leash(sheet, seen.error))
        if drive.omnidirectional:
            twist = omnidirectional_twist(seen, law.horizon)
        else:
            refused = math.SX(law.refuses(seen))
            speed, turn = _asked(law, seen)
            if articulated:
                speed, turn = of_front(sheet, robot, at, speed, turn, measured)
            twist = [speed, math.SX(0), turn]
        nu_d, nu_d_dot = base_command(sheet, robot, at, twist, measured, law.horizon)
    arm = zip(joints, state.joint_rates, horizons, strict=True)
    for i, (each, rate, h) in enumerate(arm, start=BASE_ERRORS + 1):
        nu_d.append(sheet.named(f"u{i}", rate + each / h))
        nu_d_dot.append(sheet.rate(nu_d[-1]))
    return Desired([*error, *joints], nu_d, nu_d_dot, refused)


def _asked(law: BaseLaw, at: Tracking) -> tuple[Any, Any]:
    """Return what a law asks of a base; one of a user's own may not be a formula.

    Raises:
        UnfitLawError: It is none.
    """
    try:
        speed, turn = map(math.SX, law.unicycle(at))
        column = math.vertcat(speed, turn)
        f = math.Function("asked", [math.vertcat(*math.symvar(column))], [column])
        places = (k for k in range(f.n_instructions()) if f.instruction_id(k) == math.OP_CONST)
        none = any(numbers.isnan(f.instruction_constant(k)) for k in places)
        fault = "it gives NaN, as functions of Python's math do with symbols" if none else ""
    except RpctlError:
        raise
    except Exception as error:
        first, *_ = str(error).splitlines() or [""]
        fault = f"{type(error).__name__}: {first}".rstrip(".")
    if fault:
        raise UnfitLawError(
            f"unicycle() of {type(law).__name__} is not a formula: {fault}. Write it with "
            "rpctl.math (math.cos; math.if_else for if), and return the speed and the turning "
            "rate"
        )
    return speed, turn


def _base_pose(sheet: Sheet, robot: Robot, measured: Measured) -> list[Any]:
    """Write the pose (3,) of P."""
    (px, py), (x, y, theta) = robot.drive.point, measured.pose
    cos, sin = math.cos(theta), math.sin(theta)
    return [
        sheet.named("x_P", x + cos * px - sin * py),
        sheet.named("y_P", y + sin * px + cos * py),
        sheet.named("theta_P", theta + robot.drive.heading),
    ]


def _base_errors(
    sheet: Sheet, state: ReferenceState, measured: Measured, pose: Sequence[Any]
) -> list[Any]:
    """Write the base's error, and how it changes."""
    values = base_error(state.pose, pose)
    error = [sheet.symbol(f"x{i}", each) for i, each in enumerate(values, start=1)]
    for each, rate in zip(error, base_error_rate(error, state.twist, measured.twist), strict=True):
        sheet.moves(each, sheet.named(f"{each.name()}_dot", rate))
    return error


def _joint_errors(
    sheet: Sheet, robot: Robot, state: ReferenceState, measured: Measured
) -> list[Any]:
    """Write the errors of the arm's joints, and how they change."""
    values = joint_errors(robot, state.joints, measured.joints)
    found = []
    for i, (value, *rates) in enumerate(
        zip(values, state.joint_rates, measured.joint_rates, strict=True), start=BASE_ERRORS + 1
    ):
        found.append(sheet.symbol(f"x{i}", value))
        sheet.moves(found[-1], rates[0] - rates[1])
    return found


def formula(law: BaseLaw, robot: Robot, horizons: Sequence[Any], **options: object) -> Any:
    """Return a law on a robot as a function of a reference's row and of what is measured.

    Its outputs are ν_d, ν̇_d and whether the law refuses the reference.

    Args:
        law: The law.
        robot: The robot.
        horizons: Prediction times of the arm's joints (n_joints,), s.
        options: Of the ``casadi.Function``.
    """
    sheet, row = Sheet(), math.SX.sym("row", sum(row_sizes(robot)))
    column = math.SX.sym("measured", sum(Measured.sizes(robot)))
    state, measured = row_symbols(robot, row), Measured.of(robot, column)
    _, *found, refused = desired(sheet, law, robot, state, measured, horizons)
    values = [math.vertcat(*part, math.SX(0, 1)) for part in found]
    return math.Function("law", [row, column], sheet.resolved([*values, refused]), options)


def symbolic_error(dynamics: SymbolicDynamics, row: Any, q: Any) -> Any:
    """Return the tracking error (3 + n_joints, 1), as ``tracking_error``.

    Args:
        dynamics: The robot's dynamics.
        row: Row of a reference table.
        q: Configuration (nq, 1).
    """
    robot = dynamics.robot
    state = row_symbols(robot, row)
    base = base_error(state.pose, math.vertsplit(dynamics.base_pose(q)))
    positions = [dynamics.position(q, name) for name in robot.joint_names]
    return math.vertcat(*base, *joint_errors(robot, state.joints, positions))


def measured(dynamics: SymbolicDynamics, q: Any, nu: Any) -> Measured:
    """Return what laws read of a state, q (nq, 1) and ν (dof, 1)."""
    robot = dynamics.robot
    pose = q[0], q[1], math.atan2(q[3], q[2])
    joints = [dynamics.position(q, name) for name in robot.joint_names]
    rates = math.vertsplit(nu)[robot.dof - len(joints) :]
    found = Measured(pose, math.vertsplit(dynamics.twist(q, nu)), joints, rates)
    steered = robot.drive.steered
    if not steered:
        return found
    found = found._replace(
        steered=[dynamics.position(q, swivel.joint) for swivel in steered],
        steering_rates=math.vertsplit(nu)[1 : 1 + len(steered)],
    )
    if robot.drive.has_axle:
        return found
    return found._replace(rolling=_rolling(dynamics, q, nu))


def _rolling(dynamics: SymbolicDynamics, q: Any, nu: Any) -> Rolling:
    robot, count = dynamics.robot, len(dynamics.robot.drive.base_speeds)
    point, at = math.DM(robot.point_velocity), dynamics.at(q)
    turning, unit = math.SX.zeros(robot.dof, 1), math.SX.eye(robot.dof)[:, 0]
    turning[1:count] = nu[1:count]
    rows = math.densify(point @ at.S[:BASE_NV, :count])
    drifts = [point @ at.drift(each)[:BASE_NV] for each in (turning, turning + unit)]
    drift, unit_drift = (math.vertsplit(math.densify(each)) for each in drifts)
    split = [math.horzsplit(row) for row in math.vertsplit(rows)]
    return Rolling(split, drift, unit_drift)
