"""The planar geometry of steered wheels: one centre of rotation, on every wheel's axle.

Twists and rows are those of :mod:`rpctl.drive.rows`. Two lateral rows leave one twist, along
N = l₁ × l₂, and every further wheel has to head along the velocity that N gives its place.
"""

from __future__ import annotations

import math as numbers
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.description.records import Joint
from rpctl.drive.drive import Drive, Swivel
from rpctl.drive.rows import (
    PLANAR,
    angle_of,
    lateral_row,
    rolling_row,
    swivel_motion,
    unit_ahead,
    unit_left,
)
from rpctl.kernels.scalars import rounded
from rpctl.kernels.sheet import Evaluator, Sheet

NEWTON_STEPS = 4  # steps to the angle of wheels that mimic one another; quadratic from near
TURN = 2.0 * numbers.pi
MIN_SPEED = 1e-12  # m/s: a place that stands still has no heading
LEADER_SAMPLES = 251  # positions of a leader to each side at which its followers are looked at
MAX_FOLLOWER_JUMP = 0.5  # rad; no follower turns so far between two of them
MAX_STEERING = 1.3  # rad; nearer to a right angle steering is not asked to go
SINGULARITY_MARGIN = 0.1  # of 1: steering nearer to a singular one is not drawn at random


Positions = Mapping[str, Any]  # of joints by name, rad: numbers, or arrays (K,) of K instants


