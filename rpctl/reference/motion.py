"""``Reference``: where base and arm should be at a time or at many, and what that takes."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple, TypeGuard

import numpy as np
import pinocchio as pin

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.drive.rows import angle_of, rolling_row
from rpctl.drive.steering import follower_positions, steer, trailing_positions
from rpctl.errors import RpctlError
from rpctl.reference.formula import Columns, Numbers, Reader
from rpctl.robot.leaning import LeaningRobot
from rpctl.robot.model import BASE_NV, Robot

MAX_SHOWN_CHARACTERS = 80  # of a value in a message


class ReferenceState(NamedTuple):
    """A reference at one time: base and arm, each with first and second derivatives.

    Attributes:
        pose: Pose of P (3,) in the world: x and y (m), heading (rad).
        twist: Speed of P forward and to the left (m/s) and turning rate (rad/s) (3,), in the
            reference's own axes.
        twist_dot: Derivatives of these three numbers (3,), m/s² and rad/s².
        joints: Positions of the arm (n_joints,), rad or m, in the order of ``robot.joint_names``.
        joint_rates: Their rates (n_joints,), rad/s or m/s.
        joint_accelerations: Their accelerations (n_joints,), rad/s² or m/s².
        direction: A vector along the twist that does not vanish if the reference stands still, and
            its first two derivatives by time, in the rows of (3, 3): steered wheels point along it.
            None: the twist serves.
    """

    pose: Array
    twist: Array
    twist_dot: Array
    joints: Array
    joint_rates: Array
    joint_accelerations: Array
    direction: Array | None = None


Reference = Callable[[float], ReferenceState]


def row_of(state: ReferenceState) -> Array:
    """Return a state as one row (9 + 3 n_joints + 9,), in the order of its parts.

    Where it has no direction, its twist, the twist's derivative and zeros stand for it.
    """
    *parts, toward = state
    instead = state.twist, state.twist_dot, np.zeros(3)
    return np.concatenate([*parts, *(instead if toward is None else toward)], dtype=float)


def state_of(row: Array) -> ReferenceState:
    """Return the state of a row, or that of rows (K, width): its arrays have a row each, then."""
    n = row.shape[-1] // 3 - 6
    ends = [0, 3, 6, 9, 9 + n, 9 + 2 * n, 9 + 3 * n]
    parts = [row[..., first:last] for first, last in pairwise(ends)]
    toward = row[..., ends[-1] :]
    return ReferenceState(*[*parts, toward.reshape(*toward.shape[:-1], 3, 3)])


class RowReference:
    """A reference that tells the rows of its table; what it returns is cut from them.

    Attributes:
        row: Returns its row (width,) at a time (s), or a row for each of the times (K,).
    """

    row: Callable[[Numbers], Array]

    def __call__(self, t: Numbers) -> ReferenceState:
        """Return the reference at time ``t`` (s), or at times (K,), a row each."""
        return state_of(self.row(t))

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the formulas, which each process makes for itself."""
        return {name: value for name, value in vars(self).items() if not isinstance(value, Columns)}


def end_effector_reference(robot: Robot, data: pin.Data, state: ReferenceState) -> pin.SE3:
    """Return the end effector's pose in the world where base and arm are on their reference.

    Raises:
        RpctlError: The robot has no end effector.
    """
    return robot.end_effector_pose(data, robot.configuration_at(state.pose, state.joints))


PUSHED = 0.2  # of a hitch's speed, backwards: its trailer is pushed, not swung aside
SLOW_M_S = 0.01  # a hitch that is slower is left to find its way
MOMENTS = 200  # of a reference at which that is looked for


def require_pulling(robot: Robot, reference: Reference, duration: float = 20.0) -> None:
    """Refuse a reference that pushes a trailer: its hitch would fold, and no law holds it.

    Args:
        duration: How much of the reference counts, s.

    Raises:
        RpctlError: When it does so first, and how fast.
    """
    hitches = [swivel for swivel in robot.drive.trailers if swivel.parent is None]
    for t in np.linspace(0.0, duration, MOMENTS) if hitches else ():
        ahead, left, turn = (robot.root_velocity @ reference(float(t)).twist).tolist()
        for swivel in hitches:
            x, y = swivel.pivot
            V = complex(ahead - turn * y, left + turn * x)
            speed = (V * cmath.exp(-1j * swivel.heading)).real * math.copysign(1.0, swivel.trail)
            if speed > max(SLOW_M_S, PUSHED * abs(V)):
                raise RpctlError(
                    f'the reference pushes the trailer behind "{swivel.joint}" backwards, at '
                    f"{speed:.2g} m/s after {t:.3g} s: its hitch would fold, and no law of rpctl "
                    "prevents it; take a reference that drives forward, or hold the hitch with "
                    f"--lock {swivel.joint}"
                )


