"""Inertias of bodies as ten numbers each, less what nobody feels.

The numbers are m, m c (3), and the inertia about the origin of the body's frame, xx, yy, zz, xy,
xz, yz. They are linear in what a body is made of.

What a joint lets nobody feel is moved to the body before it ([KD04, Ch. 9]). Behind a joint that
turns about z, a mass on that axis with an inertia that is round about it, and none about the axis,
acts as if it were fixed to the parent, so m, m c_z and I_yy of each such body are 0 afterwards; of
a wheel that is round nothing is left but its inertia about its axle, and its angle is no longer
asked for. Behind a joint that slides, only mass and first moment stay.

[KD04] W. Khalil, E. Dombre, "Modeling, Identification and Control of Robots", Kogan Page, 2004.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.link_inertias import pseudo_inertia
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.symbols.bodies import MovingBody

NUMBERS = 10  # of a body's inertia
M, MX, MY, MZ, XX, YY, ZZ, XY, XZ, YZ = range(NUMBERS)
UNFELT_BY_ROOT = (MZ, XX, YY, XY, XZ, YZ)  # it is planar


def inertias_of(robot: Robot) -> Array:
    """Return the pseudo-inertias (n, 4, 4) of the bodies in the axes of Pinocchio's joints.

    :mod:`rpctl.robot.link_inertias` says what these are.
    """
    return np.array([pseudo_inertia(each) for each in list(robot.model.inertias)[ROOT_JOINT:]])


def felt(bodies: Sequence[MovingBody], inertias: Array) -> Array:
    """Return the ten numbers of each body (..., n, 10) that motion and forces tell apart.

    Args:
        bodies: The bodies.
        inertias: Pseudo-inertias (..., n, 4, 4) in the axes of Pinocchio's joints.
    """
    from_frames = np.linalg.inv([body.frame for body in bodies])
    found = from_frames @ inertias @ np.swapaxes(from_frames, 1, 2)
    for i in reversed(range(1, len(bodies))):
        body, own = bodies[i], found[..., i, :, :]
        unfelt = np.zeros(own.shape)
        if body.slides:
            unfelt[..., :3, :3] = own[..., :3, :3]
        else:
            unfelt[..., 2:, 2:] = own[..., 2:, 2:]
            unfelt[..., 2, 2] += own[..., 0, 0]  # so that it has the inertia I_yy
        found[..., i, :, :] = own - unfelt
        found[..., body.parent, :, :] += body.pose @ unfelt @ body.pose.T
    numbers = _ten_numbers(found)
    numbers[..., 0, UNFELT_BY_ROOT] = 0.0
    return numbers


def _ten_numbers(inertias: Array) -> Array:
    """Return the ten numbers (..., 10) of pseudo-inertias (..., 4, 4)."""
    xx, yy, zz = (inertias[..., k, k] for k in range(3))
    moments = [yy + zz, xx + zz, xx + yy]
    products = [-inertias[..., i, j] for i, j in ((0, 1), (0, 2), (1, 2))]
    first = [inertias[..., k, 3] for k in (3, 0, 1, 2)]
    return np.stack([*first, *moments, *products], axis=-1)
