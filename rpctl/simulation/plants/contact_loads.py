"""How the contacts of a robot share its load, as a function of its moments: pushes only.

Contacts are equal springs under a rigid robot, N = max(0, a + b x + c y): by statics alone for
three of them, and one split of many for more. It is that of :func:`rpctl.dynamics.stance.loads`,
together with its derivatives, and with an answer where there is none: a robot that tips.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy  # loads scipy.optimize, which takes long, at its first use

from rpctl.arrays import Array
from rpctl.dynamics.stance import LOAD_RESOLUTION, MIN_STANCE_WIDTH_M


class LoadSplit(NamedTuple):
    """How contacts at given places share any load.

    Attributes:
        directions: The moments (k, 3) of the sum and the moments about x and y that they determine.
        statics: Map (k, n) from the loads to those.
        free: Changes of the loads that statics do not see (n - k, n), orthonormal.
        split: Map (n, 3) from the sum and both moments to the loads of least norm.
    """

    directions: Array
    statics: Array
    free: Array
    split: Array


NO_CONTACTS = LoadSplit(np.eye(3)[:1], np.zeros((1, 0)), np.zeros((0, 0)), np.zeros((0, 3)))


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
    U, singular, Vt = np.linalg.svd(statics)
    count = len(directions)
    split = (Vt[:count].T / singular) @ U.T @ directions
    return LoadSplit(directions, statics, Vt[count:], split)


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
    return _pressed(split, moments, load) or _tipping(split, moments, load)


def _pressed(split: LoadSplit, moments: Array, load: Array) -> ContactLoads | None:
    """Return the least loads that only push, or None where there are none: [LH74, Ch. 23].

    Args:
        split: How the contacts share loads.
        moments: Their sum and moments (3,).
        load: Loads of least norm (n,), not all pushing.
    """
    share = load / moments[0]
    left, target = np.vstack([split.free, -share]), np.zeros(len(split.free) + 1)
    target[-1] = 1.0
    residual = left @ scipy.optimize.nnls(left, target)[0] - target
    if residual[-1] > -LOAD_RESOLUTION:
        return None
    share = share - split.free.T @ residual[:-1] / residual[-1]
    held = split.statics * (share > LOAD_RESOLUTION)
    slope = np.linalg.pinv(held) @ split.directions
    return ContactLoads(np.maximum(slope @ moments, 0.0), slope, False)


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
