"""The rows of rolling of wheels on a tree of upright joints: what they ask of twist and rates.

A twist of the base is (x, y, turn): the velocity of the root link in its own axes. A wheel that
stands at p and heads along d(θ) = (cos θ, sin θ) has the rolling row k and the lateral row l,

    k = (d, d·(ẑ × p)),   l = (n, n·(ẑ × p)),   n = ẑ × d,   k′ = l, l′ = −k by θ.

A wheel on a chain of upright joints that turn by φ₁, …, φ_k (a steered wheel, a caster, a trailer
behind trailers) heads along d(θ_k), θ_j = ψ + φ₁ + … + φ_j. With the joints at 0 their axes stand
at p₁, …, p_k, and p₀ = 0. Seen from the last body, the path from the axis j to the axis j + 1 turns
at ω + φ̇₁ + … + φ̇_j and lies at φ_{j+1} + … + φ_k to the right of where it did, so that the speed
along the heading of the point below the last axis is

    d(θ_k)·v + Σ_j d(ψ + φ_{j+1} + … + φ_k)·(ẑ × (p_{j+1} − p_j)) (ω + φ̇₁ + … + φ̇_j),

with j from 0 to k − 1. That across is its derivative by ψ. A contact ρ away from the last axis adds
(d·(ẑ × ρ)) (ω + φ̇₁ + … + φ̇_k), whose first factor is constant.

All rows are linear in the cosines and sines of a few sums of angles, see :class:`TurningMatrix`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.drive.drive import Drive, Swivel

Angle = TypeVar("Angle", float, Array)
PLANAR = 3  # entries of a twist of the base


def unit_ahead(angle: float | Array) -> Array:
    """Return d (2, ...) along angles (...), rad."""
    return np.array([np.cos(angle), np.sin(angle)])


def unit_left(angle: float | Array) -> Array:
    """Return n (2, ...) to the left of angles (...), rad."""
    return np.array([-np.sin(angle), np.cos(angle)])


def rolling_row(pivot: tuple[float, float], angle: float | Array) -> Array:
    """Return k (..., 3) of a wheel at ``pivot`` (m) that heads along angles (...), rad."""
    return np.asarray(unit_ahead(angle).T @ velocity_of(pivot))


def lateral_row(pivot: tuple[float, float], angle: float | Array) -> Array:
    """Return l (..., 3) of a wheel at ``pivot`` (m) that heads along angles (...), rad."""
    return np.asarray(unit_left(angle).T @ velocity_of(pivot))


def velocity_of(place: tuple[float, float]) -> Array:
    """Return what makes a twist the velocity of a place (m) of the base (2, 3)."""
    x, y = place
    return np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])


def angle_of(swivel: Swivel, position: Angle) -> Angle:
    """Return the rolling direction (rad) in the root link's frame at joint positions (rad)."""
    return swivel.heading + swivel.sign * position


