"""The base's twist by its steering, at many postures at a time: what the prediction asks most."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Swivel
from rpctl.drive.steering import lateral_row, rolling_row
from rpctl.dynamics.basis import RANK_MARGIN
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import Turning
from rpctl.errors import SingularBasisError


class Part(NamedTuple):
    """A row, or its share, that turns with a steered joint, or with a swivel that mimics one."""

    row: int
    turning: Turning
    share: float
    column: int  # of the steered joint
    ratio: float
    offset: float  # rad


class Steering:
    """Maps from the base's speed and the steering rates to the twist of P.

    They are S's rows of the base, from the constraints that fix it alone: with M(δ) two lateral
    rows and the row of the speed ν₁, and N what turning wheels beside their axes adds to them,

        M(δ) T = (0, 0, ν₁) − N δ̇,    ∂T/∂δ_i = −M⁻¹ (∂M/∂δ_i) T  at given ν₁ and δ̇.

    Args:
        dynamics: Dynamics of a robot with steered wheels.
    """

    def __init__(self, dynamics: ReducedDynamics) -> None:
        robot, rolling = dynamics.robot, dynamics.rolling
        drive = robot.drive
        names = [swivel.joint for swivel in drive.steered]
        self._to_point = robot.point_velocity
        self._constant = np.zeros((3, 3))
        self._right = np.zeros((3, 1 + len(names)))
        self._right[2, 0] = 1.0
        if drive.has_axle:
            self._constant[0] = lateral_row(drive.point, drive.heading)
            self._constant[2] = rolling_row(drive.point, drive.heading)
        fixing = [part for part in rolling.turning if part.swivel.role in ("steered", "mimic")]
        lateral = [part for part in fixing if part.row not in rolling.along]
        rows = {
            row: i + drive.has_axle for i, row in enumerate(dict.fromkeys(p.row for p in lateral))
        }
        self._parts = [_part(rows[part.row], part, 1.0, names) for part in lateral]
        if not drive.has_axle:  # the speed is the first swivel's wheels', on average
            along = [p for p in fixing if p.row in rolling.along and p.swivel == drive.steered[0]]
            self._parts += [_part(2, part, 1.0 / len(along), names) for part in along]
        for row, turning, share, column, ratio, _ in self._parts:
            self._constant[row, 2] += share * turning.lever
            self._right[row, 1 + column] -= share * turning.swivel.sign * turning.lever * ratio

    def maps(self, angles: Array) -> Array:
        """Return the maps (K, 3, 1 + n_steered) at steering angles (K, n_steered), rad.

        Raises:
            SingularBasisError: Some angles fix no one motion.
        """
        rows = np.tile(self._constant, (len(angles), 1, 1))
        for part in self._parts:
            cos, sin = _direction(part, angles)
            x, y = part.turning.swivel.pivot
            rows[:, part.row] += part.share * np.column_stack([cos, sin, sin * x - cos * y])
        return self._to_point @ _solve(rows, self._right)

    def slopes(self, angles: Array, speeds: Array) -> Array:
        """Return the derivatives (K, 3, n_steered) of the twists by the angles.

        Args:
            angles: rad (K, n_steered).
            speeds: The base's speed and the steering rates (K, 1 + n_steered).
        """
        rows = np.tile(self._constant, (len(angles), 1, 1))
        turned = np.zeros((len(angles), angles.shape[1], 3, 3))
        for part in self._parts:
            cos, sin = _direction(part, angles)
            x, y = part.turning.swivel.pivot
            rows[:, part.row] += part.share * np.column_stack([cos, sin, sin * x - cos * y])
            gain = part.share * part.turning.swivel.sign * part.ratio
            turned[:, part.column, part.row] += gain * np.column_stack(
                [-sin, cos, cos * x + sin * y]
            )
        twist = _solve(rows, (speeds @ self._right.T)[:, :, None])[:, :, 0]
        changed = np.einsum("kirj,kj->kri", turned, twist)
        return -self._to_point @ _solve(rows, changed)


def _part(row: int, turning: Turning, share: float, names: list[str]) -> Part:
    swivel: Swivel = turning.swivel
    if swivel.role == "steered":
        return Part(row, turning, share, names.index(swivel.joint), 1.0, 0.0)
    column = names.index(str(swivel.shares))
    return Part(row, turning, share, column, swivel.ratio, swivel.offset)


def _direction(part: Part, angles: Array) -> tuple[Array, Array]:
    position = part.ratio * angles[:, part.column] + part.offset
    angle = part.turning.angle + part.turning.swivel.sign * position
    return np.cos(angle), np.sin(angle)


def _solve(rows: Array, right: Array) -> Array:
    """Return rows⁻¹ right of each posture: (K, 3, 3), and (3, n) or (K, 3, n)."""
    try:
        inverse = np.asarray(np.linalg.inv(rows), dtype=float)
    except np.linalg.LinAlgError:
        inverse = np.full(rows.shape, np.inf)
    size = np.abs(rows).max(axis=(1, 2)) * np.abs(inverse).max(axis=(1, 2))
    if not (size * RANK_MARGIN < 1.0).all():
        raise SingularBasisError("the steered wheels fix no one motion ahead")
    return inverse @ right
