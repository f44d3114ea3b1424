"""How much of a robot's limits a reference takes, and paces and swings that keep to a share."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import (
    FRICTION,
    Contacts,
    GroundReaction,
    find_contacts,
    ground_reactions,
)
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import ActuationError, listed
from rpctl.reference.motion import (
    Reference,
    ReferenceState,
    configurations,
    reference_rates,
    row_of,
    state_of,
    steering,
    trailing,
)
from rpctl.reference.path_reference import PathReference, TimedPath, Waves
from rpctl.reference.sizing import pivot_speeds
from rpctl.robot.model import Robot

LIMIT_SHARE = 0.5  # of each limit: what a default reference takes; the rest corrects errors
LIMIT_SHARE_TEXT = "half"
MAX_LISTED = 3  # joints that a sentence lists
STEP = 0.8  # factor by which an arm's motion is reduced until its efforts fit
MAX_STEPS = 24  # of reducing swings, to half a percent, and of slowing down
LAP_SAMPLES, RAMP_SAMPLES = 72, 7  # times at which a lap and its soft start are looked at
ARM_PERIODS = 5.0  # of its slowest wave: an arm's waves meet in most ways within it
TIMED_SAMPLES = 200  # times at which a planned reference is looked at
MAX_TIMED_STEPS = 6  # of slowing down a planned reference: its posture may leave little of a limit
MOVING_SHARE = 0.5 * LIMIT_SHARE  # of what holding leaves: what an arm's accelerations may take


Paced = TypeVar("Paced", PathReference, TimedPath)


class MotionSamples(NamedTuple):
    """The motion that a reference asks of a robot at N times."""

    q: Array  # (N, nq)
    nu: Array  # (N, dof)
    nu_dot: Array  # (N, dof)
    twist: Array  # (N, 3) of the root link in its own axes, m/s, m/s, rad/s

    @property
    def still(self) -> MotionSamples:
        """The same places, at rest."""
        return self._replace(nu=0.0 * self.nu, nu_dot=0.0 * self.nu_dot)


class Usage(NamedTuple):
    """The largest share of one limit that a motion takes.

    Of an effort and of the margin to tipping, it is the share of what holding the robot still
    leaves of the limit.
    """

    joint: str  # or the contact, of grip; nothing, of balance
    quantity: str  # "velocity", "effort", "grip" or "balance"
    limit: float  # of the joint, in its unit; a coefficient of friction; m
    ratio: float

    def text(self, robot: Robot) -> str:
        """Return the limit in words, as ``wheel_left_joint's 3.5 rad/s``."""
        if self.quantity == "grip":
            return f"{self.joint}'s grip at friction {self.limit:g}"
        if self.quantity == "balance":
            return f"its {self.limit:.3g} m to tipping"
        straight = robot.description.joint[self.joint].kind == "prismatic"
        units = {"velocity": ("rad/s", "m/s"), "effort": ("N m", "N")}
        return f"{self.joint}'s {self.limit:.3g} {units[self.quantity][straight]}"


def sample(robot: Robot, state: ReferenceState) -> MotionSamples:
    """Return the motion that a reference asks for at the rows of its state's arrays."""
    q = configurations(robot, state.pose, state.joints, steering(robot, state)[:, 0])
    for swivel, positions in zip(
        robot.drive.powered_casters, trailing(robot, state).T, strict=True
    ):
        robot.entries[swivel.joint].write_all(q, positions)
    return MotionSamples(q, *reference_rates(robot, state), state.twist @ robot.root_velocity.T)


def rate_usage(
    dynamics: ReducedDynamics, samples: MotionSamples, joints: Collection[str]
) -> list[Usage]:
    """Return how much of their velocity limits joints take; those without a limit are left out.

    Args:
        joints: Names of the joints to look at.
    """
    robot = dynamics.robot
    limits = {name: robot.description.joint[name].velocity for name in joints}
    limits = {name: limit for name, limit in limits.items() if math.isfinite(limit)}
    if not limits:
        return []
    rates = np.abs(velocities(dynamics, samples)).max(axis=0)
    trailing = _caster_rates(robot, samples.twist)
    return [
        Usage(name, "velocity", limit, rate / limit)
        for name, limit in limits.items()
        for rate in [trailing.get(name, float(rates[robot.velocity_index(name)]))]
    ]


