"""Splits: all the ways in which contacts may share a load, and how near to slipping wheels get.

Statics give three equations, G N = m, for the n loads N ≥ 0 of contacts on flat ground: their sum
and their moments. Beyond three contacts the admissible loads fill a polytope. The least and the
largest load of a contact are linear programs over it. By their fundamental theorem the optimum lies
at a corner, and there no more than three contacts bear the load. So the loads of all triples give
the exact intervals, for all samples at once, and no solver runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, GroundReactions
from rpctl.dynamics.stance import LOAD_RESOLUTION

MIN_TRIANGLE_HEIGHT = (
    1e-12  # height over length of a triangle: below it three contacts lie on one line
)
ZERO_LOAD_N = 1e-100  # N: stands for no load where a force is divided by it, and nothing overflows
MAX_FORCE_RATIO = 1e50  # a force over a load beyond it is one over none
MAX_CONTACTS = 50  # contacts: beyond, there are too many triples
BLOCK_LOADS = 60_000  # loads of corners that are held at once: they stay in the cache


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
    """Reactions at K instants."""

    arms: Array  # (K, n, 2) of the contacts about the zero-moment points, m
    total: Array  # (K,) load, N
    own: Array  # (K, n_wheels) horizontal forces that wheels do not share, N
    lateral: Array  # (K, n_axles) forces of axles, N
    incidence: Array  # (n_wheels, n_axles) which wheels share them, 0 or 1


def find_ranges(contacts: Contacts, reactions: GroundReactions) -> Ranges:
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
    found = []
    for first in range(0, count, size):
        instants = _instants(contacts, reactions, slice(first, first + size))
        load, admissible = _corner_loads(instants.arms, instants.total)
        loads = _load_ranges(load, admissible)
        found.append((loads, _slip_ranges(instants, load, admissible, loads)))
    loads, slips = (np.concatenate(parts) for parts in zip(*found, strict=True))
    lifted = reactions.force[:, 2] < contacts.floor
    loads[lifted] = slips[lifted] = np.nan
    slips /= contacts.friction
    for array in (loads, slips):
        array.setflags(write=False)
    return Ranges(loads, slips)


def _instants(contacts: Contacts, reactions: GroundReactions, rows: slice) -> _Instants:
    """Return some of the reactions; the lateral force of a wheel alone on its axle is its own."""
    along, lateral = np.abs(reactions.longitudinal[rows]), np.abs(reactions.lateral[rows])
    total = np.maximum(reactions.force[rows, 2], contacts.floor)
    alone = contacts.incidence.sum(axis=0) == 1.0
    own = np.hypot(along, lateral @ (contacts.incidence * alone).T)
    rounding = LOAD_RESOLUTION * total[:, None]
    return _Instants(
        arms=reactions.arms[rows],
        total=total,
        own=own * (own > rounding),
        lateral=lateral * (lateral > rounding),
        incidence=contacts.incidence * ~alone,
    )


@lru_cache(maxsize=8)
def _triples(count: int) -> NDArray[np.intp]:
    """Return all triples of so many contacts (3, T)."""
    return np.array(list(combinations(range(count), 3)), dtype=np.intp).T


def _corner_loads(arms: Array, total: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the loads (K, n, T) that each triple alone would bear, N, and if it can (K, T).

    Contact i bears as much of the load as the triangle of the other two and the zero-moment point
    p is of the triple's own: N_i = f_z |p p_j p_k| / |p_i p_j p_k|.
    """
    chosen = _triples(arms.shape[1])
    x, y = (arms[:, chosen, axis] for axis in (0, 1))  # (K, 3, T)
    (xj, xk), (yj, yk) = ((np.roll(z, -1, axis=1), np.roll(z, -2, axis=1)) for z in (x, y))
    area = ((xj - x) * (yk - y) - (xk - x) * (yj - y))[:, :1]  # (K, 1, T), twice
    longest = ((xj - x) ** 2 + (yj - y) ** 2).max(axis=1, keepdims=True)
    wide = np.abs(area) > MIN_TRIANGLE_HEIGHT * longest
    part = (xj * yk - xk * yj) / np.where(wide, area, 1.0)
    admissible = wide[:, 0] & (part.min(axis=1) >= -LOAD_RESOLUTION)
    load = np.zeros((*arms.shape[:2], chosen.shape[1]))
    load[:, chosen, np.arange(chosen.shape[1])] = (
        part * (part > LOAD_RESOLUTION) * total[:, None, None]
    )
    return load, admissible


def _load_ranges(load: Array, admissible: NDArray[np.bool_]) -> Array:
    """Return the least and the largest load of each contact (K, n, 2)."""
    allowed = np.where(admissible[:, None], load, np.nan)
    return np.stack([np.fmin.reduce(allowed, axis=2), np.fmax.reduce(allowed, axis=2)], axis=2)


def _slip_ranges(
    instants: _Instants, load: Array, admissible: NDArray[np.bool_], loads: Array
) -> Array:
    """Return the least and the largest of the worst wheel's force over load (K, 2).

    A wheel's is s = √(F²/N² + L²/Σ²) with the lateral force L of its axle, whose wheels bear Σ.
    It is convex in the loads, and so is the worst wheel's, whose maximum therefore lies at a
    corner of the polytope. The minimum is :func:`_slip_lower_bound`'s, or the one value there is.
    """
    own, lateral, incidence = instants.own, instants.lateral, instants.incidence
    wheels = load[:, : own.shape[1]]
    sideways = incidence @ (
        lateral[:, :, None] / (incidence.T @ wheels + ZERO_LOAD_N)
    )  # (K, n_wheels, T)
    slip = np.hypot(own[:, :, None] / (wheels + ZERO_LOAD_N), sideways).max(axis=1)
    most = np.fmax.reduce(np.where(admissible, slip, np.nan), axis=1)
    inevitable = np.fmin.reduce(np.where(admissible[:, None], sideways, np.nan), axis=2)
    one = (loads[:, :, 1] - loads[:, :, 0]).max(axis=1) <= LOAD_RESOLUTION * instants.total
    least = np.where(one, most, np.minimum(_slip_lower_bound(instants, inevitable), most))
    found = np.stack([least, most], axis=1)
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
        sideways: l of each wheel (K, n_wheels).
    """
    x, y = instants.arms[..., 0], instants.arms[..., 1]
    cross = x[:, :, None] * y[:, None] - y[:, :, None] * x[:, None]  # of arms a and b (K, n, n)
    lever = cross[..., None] + cross[:, None] + cross.transpose(0, 2, 1)[:, :, None]  # of k: a to b
    longest = np.abs(lever).max(axis=3)
    edge = (lever.min(axis=3) >= -LOAD_RESOLUTION * longest) & (longest > 0.0)
    edge_moment = np.maximum(cross, LOAD_RESOLUTION * longest) * instants.total[:, None, None]
    edge_moment = np.where(edge, edge_moment, np.inf)
    lever = np.maximum(lever[..., : sideways.shape[1]], 0.0)
    own = instants.own[:, None, :, None]
    needed = (lever @ own)[..., 0] / edge_moment
    aside = (lever @ (own * sideways[:, None, :, None] ** 2))[..., 0] / edge_moment
    bound = needed**2 + aside / (needed + ZERO_LOAD_N)
    return np.asarray(np.sqrt(np.maximum(bound.max(axis=(1, 2)), sideways.max(axis=1) ** 2)))
