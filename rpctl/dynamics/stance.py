"""The stance: contacts on flat ground, their polygon, and how they share a load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # loads scipy.optimize, which takes long, at its first use

from rpctl.arrays import Array

MIN_STANCE_WIDTH_M = 5e-3  # m: contacts this near to one line do not hold a balance
BVLS_TOLERANCE = 1e-15  # relative change of the cost at which the active set is taken for final
LOAD_RESOLUTION = 1e-9  # of the load: a smaller share is rounding


@dataclass(frozen=True)
class Stance:
    """Contacts of one posture that hold a balance, in the root link's frame.

    Attributes:
        statics: Map (3, n) from the contacts' loads to their sum and first moments: 1, x, y.
        split: Its pseudoinverse (n, 3): the loads of least norm.
        free: Changes of the loads that statics do not see (n - 3, n), orthonormal.
        inward: Inward unit normals of the support polygon's edges (n_edges, 2).
        offset: Signed distance of the root link's origin to each edge (n_edges,), m.
    """

    statics: Array
    split: Array
    free: Array
    inward: Array
    offset: Array


def make_stance(points: Array) -> Stance:
    """Return the polygon and the loads' split of contacts (n, 2) that hold a balance."""
    statics = np.vstack([np.ones(len(points)), points.T])  # Σ N, Σ N x, Σ N y
    U, singular, Vt = np.linalg.svd(statics)
    corners = points[_hull(points)]
    edge = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack([-edge[:, 1], edge[:, 0]]) / np.linalg.norm(edge, axis=1)[:, None]
    return Stance(
        statics=statics,
        split=(Vt[:3].T / singular) @ U.T,
        free=Vt[3:],
        inward=inward,
        offset=-(inward * corners).sum(axis=1),
    )


def _hull(points: Array) -> list[int]:
    """Return the corners of the convex hull (indices), counterclockwise, by monotone chains."""
    order = np.lexsort(points.T[::-1]).tolist()

    def half(indices: list[int]) -> list[int]:
        chain: list[int] = []
        for i in indices:
            while len(chain) > 1 and _turn(points[chain[-2]], points[chain[-1]], points[i]) <= 0.0:
                chain.pop()
            chain.append(i)
        return chain[:-1]

    return half(order) + half(order[::-1])


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def width(points: Array) -> float:
    """Return how far points (n, 2) lie off their best line, m: 0 for fewer than three."""
    if len(points) < 3:
        return 0.0
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1])


def loads(stance: Stance, moments: Array, margin: float) -> Array:
    """Return the contacts' loads (n,), N, with Σ N_i (1, x_i, y_i) = ``moments``.

    Those of least norm lie in one plane over the ground, N = a + b x + c y: the loads of a rigid
    robot on equal springs. Where the plane dips below the ground although the robot does not tip,
    the springs there let go, and N = max(0, a + b x + c y): the least ones that only push, a least
    distance problem ([LH74, Ch. 23]).

    Args:
        stance: The contacts' polygon and how they share a load.
        moments: Σ N_i (1, x_i, y_i) (3,) of the ground's force; N, N·m.
        margin: Distance of the zero-moment point to the polygon's edge, m; negative outside.
    """
    load = stance.split @ moments
    if margin <= 0.0 or len(load) == 3 or load.min() >= 0.0:
        return np.asarray(load)
    target = np.zeros(len(stance.free) + 1)
    target[-1] = 1.0
    left = np.vstack([stance.free, -load / moments[0]])
    found = scipy.optimize.lsq_linear(
        left, target, (0.0, np.inf), method="bvls", tol=BVLS_TOLERANCE
    )
    residual = left @ found.x - target
    if residual[-1] > -LOAD_RESOLUTION:
        return np.asarray(load)
    share = load / moments[0] - stance.free.T @ residual[:-1] / residual[-1]
    pressed = share > LOAD_RESOLUTION
    load = np.zeros(len(load))
    load[pressed] = np.linalg.pinv(stance.statics[:, pressed]) @ moments
    return load
