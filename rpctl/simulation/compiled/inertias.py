"""Inertias of bodies as ten numbers each, linear in what a body is made of.

They are m, m c (3), and the inertia about the origin of a frame, xx, yy, zz, xy, xz, yz.

What a joint lets nobody feel is moved to the body before it ([KD04, Ch. 9]). Behind a joint that
turns about z, a mass on that axis with an inertia that is round about it, and none about the axis,
acts as if it were fixed to the parent, so m, m c_z and I_yy of each such body are 0 afterwards; of
a wheel that is round nothing is left but its inertia about its axle, and its angle is no longer
asked for. Behind a joint that slides, only mass and first moment stay.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.bodies import MovingBody

NUMBERS = 10  # of a body's inertia
M, MX, MY, MZ, XX, YY, ZZ, XY, XZ, YZ = range(NUMBERS)
FELT_BY_ROOT = (M, MX, MY, ZZ)  # on a planar root nothing else moves
ENTRIES = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])  # of xx, yy, zz, xy, xz, yz in a matrix


def inertial_numbers(robot: Robot) -> Array:
    """Return the ten numbers of each body (n, 10) in the axes of Pinocchio's joints."""
    inertias = list(robot.model.inertias)[ROOT_JOINT:]
    return np.array([ten_numbers(inertia) for inertia in inertias])


def ten_numbers(inertia: pin.Inertia) -> Array:
    """Return the ten numbers (10,) of a body whose inertia is given about its centre of mass."""
    m, c = inertia.mass, inertia.lever
    about = inertia.inertia + m * ((c @ c) * np.eye(3) - np.outer(c, c))
    return np.array([m, *(m * c), *about[ENTRIES]])


def ten_of(m: float, mc: Array, second: Array) -> Array:
    """Return the ten numbers (10,) of a body.

    Args:
        m: Mass, kg.
        mc: First moment (3,), kg m.
        second: Second moment ∫ r rᵀ (3, 3), kg m².
    """
    about = _other_moments(second, 1.0)
    return np.array([m, *mc, *about[ENTRIES]])


def in_frame(numbers: Array, frame: Array) -> Array:
    """Return the ten numbers (..., 10) of bodies in another frame.

    Args:
        numbers: In one frame.
        frame: Pose (4, 4) of the other in it.
    """
    R, p = frame[:3, :3], frame[:3, 3]
    m, mc = numbers[..., M], numbers[..., MX : MZ + 1]
    second = _other_moments(numbers[..., [[XX, XY, XZ], [XY, YY, YZ], [XZ, YZ, ZZ]]], 0.5)
    outer = mc[..., :, None] * p
    second = second - outer - np.swapaxes(outer, -1, -2) + m[..., None, None] * np.outer(p, p)
    about = _other_moments(R.T @ second @ R, 1.0)
    moved = (mc - m[..., None] * p) @ R
    return np.concatenate([m[..., None], moved, about[..., ENTRIES[0], ENTRIES[1]]], axis=-1)


def _other_moments(moments: Array, factor: float) -> Array:
    """Return ∫ r rᵀ (..., 3, 3) of an inertia (factor ½), or the inertia of ∫ r rᵀ (factor 1)."""
    trace = np.trace(moments, axis1=-2, axis2=-1)
    return np.asarray(factor * trace[..., None, None] * np.eye(3) - moments)


def felt(bodies: Sequence[MovingBody], numbers: Array) -> Array:
    """Return the ten numbers of each body (..., n, 10) that motion and forces tell apart.

    Args:
        bodies: The bodies.
        numbers: All ten of each, in the axes of Pinocchio's joints.
    """
    found = np.stack(
        [in_frame(numbers[..., i, :], body.frame) for i, body in enumerate(bodies)], axis=-2
    )
    for i in reversed(range(1, len(bodies))):
        body, own = bodies[i], found[..., i, :]
        unfelt = np.zeros(own.shape)
        if body.slides:
            unfelt[..., XX:] = own[..., XX:]
        else:
            unfelt[..., [M, MZ, XX, YY]] = own[..., [M, MZ, YY, YY]]
        found[..., i, :] = own - unfelt
        found[..., body.parent, :] += in_frame(unfelt, np.asarray(np.linalg.inv(body.pose), float))
    found[..., 0, [k for k in range(NUMBERS) if k not in FELT_BY_ROOT]] = 0.0
    return found
