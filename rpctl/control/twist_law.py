"""Base class of the kinematic laws: the twist of the base, and the arm beside it."""

from __future__ import annotations

import math as numbers
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.approach import Approach
from rpctl.control.dynamic import USUAL_PERIOD, joint_gains
from rpctl.control.error import (
    BASE_ERRORS,
    Leash,
    Tracking,
    base_error,
    base_error_rate,
    joint_errors,
    omnidirectional_twist,
)
from rpctl.control.law import Command, KinematicController, ReportsNothing, Rest
from rpctl.control.steering import Measured, base_command, reference_direction
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import UnfitLawError
from rpctl.files.records import POSITIVE, Record, Setting
from rpctl.kernels.sheet import Evaluator, Sheet
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.model import BASE_NV, Robot

NUMBERS = (int, float, np.float64)  # types of settings that formulas take for scalars


@dataclass(frozen=True)
class BaseLaw(Record, ABC):
    """A kinematic law that is defined by its twist for a base that cannot move sideways.

    An omnidirectional base gets :func:`~rpctl.control.error.omnidirectional_twist`, whatever the
    law: its three errors need no trade. The arm's errors, predicted to first order over a horizon h
    of each joint's own, vanish: q̇_d = q̇_r + (q_r − q)/h ([MS21, Eq. 20]).

    :meth:`unicycle` is a formula over scalars, with the functions of :mod:`rpctl.math`. All else
    is made of it: ν̇_d along the actual motion, what a loop in Python calls, machine code, and
    what ``derive --law`` writes.
    """

    refusal: ClassVar[str] = ""  # what is said where it :meth:`refuses` a reference

    horizon: Annotated[
        float,
        POSITIVE,
        Setting("s", "Horizon h", "Prediction time of the arm and of an omnidirectional base."),
    ]
    joint_horizon: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Joints' horizon h",
            "Prediction time of the arm's joints; of each what its bandwidth allows if not given.",
        ),
    ] = field(default=None, kw_only=True)
    leash: Annotated[
        Leash | None,
        Setting("", "Leash", "Bounds the base's error before the law; false: as it was published."),
    ] = field(default=None, kw_only=True)
    approach: Annotated[
        Approach | None,
        Setting(
            "",
            "Approach from",
            "Stage for large errors of a base that cannot turn on the spot; false: none.",
        ),
    ] = field(default=None, kw_only=True)

    def start(
        self, dynamics: ReducedDynamics, period: float, rest: Rest | None = None
    ) -> KinematicController:
        """Return the controller of one run, with its stage for far starts before it.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s: the joints' prediction times depend on it.
            rest: Not used.
        """
        controller = BaseController(self, dynamics, self.joint_horizons(dynamics, period))
        return controller if self.approach is None else self.approach.start(dynamics, controller)

    def joint_horizons(self, dynamics: ReducedDynamics, period: float) -> Array:
        """Return the prediction times of the arm's joints (n_joints,), s.

        Args:
            dynamics: The robot's dynamics, as far as the controller knows them.
            period: Control period, s.
        """
        if self.joint_horizon is None:
            return joint_gains(dynamics, period).horizon
        return np.full(len(dynamics.robot.joints), self.joint_horizon)

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the command of a controller with the usual control period, 2 ms, near or far.

        Args:
            dynamics: The robot's dynamics.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """
        horizons = self.joint_horizons(dynamics, USUAL_PERIOD)
        controller = BaseController(self, dynamics, horizons)
        return controller(dynamics, reference, t, q, nu)

    def numbers(self) -> dict[str, float]:
        """Return the numbers among the settings by name, but for the joints' prediction time."""
        found = _numbers(self)
        if self.leash is not None:
            found |= {f"leash.{name}": value for name, value in _numbers(self.leash).items()}
        return found

    def with_numbers(self, scalars: Mapping[str, Any]) -> BaseLaw:
        """Return the law with scalars for what :meth:`numbers` names."""
        found, leash = copy(self), copy(self.leash)
        object.__setattr__(found, "leash", leash)
        for name, scalar in scalars.items():
            owner, _, inner = name.rpartition(".")
            if owner in ("", "leash"):
                object.__setattr__(leash if owner else found, inner, scalar)
        return found

    def refuses(self, at: Tracking) -> Any:
        """Return whether the law cannot follow the reference at a time, a scalar."""
        return 0.0

    @abstractmethod
    def unicycle(self, at: Tracking) -> tuple[Any, Any]:
        """Return the speed (m/s) and the turning rate (rad/s) of a base that cannot move sideways.

        Args:
            at: The reference and the error, in scalars.
        """


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
    error = _base_errors(sheet, robot, state, measured)
    joints = _joint_errors(sheet, robot, state, measured)
    nu_d, nu_d_dot, refused = list[Any](), list[Any](), math.SX(0)
    if drive.base_speeds:
        direction = reference_direction(sheet, state)
        leashed = error if law.leash is None else law.leash(sheet, error)
        at = Tracking(
            sheet, state.twist, state.twist_dot, direction, error, leashed, measured.twist
        )
        if drive.omnidirectional:
            twist = omnidirectional_twist(at, law.horizon)
        else:
            refused = math.SX(law.refuses(at))
            speed, turn = law.unicycle(at)
            twist = [speed, math.SX(0), turn]
        nu_d, nu_d_dot = base_command(sheet, robot, at, twist, measured, law.horizon)
    arm = zip(joints, state.joint_rates, horizons, strict=True)
    for i, (each, rate, h) in enumerate(arm, start=BASE_ERRORS + 1):
        nu_d.append(sheet.named(f"u{i}", rate + each / h))
        nu_d_dot.append(sheet.rate(nu_d[-1]))
    return Desired([*error, *joints], nu_d, nu_d_dot, refused)


