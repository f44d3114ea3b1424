"""How much of a robot's limits a reference takes: rates of wheels and joints, and efforts."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Swivel
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.quasi_velocities import (
    configuration_along,
    configurations,
    reference_rates,
)
from rpctl.robot.model import Robot


class MotionSample(NamedTuple):
    """The motion that a reference asks of a robot at one time."""

    q: Array  # (nq,)
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)
    twist: Array  # (3,) of the root link in its own axes, m/s, m/s, rad/s


class Usage(NamedTuple):
    """The largest share of one limit that a motion takes.

    Of an effort, it is the share of what holding the robot still leaves of the limit.
    """

    joint: str
    quantity: str  # "velocity" or "effort"
    limit: float  # of the joint, in its unit
    ratio: float

    def text(self, robot: Robot) -> str:
        """Return the limit in words, as ``wheel_left_joint's 3.5 rad/s``."""
        straight = robot.description.joint[self.joint].kind == "prismatic"
        units = {"velocity": ("rad/s", "m/s"), "effort": ("N m", "N")}
        return f"{self.joint}'s {self.limit:.3g} {units[self.quantity][straight]}"


def sample(
    robot: Robot, reference: Reference, times: Sequence[float] | Array
) -> list[MotionSample]:
    """Return the motion that a reference asks for.

    Args:
        robot: The robot.
        reference: The reference; at several times it takes them as an array.
        times: When, s.
    """
    if len(times) > 1 and not (robot.drive.steered or robot.drive.powered_casters):
        at_once: Any = reference
        state: ReferenceState = at_once(np.array(times))
        q = configurations(robot, state.pose, state.joints)
        twists = state.twist @ robot.root_velocity.T
        rows = zip(q, *reference_rates(robot, state), twists, strict=True)
        return [MotionSample(*row) for row in rows]
    found = []
    for t in times:
        state = reference(float(t))
        q = configuration_along(robot, state)
        twist = robot.root_velocity @ state.twist
        found.append(MotionSample(q, *reference_rates(robot, state), twist))
    return found


def rate_usage(
    dynamics: ReducedDynamics, samples: Sequence[MotionSample], joints: Collection[str]
) -> list[Usage]:
    """Return how much of their velocity limits joints take; those without a limit are left out.

    Args:
        dynamics: The robot's dynamics.
        samples: The motion.
        joints: Names of the joints to look at.
    """
    robot = dynamics.robot
    limits = {name: robot.description.joint[name].velocity for name in joints}
    limits = {name: limit for name, limit in limits.items() if math.isfinite(limit)}
    if not limits:
        return []
    rates = np.abs([dynamics.basis(at.q) @ at.nu for at in samples]).max(axis=0)
    trailing = _caster_rates(robot, np.array([at.twist for at in samples]))
    return [
        Usage(name, "velocity", limit, rate / limit)
        for name, limit in limits.items()
        for rate in [trailing.get(name, float(rates[robot.velocity_index(name)]))]
    ]


def _caster_rates(robot: Robot, twists: Array) -> dict[str, float]:
    """Return bounds of the rates (rad/s) of idle casters and their wheels, by joint.

    Such a caster's angle is no function of the reference: it may have to swing round first. With V
    the speed of its pivot and k its trail, it turns over the ground at V/k at most.

    Args:
        robot: The robot.
        twists: Twists of the root link (N, 3).
    """
    found = {}
    for swivel in robot.drive.idle_casters:
        speed, turning = _pivot_speeds(swivel, twists), np.abs(twists[:, 2])
        swing = speed / abs(swivel.trail)
        found[swivel.joint] = float((swing + turning).max())
        for wheel in (robot.drive.wheels[i] for i in robot.drive.carried(swivel)):
            rolling = (speed + abs(wheel.lateral) * swing) / wheel.radius
            found[wheel.joint] = float(rolling.max())
    return found


def _pivot_speeds(swivel: Swivel, twists: Array) -> Array:
    """Return the speeds (N,) of a swivel's pivot, m/s."""
    x, y = swivel.pivot
    return np.hypot(twists[:, 0] - twists[:, 2] * y, twists[:, 1] + twists[:, 2] * x)


def effort_usage(
    dynamics: ReducedDynamics, samples: Sequence[MotionSample], holding: Array
) -> list[Usage]:
    """Return how much of what holding and dry friction leave of the effort limits a motion takes.

    By the inverse dynamics, so gravity, inertia, damping and Coriolis forces count. Dry friction
    does not fall with the pace or the size of a motion: its largest effort comes off the limit.
    Actuators of which nothing is left are not looked at, nor are those without a limit.

    Args:
        dynamics: The robot's dynamics.
        samples: The motion.
        holding: Sizes of the efforts that hold the robot still: in one posture (n_act,), or where
            each sample has it (N, n_act).
    """
    robot = dynamics.robot
    limited = np.isfinite(robot.effort_limits)
    if not limited.any():
        return []
    tau = [dynamics.efforts(at.q, dynamics.inverse(at.q, at.nu, at.nu_dot)) for at in samples]
    dry = dry_friction(dynamics, samples)
    left = robot.effort_limits - holding - np.abs(dry).max(axis=0)
    usable = limited & (left > 0.0)
    share = np.where(usable, (np.abs(tau - dry) - holding) / np.where(usable, left, 1.0), 0.0)
    rows = zip(robot.actuators, robot.effort_limits, share.max(axis=0), strict=True)
    return [
        Usage(name, "effort", float(limit), float(ratio))
        for name, limit, ratio in rows
        if math.isfinite(limit)
    ]


def dry_friction(dynamics: ReducedDynamics, samples: Sequence[MotionSample]) -> Array:
    """Return the efforts (N, n_act) that dry friction alone takes at each sample."""
    robot, losses = dynamics.robot, dynamics.robot.losses
    if losses is None:
        return np.zeros((len(samples), len(robot.actuators)))
    dry, found = replace(losses, damping=np.zeros(len(losses.damping))), []
    for at in samples:
        S = dynamics.basis(at.q)
        found.append(dynamics.efforts(at.q, -S.T @ dry.force(S @ at.nu)))
    return np.array(found)


def holding_efforts(dynamics: ReducedDynamics, samples: Sequence[MotionSample]) -> Array:
    """Return the sizes of the efforts (N, n_act) that hold the robot still at each sample."""
    still = np.zeros(dynamics.robot.dof)
    return np.abs([dynamics.efforts(at.q, dynamics.inverse(at.q, still, still)) for at in samples])


def largest(usages: Iterable[Usage]) -> Usage | None:
    """Return the usage of the largest ratio, or None of none."""
    return max(usages, key=lambda usage: usage.ratio, default=None)


def base_joints(robot: Robot) -> list[str]:
    """Return the names of the joints that roll or turn with the base: wheels and swivels."""
    wheels = [wheel.joint for wheel in robot.drive.wheels]
    return wheels + [swivel.joint for swivel in robot.drive.swivels]
