"""The plan of the contact trial, shared by both sides: a gentle motion, its efforts, and a servo.

The wheels get efforts as functions of time alone, the same numbers on both sides. Steered and
arm joints would fall or drift under efforts alone, so each side adds the same servo on its own
measured positions: where the models differ, so do the efforts that the same motion takes. The
motors of swivels that follow others push as planned, for what ties them holds them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.drive.steering import steer, trailing_positions
from rpctl.dynamics.ground_reaction import FRICTION, Contacts, find_contacts, ground_reaction
from rpctl.dynamics.motion import step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import ActuationError, RpctlError
from rpctl.robot.model import Robot

AHEAD = np.array([1.0, 0.0, 0.0])  # a twist
DURATION_S = 2.0  # s
TICK_S = 2e-3  # s: both sides hold their efforts this long
TOP_SPEED = 1.0  # m/s at the end, where nothing speaks for less: a walking pace
BASE_TURN = 0.8  # rad that a base turns at that pace
SIDEWAYS_RATIO = 0.4  # of the forward speed, of a base that moves to any side
MAX_STEERING = 0.3  # rad, at most half of what the joint has: axles meet a few wheelbases away
ARM_STROKE, ARM_STROKE_M = (
    0.3,
    0.05,
)  # rad and m that an arm's joint moves, at most a tenth of its range
MAX_GRIP_RATIO = (
    0.5  # largest share of the friction: a wheel near it creeps, in MuJoCo as on a floor
)
MAX_MOTOR_RATIO = 0.8  # largest share of the wheels' efforts, and of any motor's speed
TICKS_PER_CHECK = 25  # ticks between the instants at which the ground is asked
PACES = tuple(0.5**k for k in range(5))  # of SPEED and TURN, the fastest gentle one counts
SERVO_BANDWIDTH = 80.0  # rad/s of the servo, critically damped: stiffer than arms hang by gravity


@dataclass(frozen=True)
class Course:
    """How a motion runs with time: speeds rise to their size, the rest moves by it and stops.

    Attributes:
        duration: s.
        tick: How long efforts are held, s.
        rise: Share of the duration in which speeds rise.
        pulse: Share of it, in its middle, in which the rest moves.
        lost: Share of their size that speeds lose again at the end, within as long as they rise.
    """

    duration: float = DURATION_S
    tick: float = TICK_S
    rise: float = 1.0
    pulse: float = 1.0
    lost: float = 0.0

    @property
    def peak(self) -> float:
        """Largest rate of what moves and stops, over its stroke, 1/s."""
        return 2.0 / (self.pulse * self.duration)

    def speeds(self, t: float, size: Array, rising: Array) -> tuple[Array, Array]:
        """Return ν and ν̇ (dof,) at a time.

        Args:
            t: s.
            size: Speeds (m/s) of what rises, strokes of what moves and stops (dof,).
            rising: What rises (dof,), true or false.
        """
        length, moving = self.rise * self.duration, self.pulse * self.duration
        up, up_rate = _rise(t, length)
        down, down_rate = _rise(t - (self.duration - length), length)
        speed = up - self.lost * down, up_rate - self.lost * down_rate
        pulse = _pulse(t - 0.5 * (self.duration - moving), moving)
        nu, nu_dot = (size * np.where(rising, a, b) for a, b in zip(speed, pulse, strict=True))
        return nu, nu_dot


def _rise(t: float, length: float) -> tuple[float, float]:
    """Return a rise from 0 to 1 within a length of time (s), and its rate."""
    if not 0.0 < t < length:
        return float(t >= length), 0.0
    w = math.pi / length
    return 0.5 * (1.0 - math.cos(w * t)), 0.5 * w * math.sin(w * t)


def _pulse(t: float, length: float) -> tuple[float, float]:
    """Return a pulse of area 1 within a length of time (s), and its rate."""
    if not 0.0 < t < length:
        return 0.0, 0.0
    w = 2.0 * math.pi / length
    return (1.0 - math.cos(w * t)) / length, w * math.sin(w * t) / length


class NotGentle(RpctlError):
    """No motion is gentle: there is nothing to compare."""


class DrivenRobot(Protocol):
    """A robot that efforts move, whoever computes how."""

    def measured(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return positions (n,), rad or m, and rates (n,) of joints."""

    def advance(self, tau: Array, dt: float) -> object:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s)."""


class ReducedRobot:
    """The reduced model as a robot that is driven, at rest at the start.

    Args:
        dynamics: The reduced dynamics.
        q: Where it starts (nq,).

    Attributes:
        q: Configuration now (nq,).
        nu: Quasi-velocities now (dof,).
    """

    def __init__(self, dynamics: ReducedDynamics, q: Array) -> None:
        self.dynamics, self.robot = dynamics, dynamics.robot
        self.q, self.nu = q.copy(), np.zeros(dynamics.robot.dof)

    def measured(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return positions (n,), rad or m, and rates (n,) of joints."""
        at = np.array([self.robot.joint_position(self.q, name) for name in names])
        v = self.dynamics.basis(self.q) @ self.nu
        return at, v[[self.robot.velocity_index(name) for name in names]]

    def advance(self, tau: Array, dt: float) -> None:
        """Hold efforts (n_act,), N·m or N, for ``dt`` (s)."""
        self.q, self.nu, *_ = step(self.dynamics, self.q, self.nu, tau, dt)


