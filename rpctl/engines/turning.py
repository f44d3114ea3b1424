"""How a skid-steer base turns in place in an engine, expressed as an effective track."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.wheels import mostly_left
from rpctl.engines.engine import ALL_DEFAULT, Engine, EngineRun
from rpctl.engines.recording import SETTLING_S
from rpctl.equivalence.contact.plan import ContactPlan
from rpctl.errors import DivergedError
from rpctl.robot.model import Robot

TURNING_S = 4.0  # s of turning; the second half is measured
SPIN_BANDWIDTH = 50.0  # rad/s of the servo on the wheels' speeds, critically damped
BAND = 0.02  # of a track: closer tracks count as equal
AT_SPEED = 0.05  # of the commanded speed: largest error of the wheels' speed
SWINGS = 0.1  # of the mean load: wheels whose load swings by more hop
CONVERGED, MOST_ROUNDS = 1e-10, 2000


@runtime_checkable
class TurningEngine(Protocol):
    """An engine with a set-up in which the wheels of a scrubbing base stay on the ground."""

    turning_setting: str  # an imperative that names the set-up

    def turning_speed(self, friction: float) -> float:
        """Return the largest rim speed (m/s) at which the wheels stay on the ground."""

    def start_turning(self, robot: Robot, q: Array, friction: float) -> EngineRun:
        """Return the robot at rest at q, with this set-up.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            friction: Coefficient between wheels and ground.
        """


@dataclass(frozen=True, eq=False)
class Turn:
    """How a base turned in place.

    Attributes:
        track: Track (m) at which rolling wheels would turn the base as fast; infinite if it stood.
        load: Mean vertical force of each wheel (n_wheels,), N.
        swing: The largest ratio of the standard deviation of a wheel's load to its mean.
        off: Relative error of the wheels' mean speed.
    """

    track: float
    load: Array
    swing: float
    off: float


@dataclass(frozen=True, eq=False)
class TurnVerdict:
    """How a skid-steer base turns in an engine.

    Attributes:
        default: The turn in the engine as a user runs it; None if that fails.
        mended: The turn with the engine's ``turning_setting``.
        declared: The reduced model's track, m.
        own: The track that follows from Coulomb friction at the wheels' positions, m.
        setting: The setting that mends it.
    """

    default: Turn | None
    mended: Turn
    declared: float
    own: float
    setting: str

    @property
    def agrees(self) -> bool:
        """Whether the mended engine turns at the commanded speed as the wheels' positions say."""
        return self.mended.off < AT_SPEED and near(self.mended.track, self.own)

    def line(self, engine: str) -> str:
        """Return the referee's sentence on the turn in an engine; empty if nothing explains it."""
        if not self.agrees:
            return ""
        mended, default = f"{self.mended.track:.2f} m", self.default
        known = (
            f"(reduced model: {self.declared:.2f} m, declared; from the wheels' positions: "
            f"{self.own:.2f} m)"
        )
        if default is not None and near(default.track, self.mended.track):
            said = f"turns in place as on a track of {mended} {known}"
        elif default is not None and math.isfinite(default.track):
            hops = " and its wheels hop" if default.swing > SWINGS else ""
            said = f"turns in place as on a track of {default.track:.2f} m{hops}; once "
            said += f"corrected, as on a track of {mended} {known}: {self.setting}"
        else:
            said = (
                f"does not turn in place; once corrected, it turns as on a track of {mended} "
                f"{known}: {self.setting}"
            )
        if not near(self.declared, self.mended.track):
            said += f"; declare [drive] track = {self.mended.track:.3g}"
        return f"{engine}: {said}"

    def to_dict(self, engine: str) -> dict[str, Any]:
        """Return the verdict as plain values for JSON; an infinite track is None."""
        turns = {"track": self.default, "mended": self.mended}
        return {
            **{
                name: turn.track if turn is not None and math.isfinite(turn.track) else None
                for name, turn in turns.items()
            },
            "declared": self.declared,
            "own": self.own,
            "agrees": self.agrees,
            "line": self.line(engine),
        }


def near(track: float, other: float) -> bool:
    """Return whether two tracks (m) are equal within :data:`BAND`."""
    return abs(track - other) < BAND * other


def judge_turn(
    robot: Robot, engine: Engine, plan: ContactPlan, friction: float
) -> TurnVerdict | None:
    """Return how a base turns in place; None if the base or the engine is of another kind.

    Args:
        robot: The robot.
        engine: The engine.
        plan: The efforts that hold the arm where it starts.
        friction: Coefficient of friction between wheels and ground if it is mended.
    """
    drive = robot.drive
    plain = all(wheel.driven and not wheel.slides for wheel in drive.wheels)
    if drive.type != "skid-steer" or not plain or not isinstance(engine, TurningEngine):
        return None
    speed = engine.turning_speed(friction)
    try:
        run = engine.start_turning(robot, plan.q[0], friction)
        mended = turn_in_place(run, robot, plan, engine.tick, speed)
    except DivergedError:
        return None
    try:
        run = engine.start(robot, plan.q[0], ALL_DEFAULT, friction)
        default = turn_in_place(run, robot, plan, engine.tick, speed)
    except DivergedError:
        default = None
    own = scrubbing_track(wheel_places(robot), mended.load)
    return TurnVerdict(default, mended, drive.track, own, engine.turning_setting)


