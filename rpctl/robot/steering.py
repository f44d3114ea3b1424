"""The planar geometry of steered wheels: one centre of rotation, on every wheel's axle.

Vectors of the base are (x, y, turn): velocities of the root link in its own axes. A wheel that
stands at p and heads along d(φ) = (cos φ, sin φ) has the lateral row l and the rolling row k,

    l·T = 0,   l = (n, n·(ẑ × p)),   k = (d, d·(ẑ × p)),   n = ẑ × d,

so l′ = −k and k′ = l by φ. Two lateral rows leave one twist, along N = l₁ × l₂, and every further
wheel has to head along the velocity that N gives its place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from rpctl.description.records import Array, Joint
from rpctl.robot.drive import Drive, Swivel

STEEP = 1.3  # rad; nearer to a right angle steering is not asked to go
REGULAR = 0.1  # of 1: steering nearer to a singular one is not drawn at random


def rolling_row(pivot: tuple[float, float], angle: float) -> Array:
    """Return k (3,) of a wheel at ``pivot`` (m) that heads along ``angle`` (rad)."""
    x, y = pivot
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([cos, sin, sin * x - cos * y])


def lateral_row(pivot: tuple[float, float], angle: float) -> Array:
    """Return l (3,) of a wheel at ``pivot`` (m) that heads along ``angle`` (rad)."""
    return rolling_row(pivot, angle + 0.5 * math.pi)


def angle_of(swivel: Swivel, position: float) -> float:
    """Return the rolling direction (rad) in the root link's frame at a joint position (rad)."""
    return swivel.heading + swivel.sign * position


def free_twist(drive: Drive, positions: Mapping[str, float]) -> Array:
    """Return N (3,): the twist that the steering leaves, of no particular length.

    Args:
        drive: A drive with steered wheels.
        positions: Positions of the steered joints, rad; 0 for those left out.
    """
    rows = [lateral_row(drive.point, drive.heading)] if drive.has_axle else []
    for swivel in drive.steered:
        row = lateral_row(swivel.pivot, angle_of(swivel, positions.get(swivel.joint, 0.0)))
        if swivel.shares is None:
            rows.append(row)
        else:
            rows[-1] = rows[-1] + row
    return np.cross(rows[0], rows[1])


def heading_along(swivel: Swivel, twist: Array) -> float:
    """Return the joint position (rad), within ±π/2 of 0, at which a swivel heads along a twist."""
    x, y = swivel.pivot
    angle = math.atan2(twist[1] + twist[2] * x, twist[0] - twist[2] * y)
    position = swivel.sign * (angle - swivel.heading)
    return position - math.pi * round(position / math.pi)


def follow(drive: Drive, positions: Mapping[str, float]) -> dict[str, float]:
    """Return the positions (rad) of the followers, given those of the steered joints."""
    if not drive.followers:
        return {}
    twist = free_twist(drive, positions)
    return {swivel.joint: heading_along(swivel, twist) for swivel in drive.followers}


def regular(drive: Drive, positions: Mapping[str, float]) -> bool:
    """Return whether steering is far from where it leaves no one motion, or more than one.

    The base's speed is that of P along the heading, or that of the first steered wheel along its
    own; N must not vanish, nor lie across it.
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
    return bool(abs(reach) > REGULAR * size * float(np.linalg.norm(scale * speed)))


def steer(drive: Drive, direction: Array) -> Array:
    """Return the steered joints' positions, rates and accelerations (3, n_steered) along a twist.

    Each wheel heads along the velocity V of its place, φ = atan2(V_y, V_x), so that
    φ̇ = V × V̇/|V|² and φ̈ = (V × V̈ − 2 φ̇ V·V̇)/|V|². A contact off the steering axis (trail k)
    turns a steady bend's angle by asin(k ω/|V|).

    Args:
        drive: A drive with steered wheels.
        direction: A twist of the root link of any length but zero, and its first two derivatives
            by time (3, 3).

    Returns:
        Positions within ±π/2 of 0, for heading back is heading along; rad, rad/s, rad/s².
    """
    found = np.zeros((3, len(drive.steered)))
    for column, swivel in zip(found.T, drive.steered, strict=True):
        x, y = swivel.pivot
        V, V_dot, V_ddot = ((d[0] - d[2] * y, d[1] + d[2] * x) for d in direction)
        square = max(V[0] ** 2 + V[1] ** 2, np.finfo(float).tiny)
        rate = (V[0] * V_dot[1] - V[1] * V_dot[0]) / square
        along = V[0] * V_dot[0] + V[1] * V_dot[1]
        bend = (V[0] * V_ddot[1] - V[1] * V_ddot[0] - 2.0 * rate * along) / square
        shift = swivel.trail * direction[0, 2] / math.sqrt(square)
        offset = swivel.sign * math.asin(min(1.0, max(-1.0, shift)))
        position = heading_along(swivel, direction[0]) + offset
        column[:] = position, swivel.sign * rate, swivel.sign * bend
    return found


def turning_radius(drive: Drive, joints: Mapping[str, Joint]) -> float:
    """Return the radius (m) of the tightest bend of P that the joints' limits let a base steer.

    0 where it turns on the spot, or where nothing limits the steering.

    Args:
        drive: The drive.
        joints: Joints by name.
    """
    if not (drive.has_axle and drive.steered):
        return 0.0
    ahead = np.array([math.cos(drive.heading), math.sin(drive.heading)])
    left = np.array([-ahead[1], ahead[0]])
    radii = []
    for swivel in drive.steered:
        joint, reach = joints[swivel.joint], np.subtract(swivel.pivot, drive.point)
        turn = swivel.sign * np.array([joint.lower, joint.upper]) + swivel.heading - drive.heading
        limit = min(float(np.abs(turn).min()), STEEP)
        radii.append(abs(float(reach @ ahead)) / math.tan(limit) + abs(float(reach @ left)))
    return max(radii)