@dataclass(frozen=True)
class ContactPlan:
    """The motion both sides are to make.

    Attributes:
        q: Configurations (n + 1, nq), TICK apart.
        v: Velocities (n + 1, nv).
        tau: Efforts (n, n_act) that it takes, N·m or N; of wheels those that they get.
        hold: Efforts (n_act,) that hold the robot where it starts, N·m or N.
        servoed: Actuators (indices) with a servo.
        names: Their joints.
        targets: Their positions (n + 1, n_held) and rates (n + 1, n_held).
        inertia: What they feel of the robot where they are to be (n + 1, n_held, n_held); the
            servo is BANDWIDTH² of it stiff, and critically damped.
    """

    q: Array
    v: Array
    tau: Array
    hold: Array
    servoed: tuple[int, ...]
    names: tuple[str, ...]
    targets: tuple[Array, Array]
    inertia: Array

    def efforts(
        self, tick: int, positions: Array, rates: Array, planned: Array | None = None
    ) -> Array:
        """Return what the actuators do (n_act,) at measured positions and rates (n_held,).

        Before tick 0 the motion waits at its start, after the last one at its end.

        Args:
            tick: The tick.
            positions: Of the joints with a servo, rad or m.
            rates: rad/s or m/s.
            planned: Efforts (n_act,) instead of the plan's.
        """
        if planned is None:
            planned = self.hold if tick < 0 else self.tau[min(tick, len(self.tau) - 1)]
        tau = np.array(planned)
        tick = max(tick, 0)
        if self.servoed:
            gap, slower = self.targets[0][tick] - positions, self.targets[1][tick] - rates
            gap = (gap + math.pi) % (2.0 * math.pi) - math.pi  # an angle read in (−π, π]
            push = SERVO_BANDWIDTH * (SERVO_BANDWIDTH * gap + 2.0 * slower)
            tau[list(self.servoed)] += self.inertia[tick] @ push
        return tau

    def drive(
        self, robot: DrivenRobot, tick: int, dt: float = TICK_S, planned: Array | None = None
    ) -> Array:
        """Let a robot do a tick of ``dt`` (s), its servo on what is measured; return efforts."""
        tau = self.efforts(tick, *robot.measured(self.names), planned)
        robot.advance(tau, dt)
        return tau


def standing_contacts(dynamics: ReducedDynamics, friction: float = FRICTION) -> Contacts:
    """Return how a robot stands on the ground.

    Args:
        dynamics: Its dynamics.
        friction: Coefficient between wheels and ground.

    Raises:
        NotGentle: It has a fixed base, or is not known to stand.
    """
    found = find_contacts(dynamics, friction)
    if found is None:
        raise NotGentle("a fixed base does not roll")
    if not found.balanced:
        why = found.notes[0] if found.notes else "it has no contacts"
        raise NotGentle(f"rpctl does not know that it stands: {why}")
    return found


