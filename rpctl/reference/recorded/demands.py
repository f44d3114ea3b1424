"""What a table's reference asks beyond its robot's limits, and a pace at which it does not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError
from rpctl.reference.fitting import dry_friction, efforts, sample, velocities
from rpctl.reference.motion import steering
from rpctl.reference.path_reference import TimedPath
from rpctl.reference.paths import PathTime
from rpctl.reference.recorded.table_file import Table
from rpctl.reference.sizing import VELOCITY_LIMIT_FRACTION, Told
from rpctl.reference.time_law import Bound, time_law
from rpctl.robot.model import Robot

SAMPLES_PER_ROW, MIN_SAMPLES, MAX_SAMPLES = 4, 200, 3000
SAME_STRETCH = 0.5  # s: what is beyond a limit again so soon is one stretch
ROUNDING = 1e-6  # of a limit: no demand is beyond it by less
QUANTITIES = {  # what is asked: units of turning and of sliding joints
    "effort": ("N m", "N"),
    "velocity": ("rad/s", "m/s"),
    "position": ("rad", "m"),
}
EFFORT_SHARE = (
    0.8  # of what holding and dry friction leave of an effort limit: the rest corrects errors
)
SPACING = 0.05  # s of the table between the points where limits are looked at
MIN_POINTS, MAX_POINTS = 100, 2000  # numbers of these points
PACE_RISE = 2.0  # 1/s: the recorded pace is reached within half a second at least


@dataclass(frozen=True)
class Exceedance:
    """Where a limit is exceeded, in time (s) and in lines of the file."""

    start: float
    end: float
    first_line: int
    last_line: int


@dataclass(frozen=True)
class Demand(Told):
    """What a reference asks of a joint beyond one of its limits.

    Attributes:
        joint: Its name.
        quantity: ``effort``, ``velocity`` or ``position``.
        value: What is asked where it is farthest beyond, in the unit.
        limit: What is allowed there.
        unit: Of both.
        time: When that is, s.
        line: Of the file, there.
        stretches: All that is beyond the limit.
    """

    joint: str
    quantity: str
    value: float
    limit: float
    unit: str
    time: float
    line: int
    stretches: tuple[Exceedance, ...]

    @property
    def ratio(self) -> float:
        """How many times the limit is asked; of a position that has a limit of 0 infinity."""
        return abs(self.value / self.limit) if self.limit else math.inf

    @property
    def sentence(self) -> str:
        """It in one line."""
        times = "" if self.quantity == "position" else f", {self.ratio:.3g} times that"
        first, last = self.stretches[0], self.stretches[-1]
        many = f" in {len(self.stretches)} stretches" if len(self.stretches) > 1 else ""
        return (
            f"{self.joint} {self.quantity}: {abs(self.value):.3g} {self.unit} where "
            f"{abs(self.limit):.3g} is allowed{times}, at {self.time:.3g} s (line {self.line}); "
            f"beyond from {first.start:.3g} to {last.end:.3g} s{many} "
            f"(lines {first.first_line} to {last.last_line})"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON says it."""
        return {**super().to_dict(), "ratio": self.ratio if math.isfinite(self.ratio) else None}


class _Asked(NamedTuple):
    """One quantity of one joint at all samples: what is asked (N,) between what is allowed."""

    joint: str
    quantity: str
    values: Array
    lower: float
    upper: float


def find_demands(dynamics: ReducedDynamics, reference: TimedPath, table: Table) -> list[Demand]:
    """Return what a table's reference asks beyond its robot's limits, the worst first.

    Efforts are those of the inverse dynamics along it. Where steered wheels fix no one motion
    nothing is looked at.
    """
    count = int(np.clip(SAMPLES_PER_ROW * len(table.t), MIN_SAMPLES, MAX_SAMPLES))
    times, asked = _asked(dynamics, reference, np.linspace(0.0, reference.duration, count + 1))
    at = reference.time_law(times).s + 1e-9
    rows = np.clip(np.searchsorted(table.t, at, side="right") - 1, 0, len(table.t) - 1)
    lines = np.array(table.lines)[rows]
    beyond = filter(None, (_demand(dynamics, each, times, lines) for each in asked))
    return sorted(beyond, key=lambda demand: demand.ratio, reverse=True)