def free_twist(drive: Drive, positions: Positions) -> Array:
    """Return N (3, ...): the twist that the steering leaves, of no particular length.

    Args:
        positions: Positions of the steered joints, rad, numbers or arrays; 0 for those left out.
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
    (a, b, c), (x, y, z) = (row.T for row in rows.values())
    return np.array(
        [b * z - c * y, c * x - a * z, a * y - b * x]
    )  # NumPy's takes ten times as long


def heading_along(swivel: Swivel, twist: Array) -> Any:
    """Return the joint positions (rad), within ±π/2 of 0, along which a swivel heads by twists.

    Args:
        swivel: The swivel.
        twist: Twists of the root link (3, ...), of any length.
    """
    x, y = swivel.pivot
    angle = np.arctan2(twist[1] + twist[2] * x, twist[0] - twist[2] * y)
    position = swivel.sign * (angle - swivel.heading)
    return position - numbers.pi * np.rint(position / numbers.pi)


def follower_positions(drive: Drive, positions: Positions) -> dict[str, Any]:
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
    size = max(numbers.dist(drive.point, swivel.pivot) for swivel in drive.steered)
    scale = np.array([1.0, 1.0, 1.0 / size])
    first, speed = drive.steered[0], rolling_row(drive.point, drive.heading)
    if not drive.has_axle:
        speed = rolling_row(first.pivot, angle_of(first, positions.get(first.joint, 0.0)))
    reach = free_twist(drive, positions) @ speed
    return bool(abs(reach) > SINGULARITY_MARGIN * size * float(np.linalg.norm(scale * speed)))


def steer(drive: Drive, direction: Array) -> Array:
    """Return the steered joints' positions, rates and accelerations along twists.

    Args:
        direction: A twist of the root link of any length but zero, and its first two derivatives
            by time (..., 3, 3).

    Returns:
        (..., 3, n_steered), positions within ±π/2 of 0, for heading back is heading along; rad,
        rad/s, rad/s².
    """
    function, evaluator = _steering_function(drive)
    if direction.ndim == 2:
        (found,) = evaluator(direction.ravel())
    else:
        found = function(direction.reshape(-1, direction[0].size).T).full().T
    return found.reshape(*direction.shape[:-1], len(drive.steered))


@lru_cache(maxsize=64)
def _steering_function(drive: Drive) -> tuple[Any, Evaluator]:
    sheet, column = Sheet(), math.SX.sym("direction", 9)
    twist, once, twice = math.vertsplit(column, [0, 3, 6, 9])
    for k in range(PLANAR):
        sheet.moves(twist[k], once[k])
        sheet.moves(once[k], twice[k])
    positions = steered_angles(sheet, drive, math.vertsplit(twist), "d")
    rates = [sheet.rate(each) for each in positions]
    whole = math.vertcat(*positions, *rates, *(sheet.rate(each) for each in rates))
    function = math.Function("steer", [column], sheet.resolved([whole]))
    return function, Evaluator(function)


def steered_angles(sheet: Sheet, drive: Drive, twist: Sequence[Any], mark: str) -> list[Any]:
    """Write the positions (n_steered,) of the steered joints along a twist, in scalars.

    With V the velocity of a wheel's place, its lateral row asks n·V = 0, so that the angle φ is
    V's; its rate follows from the row's own, φ̇ d·V = n·V̇. Swivels that mimic another one count
    along with it, each by its ratio. A contact off the steering axis (trail k) turns a steady
    bend's angle by asin(k ω/d·V).

    Args:
        sheet: Where to write.
        drive: The drive.
        twist: Of the root link (3,), of any length but zero.
        mark: What names begin with.
    """
    return [
        _steered_angle(sheet, drive, swivel, twist, f"{mark}{k}")
        for k, swivel in enumerate(drive.steered, start=1)
    ]


def _steered_angle(
    sheet: Sheet, drive: Drive, swivel: Swivel, twist: Sequence[Any], name: str
) -> Any:
    group = [s for s in drive.swivels if s.role == "mimic" and s.shares == swivel.joint]
    places = [(swivel, 1.0, 0.0), *((s, s.ratio, s.offset) for s in group)]
    V = [_pivot_velocity(sheet, s, twist, f"{name}_V{i}") for i, (s, *_) in enumerate(places)]
    turned = swivel.sign * (math.atan2(V[0][1], V[0][0]) - swivel.heading)
    turned = sheet.named(f"{name}_any", turned)
    position = turned - numbers.pi * rounded(turned / numbers.pi)
    for step in range(NEWTON_STEPS if group else 0):
        position = sheet.named(f"{name}_{step}", position)
        across, along = _rows(places, V, position)
        position = position + across * _safe_inverse(along)
    position = sheet.symbol(name, position)
    sheet.moves(position, 0.0)  # its rate follows from the row's
    across, along = _rows(places, V, position)
    inverse = sheet.named(f"{name}_inv", _safe_inverse(sheet.named(f"{name}_along", along)))
    sheet.moves(position, sheet.named(f"{name}_dot", sheet.rate(across) * inverse))
    if not swivel.trail:
        return position
    size = math.sqrt(math.fmax(V[0][0] ** 2 + V[0][1] ** 2, MIN_SPEED**2))
    faces = math.if_else(swivel.sign * along < 0.0, -1.0, 1.0)  # whether the wheels roll forward
    u = sheet.named(f"{name}_u", faces * swivel.trail * twist[2] / size)
    tight = math.fabs(u) >= 1.0  # the bend is tighter than the trail: no steady angle
    right = 0.5 * numbers.pi * math.sign(u)
    lag = math.if_else(tight, right, math.asin(math.if_else(tight, 0.0, u)))
    return sheet.named(f"{name}_lag", position + swivel.sign * lag)


def _pivot_velocity(sheet: Sheet, swivel: Swivel, twist: Sequence[Any], name: str) -> list[Any]:
    """Write the velocity (2,) of a swivel's pivot under a twist."""
    (x, y), (ahead, left, turn) = swivel.pivot, twist
    return [sheet.named(f"{name}x", ahead - turn * y), sheet.named(f"{name}y", left + turn * x)]


def _rows(
    places: Sequence[tuple[Swivel, float, float]], V: Sequence[Sequence[Any]], position: Any
) -> tuple[Any, Any]:
    """Return Σ n·V and −∂/∂φ of it, Σ g d·V, where swivel after swivel turns at g φ̇.

    Args:
        places: The swivels, each with its ratio to the position φ and its offset.
        V: Velocities of their pivots.
        position: φ, rad.
    """
    across, along = math.SX(0), math.SX(0)
    for (swivel, ratio, offset), (x, y) in zip(places, V, strict=True):
        angle = swivel.heading + swivel.sign * (ratio * position + offset)
        cos, sin = math.cos(angle), math.sin(angle)
        across += cos * y - sin * x
        along += swivel.sign * ratio * (cos * x + sin * y)
    return across, along