def plan_motion(
    dynamics: ReducedDynamics, contacts: Contacts, course: Course | None = None
) -> ContactPlan:
    """Return the fastest motion among PACES that the ground and the motors bear easily.

    Args:
        dynamics: The robot's dynamics.
        contacts: How it stands.
        course: How the motion runs with time; None: speeds rise, the rest moves and stops.

    Raises:
        NotGentle: None is.
        ActuationError: Nothing drives one of the quasi-velocities.
    """
    reason, course = "", course or Course()
    for pace in PACES:
        plan = _plan_at_pace(dynamics, course, pace)
        reason = _why_not_gentle(dynamics, contacts, plan)
        if not reason:
            return plan
    raise NotGentle(f"even {PACES[-1] * TOP_SPEED:.2g} m/s is not gentle: {reason}")


def _hold(dynamics: ReducedDynamics, q: Array) -> Array:
    """Return the efforts (n_act,) that hold a robot at q (nq,)."""
    still = np.zeros(dynamics.robot.dof)
    return dynamics.efforts(q, dynamics.inverse(q, still, still))


def rest_plan(dynamics: ReducedDynamics, q: Array) -> ContactPlan:
    """Return the plan of a robot that stays at q (nq,)."""
    robot = dynamics.robot
    try:
        hold = _hold(dynamics, q)
    except ActuationError:  # what nothing drives hangs as it likes
        hold = np.zeros(len(robot.actuators))
    return _plan(dynamics, hold, [q], [np.zeros(robot.nv)], [hold])


def _plan(
    dynamics: ReducedDynamics, hold: Array, q: list[Array], v: list[Array], tau: list[Array]
) -> ContactPlan:
    """Return the plan of a motion; a servo holds the joints whose rates are quasi-velocities."""
    robot, count = dynamics.robot, len(q)
    speeds = robot.quasi_velocities
    servoed = tuple(k for k, name in enumerate(robot.actuators) if name in speeds)
    names = tuple(robot.actuators[k] for k in servoed)
    index = [robot.velocity_index(name) for name in names]
    positions = np.array([[robot.joint_position(at, name) for name in names] for at in q])
    rates = np.array(v)[:, index]
    return ContactPlan(
        q=np.array(q),
        v=np.array(v),
        tau=np.array(tau),
        hold=hold,
        servoed=servoed,
        names=names,
        targets=(positions.reshape(count, len(names)), rates.reshape(count, len(names))),
        inertia=np.array([felt_inertia(dynamics, at, names) for at in q]),
    )


def start(robot: Robot, twist: Array | None = None) -> Array:
    """Return where a motion starts (nq,), at the origin: the arm at home, casters trailing.

    Args:
        robot: The robot.
        twist: Twist of P (3,) that its wheels are steered for, of any length; None: straight ahead,
            what steers at 0.
    """
    drive = robot.drive
    root = robot.root_velocity @ (AHEAD if twist is None else twist)
    joints = dict(zip(robot.joint_names, robot.home, strict=True))
    if twist is not None and drive.steered:
        steering = steer(drive, np.vstack([root, np.zeros((2, 3))]))[0]
        joints |= zip((swivel.joint for swivel in drive.steered), steering.tolist(), strict=True)
    casters = [swivel for swivel in drive.swivels if swivel.trails]
    trailing = trailing_positions(drive, root, casters)
    joints |= zip((swivel.joint for swivel in casters), trailing.tolist(), strict=True)
    return robot.configuration(joints=joints)


def _plan_at_pace(dynamics: ReducedDynamics, course: Course, pace: float) -> ContactPlan:
    """Return the motion at a pace."""
    robot, tick_s = dynamics.robot, course.tick
    count = round(course.duration / tick_s)
    size = _amplitudes(robot, course, pace)
    rising = np.array([name in ("v", "vx", "vy") for name in robot.quasi_velocities])
    q, v, tau = [start(robot)], [np.zeros(robot.nv)], []
    for tick in range(count):
        nu, nu_dot = course.speeds((tick + 0.5) * tick_s, size, rising)
        ahead = pin.integrate(robot.model, q[-1], 0.5 * tick_s * (dynamics.basis(q[-1]) @ nu))
        velocity = dynamics.basis(ahead) @ nu
        tau.append(dynamics.efforts(ahead, dynamics.inverse(ahead, nu, nu_dot)))
        q.append(pin.integrate(robot.model, q[-1], tick_s * velocity))
        v.append(dynamics.basis(q[-1]) @ course.speeds((tick + 1) * tick_s, size, rising)[0])
    return _plan(dynamics, _hold(dynamics, q[0]), q, v, tau)


