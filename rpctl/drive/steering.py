"""The planar geometry of steered wheels: one centre of rotation, on every wheel's axle.

Twists and rows are those of :mod:`rpctl.drive.rows`. Two lateral rows leave one twist, along
N = l₁ × l₂, and every further wheel has to head along the velocity that N gives its place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.drive.drive import Drive, Swivel
from rpctl.drive.rows import angle_of, lateral_row, rolling_row

NEWTON_STEPS = 4  # steps to the angle of wheels that mimic one another; quadratic from near
MIN_SPEED = 1e-12  # m/s: a place that stands still has no heading
LEADER_SAMPLES = 251  # positions of a leader to each side at which its followers are looked at
MAX_FOLLOWER_JUMP = 0.5  # rad; no follower turns so far between two of them
MAX_STEERING = 1.3  # rad; nearer to a right angle steering is not asked to go
SINGULARITY_MARGIN = 0.1  # of 1: steering nearer to a singular one is not drawn at random


def free_twist(drive: Drive, positions: Mapping[str, float]) -> Array:
    """Return N (3,): the twist that the steering leaves, of no particular length.

    Args:
        positions: Positions of the steered joints, rad; 0 for those left out.
    """
    rows = {"": lateral_row(drive.point, drive.heading)} if drive.has_axle else {}
    for swivel in drive.swivels:
        if swivel.role not in ("steered", "mimic"):
            continue
        leader = swivel.joint if swivel.shares is None else swivel.shares
        followed = leader if swivel.role == "mimic" else swivel.joint
        position = swivel.ratio * positions.get(followed, 0.0) + swivel.offset
        row = lateral_row(swivel.pivot, angle_of(swivel, position))
        rows[leader] = rows[leader] + row if leader in rows else row
    (a, b, c), (x, y, z) = (row.tolist() for row in rows.values())
    return np.array(
        [b * z - c * y, c * x - a * z, a * y - b * x]
    )  # NumPy's takes ten times as long


def heading_along(swivel: Swivel, twist: Array) -> float:
    """Return the joint position (rad), within ±π/2 of 0, at which a swivel heads along a twist."""
    x, y = swivel.pivot
    angle = math.atan2(twist[1] + twist[2] * x, twist[0] - twist[2] * y)
    position = swivel.sign * (angle - swivel.heading)
    return position - math.pi * round(position / math.pi)


def follower_positions(drive: Drive, positions: Mapping[str, float]) -> dict[str, float]:
    """Return the positions (rad) of the followers, given those of the steered joints."""
    if not drive.followers:
        return {}
    twist = free_twist(drive, positions)
    return {swivel.joint: heading_along(swivel, twist) for swivel in drive.followers}


def is_regular(drive: Drive, positions: Mapping[str, float]) -> bool:
    """Return whether the steering angles are far from singular ones.

    At a singular steering the base's speed (that of P along the heading, or that of the first
    steered wheel along its own) does not fix its motion: N vanishes, or lies across that speed.

    Args:
        positions: Positions of the steered joints, rad; 0 for those left out.
    """
    if not drive.steered:
        return True
    size = max(math.dist(drive.point, swivel.pivot) for swivel in drive.steered)
    scale = np.array([1.0, 1.0, 1.0 / size])
    first = drive.steered[0]
    speed = rolling_row(drive.point, drive.heading)
    if not drive.has_axle:
        speed = rolling_row(first.pivot, angle_of(first, positions.get(first.joint, 0.0)))
    reach = free_twist(drive, positions) @ speed
    return bool(abs(reach) > SINGULARITY_MARGIN * size * float(np.linalg.norm(scale * speed)))


def steer(drive: Drive, direction: Array) -> Array:
    """Return the steered joints' positions, rates and accelerations (3, n_steered) along a twist.

    With V the velocity of a wheel's place, its lateral row asks n·V = 0, so that the angle φ is
    V's; differentiated, φ̇ d·V = n·V̇ and φ̈ d·V = n·V̈ − 2 φ̇ d·V̇ − φ̇² n·V. Swivels that mimic
    another one count along with it, each by its ratio. A contact off the steering axis (trail k)
    turns a steady bend's angle by asin(k ω/|V|).

    Args:
        direction: A twist of the root link of any length but zero, and its first two derivatives
            by time (3, 3).

    Returns:
        Positions within ±π/2 of 0, for heading back is heading along; rad, rad/s, rad/s².
    """
    found = np.zeros((3, len(drive.steered)))
    for column, swivel in zip(found.T, drive.steered, strict=True):
        group = [s for s in drive.swivels if s.role == "mimic" and s.shares == swivel.joint]
        places = [(swivel, 1.0, 0.0), *((s, s.ratio, s.offset) for s in group)]
        position = heading_along(swivel, direction[0])
        for _ in range(NEWTON_STEPS if group else 0):
            position += _newton_step(places, direction, position)[0]
        _, *rates = _newton_step(places, direction, position)
        column[:] = position, *rates
        if swivel.trail:
            column += swivel.sign * _caster_angle(swivel, direction)
    return found


def _pivot_velocities(swivel: Swivel, direction: Array) -> Array:
    """Return the velocity of a swivel's pivot under a twist, and its derivatives (3, 2)."""
    (x, y), turn = swivel.pivot, direction[:, 2]
    return np.column_stack([direction[:, 0] - turn * y, direction[:, 1] + turn * x])