def _safe_inverse(value: Any) -> Any:
    """Return 1/value; 0 where a place as good as stands still, which keeps its angle."""
    moves = math.fabs(value) > MIN_SPEED
    return math.if_else(moves, 1.0 / math.if_else(moves, value, 1.0), 0.0)


def trailing_positions(
    drive: Drive, twist: Array, casters: Sequence[Swivel] | None = None
) -> Array:
    """Return the positions (..., n_casters) at which casters trail, rad.

    In steady motion along a twist a caster stands still: its contact, k behind its axis, lies
    asin(k ω/|V|) off the direction of its pivot's velocity V. In a bend tighter than its trail it
    never does, and a right angle is taken; where its pivot stands still, 0. So do trailers, each
    seen from what pulls it.

    Args:
        twist: Twists of the root link (..., 3), of any length.
        casters: Which; None: those whose joint or wheels have actuators.
    """
    positions, turning = np.zeros((*twist.shape[:-1], len(drive.swivels))), twist[..., 2]
    for i, swivel in enumerate(drive.swivels):
        if swivel.trails:
            motion = swivel_motion(drive, swivel)
            angles = positions @ motion.G.T + swivel.heading  # of what pulls it: it is at 0
            waves = np.stack([np.cos(angles), np.sin(angles)], axis=-2)
            ahead, left = (  # the speeds of its pivot, seen along its heading at 0
                np.einsum("...ak,akc,...c->...", waves, factors[..., :PLANAR], twist)
                for factors in (motion.forward, motion.leftward)
            )
            speed = np.maximum(np.hypot(ahead, left), MIN_SPEED)
            lag = np.arcsin(np.clip(-swivel.trail * turning / speed, -1.0, 1.0))
            turn = np.arctan2(left, ahead) - lag
            turn -= TURN * np.rint(turn / TURN)
            positions[..., i] = np.where(speed > MIN_SPEED, swivel.sign * turn, 0.0)
    wanted = drive.powered_casters if casters is None else casters
    return positions[..., [drive.swivels.index(swivel) for swivel in wanted]]


def turning_radius(drive: Drive, joints: Mapping[str, Joint]) -> float:
    """Return the radius (m) of the tightest bend of P that the joints' limits let a base steer.

    0 where it turns on the spot, or where nothing limits the steering.

    Args:
        joints: Joints by name.
    """
    return heading_radius(drive, joints) if drive.has_axle else 0.0


def heading_radius(drive: Drive, joints: Mapping[str, Joint]) -> float:
    """Return the radius (m) of the tightest bend along which a base can head, P on it.

    That of :func:`turning_radius`; a base whose wheels all steer can turn more sharply, too, but
    then a wheel inside of the bend turns past a right angle, and counts from behind. 0 where
    nothing steers.

    Args:
        joints: Joints by name.
    """
    axes, radii = np.array([unit_ahead(drive.heading), unit_left(drive.heading)]), []
    for swivel in drive.swivels:
        if swivel.trails or (drive.has_axle and swivel.role != "steered"):
            continue
        joint = joints[swivel.joint]
        turn = swivel.sign * np.array([joint.lower, joint.upper]) + swivel.heading - drive.heading
        limit = min(float(np.abs(turn).min()), MAX_STEERING)
        ahead, beside = (axes @ np.subtract(swivel.pivot, drive.point)).tolist()
        along = abs(ahead * numbers.cos(limit) + swivel.trail)
        radii.append(along / numbers.sin(limit) + abs(beside))
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
        for swivel in drive.followers:
            follower = joints[swivel.joint]
            places = [
                _allowed_branch(
                    drive, own[0].name, follower, bound * np.linspace(0.0, 1.0, LEADER_SAMPLES)
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