def _asked(
    dynamics: ReducedDynamics, reference: TimedPath, times: Array
) -> tuple[Array, list[_Asked]]:
    """Return the times that were looked at, and what is asked at them."""
    robot, state = dynamics.robot, reference(times)
    seen, rates, taken = [], [], []
    for number, (q, nu, nu_dot, _) in enumerate(zip(*sample(robot, state), strict=True)):
        with suppress(SingularBasisError):
            taken.append(dynamics.efforts(q, dynamics.inverse(q, nu, nu_dot)))
            rates.append(dynamics.basis(q) @ nu)
            seen.append(number)
    if not seen:
        return np.empty(0), []
    angles = steering(robot, state)[seen, 0]
    series = _series(dynamics, np.array(rates), np.array(taken), state.joints[seen], angles)
    return times[seen], [each for each in series if math.isfinite(each.upper - each.lower)]


def _series(
    dynamics: ReducedDynamics, rates: Array, efforts: Array, joints: Array, angles: Array
) -> Iterator[_Asked]:
    """Yield what is asked of each joint.

    Args:
        rates: Velocities (N, nv).
        efforts: (N, n_act).
        joints: Positions of the arm (N, n_joints).
        angles: Positions of the steered joints (N, n_steered).
    """
    robot = dynamics.robot
    idle = idle_joints(robot)
    for name in robot.moving_joint_names:
        limit = robot.description.joint[name].velocity
        if name not in idle:
            yield _Asked(name, "velocity", rates[:, robot.velocity_index(name)], -limit, limit)
    for name, limit, values in zip(robot.actuators, robot.effort_limits, efforts.T, strict=True):
        yield _Asked(name, "effort", values, -limit, limit)
    for joint, values in zip(robot.joints, joints.T, strict=True):
        if joint.kind != "continuous":
            yield _Asked(joint.name, "position", values, joint.lower, joint.upper)
    limits = robot.steering_limits
    for k, swivel in enumerate(robot.drive.steered):
        lower, upper = float(limits.lower[k]), float(limits.upper[k])
        yield _Asked(swivel.joint, "position", angles[:, k], lower, upper)


def _demand(dynamics: ReducedDynamics, asked: _Asked, times: Array, lines: Array) -> Demand | None:
    """Return what is asked of a joint beyond its limits; None if nothing is."""
    size = max(abs(asked.lower), abs(asked.upper))
    beyond = np.maximum(asked.values - asked.upper, asked.lower - asked.values)
    outside = np.flatnonzero(beyond > ROUNDING * size)
    if not len(outside):
        return None
    worst = int(beyond.argmax())
    value = float(asked.values[worst])
    straight = dynamics.robot.description.joint[asked.joint].kind == "prismatic"
    return Demand(
        asked.joint, asked.quantity, value, asked.upper if value > asked.upper else asked.lower,
        QUANTITIES[asked.quantity][straight], float(times[worst]), int(lines[worst]),
        tuple(_stretches(outside, times, lines)),
    )  # fmt: skip


def _stretches(outside: NDArray[np.intp], times: Array, lines: Array) -> Iterator[Exceedance]:
    """Yield where the samples of given indices are, those near one another as one."""
    for group in np.split(outside, np.flatnonzero(np.diff(times[outside]) > SAME_STRETCH) + 1):
        first, last = group[0], group[-1]
        yield Exceedance(
            float(times[first]), float(times[last]), int(lines[first]), int(lines[last])
        )


def idle_joints(robot: Robot) -> set[str]:
    """Return the idle casters, trailers and their wheels: no reference says how they move."""
    idle = {swivel.joint for swivel in robot.drive.idle_casters}
    return idle | {wheel.joint for wheel in robot.drive.wheels if wheel.swivel in idle}