class WrongAnswerError(RpctlError):
    """What a reference or a law returned has not the form that it should have."""


class NotFiniteError(RpctlError):
    """What a reference or a law returned has the right form, and numbers that are not finite."""


def require_state(robot: Robot, state: object, t: float) -> ReferenceState:
    """Return what a reference returned, if it is a ``ReferenceState`` that fits the robot.

    Raises:
        WrongAnswerError: It is something else; what to return is said.
    """
    if not isinstance(state, ReferenceState):
        raise WrongAnswerError(
            f"the reference returns {shown(state)} at t = {t:g} s; return a rpctl.ReferenceState, "
            "or let rpctl.as_reference(function) make one of x, y, heading and joints"
        )
    if np.ndim(state.joints) == 1 and len(state.joints) != len(robot.joints):
        raise WrongAnswerError(
            f"the reference has {len(state.joints)} joints, {robot.name} has {len(robot.joints)} "
            f"({', '.join(robot.joint_names)}); let the function return their positions after the "
            "heading, or tell rpctl.as_reference by joints= where they stay"
        )
    for index, name in enumerate(ReferenceState._fields[:6]):
        length = 3 if index < 3 else len(robot.joints)
        require_numbers(name, " of the reference", state[index], length)
    return state


def require_reference(given: object) -> None:
    """Refuse what is no function of time.

    Raises:
        RpctlError: It is something else; what to give is said.
    """
    if isinstance(given, type) or not callable(given):
        raise RpctlError(
            f"the reference is {shown(given)}; give a name, a file (.csv of rows t,x,y,theta, or "
            ".toml), or a function of the time that rpctl.as_reference makes of one that returns "
            "x, y and heading, or x and y with along_path=True"
        )


def require_numbers(name: str, whose: str, values: Any, length: int) -> None:
    """Refuse what is no array of this many finite numbers.

    Args:
        whose: Whose it is, in words that follow the name.
        length: How many numbers it has to hold.

    Raises:
        NotFiniteError: A number is not finite.
        WrongAnswerError: It is something else; what to give is said.
    """
    if not isinstance(values, np.ndarray):
        raise WrongAnswerError(
            f"{name}{whose} is {shown(values)}; give an array of {length} numbers"
        )
    if values.shape != (length,) or values.dtype.kind not in "fiu":
        raise WrongAnswerError(
            f"{name}{whose} is an array {values.shape} of {values.dtype}; "
            f"give {length} real numbers"
        )
    if not math.isfinite(values @ values):  # of so few numbers the fastest
        raise NotFiniteError(f"{name}{whose} is {shown(values)}; give finite numbers")


def shown(value: object) -> str:
    """Return a value and its type, in a few characters."""
    text = repr(value)
    if len(text) > MAX_SHOWN_CHARACTERS:
        text = f"{text[:MAX_SHOWN_CHARACTERS]}..."
    return f"{text} ({type(value).__name__})"


class ReferenceRates(NamedTuple):
    """Quasi-velocities and their derivatives."""

    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)


def reference_rates(robot: Robot, state: ReferenceState) -> ReferenceRates:
    """Return ν and ν̇ of a reference.

    Args:
        state: The reference. Its arrays may have a row an instant; so have those returned, then.
    """
    drive = robot.drive
    speeds = np.stack([state.twist, state.twist_dot], axis=-2)  # (..., 2, 3)
    if drive.leans:  # as it leans in the end: what tilts it is the law's
        turned = steering(robot, state)[..., 1:, :]
        still = np.zeros_like(speeds[..., :1])
        ways = speeds[..., :1] if drive.steered else speeds[..., [0, 2]]
        base = np.concatenate([ways, still, turned], axis=-1)
    elif drive.steered:
        turned = steering(robot, state)
        own = speeds[..., :1] if drive.has_axle else _rolling_speed(robot, speeds, turned)
        base = np.concatenate([own, turned[..., 1:, :]], axis=-1)
    else:
        base = speeds[..., [0, 2]] if drive.has_axle else speeds[..., : len(drive.base_speeds)]
    arm = np.stack([state.joint_rates, state.joint_accelerations], axis=-2)
    found = np.concatenate([base, arm], axis=-1)
    return ReferenceRates(found[..., 0, :], found[..., 1, :])


