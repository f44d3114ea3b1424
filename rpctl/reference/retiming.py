"""A recorded path at a pace that its robot keeps: slower than recorded where a limit binds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.csv_file import Table
from rpctl.reference.demands import idle_joints
from rpctl.reference.limits import VELOCITY_LIMIT_FRACTION
from rpctl.reference.paths import PathTime
from rpctl.reference.quasi_velocities import configuration_along, reference_rates
from rpctl.reference.time_law import Bound, time_law
from rpctl.reference.timed_path import TimedPath
from rpctl.reference.usage import MotionSample, dry_friction

EFFORT_SHARE = (
    0.8  # of what holding and dry friction leave of an effort limit: the rest corrects errors
)
SPACING = 0.05  # s of the table between the points where limits are looked at
MIN_POINTS, MAX_POINTS = 100, 2000  # numbers of these points
PACE_RISE = 2.0  # 1/s: the recorded pace is reached within half a second at least


@dataclass(frozen=True)
class Retimed:
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

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON says it."""
        return {**asdict(self), "sentence": self.sentence}


class NamedBound(NamedTuple):
    """A bound of the time law, and what it is for."""

    bound: Bound
    reason: str


def retimed(
    dynamics: ReducedDynamics, reference: TimedPath, table: Table
) -> tuple[TimedPath, Retimed]:
    """Return a table's path in the shortest time that keeps limits and is nowhere ahead of it.

    Args:
        dynamics: The robot's dynamics.
        reference: Its reference, in the table's own time.
        table: Its rows.

    Raises:
        RpctlError: No time law keeps the limits.
    """
    end = float(table.t[-1])
    s = np.linspace(0.0, end, int(np.clip(end / SPACING, MIN_POINTS, MAX_POINTS)) + 1)
    limits = list(limits_along(dynamics, reference, s))
    pace = Bound(np.ones(len(s)), np.zeros(len(s)), 1.0, PACE_RISE)
    law = time_law(s, [pace, *(limit.bound for limit in limits)])
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


def limits_along(dynamics: ReducedDynamics, reference: TimedPath, s: Array) -> Iterator[NamedBound]:
    """Yield what a robot's limits of velocity and effort ask of the pace.

    Args:
        dynamics: The robot's dynamics.
        reference: The path.
        s: Points of it (N,).
    """
    robot = dynamics.robot
    points = [_point(dynamics, reference, float(x)) for x in s]
    rates, held, by_square, by_acceleration = (np.array(part) for part in zip(*points, strict=True))
    none, idle = np.zeros(len(s)), idle_joints(robot)
    for name in robot.moving_joint_names:
        limit = VELOCITY_LIMIT_FRACTION * robot.description.joint[name].velocity
        if np.isfinite(limit) and name not in idle:
            rate = rates[:, robot.velocity_index(name)]
            yield NamedBound(Bound(rate, none, limit), f"the velocity of {name}")
    for k, (name, limit) in enumerate(zip(robot.actuators, robot.effort_limits, strict=True)):
        left = limit - held[:, k]
        most = np.where(left > 0.0, EFFORT_SHARE * left, np.inf)
        bound = Bound(by_acceleration[:, k], by_square[:, k], np.inf, most)
        yield NamedBound(bound, f"the effort of {name}")


def _point(dynamics: ReducedDynamics, reference: TimedPath, s: float) -> tuple[Array, ...]:
    """Return, at a point of the path, velocities (nv,) by ṡ; sizes of the efforts at any pace, to
    hold the robot and against dry friction; and those by ṡ² and by s̈, (n_act,) each."""
    robot, still = dynamics.robot, np.zeros(dynamics.robot.dof)
    steady, starting = (reference.at(PathTime(s, *rates)) for rates in ((1.0, 0.0), (0.0, 1.0)))
    q = configuration_along(robot, steady)
    nu, nu_dot = reference_rates(robot, steady)
    _, push = reference_rates(robot, starting)
    held, moving, pushed = (
        dynamics.efforts(q, dynamics.inverse(q, *motion))
        for motion in ((still, still), (nu, nu_dot), (still, push))
    )
    (dry,) = dry_friction(dynamics, [MotionSample(q, nu, nu_dot, steady.twist)])
    always = np.abs(held) + np.abs(dry)
    return dynamics.basis(q) @ nu, always, moving - held - dry, pushed - held


def _reason(limits: Sequence[NamedBound], s: Array, at: PathTime) -> str:
    """Return which limit is the nearest at an instant.

    Args:
        limits: Those of the path.
        s: Its points (N,).
        at: The instant.
    """
    point = int(np.abs(s - at.s).argmin())
    shares = []
    for bound, _ in limits:
        slope, bend = bound.slope[point], bound.bend[point]
        most = np.broadcast_to(bound.acceleration, len(s))[point]
        change = abs(bend * at.rate**2 + slope * at.acceleration) / most
        shares.append(max(abs(slope * at.rate) / bound.speed, change))
    return limits[int(np.argmax(shares))].reason