def turn_in_place(
    run: EngineRun, robot: Robot, plan: ContactPlan, tick: float, speed: float
) -> Turn:
    """Turn a base to the left, with equal wheel speeds on both sides, and return the turn.

    Args:
        run: The robot in the engine, at rest.
        robot: The robot.
        plan: The efforts that hold the arm where it starts.
        tick: How long efforts are held, s.
        speed: Speed of the rims, m/s.

    Raises:
        DivergedError: The motion diverges.
    """
    names = [wheel.joint for wheel in robot.drive.wheels]
    motors = [robot.actuators.index(name) for name in names]
    limits = np.array([robot.description.joint[name].effort for name in names])
    side, joints = np.sign(wheel_places(robot)[:, 1]), robot.description.joint
    left = [mostly_left(robot.tree.axis(joints[name])) for name in names]
    # each wheel's way forward over its turn, m: its radius, with a sign
    rolls = np.copysign([wheel.radius for wheel in robot.drive.wheels], left)
    inertia = pin.crba(robot.model, robot.model.createData(), robot.configuration())
    # of each wheel about its axle, kg m², its motor's rotor with it
    spin = np.diag(inertia)[[robot.velocity_index(name) for name in names]]
    summed, rows = np.zeros(len(names)), []
    settling, count = round(SETTLING_S / tick), round(TURNING_S / tick)
    for k in range(settling + count):
        tau = plan.efforts(-1, *run.measured(plan.names))
        _, rates = run.measured(names)
        gap = (speed * -side / rolls if k >= settling else 0.0) - rates
        summed += tick * gap
        push = SPIN_BANDWIDTH * spin * (2.0 * gap + SPIN_BANDWIDTH * summed)
        tau[motors] = np.clip(push, -limits, limits)
        run.advance(tau, tick)
        if k >= settling + count // 2:
            after = run.state()
            rows.append((after.planar[2], *(rates * rolls), *after.load[: len(names)]))
    return _measured(np.array(rows), side, tick, speed)


def _measured(rows: Array, side: Array, tick: float, speed: float) -> Turn:
    """Return the turn, given rows of heading, rolling speeds and loads, one tick apart."""
    n = len(side)
    heading, rims, load = np.unwrap(rows[:, 0]), rows[:, 1 : 1 + n], rows[:, 1 + n :]
    yaw = float(heading[-1] - heading[0]) / (tick * (len(rows) - 1))
    rim = float((-side * rims).mean())
    mean = load.mean(axis=0)
    swing = float((load.std(axis=0) / np.maximum(mean, np.finfo(float).tiny)).max())
    track = 2.0 * rim / yaw if yaw > 0.0 else math.inf
    return Turn(track, mean, swing, abs(rim / speed - 1.0))


def wheel_places(robot: Robot) -> Array:
    """Return the wheels' positions in the file, ahead and to the left of P (n_wheels, 2), m."""
    drive, found = robot.drive, []
    cos, sin = math.cos(drive.heading), math.sin(drive.heading)
    for wheel in drive.wheels:
        pose = robot.tree.pose(robot.description.joint[wheel.joint].child)
        centre = pose[:3, 3] + pose[:3, :3] @ (wheel.offset * np.array(wheel.axis))
        x, y = centre[:2] - np.array(drive.point)
        found.append((cos * x + sin * y, cos * y - sin * x))
    return np.array(found).reshape(-1, 2)


def scrubbing_track(places: Array, load: Sequence[float] | Array) -> float:
    """Return the effective track (m) of a base that turns in place by equal and opposite speeds.

    Coulomb friction balances at the twist of the base that minimises Σ N |u|, where u is the slip
    of each contact point. For four wheels at (±L/2, ±W/2) with equal loads the track is W + L²/W.

    Args:
        places: Positions of the wheels, ahead and to the left of P (n, 2), m.
        load: Load of each wheel (n,), N.
    """
    x, y = places.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = np.concatenate([np.stack([one, zero, -y], 1), np.stack([zero, one, x], 1)])
    rims = np.concatenate([-np.sign(y), zero])  # m/s
    weight, twist = np.asarray(load, float), np.zeros(3)
    scale = weight.copy()
    for _ in range(MOST_ROUNDS):  # weighted least squares, as Weiszfeld did
        root = np.sqrt(np.tile(scale, 2))
        before, twist = twist, np.linalg.lstsq(rows * root[:, None], rims * root, rcond=None)[0]
        if np.abs(twist - before).max() < CONVERGED:
            break
        slip = np.hypot(*np.split(rows @ twist - rims, 2))
        scale = weight / np.maximum(slip, CONVERGED)
    return 2.0 / float(twist[2]) if twist[2] > 0.0 else math.inf