def _base_errors(
    sheet: Sheet, robot: Robot, state: ReferenceState, measured: Measured
) -> list[Any]:
    """Write the base's error, and how it changes."""
    (px, py), (x, y, theta) = robot.drive.point, measured.pose
    cos, sin = math.cos(theta), math.sin(theta)
    pose = [
        sheet.named("x_P", x + cos * px - sin * py),
        sheet.named("y_P", y + sin * px + cos * py),
        sheet.named("theta_P", theta + robot.drive.heading),
    ]
    values = base_error(state.pose, pose)
    error = [sheet.symbol(f"x{i}", each) for i, each in enumerate(values, start=1)]
    rates = base_error_rate(error, state.twist, measured.twist)
    for each, rate in zip(error, rates, strict=True):
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


def reference_sizes(robot: Robot) -> list[int]:
    """Return how many numbers a row of a reference table has of each of its arrays."""
    return [BASE_NV] * 3 + [len(robot.joints)] * 3 + [BASE_NV] * 3


def reference_symbols(robot: Robot, row: Any) -> ReferenceState:
    """Return the scalars of a row (n, 1) of a reference table."""
    ends = np.cumsum([0, *reference_sizes(robot)]).tolist()
    parts: list[Any] = [math.vertsplit(part) for part in math.vertsplit(row, ends)]
    state = ReferenceState(*parts[:6])
    return state._replace(direction=parts[6:])  # type: ignore[arg-type]


class BaseController(ReportsNothing):
    """A :class:`BaseLaw` on one robot at one control period.

    Args:
        law: The law.
        dynamics: The robot's dynamics.
        joint_horizons: Prediction times of the arm's joints (n_joints,), s.
    """

    def __init__(self, law: BaseLaw, dynamics: ReducedDynamics, joint_horizons: Array) -> None:
        self._refusal = law.refusal
        self._evaluate = _evaluator(law, dynamics, tuple(joint_horizons.tolist()))

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return ν_d and its analytic derivative along the actual motion.

        Raises:
            UnfitLawError: The law cannot follow the reference.
        """
        state = reference(t)
        direction = np.zeros(9) if state.direction is None else np.ravel(state.direction)
        row = np.concatenate([*state[:6], direction])
        nu_d, nu_d_dot, (refused,) = self._evaluate(row, measure(dynamics, q, nu))
        if refused:
            raise UnfitLawError(self._refusal)
        return Command(nu_d, nu_d_dot)


@lru_cache(maxsize=16)
def _evaluator(law: BaseLaw, dynamics: ReducedDynamics, horizons: tuple[float, ...]) -> Evaluator:
    return Evaluator(formula(law, dynamics.robot, horizons))


def formula(law: BaseLaw, robot: Robot, horizons: Sequence[Any], **options: object) -> Any:
    """Return a law on a robot as a function of a reference's row and of what is measured.

    Its outputs are ν_d, ν̇_d and whether the law refuses the reference.

    Args:
        law: The law.
        robot: The robot.
        horizons: Prediction times of the arm's joints (n_joints,), s.
        options: Of the ``casadi.Function``.
    """
    sheet, row = Sheet(), math.SX.sym("row", sum(reference_sizes(robot)))
    column = math.SX.sym("measured", sum(Measured.sizes(robot)))
    state, measured = reference_symbols(robot, row), Measured.of(robot, column)
    _, *found, refused = desired(sheet, law, robot, state, measured, horizons)
    values = [math.vertcat(*part, math.SX(0, 1)) for part in found]
    return math.Function("law", [row, column], sheet.resolved([*values, refused]), options)


def measure(dynamics: ReducedDynamics, q: Array, nu: Array) -> Array:
    """Return the entries of :class:`Measured` at one state, side by side."""
    robot = dynamics.robot
    pose = [q[0], q[1], numbers.atan2(q[3], q[2])]
    rates = nu[robot.dof - len(robot.joints) :]
    found: list[Any] = [pose, dynamics.twist(q, nu), robot.joint_positions(q), rates]
    steered = robot.drive.steered
    if steered:
        turning = nu[1 : 1 + len(steered)]
        found += [[robot.joint_position(q, swivel.joint) for swivel in steered], turning]
        found += rolling(dynamics, q, turning)
    return np.concatenate(found)


def rolling(dynamics: ReducedDynamics, q: Array, turning: Array) -> list[Array]:
    """Return the entries of :class:`Rolling`; none where an axle says how the base rolls."""
    robot, count = dynamics.robot, len(turning)
    if robot.drive.has_axle:
        return []
    at, unit = dynamics.at(q), np.eye(robot.dof)[0]
    nu = np.concatenate([[0.0], turning, np.zeros(robot.dof - 1 - count)])
    point = robot.point_velocity
    drifts = [point @ at.drift(each)[:BASE_NV] for each in (nu, nu + unit)]
    return [np.ravel(point @ at.S[:BASE_NV, : 1 + count]), *drifts]
