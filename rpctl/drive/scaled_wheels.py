"""Drives like another one, whose wheels are larger or stand farther apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rpctl.arrays import Array
from rpctl.description.frozen_tree import FrozenTree
from rpctl.drive.drive import Drive
from rpctl.drive.rows import unit_left
from rpctl.drive.wheels import ground_tolerance
from rpctl.errors import RpctlError

SOURCE = "scaled"  # of a radius that is not the file's
LEAST_LATERAL_M = 1e-6  # m: a wheel nearer to the middle line stands on it


def with_radii(drive: Drive, tree: FrozenTree, radii: Array) -> Drive:
    """Return a drive whose wheels have other radii; their axles stay where they are on the body.

    Args:
        radii: Of the wheels (n_wheels,), m.

    Raises:
        RpctlError: A wheel would not reach the ground.
    """
    changed = [w.joint for w, r in zip(drive.wheels, radii, strict=True) if r != w.radius]
    if not changed:
        return drive
    wheels = tuple(
        replace(wheel, radius=r, source=SOURCE) if wheel.joint in changed else wheel
        for wheel, r in zip(drive.wheels, radii.tolist(), strict=True)
    )
    lifted = lifted_wheels(drive, tree, radii)
    if lifted.any():
        name = wheels[int(lifted.argmax())].joint
        raise RpctlError(
            f'radii: wheel "{name}" would not reach the ground that the others stand on; scale '
            "the radii of all wheels alike, or by less"
        )
    lower = float(np.mean(radii - [wheel.radius for wheel in drive.wheels]))
    declared = dict.fromkeys((*drive.declared, *(f"radius of {name}" for name in changed)))
    return replace(drive, wheels=wheels, ground=drive.ground - lower, declared=tuple(declared))


def lifted_wheels(drive: Drive, tree: FrozenTree, radii: Array) -> Array:
    """Return which wheels (..., n_wheels) would hang in the air with other radii, and do not now.

    Args:
        radii: Of the wheels (..., n_wheels), m.
    """
    now = np.array([wheel.radius for wheel in drive.wheels])
    height = _centres(drive, tree)[:, 2]
    tolerance = np.array([ground_tolerance(radius) for radius in now.tolist()])
    gap, gap_now = (
        bottom - bottom.min(axis=-1, keepdims=True) for bottom in (height - radii, height - now)
    )
    return np.asarray(gap > np.maximum(tolerance, gap_now + tolerance * 1e-9))


def scale_track(drive: Drive, tree: FrozenTree, scale: float) -> Drive:
    """Return a drive whose wheels touch the ground farther from the middle line, or nearer to it.

    The contacts of the wheels that the root link holds move, as those of wide tyres do; the wheels
    themselves and their masses stay.

    Args:
        scale: Of the contacts' distances from the line through P along the heading.

    Raises:
        RpctlError: No such wheel stands beside that line.
    """
    if scale == 1.0:
        return drive
    laterals = contact_laterals(drive, tree)
    if not laterals.any():
        raise RpctlError(
            "track: no wheel that the root link holds stands beside the middle line; leave it out"
        )
    wheels = tuple(
        replace(wheel, shift=wheel.shift + (scale - 1.0) * lateral) if lateral else wheel
        for wheel, lateral in zip(drive.wheels, laterals.tolist(), strict=True)
    )
    declared = tuple(dict.fromkeys((*drive.declared, "track")))
    return replace(drive, wheels=wheels, track=scale * drive.track, declared=declared)


def contact_laterals(drive: Drive, tree: FrozenTree) -> Array:
    """Return how far (n_wheels,) to the left of P each contact is, m; 0 of what no track moves."""
    if not drive.wheels:
        return np.empty(0)
    beside = (_centres(drive, tree)[:, :2] - drive.point) @ unit_left(drive.heading)
    lateral = beside + [wheel.shift for wheel in drive.wheels]
    moves = [wheel.swivel is None and not wheel.slides for wheel in drive.wheels]
    return np.where(moves & (np.abs(lateral) > LEAST_LATERAL_M), lateral, 0.0)


def _centres(drive: Drive, tree: FrozenTree) -> Array:
    """Return the centres (n_wheels, 3) of the wheels in the root link's frame, m."""
    joints = [tree.description.joint[wheel.joint] for wheel in drive.wheels]
    offsets = np.array([[wheel.offset] for wheel in drive.wheels])
    origins = np.array([tree.frame(joint)[:3, 3] for joint in joints])
    return origins + offsets * np.array([tree.axis(joint) for joint in joints])