def _caster_rates(robot: Robot, twists: Array) -> dict[str, float]:
    """Return bounds of the rates (rad/s) of idle casters, trailers and their wheels, by joint.

    Such a one's angle is no function of the reference: it may have to swing round first. With V
    the speed of its pivot and k its trail, it turns over the ground at V/k at most.

    Args:
        twists: Twists of the root link (N, 3).
    """
    found: dict[str, float] = {}
    turning: dict[str | None, Array] = {None: np.abs(twists[:, 2])}
    for swivel in robot.drive.idle_casters:
        speed = pivot_speeds(robot.drive, swivel, twists)
        swing = speed / abs(swivel.trail)
        turning[swivel.joint] = swing
        found[swivel.joint] = float((swing + turning.get(swivel.parent, turning[None])).max())
        for wheel in (robot.drive.wheels[i] for i in robot.drive.carried(swivel)):
            found[wheel.joint] = float(((speed + abs(wheel.lateral) * swing) / wheel.radius).max())
    return found


def effort_usage(dynamics: ReducedDynamics, samples: MotionSamples, holding: Array) -> list[Usage]:
    """Return how much of what holding and dry friction leave of the effort limits a motion takes.

    By the inverse dynamics, so gravity, inertia, damping and Coriolis forces count. Dry friction
    does not fall with the pace or the size of a motion: its largest effort comes off the limit.
    Actuators of which nothing is left are not looked at, nor are those without a limit.

    Args:
        holding: Sizes of the efforts that hold the robot still: in one posture (n_act,), or where
            each sample has it (N, n_act).
    """
    robot = dynamics.robot
    limited = np.isfinite(robot.effort_limits)
    if not limited.any():
        return []
    tau, dry = efforts(dynamics, samples), dry_friction(dynamics, samples)
    left = robot.effort_limits - holding - np.abs(dry).max(axis=0)
    usable = limited & (left > 0.0)
    share = np.where(usable, (np.abs(tau - dry) - holding) / np.where(usable, left, 1.0), 0.0)
    rows = zip(robot.actuators, robot.effort_limits, share.max(axis=0), strict=True)
    return [
        Usage(name, "effort", float(limit), float(ratio))
        for name, limit, ratio in rows
        if math.isfinite(limit)
    ]


def ground_usage(dynamics: ReducedDynamics, samples: MotionSamples) -> list[Usage]:
    """Return how much of its wheels' grip, and of its margin to tipping, a motion takes.

    Of the margin, it is how far the zero-moment point moves, wherever to; of the grip, it is that
    of the loads at rest, of equally stiff contacts. So both fall with the square of the pace. A
    robot that tips while it stands is not looked at: no pace would help it.
    """
    contacts = find_contacts(dynamics)
    if contacts is None or not contacts.balanced:
        return []
    rest, moving = (_ground(dynamics, contacts, each) for each in (samples.still, samples))
    if rest.tip_margin.min() <= 0.0:
        return []
    taken = np.linalg.norm(moving.arms[:, 0] - rest.arms[:, 0], axis=1) / rest.tip_margin
    worst = int(taken.argmax())
    wheels = slice(moving.slip_ratio.shape[1])
    floor = np.maximum(rest.load[:, wheels], contacts.floor)
    grip = moving.slip_ratio * np.maximum(moving.load[:, wheels], contacts.floor) / floor
    k, wheel = np.unravel_index(int(grip.argmax()), grip.shape)
    return [
        Usage("", "balance", float(rest.tip_margin[worst]), float(taken[worst])),
        Usage(contacts.names[wheel], "grip", FRICTION, float(grip[k, wheel])),
    ]


def _ground(
    dynamics: ReducedDynamics, contacts: Contacts, samples: MotionSamples
) -> GroundReaction:
    reactions = dynamics.reactions(samples.q, samples.nu, efforts(dynamics, samples))
    return ground_reactions(dynamics, contacts, samples.q, reactions)


def dry_friction(dynamics: ReducedDynamics, samples: MotionSamples) -> Array:
    """Return the efforts (N, n_act) that dry friction alone takes at each sample."""
    robot, losses = dynamics.robot, dynamics.robot.losses
    if losses is None:
        return np.zeros((len(samples.q), len(robot.actuators)))
    dry, found = replace(losses, damping=np.zeros(len(losses.damping))), []
    for q, v in zip(samples.q, velocities(dynamics, samples), strict=True):
        found.append(nearest_efforts(dynamics, q, -dynamics.basis(q).T @ dry.force(v)))
    return np.array(found)