def steering(robot: Robot, state: ReferenceState) -> Array:
    """Return positions, rates and accelerations (..., 3, n) of a reference's steered joints."""
    if not robot.drive.steered:
        return np.zeros((*state.twist.shape, 0))
    return steer(robot.drive, direction(state) @ robot.root_velocity.T)


def trailing(robot: Robot, state: ReferenceState) -> Array:
    """Return the positions (..., n_powered_casters) at which a reference's casters trail, rad."""
    return trailing_positions(robot.drive, direction(state)[..., 0, :] @ robot.root_velocity.T)


def configuration_along(robot: Robot, state: ReferenceState, pose: Array | None = None) -> Array:
    """Return q (nq,) of a reference: arm and steering as it has them, powered casters trailing.

    Args:
        pose: Pose of P (3,); None takes the reference's.
    """
    place = state.pose if pose is None else pose
    q = robot.configuration_at(place, state.joints, steering(robot, state)[0])
    casters = zip(robot.drive.powered_casters, trailing(robot, state).tolist(), strict=True)
    for swivel, position in casters:
        robot.set_joint(q, swivel.joint, position)
    return q


AHEAD = np.diag([1.0, 0.0, 0.0])
AHEAD.setflags(write=False)


def direction(state: ReferenceState) -> Array:
    """Return a reference's direction of travel (..., 3, 3); of one that gives none, its twist.

    Where there is neither, wheels point ahead.
    """
    given, twist = state.direction, state.twist
    if given is not None and given.ndim == 2 and given[0].any():
        return given
    moving = np.stack([twist, state.twist_dot, np.zeros_like(twist)], axis=-2)
    found = np.where(moving[..., :1, :].any(axis=-1, keepdims=True), moving, AHEAD)
    if given is None:
        return found
    return np.where(given[..., :1, :].any(axis=-1, keepdims=True), given, found)


def _rolling_speed(robot: Robot, speeds: Array, turned: Array) -> Array:
    """Return the rolling speed of the first steered swivel's wheels and its derivative (..., 2, 1).

    k·T − y (ω + φ̇), with y the wheels' mean place beside the swivel; along the heading k̇·T = 0.
    """
    swivel = robot.drive.steered[0]
    beside = [robot.drive.wheels[wheel].lateral for wheel in robot.drive.carried(swivel)]
    row = rolling_row(swivel.pivot, angle_of(swivel, turned[..., 0, 0]))
    turning = speeds[..., 2:] + swivel.sign * turned[..., 1:, :1]
    return np.asarray(speeds @ robot.root_velocity.T @ row[..., None] - np.mean(beside) * turning)


def configurations(robot: Robot, pose: Array, joints: Array, steered: Array | None = None) -> Array:
    """Return q (K, nq) for poses of P and positions of the arm; wheels and casters at 0.

    Joints that mimic others, and swivels that follow, are where those put them.

    Args:
        pose: Poses (K, 3), m and rad.
        joints: Positions (K, n_joints), rad or m.
        steered: Positions of the steered joints (K, n_steered), rad; None for 0.
    """
    if isinstance(robot, LeaningRobot):
        return robot.configurations_at(pose, joints, steered)
    q = np.tile(pin.neutral(robot.model), (len(pose), 1))
    heading, (px, py) = pose[:, 2] - robot.drive.heading, robot.drive.point
    cos, sin = np.cos(heading), np.sin(heading)
    q[:, 0], q[:, 1] = pose[:, 0] - cos * px + sin * py, pose[:, 1] - sin * px - cos * py
    q[:, 2], q[:, 3] = cos, sin
    positions: dict[str, Any] = dict(zip(robot.joint_names, joints.T, strict=True))
    if steered is not None:
        names = (swivel.joint for swivel in robot.drive.steered)
        positions |= dict(zip(names, steered.T, strict=True))
    known = {**robot.locked, **positions}
    for joint in robot.mimics:
        if joint.mimic is not None:
            followed = known.get(joint.mimic.joint, 0.0)
            positions[joint.name] = joint.mimic.multiplier * followed + joint.mimic.offset
    positions |= follower_positions(robot.drive, known)
    for name, each in positions.items():
        robot.entries[name].write_all(q, each)
    return q


