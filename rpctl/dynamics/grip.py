"""Grip: whether friction can hold a motion, however wheels share the forces that it takes.

A wheel's force along its rolling direction follows from its own motor and inertia, unless a brake
locks it. How wheels share the sideways force of an axle does not, nor, beyond three contacts, how
contacts share the load. The wheels slide, as a whole, where no way to share holds each of them
within its circle |T| ≤ μ N: a convex program, solved by linear ones that cut the circles by
tangents. One wheel at the end of its grip slides nothing, as long as the others of its axle hold
what it cannot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # loads scipy.optimize, which takes long, at its first use

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, stance_at
from rpctl.dynamics.many_states import Reactions
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import UP
from rpctl.robot.coordinates import ROOT_JOINT

FIRST_TANGENTS = 16  # of each circle; more are added where the solution leaves it
CUTS = 6  # rounds of tangents: each round's gap is about the square of the one before
CUT_TOLERANCE = 1e-7  # of the weight: how far a solution may leave a circle
RANK_MARGIN = 1e-9  # of the largest singular value: wheels on one line share one sideways force
TINY = 1e-300  # stands for 0 where something is divided by it
MIN_TRAIL_M = 1e-6  # m: a swivel with a longer trail is turned by its wheels' sideways force


@dataclass(frozen=True)
class WheelForces:
    """Horizontal forces of the ground on a robot's wheels, and what is free of them.

    Each wheel has two: along the direction that its rolling holds, and to the left of it.

    Attributes:
        least: Those of least norm (n_wheels, 2), N.
        free: Map (n_wheels, 2, n_free) from what wheels may share as they like to forces.
    """

    least: Array
    free: Array


def wheel_forces(
    dynamics: ReducedDynamics,
    contacts: Contacts,
    q: Array,
    reactions: Reactions,
    locked: bool = False,
) -> WheelForces:
    """Return the horizontal forces of the ground on the wheels at one state.

    Args:
        dynamics: The reduced dynamics.
        contacts: The robot's contacts, balanced.
        q: Configuration (nq,).
        reactions: What the ground does, as of one state.
        locked: Whether brakes hold the driven wheels, so that they share what pushes along them,
            too; else their motors' efforts decide.
    """
    drive, rolling = dynamics.robot.drive, dynamics.rolling
    multipliers = dynamics.at(q).multipliers @ reactions.residual[0]
    count = len(drive.wheels)
    place = stance_at(dynamics, contacts, q).statics[1:, :count].T  # (n_wheels, 2)
    ahead = _rolling_directions(dynamics, q)
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    each, none = np.eye(count), np.zeros((count, count))
    rows = [np.hstack([_planar(place, ahead).T, _planar(place, left).T])]
    right = [reactions.wrench[0, [0, 1, 5]]]
    given = [k for k, wheel in enumerate(drive.wheels) if not (locked and wheel.driven)]
    rows.append(np.hstack([each, none])[given])
    right.append(multipliers[list(rolling.along)][given])
    trailing = {s.joint for s in drive.swivels if abs(s.trail) > MIN_TRAIL_M}
    able = np.zeros(count, dtype=bool)
    for row, shared in rolling.across:
        able[list(shared)] = True
        if drive.wheels[shared[0]].swivel in trailing:  # fixed by what turns the swivel
            rows.append(np.hstack([none, each])[list(shared)].sum(axis=0)[None])
            right.append(multipliers[row][None])
    able &= [not wheel.slides for wheel in drive.wheels]
    has = np.concatenate([np.ones(count, dtype=bool), able])
    U, singular, Vt = np.linalg.svd(np.vstack(rows)[:, has])
    rank = int((singular > RANK_MARGIN * singular.max(initial=TINY)).sum())
    least, free = np.zeros(2 * count), np.zeros((2 * count, Vt.shape[0] - rank))
    least[has] = Vt[:rank].T @ ((U[:, :rank].T @ np.concatenate(right)) / singular[:rank])
    free[has] = Vt[rank:].T
    return WheelForces(least.reshape(2, count).T, free.reshape(2, count, -1).swapaxes(0, 1))


def _planar(place: Array, direction: Array) -> Array:
    """Return unit forces along directions (n, 2) as planar wrenches (n, 3) about the origin."""
    (x, y), (dx, dy) = place.T, direction.T
    return np.column_stack([dx, dy, x * dy - y * dx])


def _rolling_directions(dynamics: ReducedDynamics, q: Array) -> Array:
    """Return where the rolling row of each wheel points (n_wheels, 2), root link's axes."""
    robot, data = dynamics.robot, dynamics.placements(q)
    root, found = data.oMi[ROOT_JOINT].rotation, []
    for wheel in robot.drive.wheels:
        direction = np.array(wheel.direction)
        if wheel.swivel is not None:
            joint = robot.model.getJointId(wheel.joint)
            ahead = root.T @ np.cross(data.oMi[joint].rotation @ np.array(wheel.axis), UP)
            direction = ahead[:2] / math.hypot(ahead[0], ahead[1])
            still = robot.tree.axis(robot.description.joint[wheel.joint])
            direction *= math.copysign(1.0, np.array(wheel.direction) @ np.cross(still, UP)[:2])
        found.append(direction)
    return np.array(found)


def missing_grip(
    forces: WheelForces, statics: Array, moments: Array, friction: float, load: Array | None = None
) -> float:
    """Return how much grip the wheels lack, as a share of the weight; negative: they have some.

    It is the least t for which forces T and loads N ≥ 0 exist with |T| ≤ μ N + t W for every
    wheel; infinite where no loads that only push balance the robot.

    Args:
        forces: The wheels' horizontal forces.
        statics: Map (3, n) from loads to their sum and first moments.
        moments: Sum and first moments (3,) of the ground's vertical force; N, N·m.
        friction: Coefficient between wheels and ground.
        load: The contacts' loads (n,), N, where they are known; else they share it as they like.
    """
    weight, count = max(float(moments[0]), TINY), len(forces.least)
    least, free, n = forces.least / weight, forces.free.shape[2], statics.shape[1]
    equal, right = statics, moments / weight
    if load is not None:
        equal, right = np.eye(n), np.maximum(load / weight, 0.0)
    equal = np.hstack([np.zeros((len(equal), free)), equal, np.zeros((len(equal), 1))])
    bounds = [(None, None)] * free + [(0.0, None)] * n + [(None, None)]
    angles = np.tile(2.0 * math.pi * np.arange(FIRST_TANGENTS) / FIRST_TANGENTS, (count, 1))
    wheels = np.arange(count)
    for _ in range(CUTS):
        normal = np.stack([np.cos(angles), np.sin(angles)], axis=2)  # (n_wheels, tangents, 2)
        table = np.zeros((*angles.shape, free + n + 1))
        table[..., :free] = normal @ forces.free
        table[wheels, :, free + wheels] = -friction
        table[..., -1] = -1.0
        most = -(normal @ least[..., None])
        found = scipy.optimize.linprog(
            np.eye(free + n + 1)[-1],
            table.reshape(-1, free + n + 1),
            most.ravel(),
            equal,
            right,
            bounds,
        )
        if not found.success:
            return math.inf
        push = least + forces.free @ found.x[:free]  # (n_wheels, 2)
        needed = np.hypot(*push.T) - friction * found.x[free : free + count]
        if needed.max() <= found.x[-1] + CUT_TOLERANCE:
            break
        angles = np.column_stack([angles, np.arctan2(push[:, 1], push[:, 0])])
    return float(found.x[-1])