def efforts(dynamics: ReducedDynamics, samples: MotionSamples) -> Array:
    """Return the efforts (N, n_act) of the actuators that a motion takes at each sample."""
    rows = zip(samples.q, samples.nu, samples.nu_dot, strict=True)
    return np.array(
        [nearest_efforts(dynamics, q, dynamics.inverse(q, *rates)) for q, *rates in rows]
    )


def nearest_efforts(dynamics: ReducedDynamics, q: Array, force: Array) -> Array:
    """Return τ (n_act,) of a quasi-force (dof,); of a robot that leans, all but what tilts it."""
    if not dynamics.robot.drive.leans:
        return dynamics.efforts(q, force)
    return np.asarray(np.linalg.lstsq(dynamics.actuation(q), force, rcond=None)[0])


def velocities(dynamics: ReducedDynamics, samples: MotionSamples) -> Array:
    """Return the velocities (N, nv) at each sample."""
    return np.array([dynamics.basis(q) @ nu for q, nu in zip(samples.q, samples.nu, strict=True)])


def holding_efforts(dynamics: ReducedDynamics, samples: MotionSamples) -> Array:
    """Return the sizes of the efforts (N, n_act) that hold the robot still at each sample."""
    return np.abs(efforts(dynamics, samples.still))


def largest(usages: Iterable[Usage]) -> Usage | None:
    """Return the usage of the largest ratio, or None of none."""
    return max(usages, key=lambda usage: usage.ratio, default=None)


def fit_arm(dynamics: ReducedDynamics, arm: Waves) -> tuple[Waves, str]:
    """Return an arm's motion within a share of what holding it at home leaves of the efforts.

    Returns:
        The motion, all its swings reduced by one factor where it needs that, and what for.
    """
    robot = dynamics.robot
    if not arm.amplitude.any() or not np.isfinite(robot.effort_limits).any():
        return arm, ""
    full = arm.amplitude
    times = np.linspace(0.0, ARM_PERIODS * 2.0 * math.pi / arm.rate.min(), LAP_SAMPLES)
    note = ""
    for step in range(MAX_STEPS + 1):
        factor = STEP**step if step < MAX_STEPS else 0.0
        arm = replace(arm, amplitude=factor * full)
        worst = _arm_usage(dynamics, sample(robot, PathReference(None, 0.0, arm, 0.0)(times)))
        if worst is None or worst.ratio <= LIMIT_SHARE:
            break
        note = f"{STEP * 100.0 * factor:.0f} % of its swing for {worst.text(robot)}"
    return arm, note


def _arm_usage(dynamics: ReducedDynamics, samples: MotionSamples) -> Usage | None:
    """Return the most that an arm's motion takes, relative to what it may.

    All of it counts against what holding leaves at the first sample, accelerations on their own
    against what holding leaves where the arm then is.
    """
    holding = _holding(dynamics, samples)
    gentle = [
        usage._replace(ratio=usage.ratio * LIMIT_SHARE / MOVING_SHARE)
        for usage in effort_usage(dynamics, samples, holding)
    ]
    return largest([*effort_usage(dynamics, samples, holding[0]), *gentle])


def _holding(dynamics: ReducedDynamics, samples: MotionSamples) -> Array:
    """Return what holds the robot still (N, n_act); inf for what is too weak for it at first."""
    holding = holding_efforts(dynamics, samples)
    holding[:, holding[0] >= dynamics.robot.effort_limits] = np.inf
    return holding


def too_weak(dynamics: ReducedDynamics, reference: Reference | None = None) -> str:
    """Return in words which actuator gravity overcomes, and what to do; empty if none.

    What nothing drives is none: the findings of the robot tell of it, and laws refuse it.

    Args:
        reference: Where it starts, the robot stands; None: at home.
    """
    robot = dynamics.robot
    none = np.zeros(len(robot.joints))
    at_home = ReferenceState(*[*np.zeros((3, 3)), robot.home, none, none])
    start = row_of(at_home if reference is None else reference(0.0))
    try:
        held = holding_efforts(dynamics, sample(robot, state_of(start[None])))[0]
    except ActuationError:
        return ""
    weak = [
        Usage(name, "effort", float(limit), float(effort / limit))
        for name, limit, effort in zip(robot.actuators, robot.effort_limits, held, strict=True)
        if effort >= limit
    ]
    worst = largest(weak)
    if worst is None:
        return ""
    unit = "N" if robot.description.joint[worst.joint].kind == "prismatic" else "N m"
    place = "at home" if reference is None else "where the reference starts"
    return (
        f"gravity {place} exceeds the effort limit of {worst.joint}: "
        f"{worst.ratio * worst.limit:.3g} of {worst.limit:.3g} {unit}; give another posture "
        "with --home, or a larger limit"
    )


