"""Grip: whether friction can hold a motion, however wheels share the forces that it takes.

A wheel's force along its rolling direction follows from its own motor and inertia, unless a brake
locks it. How wheels share the sideways force of an axle does not, nor, beyond three contacts, how
contacts share the load. The wheels slide, as a whole, where no way to share holds each of them
within its circle |T| ≤ μ N: a convex program, solved by linear ones that cut the circles by
tangents. One wheel at the end of its grip slides nothing, as long as the others of its axle hold
what it cannot.

Splits: all the ways in which contacts may share a load, and how near to slipping wheels get.

Statics give three equations, G N = m, for the n loads N ≥ 0 of contacts on flat ground: their sum
and their moments. Beyond three contacts the admissible loads fill a polytope. The least and the
largest load of a contact are linear programs over it. By their fundamental theorem the optimum lies
at a corner, and there no more than three contacts bear the load. So the loads of all triples give
the exact intervals, for all samples at once, and no solver runs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, GroundReaction, stance_at
from rpctl.dynamics.reduced import Reactions, ReducedDynamics
from rpctl.dynamics.rolling import UP
from rpctl.dynamics.stance import LOAD_RESOLUTION
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
    """Return the horizontal forces of the ground on the wheels of a balanced robot at one state.

    Where brakes have ``locked`` the driven wheels, these share what pushes along them, too; else
    their motors' efforts decide.
    """
    drive, rolling = dynamics.robot.drive, dynamics.rolling
    multipliers = reactions.multipliers[0]
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

    It is the least t for which forces T and loads N ≥ 0 exist with |T| ≤ μ N + t W for every wheel;
    infinite where no loads that only push balance the robot.

    Args:
        statics: Map (3, n) from loads to their sum and first moments.
        moments: Sum and first moments (3,) of the ground's vertical force; N, N·m.
        friction: Coefficient between wheels and ground.
        load: The contacts' loads (n,), N, where they are known; else any that balance.
    """
    weight, wheels = max(float(moments[0]), TINY), np.arange(len(forces.least))
    least, free, n = forces.least / weight, forces.free.shape[2], statics.shape[1]
    equal, right = statics, moments / weight
    if load is not None:
        equal, right = np.eye(n), np.maximum(load / weight, 0.0)
    equal = np.hstack([np.zeros((len(equal), free)), equal, np.zeros((len(equal), 1))])
    bounds = [(None, None)] * free + [(0.0, None)] * n + [(None, None)]
    tangents = 2.0 * math.pi * np.arange(FIRST_TANGENTS) / FIRST_TANGENTS
    angles = np.tile(tangents, (len(wheels), 1))
    for _ in range(CUTS):
        normal = np.stack([np.cos(angles), np.sin(angles)], axis=2)  # (n_wheels, tangents, 2)
        table = np.zeros((*angles.shape, free + n + 1))
        table[..., :free] = normal @ forces.free
        table[wheels, :, free + wheels] = -friction
        table[..., -1] = -1.0
        most, cost = -(normal @ least[..., None]).ravel(), np.eye(free + n + 1)[-1]
        rows = table.reshape(len(most), -1)
        found = scipy.optimize.linprog(cost, rows, most, equal, right, bounds)
        if not found.success:
            return math.inf
        push = least + forces.free @ found.x[:free]  # (n_wheels, 2)
        needed = np.hypot(*push.T) - friction * found.x[free + wheels]
        if needed.max() <= found.x[-1] + CUT_TOLERANCE:
            break
        angles = np.column_stack([angles, np.arctan2(push[:, 1], push[:, 0])])
    return float(found.x[-1])


MIN_TRIANGLE_HEIGHT = (
    1e-12  # height over length of a triangle: below it three contacts lie on one line
)
ZERO_LOAD_N = 1e-100  # N: stands for no load where a force is divided by it, and nothing overflows
MAX_FORCE_RATIO = 1e50  # a force over a load beyond it is one over none
MAX_CONTACTS = 50  # contacts: beyond, there are too many triples
BLOCK_LOADS = 30_000  # loads of corners that are held at once: they stay in the cache


@dataclass(frozen=True)
class Ranges:
    """Ranges of contact loads and slip ratios at K instants.

    Attributes:
        load: Least and largest load of each contact (K, n, 2) of all admissible splits, N; NaN
            where the robot tips, for then there is none.
        slip: Least and largest slip ratio of the worst wheel (K, 2) of all admissible splits: the
            largest is exact, the least a bound from below that is exact where no wheels share a
            lateral force. Inf where a wheel that has to push may bear nothing.
    """

    load: Array
    slip: Array