@dataclass(frozen=True)
class TurningMatrix:
    """A matrix that is linear in the cosines and sines of angles θ, and θ in joint positions p.

        A(p) = constant + Σ_k (cos θ_k · harmonics_k + sin θ_k · harmonics_{m+k}),  θ = phase + G p

    Methods take the cosines and sines u (..., 2m) of any number of postures at a time.

    Attributes:
        constant: (rows, columns).
        harmonics: (2m, rows, columns).
        phase: (m,) rad.
        G: (m, n).
    """

    constant: Array
    harmonics: Array
    phase: Array
    G: Array

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for array in (self.constant, self.harmonics, self.phase, self.G):
            array.setflags(write=False)

    @cached_property
    def _flat(self) -> tuple[Array, Array, Array]:
        """The entries of the constant and of the harmonics of A and of its rate, as vectors."""
        cosines, sines = np.split(self.harmonics, 2)
        shape = len(self.harmonics), self.constant.size
        rates = np.concatenate([sines, -cosines])  # (cos θ)˙ = −sin θ θ̇, (sin θ)˙ = cos θ θ̇
        return self.constant.ravel(), self.harmonics.reshape(shape), rates.reshape(shape)

    @cached_property
    def _twice(self) -> Array:
        return np.concatenate([self.G, self.G]).T  # (n, 2m)

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Which columns (columns,) have entries that change."""
        return np.asarray(self.harmonics.any(axis=(0, 1)))

    @property
    def bound(self) -> Array:
        """The largest size (rows, columns) that each entry may have."""
        cosines, sines = np.split(self.harmonics, 2)
        return np.asarray(np.abs(self.constant) + np.hypot(cosines, sines).sum(axis=0))

    def turn(self, positions: Array) -> Array:
        """Return u (..., 2m) at joint positions (..., n), rad."""
        angles = positions.dot(self.G.T) + self.phase
        return np.concatenate((np.cos(angles), np.sin(angles)), axis=-1)

    def at(self, u: Array) -> Array:
        """Return A (..., rows, columns)."""
        constant, harmonics, _ = self._flat
        A: Array = (u.dot(harmonics) + constant).reshape(u.shape[:-1] + self.constant.shape)
        return A

    def rate(self, u: Array, rates: Array) -> Array:
        """Return Ȧ (..., rows, columns) at rates (..., n) of the joints."""
        change: Array = (u * rates.dot(self._twice)).dot(self._flat[2])
        return change.reshape(change.shape[:-1] + self.constant.shape)

    def map(self, linear: Callable[[Array], Array]) -> TurningMatrix:
        """Return the image under a linear map of matrices (..., rows, columns)."""
        return TurningMatrix(linear(self.constant), linear(self.harmonics), self.phase, self.G)

    def following(self, spread: Array, offset: Array) -> TurningMatrix:
        """Return it for joints that follow others: p = spread p′ + offset (rad)."""
        return TurningMatrix(
            self.constant, self.harmonics, self.phase + self.G @ offset, self.G @ spread
        )


@dataclass(frozen=True)
class DriveRows:
    """The rows of a drive's wheels, one each, then of its axle, its swivels and their followers.

    That P does not move sideways is one row for all wheels that the root link holds, as files round
    the angles and places of wheels, and two axles a hair apart would let the base move nowhere. A
    swivel has one lateral row for all its wheels; one that follows has a row that keeps its axle on
    the common centre of rotation. Wheels that the root link holds have an empty row here, and no
    row has the wheels' own rates: the robot's model knows them.

    Attributes:
        matrix: (rows, 3 + n_swivels), of the base's twist and the swivels' rates.
        across: Row of each lateral force, and the wheels (indices) that share it.
        gliding: Rows of swivels that glide, and of their wheels.
    """

    matrix: TurningMatrix
    across: tuple[tuple[int, tuple[int, ...]], ...]
    gliding: tuple[int, ...]


@dataclass(frozen=True)
class SwivelMotion:
    """How the ground sees a swivel: factors of twist and rates (3 + n_swivels,).

    Attributes:
        turning: In the rate at which it turns, ω + φ̇₁ + … + φ̇_k.
        forward: (2, k, 3 + n_swivels) Of the cosines and sines of its k waves, in the speed along
            its heading of the point below its axis.
        G: (k, n_swivels) The waves' angles in joint positions, see :class:`TurningMatrix`.
    """

    turning: Array
    forward: Array
    G: Array

    @property
    def leftward(self) -> Array:
        """Those of the speed to the left of its heading."""
        cosines, sines = self.forward
        return np.array([sines, -cosines])


def swivel_motion(drive: Drive, swivel: Swivel) -> SwivelMotion:
    """Return how a swivel moves over the ground, the swivels that carry it included."""
    order = [each.joint for each in drive.swivels]
    chain = drive.chain(swivel)
    turning, last = np.eye(PLANAR + len(order))[2], (0.0, 0.0)
    forward = np.zeros((2, len(chain), len(turning)))
    G = np.zeros((len(chain), len(order)))
    forward[:, 0, :2] = np.eye(2)
    for k, joint in enumerate(chain):
        x, y = np.subtract(joint.pivot, last)
        forward[:, k] += np.outer([-y, x], turning)
        column = order.index(joint.joint)
        turning[PLANAR + column], last = joint.sign, joint.pivot
        G[: k + 1, column] = joint.sign
    return SwivelMotion(turning, forward, G)


def drive_rows(drive: Drive, gliding: Collection[str] = ()) -> DriveRows:
    """Return the rows of a drive.

    Args:
        gliding: Joints of swivels that glide: the ground does nothing to them, they keep their
            angle and their wheels do not roll.
    """
    swivels, wheels = drive.swivels, drive.wheels
    owners = [s for s in swivels if s.shares is None]  # of lateral rows
    first = len(wheels) + drive.has_axle
    lateral = {s.joint: row for row, s in enumerate(owners, start=first)}
    lateral |= {s.joint: lateral[s.shares] for s in swivels if s.shares is not None}
    shape = first + len(owners), PLANAR + len(swivels)
    constant = np.zeros(shape)
    if drive.has_axle:
        constant[len(wheels), :PLANAR] = lateral_row(drive.point, drive.heading)
    waves = [(np.zeros((0, len(swivels))), np.zeros(0), np.zeros((2, 0, *shape)))]
    glide: list[int] = []
    for i, swivel in enumerate(swivels):
        row, carried = lateral[swivel.joint], list(drive.carried(swivel))
        if swivel.joint in gliding:
            constant[row, PLANAR + i] = 1.0
            glide += [*carried, row]
            continue
        motion = swivel_motion(drive, swivel)
        factors = np.zeros((2, len(motion.G), *shape))
        waves.append((motion.G, np.full(len(motion.G), swivel.heading), factors))
        for wheel in carried:
            factors[:, :, wheel] = motion.forward
            constant[wheel] -= wheels[wheel].lateral * motion.turning
        if swivel.role != "follower":
            factors[:, :, row] = motion.leftward
            constant[row] += swivel.trail * motion.turning
    for swivel in drive.followers:
        if swivel.joint not in gliding:
            G, phase, concurrence = _concurrence(drive, swivel)
            factors = np.zeros((2, len(G), *shape))
            factors[:, :, lateral[swivel.joint], PLANAR:] = concurrence
            waves.append((G, phase, factors))
    harmonics = np.concatenate([factors for _, _, factors in waves], axis=1)
    matrix = TurningMatrix(
        constant=constant,
        harmonics=harmonics.reshape(2 * harmonics.shape[1], *shape),
        phase=np.concatenate([phase for _, phase, _ in waves]),
        G=np.concatenate([G for G, _, _ in waves]),
    )
    return DriveRows(matrix, _across(drive, lateral), tuple(glide))


def _concurrence(drive: Drive, follower: Swivel) -> tuple[Array, Array, Array]:
    """Return the row that keeps a follower's axle on the common centre of two others.

    Three axles meet in one point where det(l₁, l₂, l₃) = 0. With pivots p_k, angles θ_k and indices
    that count round, products of cosines and sines become those of sums of angles:

        2 det(l₁, l₂, l₃) = Σ_k Δ_k × d(ψ_k),   Δ_k = p_{k−1} − p_{k+1},

    with ψ_k = θ_{k+1} + θ_{k−1} − θ_k, and the row is its rate, ½ Σ_k Δ_k·d(ψ_k) ψ̇_k.

    Returns:
        G (3, n_swivels) and phases (3,) of ψ, and the factors (2, 3, n_swivels) of its cosines and
        sines in the row.
    """
    order = {swivel.joint: i for i, swivel in enumerate(drive.swivels)}
    meeting = [*drive.steered, follower]
    G = np.array([s.sign * np.eye(len(order))[order[s.joint]] for s in meeting])
    phase, pivots = [s.heading for s in meeting], [s.pivot for s in meeting]
    if drive.has_axle:  # it holds one leader then
        G = np.vstack([np.zeros(len(order)), G])
        phase, pivots = [drive.heading, *phase], [drive.point, *pivots]
    sides = np.roll(pivots, 1, axis=0) - np.roll(pivots, -1, axis=0)  # Δ (3, 2), m
    combine = 1.0 - 2.0 * np.eye(3)
    return combine @ G, combine @ phase, 0.5 * sides.T[:, :, None] * (combine @ G)


def _across(drive: Drive, lateral: dict[str, int]) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Return the row of each lateral force, and the wheels (indices) that share it.

    Wheels that follow share that of the nearest leader.
    """
    across: dict[int, list[int]] = {}
    if drive.has_axle:
        held = (i for i, wheel in enumerate(drive.wheels) if wheel.swivel is None)
        across[len(drive.wheels)] = [i for i in held if not drive.wheels[i].slides]
    for swivel in drive.swivels:
        leader = swivel
        if swivel.role == "follower":
            leader = min(drive.steered, key=lambda s: math.dist(s.pivot, swivel.pivot))
        across.setdefault(lateral[leader.joint], []).extend(drive.carried(swivel))
    return tuple((row, tuple(wheels)) for row, wheels in across.items())