def slow_down(dynamics: ReducedDynamics, reference: Paced) -> tuple[Paced, Usage | None]:
    """Return a reference at a pace that keeps to a share of all limits, and what slowed it down.

    What motion takes of an effort falls with the pace or with its square: by the root no step goes
    too far.
    """
    samples, bound = _samples(dynamics.robot, reference), None
    fast = largest(rate_usage(dynamics, samples, _watched(dynamics.robot, reference)))
    if fast is not None and fast.ratio > LIMIT_SHARE:
        reference, bound = reference.slowed(fast.ratio / LIMIT_SHARE), fast
        samples = _samples(dynamics.robot, reference)
    for _ in range(MAX_TIMED_STEPS if isinstance(reference, TimedPath) else MAX_STEPS):
        effort = _effort(dynamics, samples)
        if effort is None or effort.ratio <= LIMIT_SHARE:
            break
        factor = 1.0 / min(0.97, math.sqrt(LIMIT_SHARE / effort.ratio))
        reference, bound = reference.slowed(factor), effort
        samples = _samples(dynamics.robot, reference)
    return reference, bound


def usage_of(dynamics: ReducedDynamics, reference: PathReference | TimedPath) -> Usage | None:
    """Return the limit of which a reference takes the most, or None of a robot without limits."""
    samples = _samples(dynamics.robot, reference)
    rates = rate_usage(dynamics, samples, _watched(dynamics.robot, reference))
    effort = _effort(dynamics, samples)
    return largest([*rates, *([effort] if effort else [])])


def _watched(robot: Robot, reference: PathReference | TimedPath) -> Sequence[str]:
    """Return the joints whose rates count: those of the arm are those of its waves anyway."""
    if isinstance(reference, TimedPath):
        return robot.moving_joint_names
    wheels = [wheel.joint for wheel in robot.drive.wheels]
    return wheels + [swivel.joint for swivel in robot.drive.swivels]


def _samples(robot: Robot, reference: PathReference | TimedPath) -> MotionSamples:
    """Return the motion of a planned reference, or along the soft start and a lap."""
    if isinstance(reference, TimedPath):
        return sample(robot, reference(np.linspace(0.0, reference.duration, TIMED_SAMPLES)))
    ramp, end = reference.ramp, 0.5 * reference.ramp + reference.lap / reference.rate
    start = np.linspace(0.0, ramp, RAMP_SAMPLES, endpoint=False)
    return sample(robot, reference(np.append(start, np.linspace(ramp, end, LAP_SAMPLES))))


def _effort(dynamics: ReducedDynamics, samples: MotionSamples) -> Usage | None:
    """Return the most that a motion takes of what holding leaves, or of what the ground bears."""
    usages = effort_usage(dynamics, samples, _holding(dynamics, samples))
    return largest([*usages, *ground_usage(dynamics, samples)])


def reason(usage: Usage | None, robot: Robot, given: bool) -> str:
    """Return in words what set the speed.

    Args:
        usage: The limit of which the reference takes the most, if any.
        given: Whether the user gave the speed.
    """
    if usage is None:
        return "as given" if given else "a speed for a robot of its size"
    of = "what holding leaves of " if usage.quantity == "effort" else ""
    if given:
        return f"as given, {100.0 * usage.ratio:.0f} % of {of}{usage.text(robot)}"
    if usage.quantity == "velocity":
        return f"{LIMIT_SHARE_TEXT} of what {usage.text(robot)} allow"
    return f"{LIMIT_SHARE_TEXT} of {of}{usage.text(robot)}"


def assumptions(robot: Robot) -> str:
    """Return which limits the URDF lacks, and what was assumed for them, or nothing."""
    joints = [robot.description.joint[name] for name in robot.actuators]
    missing = {
        quantity: [joint.name for joint in joints if math.isinf(getattr(joint, quantity))]
        for quantity in ("velocity", "effort")
    }
    lacking = " and ".join(
        f"no {quantity} limit of {listed(names, MAX_LISTED)}"
        for quantity, names in missing.items()
        if names
    )
    if not lacking:
        return ""
    return f"the URDF has {lacking}; there, size alone sets the pace"