class _Instants(NamedTuple):
    """Reactions at K instants, which stand in the last axis: reductions over others are quick."""

    arms: Array  # (n, 2, K) of the contacts about the zero-moment points, m
    total: Array  # (K,) load, N
    own: Array  # (n_wheels, K) horizontal forces that wheels do not share, N
    lateral: Array  # (n_axles, K) forces of axles, N
    incidence: Array  # (n_wheels, n_axles) which wheels share them, 0 or 1
    points: Array  # (n, 2, K), or (n, 2, 1) where contacts keep their places, m


def find_ranges(contacts: Contacts, reactions: GroundReaction) -> Ranges:
    """Return the ranges of loads and of the worst slip ratio over all splits that statics admit.

    Args:
        contacts: How the robot stands.
        reactions: What the ground did to it at K instants, K > 0.

    Returns:
        The ranges; empty ones, (K, 0), where loads are not defined or contacts are a crowd.
    """
    count, n = len(reactions.force), len(contacts.names)
    if not contacts.balanced or n > MAX_CONTACTS:
        return Ranges(np.empty((count, 0)), np.empty((count, 0)))
    size = max(1, BLOCK_LOADS // (n * _triples(n).shape[1]))
    loads, slips = np.empty((count, n, 2)), np.empty((count, 2))
    for first in range(0, count, size):
        rows = slice(first, first + size)
        instants = _instants(contacts, reactions, rows)
        load, admissible = _corner_loads(instants.arms, instants.total)
        least, most = _extremes(load, admissible)
        loads[rows, :, 0], loads[rows, :, 1] = least.T, most.T
        one = (most - least).max(axis=0) <= LOAD_RESOLUTION * instants.total
        slips[rows] = _slip_ranges(instants, load, admissible, one).T
    lifted = reactions.force[:, 2] < contacts.floor
    loads[lifted] = slips[lifted] = np.nan
    slips /= contacts.friction
    for array in (loads, slips):
        array.setflags(write=False)
    return Ranges(loads, slips)


def _instants(contacts: Contacts, reactions: GroundReaction, rows: slice) -> _Instants:
    """Return some of the reactions; the lateral force of a wheel alone on its axle is its own."""
    along, lateral = np.abs(reactions.longitudinal[rows].T), np.abs(reactions.lateral[rows].T)
    total = np.maximum(reactions.force[rows, 2], contacts.floor)
    alone = contacts.incidence.sum(axis=0) == 1.0
    own = np.hypot(along, (contacts.incidence * alone) @ lateral)
    rounding = LOAD_RESOLUTION * total
    arms = np.ascontiguousarray(reactions.arms[rows].transpose(1, 2, 0))
    stance = contacts.stance
    return _Instants(
        arms=arms,
        total=total,
        own=own * (own > rounding),
        lateral=lateral * (lateral > rounding),
        incidence=contacts.incidence * ~alone,
        points=arms if stance is None else stance.statics[1:].T[..., None],
    )


@lru_cache(maxsize=8)
def _triples(count: int) -> NDArray[np.intp]:
    """Return all triples of so many contacts (3, T)."""
    return np.array(list(combinations(range(count), 3)), dtype=np.intp).T


def _corner_loads(arms: Array, total: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the loads (n, T, K) that each triple alone would bear, N, and if it can (T, K).

    Contact i bears as much of the load as the triangle of the other two and the zero-moment point
    p is of the triple's own: N_i = f_z |p p_j p_k| / |p_i p_j p_k|.
    """
    chosen = _triples(len(arms))
    x, y = arms[:, 0][chosen], arms[:, 1][chosen]  # (3, T, K)
    (xj, xk), (yj, yk) = ((z[[1, 2, 0]], z[[2, 0, 1]]) for z in (x, y))
    area = (xj[0] - x[0]) * (yk[0] - y[0]) - (xk[0] - x[0]) * (yj[0] - y[0])  # (T, K), twice
    longest = ((xj - x) ** 2 + (yj - y) ** 2).max(axis=0)
    wide = np.abs(area) > MIN_TRIANGLE_HEIGHT * longest
    part = (xj * yk - xk * yj) / np.where(wide, area, 1.0)
    admissible = wide & (part.min(axis=0) >= -LOAD_RESOLUTION)
    load = np.zeros((len(arms), *area.shape))
    load[chosen, np.arange(chosen.shape[1])] = part * (part > LOAD_RESOLUTION) * total
    return load, admissible


def _extremes(values: Array, admissible: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the least and the largest (..., K) of values (..., T, K) over admissible triples.

    NaN where there is none.
    """
    least = np.where(admissible, values, np.inf).min(axis=-2)
    most = np.where(admissible, values, -np.inf).max(axis=-2)
    none = ~admissible.any(axis=0)
    least[..., none] = most[..., none] = np.nan
    return least, most


def _slip_ranges(
    instants: _Instants, load: Array, admissible: NDArray[np.bool_], one: NDArray[np.bool_]
) -> Array:
    """Return the least and the largest of the worst wheel's force over load (2, K).

    A wheel's is s = √(F²/N² + L²/Σ²) with the lateral force L of its axle, whose wheels bear Σ.
    It is convex in the loads, and so is the worst wheel's, whose maximum therefore lies at a
    corner of the polytope. The minimum is :func:`_slip_lower_bound`'s, or the one value there is.

    Args:
        instants: The reactions.
        load: Of the corners (n, T, K), N.
        admissible: Which of them can be (T, K).
        one: Where all of them are the same (K,).
    """
    own, lateral, incidence = instants.own, instants.lateral, instants.incidence
    wheels = load[: len(own)]
    shared = np.tensordot(incidence, wheels, axes=(0, 0)) + ZERO_LOAD_N  # (n_axles, T, K)
    sideways = np.tensordot(incidence, lateral[:, None] / shared, axes=1)  # (n_wheels, T, K)
    slip = np.hypot(own[:, None] / (wheels + ZERO_LOAD_N), sideways).max(axis=0)
    _, most = _extremes(slip, admissible)
    inevitable, _ = _extremes(sideways, admissible)
    least = np.where(one, most, np.minimum(_slip_lower_bound(instants, inevitable), most))
    found = np.stack([least, most])
    return np.where(found > MAX_FORCE_RATIO, np.inf, found)


def _slip_lower_bound(instants: _Instants, sideways: Array) -> Array:
    """Return a value (K,) below which no split brings the worst wheel's force over load.

    With l = L/max Σ, all wheels are below s only where N ≥ F/√(s² − l²). The moment of the whole
    load about an edge of the support polygon is Σ d N over all contacts at distances d ≥ 0, so
    Σ a/√(s² − l²) ≤ 1, where a is the moment of a wheel's F over that of the load. 1/√ is convex,
    and by Jensen s² ≥ (Σ a)² + Σ a l²/Σ a. Where all L vanish this is the minimum: the loads that
    remain can be borne if and only if their moments about all edges are positive.

    Args:
        instants: The reactions.
        sideways: l of each wheel (n_wheels, K).
    """
    (x, y), wheels = instants.points.swapaxes(0, 1), len(sideways)
    cross = x[:, None] * y - y[:, None] * x  # of points a and b (n, n, ...)
    # Of contact k about the way from a to b (n, n, n, ...); it is the same about any point.
    lever = cross[:, :, None] + cross[None] + cross.swapaxes(0, 1)[:, None]
    longest = np.abs(lever).max(axis=2)
    edge = (lever.min(axis=2) >= -LOAD_RESOLUTION * longest) & (longest > 0.0)
    a, b = np.nonzero(edge.any(axis=-1))  # what is an edge at no instant needs no more
    (x, y), edge, longest = instants.arms.swapaxes(0, 1), edge[a, b], longest[a, b]
    lever = np.maximum(lever[a, b, :wheels], 0.0)  # (edges, n_wheels, ...)
    moment = np.maximum(x[a] * y[b] - y[a] * x[b], LOAD_RESOLUTION * longest) * instants.total
    moment = np.where(edge, moment, np.inf)
    needed = (lever * instants.own).sum(axis=1) / moment
    aside = (lever * (instants.own * sideways**2)).sum(axis=1) / moment
    bound = (needed**2 + aside / (needed + ZERO_LOAD_N)).max(axis=0, initial=0.0)
    return np.asarray(np.sqrt(np.maximum(bound, sideways.max(axis=0) ** 2)))
