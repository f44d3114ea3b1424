"""How the contacts of a robot share its load, as a function of its moments: pushes only.

Contacts are equal springs under a rigid robot, N = max(0, a + b x + c y): by statics alone for
three of them, and one split of many for more. It is that of :func:`rpctl.dynamics.stance.loads`,
together with its derivatives, and with an answer where there is none: a robot that tips.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.stance import LOAD_RESOLUTION, MIN_STANCE_WIDTH_M, make_stance

MAX_CHANGES = 60  # of the pressed contacts; some 5 suffice unless the robot is about to tip
HALVINGS = 30  # of a step that goes too far
EASE = 1e-12  # of the trace: what keeps the matrix of too few pressed contacts regular


@dataclass(frozen=True, eq=False)
class LoadSplit:
    """How contacts at given places share any load.

    Attributes:
        points: Their places (n, 2), root link's axes, m.
        directions: The moments (k, 3) of the sum and the moments about x and y that they determine.
        statics: Map (k, n) from the loads to those.
        split: Map (n, 3) from the sum and both moments to the loads of least norm.
    """

    points: Array
    directions: Array
    statics: Array
    split: Array

    @cached_property
    def edges(self) -> Array:
        """Map (n_edges, 3) to what is positive of moments that loads can have."""
        if len(self.directions) == 3:
            stance = make_stance(self.points)
            return np.column_stack([stance.offset, stance.inward])
        if len(self.directions) == 2:
            place = self.statics[1]
            first, last = -place.min() * self.directions[0], place.max() * self.directions[0]
            return np.array([first + self.directions[1], last - self.directions[1]])
        return self.directions


class ContactLoads(NamedTuple):
    """Loads of n contacts.

    Attributes:
        load: (n,) N, none negative.
        slope: Derivatives (n, 3) by the sum and the moments.
        tips: Whether no loads that only push have these moments.
    """

    load: Array
    slope: Array
    tips: bool


NO_CONTACTS = LoadSplit(np.zeros((0, 2)), np.eye(3)[:1], np.zeros((1, 0)), np.zeros((0, 3)))


def make_split(points: Array) -> LoadSplit:
    """Return how contacts share loads.

    Contacts on one line determine the moment along it only; the other is left out.

    Args:
        points: Their places (n, 2), root link's axes, m.
    """
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0))
    known = np.flatnonzero(spread > MIN_STANCE_WIDTH_M)
    directions = np.zeros((1 + len(known), 3))
    directions[0, 0] = 1.0
    directions[1:, 1:] = axes[known]
    statics = directions @ np.vstack([np.ones(len(points)), points.T])
    return LoadSplit(points, directions, statics, np.linalg.pinv(statics) @ directions)


def share_load(split: LoadSplit, moments: Array) -> ContactLoads:
    """Return the loads that contacts share.

    Where a + b x + c y dips below the ground, contacts let go until those that are left only push.
    Where none can have such moments, the robot tips: then each contact that would push has its part
    of the whole load.

    Args:
        split: How they share loads.
        moments: Their sum, N, and Σ N_i (x_i, y_i), N·m (3,).
    """
    load = split.split @ moments
    if load.min(initial=0.0) >= 0.0:
        return ContactLoads(load, split.split, False)
    if moments[0] <= 0.0:
        return ContactLoads(np.zeros(len(load)), np.zeros((len(load), 3)), True)
    found = _pressed(split, moments) if (split.edges @ moments).min() > 0.0 else None
    return found or _tipping(split, moments, load)


def _pressed(split: LoadSplit, moments: Array) -> ContactLoads | None:
    """Return the least loads that only push, or None where the search does not end.

    They are N = max(0, Yᵀλ) at the minimum of the convex ½ |N|² − m·λ, where Y N = m.

    Args:
        split: How the contacts share loads.
        moments: Their sum and moments (3,).
    """
    Y, wanted = split.statics, split.directions @ moments / moments[0]

    def cost(multipliers: Array) -> tuple[float, Array]:
        load = np.maximum(Y.T @ multipliers, 0.0)
        return float(0.5 * load @ load - wanted @ multipliers), load

    multipliers = np.zeros(len(Y))
    multipliers[0] = 1.0 / Y.shape[1]
    least, load = cost(multipliers)
    for _ in range(MAX_CHANGES):
        held = Y * (load > 0.0)
        H = held @ Y.T
        H += EASE * np.trace(H) * np.eye(len(H))
        rest = wanted - Y @ load
        if np.abs(rest).max() < LOAD_RESOLUTION:
            slope = held.T @ np.linalg.solve(H, split.directions)
            return ContactLoads(moments[0] * load, slope, False)
        step = np.linalg.solve(H, rest)
        for _ in range(HALVINGS):
            ahead, load = cost(multipliers + step)
            if ahead <= least + LOAD_RESOLUTION * abs(least):
                break
            step = 0.5 * step
        multipliers, least = multipliers + step, ahead
    return None


def _tipping(split: LoadSplit, moments: Array, load: Array) -> ContactLoads:
    """Return each pushing contact's part of the whole load, of a robot that tips.

    Args:
        split: How the contacts share loads.
        moments: Their sum and moments (3,).
        load: Loads of least norm (n,), pushing or not.
    """
    pushing = np.maximum(load, 0.0)
    total = pushing.sum()
    change = split.split * (load > 0.0)[:, None] / total
    part = pushing / total
    slope = moments[0] * (change - part[:, None] * change.sum(axis=0))
    slope[:, 0] += part
    return ContactLoads(moments[0] * part, slope, True)