def _caster_angle(swivel: Swivel, direction: Array) -> Array:
    """Return asin(k ω/|V|) of a swivel with trail k, and its first two derivatives (3,)."""
    V, turn = _pivot_velocities(swivel, direction), direction[:, 2]
    size = max(float(np.linalg.norm(V[0])), MIN_SPEED)
    pace, spread = V[0] @ V[1] / size**2, (V[1] @ V[1] + V[0] @ V[2]) / size**2
    u = swivel.trail * turn[0] / size
    u_dot = swivel.trail * turn[1] / size - u * pace
    u_ddot = swivel.trail * (turn[2] - turn[1] * pace) / size - u_dot * pace
    u_ddot -= u * (spread - 2.0 * pace**2)
    if abs(u) >= 1.0:  # the bend is tighter than the trail: no steady angle
        return np.array([math.copysign(0.5 * math.pi, u), 0.0, 0.0])
    level = 1.0 / math.sqrt(1.0 - u**2)
    return np.array([math.asin(u), level * u_dot, level * u_ddot + level**3 * u * u_dot**2])


def trailing_positions(
    drive: Drive, twist: Array, casters: Sequence[Swivel] | None = None
) -> Array:
    """Return the positions (n_casters,) at which casters trail, rad.

    In steady motion along a twist a caster stands still: its contact, k behind its axis, lies
    asin(k ω/|V|) off the direction of its pivot's velocity V. In a bend tighter than its trail it
    never does, and a right angle is taken; where its pivot stands still, 0.

    Args:
        twist: Twist of the root link (3,), of any length.
        casters: Which; None: those whose joint or wheels have actuators.
    """
    positions = []
    for swivel in drive.powered_casters if casters is None else casters:
        (x, y), position = swivel.pivot, 0.0
        V = np.array([twist[0] - twist[2] * y, twist[1] + twist[2] * x])
        speed = math.hypot(*V)
        if speed > MIN_SPEED:
            lag = math.asin(max(-1.0, min(1.0, -swivel.trail * twist[2] / speed)))
            turn = math.atan2(V[1], V[0]) - lag - swivel.heading
            position = swivel.sign * math.remainder(turn, 2.0 * math.pi)
        positions.append(position)
    return np.array(positions)


def _newton_step(
    places: list[tuple[Swivel, float, float]], direction: Array, position: float
) -> tuple[float, float, float]:
    """Return Newton's step of a steered position, its rate and its acceleration.

    ``places`` are the swivels that turn with it, each with its ratio and offset.
    """
    rows, second = np.zeros((3, 2)), 0.0  # Σ n·V⁽ⁱ⁾ and Σ g d·V⁽ⁱ⁾ with φ̇ = g δ̇; Σ g² n·V
    for swivel, ratio, offset in places:
        gain = swivel.sign * ratio
        angle = angle_of(swivel, ratio * position + offset)
        cos, sin = math.cos(angle), math.sin(angle)
        V = _pivot_velocities(swivel, direction)
        across, along = V @ [-sin, cos], V @ [cos, sin]
        rows += np.column_stack([across, gain * along])
        second += gain**2 * across[0]
    derivative = rows[0, 1] if abs(rows[0, 1]) > MIN_SPEED else math.inf
    rate = rows[1, 0] / derivative
    bend = (rows[2, 0] - 2.0 * rate * rows[1, 1] - rate**2 * second) / derivative
    return rows[0, 0] / derivative, rate, bend


