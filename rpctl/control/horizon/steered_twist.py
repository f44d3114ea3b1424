"""The base's twist by its steering, at many postures at a time: what the prediction asks most."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.drive.drive import Swivel
from rpctl.drive.steering import lateral_row, rolling_row
from rpctl.dynamics.basis import RANK_MARGIN
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import TurningRow
from rpctl.errors import SingularBasisError


class RowTerm(NamedTuple):
    """A row, or its share, that turns with a steered joint, or with a swivel that mimics one."""

    row: int
    turning: TurningRow
    weight: float
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
        self._point_velocity = robot.point_velocity
        self._constant_rows = np.zeros((3, 3))
        self._right_hand_side = np.zeros((3, 1 + len(names)))
        self._right_hand_side[2, 0] = 1.0
        if drive.has_axle:
            self._constant_rows[0] = lateral_row(drive.point, drive.heading)
            self._constant_rows[2] = rolling_row(drive.point, drive.heading)
        base_terms = [term for term in rolling.turning if term.swivel.role in ("steered", "mimic")]
        lateral = [term for term in base_terms if term.row not in rolling.along]
        rows = {
            row: i + drive.has_axle for i, row in enumerate(dict.fromkeys(p.row for p in lateral))
        }
        self._terms = [_row_term(rows[term.row], term, 1.0, names) for term in lateral]
        if not drive.has_axle:  # the speed is the first swivel's wheels', on average
            along = [
                p for p in base_terms if p.row in rolling.along and p.swivel == drive.steered[0]
            ]
            self._terms += [_row_term(2, term, 1.0 / len(along), names) for term in along]
        for row, turning, weight, column, ratio, _ in self._terms:
            self._constant_rows[row, 2] += weight * turning.lever
            self._right_hand_side[row, 1 + column] -= (
                weight * turning.swivel.sign * turning.lever * ratio
            )

    def maps(self, angles: Array) -> Array:
        """Return the maps (K, 3, 1 + n_steered) at steering angles (K, n_steered), rad.

        Raises:
            SingularBasisError: Some angles fix no one motion.
        """
        rows = np.tile(self._constant_rows, (len(angles), 1, 1))
        for term in self._terms:
            cos, sin = _direction(term, angles)
            x, y = term.turning.swivel.pivot
            rows[:, term.row] += term.weight * np.column_stack([cos, sin, sin * x - cos * y])
        return self._point_velocity @ _solve(rows, self._right_hand_side)

    def jacobian(self, angles: Array, speeds: Array) -> Array:
        """Return the derivatives (K, 3, n_steered) of the twists by the angles.

        Args:
            angles: rad (K, n_steered).
            speeds: The base's speed and the steering rates (K, 1 + n_steered).
        """
        rows = np.tile(self._constant_rows, (len(angles), 1, 1))
        row_derivatives = np.zeros((len(angles), angles.shape[1], 3, 3))
        for term in self._terms:
            cos, sin = _direction(term, angles)
            x, y = term.turning.swivel.pivot
            rows[:, term.row] += term.weight * np.column_stack([cos, sin, sin * x - cos * y])
            gain = term.weight * term.turning.swivel.sign * term.ratio
            row_derivatives[:, term.column, term.row] += gain * np.column_stack(
                [-sin, cos, cos * x + sin * y]
            )
        twist = _solve(rows, (speeds @ self._right_hand_side.T)[:, :, None])[:, :, 0]
        derivative_times_twist = np.einsum("kirj,kj->kri", row_derivatives, twist)
        return -self._point_velocity @ _solve(rows, derivative_times_twist)


def _row_term(row: int, turning: TurningRow, weight: float, names: list[str]) -> RowTerm:
    swivel: Swivel = turning.swivel
    if swivel.role == "steered":
        return RowTerm(row, turning, weight, names.index(swivel.joint), 1.0, 0.0)
    column = names.index(str(swivel.shares))
    return RowTerm(row, turning, weight, column, swivel.ratio, swivel.offset)


def _direction(term: RowTerm, angles: Array) -> tuple[Array, Array]:
    position = term.ratio * angles[:, term.column] + term.offset
    angle = term.turning.angle + term.turning.swivel.sign * position
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