@dataclass(frozen=True)
class Retimed(Told):
    """How a recorded path was slowed down.

    Attributes:
        recorded: How long it took as recorded, s.
        duration: How long it takes, s.
        pace: The least rate relative to the recorded one, away from start and stop.
        line: Of the file, where that is.
        reason: The joint and the quantity whose limit binds there.
    """

    recorded: float
    duration: float
    pace: float
    line: int
    reason: str

    @property
    def sentence(self) -> str:
        """It in one line."""
        return (
            f"takes {self.duration:.3g} s instead of {self.recorded:.3g} s: at line {self.line} "
            f"{self.pace:.2g} of its recorded pace, for {self.reason}"
        )


def retimed(
    dynamics: ReducedDynamics, reference: TimedPath, table: Table
) -> tuple[TimedPath, Retimed]:
    """Return a table's path in the shortest time that keeps limits and is nowhere ahead of it.

    Raises:
        RpctlError: No time law keeps the limits.
    """
    end = float(table.t[-1])
    s = np.linspace(0.0, end, int(np.clip(end / SPACING, MIN_POINTS, MAX_POINTS)) + 1)
    limits = list(limits_along(dynamics, reference, s))
    pace = Bound(np.ones(len(s)), np.zeros(len(s)), 1.0, PACE_RISE)
    law = time_law(s, [pace, *(bound for bound, _ in limits)])
    times = np.linspace(0.0, law.duration, len(s))
    at, rate, _ = law(times)
    moving = (at > min(1.0, 0.1 * end)) & (at < end - min(1.0, 0.1 * end))
    slowest = int(np.where(moving, rate, np.inf).argmin())
    row = int(np.searchsorted(table.t, at[slowest], side="right")) - 1
    told = Retimed(
        end, law.duration, float(rate[slowest]), table.lines[max(row, 0)],
        _reason(limits, s, law(float(times[slowest]))),
    )  # fmt: skip
    return replace(reference, time_law=law), told


def limits_along(
    dynamics: ReducedDynamics, reference: TimedPath, s: Array
) -> Iterator[tuple[Bound, str]]:
    """Yield bounds of velocity and effort that a robot sets to the pace, and what each is for.

    Args:
        s: Points of it (N,).
    """
    robot, none = dynamics.robot, np.zeros(len(s))
    steady, starting = (
        sample(robot, reference.at(PathTime(s, *rates)))
        for rates in ((none + 1.0, none), (none, none + 1.0))
    )
    rates, dry = velocities(dynamics, steady), dry_friction(dynamics, steady)
    holding = efforts(dynamics, steady.still)
    held, by_square = np.abs(holding) + np.abs(dry), efforts(dynamics, steady) - holding - dry
    by_acceleration = efforts(dynamics, starting) - holding
    idle = idle_joints(robot)
    for name in robot.moving_joint_names:
        limit = VELOCITY_LIMIT_FRACTION * robot.description.joint[name].velocity
        if np.isfinite(limit) and name not in idle:
            rate = rates[:, robot.velocity_index(name)]
            yield Bound(rate, none, limit), f"the velocity of {name}"
    for k, (name, limit) in enumerate(zip(robot.actuators, robot.effort_limits, strict=True)):
        left = limit - held[:, k]
        most = np.where(left > 0.0, EFFORT_SHARE * left, np.inf)
        yield Bound(by_acceleration[:, k], by_square[:, k], np.inf, most), f"the effort of {name}"


def _reason(limits: Sequence[tuple[Bound, str]], s: Array, at: PathTime) -> str:
    """Return which limit is the nearest at an instant.

    Args:
        s: Its points (N,).
    """
    point = int(np.abs(s - at.s).argmin())
    shares = []
    for bound, _ in limits:
        slope, bend = bound.slope[point], bound.bend[point]
        most = np.broadcast_to(bound.acceleration, len(s))[point]
        change = abs(bend * at.rate**2 + slope * at.acceleration) / most
        shares.append(max(abs(slope * at.rate) / bound.speed, change))
    return limits[int(np.argmax(shares))][1]