def turning_radius(drive: Drive, joints: Mapping[str, Joint]) -> float:
    """Return the radius (m) of the tightest bend of P that the joints' limits let a base steer.

    0 where it turns on the spot, or where nothing limits the steering.

    Args:
        joints: Joints by name.
    """
    if not (drive.has_axle and drive.steered):
        return 0.0
    return _tightest_bend(drive, joints, drive.steered)


def heading_radius(drive: Drive, joints: Mapping[str, Joint]) -> float:
    """Return the radius (m) of the tightest bend along which a base can head, P on it.

    That of :func:`turning_radius`; a base whose wheels all steer can turn more sharply, too, but
    then a wheel inside of the bend turns past a right angle, and counts from behind. 0 where
    nothing steers.

    Args:
        joints: Joints by name.
    """
    swivels = [swivel for swivel in drive.swivels if swivel.role != "caster"]
    return _tightest_bend(drive, joints, drive.steered if drive.has_axle else swivels)


def _tightest_bend(drive: Drive, joints: Mapping[str, Joint], swivels: Sequence[Swivel]) -> float:
    """Return the radius (m) of P's tightest bend within the limits of swivels; 0 without any."""
    ahead = np.array([math.cos(drive.heading), math.sin(drive.heading)])
    left = np.array([-ahead[1], ahead[0]])
    radii = []
    for swivel in swivels:
        joint, reach = joints[swivel.joint], np.subtract(swivel.pivot, drive.point)
        turn = swivel.sign * np.array([joint.lower, joint.upper]) + swivel.heading - drive.heading
        limit = min(float(np.abs(turn).min()), MAX_STEERING)
        radii.append(abs(float(reach @ ahead)) / math.tan(limit) + abs(float(reach @ left)))
    return max(radii, default=0.0)


class SteeringLimits(NamedTuple):
    """Limits of the steered joints that keep their followers within theirs, too."""

    lower: Array  # (n_steered,) rad
    upper: Array  # (n_steered,) rad
    fastest: Array  # (n_steered,) rad/s


def steering_limits(drive: Drive, joints: Mapping[str, Joint]) -> SteeringLimits:
    """Return the limits of the steered joints, tightened so that followers keep theirs.

    With one leader and a fixed axle, each follower is a function of it, sampled over its range.
    Followers of two leaders keep to their own limits only.

    Args:
        joints: Joints by name.
    """
    own = [joints[swivel.joint] for swivel in drive.steered]
    lower, upper, fastest = (
        np.array([getattr(joint, name) for joint in own]) for name in ("lower", "upper", "velocity")
    )
    if len(own) == 1 and drive.has_axle and drive.followers:
        (name,) = (joint.name for joint in own)
        for swivel in drive.followers:
            follower = joints[swivel.joint]
            places = [
                _allowed_branch(
                    drive, name, follower, bound * np.linspace(0.0, 1.0, LEADER_SAMPLES)
                )
                for bound in (max(lower[0], -MAX_STEERING), min(upper[0], MAX_STEERING))
            ]
            lower[0], upper[0] = (leader[-1] for leader, _ in places)
            gains = [np.diff(turned) / np.diff(leader) for leader, turned in places]
            gain = max(float(np.abs(each).max(initial=1.0)) for each in gains)
            fastest[0] = min(fastest[0], follower.velocity / gain)
    return SteeringLimits(lower, upper, fastest)


def _allowed_branch(drive: Drive, leader: str, follower: Joint, grid: Array) -> tuple[Array, Array]:
    """Return the leader's positions at which a follower keeps its limits, and the follower's.

    Args:
        grid: Positions of the leader, from 0 outwards, rad.
    """
    turned = np.array([follower_positions(drive, {leader: x})[follower.name] for x in grid])
    broken = (turned < follower.lower) | (turned > follower.upper)
    broken[1:] |= (
        np.abs(np.diff(turned)) > MAX_FOLLOWER_JUMP
    )  # beyond a right angle it counts from behind
    end = int(np.argmax(broken)) if broken.any() else len(grid)
    return grid[: max(end, 1)], turned[: max(end, 1)]