def _amplitudes(robot: Robot, course: Course, pace: float) -> Array:
    """Return how much of each quasi-velocity the motion has (dof,): see :class:`Course`."""
    drive = robot.drive
    speed = {"v": TOP_SPEED, "vx": TOP_SPEED, "vy": SIDEWAYS_RATIO * TOP_SPEED, "omega": BASE_TURN}
    size = {name: pace * value for name, value in speed.items()}
    if drive.type == "skid-steer":  # it turns by scrubbing, which the reduced model leaves out
        return np.array([size["v"] if name == "v" else 0.0 for name in robot.quasi_velocities])
    for k, swivel in enumerate(drive.steered):
        joint = robot.description.joint[swivel.joint]
        most = min(MAX_STEERING, 0.5 * joint.upper, -0.5 * joint.lower)
        size[swivel.joint] = min(most, _max_stroke(joint, course)) * (-0.5) ** k
    for joint, home in zip(robot.joints, robot.home, strict=True):
        size[joint.name] = _stroke(joint, course, float(home))
    return np.array([size[name] for name in robot.quasi_velocities])


def _stroke(joint: Joint, course: Course, home: float) -> float:
    """Return how far an arm's joint moves, towards the wider side of its range."""
    stroke = ARM_STROKE_M if joint.kind == "prismatic" else ARM_STROKE
    below, above = home - joint.lower, joint.upper - home
    if math.isfinite(below + above):
        stroke = min(stroke, 0.1 * (below + above))
    stroke = min(stroke, _max_stroke(joint, course))
    return stroke if above >= below else -stroke


def _max_stroke(joint: Joint, course: Course) -> float:
    """Return how far a joint gets by the course's pulse."""
    return MAX_MOTOR_RATIO * joint.velocity / course.peak


def felt_inertia(dynamics: ReducedDynamics, q: Array, names: tuple[str, ...]) -> Array:
    """Return the inertia (n_held, n_held) that the servo's joints feel, all others free.

    Args:
        dynamics: The reduced dynamics.
        q: Configuration (nq,).
        names: The joints, whose rates are quasi-velocities.
    """
    speeds = dynamics.robot.quasi_velocities
    own = [speeds.index(name) for name in names]
    return np.linalg.inv(np.linalg.inv(dynamics.inertia(q))[np.ix_(own, own)])


def _why_not_gentle(dynamics: ReducedDynamics, contacts: Contacts, plan: ContactPlan) -> str:
    """Return why a motion exceeds effort, speed or grip limits; empty if it does not."""
    robot = dynamics.robot
    for k, name in enumerate(robot.actuators):
        if k in plan.servoed:
            continue
        motor, efforts = robot.description.joint[name], plan.tau[:, k]
        speeds = plan.v[:, robot.velocity_index(name)]
        if np.abs(efforts).max() > MAX_MOTOR_RATIO * motor.effort:
            return f"{name} needs {np.abs(efforts).max():.3g} of {motor.effort:.3g} N·m"
        if np.abs(speeds).max() > MAX_MOTOR_RATIO * motor.velocity:
            return f"{name} needs {np.abs(speeds).max():.3g} of {motor.velocity:.3g} rad/s"
    for tick in range(0, len(plan.tau), TICKS_PER_CHECK):
        q, v = plan.q[tick], plan.v[tick]
        nu = np.linalg.lstsq(dynamics.basis(q), v, rcond=None)[0]
        ground = ground_reaction(dynamics, contacts, q, nu, plan.tau[tick])
        if ground.tip_margin is None or ground.tip_margin <= 0.0:
            return "it tips"
        grip = float(ground.slip_ratio.max(initial=0.0))
        if grip > MAX_GRIP_RATIO:
            name = contacts.names[int(ground.slip_ratio.argmax())]
            return f"{name} needs {100.0 * grip:.0f} % of its grip"
    return ""