@dataclass(frozen=True, eq=False)
class ReferenceTable:
    """A reference at K times; :class:`~rpctl.reference.motion.ReferenceState` has the units.

    Attributes:
        robot: The robot that follows.
        t: Times (K,), s.
        rows: All of it side by side (K, 9 + 3 n_joints + 9), in the order of the state. Where the
            reference gives no direction, its twist, the twist's derivative and zeros stand for it.
    """

    robot: Robot = field(repr=False)
    t: Array
    rows: Array = field(repr=False)

    def __len__(self) -> int:
        """Return the number of times."""
        return len(self.t)

    @cached_property
    def state(self) -> ReferenceState:
        """All of it, the arrays with a row a time."""
        return state_of(self.rows)

    @cached_property
    def end_effector(self) -> Array:
        """Where the end effector is (K, 3) on the reference, in the world, m; (K, 0) without one.

        Base and arm are where the reference has them, wheels and swivels at 0.
        """
        if self.robot.end_effector is None:
            return np.empty((len(self), 0))
        q = configurations(self.robot, self.state.pose, self.state.joints)
        return self.robot.end_effector_poses(q)[:, :3, 3].copy()

    def at(self, chosen: slice) -> ReferenceTable:
        """Return it at some of its times."""
        return ReferenceTable(self.robot, self.t[chosen], self.rows[chosen])


def row_sizes(robot: Robot) -> list[int]:
    """Return how many numbers a row has of each of the table's arrays."""
    return [BASE_NV] * 3 + [len(robot.joints)] * 3 + [BASE_NV] * 3


def row_symbols(robot: Robot, row: Any) -> ReferenceState:
    """Return the scalars of a row (n, 1)."""
    ends = np.cumsum([0, *row_sizes(robot)]).tolist()
    parts: list[Any] = [casadi.vertsplit(part) for part in casadi.vertsplit(row, ends)]
    return ReferenceState(*parts[:6])._replace(direction=parts[6:])  # type: ignore[arg-type]


def tabulate(robot: Robot, reference: Reference, times: Array) -> ReferenceTable:
    """Return a reference at many times.

    Args:
        times: Times (K,), s.

    Raises:
        WrongAnswerError: The reference returns something else than a state that fits the robot.
    """
    times = np.array(times, dtype=float)
    if len(times) and _tells_rows(reference):
        rows = reference.row(times)
        fits = np.isfinite(rows).all(axis=1) & (rows.shape[1] == sum(row_sizes(robot)))
        for t, row in zip(times[~fits].tolist(), rows[~fits], strict=True):
            require_state(robot, state_of(row), t)
        return ReferenceTable(robot, times, rows)
    return table_of(robot, times, [require_state(robot, reference(t), t) for t in times.tolist()])


def row_reader(robot: Robot, reference: Reference) -> Callable[[float], Array]:
    """Return a function that reads a reference at one time: a row of its table.

    It returns the row (9 + 3 n_joints + 9,) of :attr:`ReferenceTable.rows` at a time (s), number by
    number what :func:`tabulate` has there. The row is valid until the next one is read: it may be
    the same array each time. A reader is for one thread.

    Raises:
        WrongAnswerError: When it is called: as of :func:`tabulate`.
    """
    if not _tells_rows(reference):
        return lambda t: row_of(require_state(robot, reference(t), t))
    tell, width = reference.row, sum(row_sizes(robot))
    if isinstance(tell, Columns):
        tell = Reader(tell.function)

    def read(t: float) -> Array:
        row = tell(t)
        if len(row) != width or not math.isfinite(row @ row):
            require_state(robot, state_of(row), t)
        return row

    return read


def _tells_rows(reference: Any) -> TypeGuard[RowReference]:
    """Return whether what a reference returns when called is its row."""
    return type(reference).__call__ is RowReference.__call__


def table_of(robot: Robot, times: Array, states: Sequence[ReferenceState]) -> ReferenceTable:
    """Return the table of states, one for each time (K,)."""
    rows = np.array([row_of(state) for state in states]).reshape(len(states), sum(row_sizes(robot)))
    return ReferenceTable(robot, times, rows)
