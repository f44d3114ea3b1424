"""The base's twist by its steering, at many postures at a time: what the prediction asks most."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.basis import RANK_MARGIN, selection
from rpctl.dynamics.projection import eliminate
from rpctl.dynamics.rolling import find_rolling
from rpctl.errors import SingularBasisError
from rpctl.robot.model import BASE_NV, Robot


class Steering:
    """Maps from the base's speed and the steering rates to the twist of P.

    They are S's rows of the base. Casters and followers have no part in them, so they glide here.
    With M(δ) y = R ν and T = X(δ) y + C ν from :func:`rpctl.dynamics.projection.eliminate`,

        ∂T/∂δ_i = (∂X/∂δ_i) y − X M⁻¹ (∂M/∂δ_i) y   at given ν.

    Args:
        robot: A robot with steered wheels.
    """

    def __init__(self, robot: Robot) -> None:
        drive = robot.drive
        rolling = find_rolling(robot, gliding=("caster", "follower"))
        core, _, _, R, C = eliminate(rolling.matrix, selection(robot, rolling))
        speeds = len(drive.base_speeds)
        self._R, self._C = R[:, :speeds], C[:BASE_NV, :speeds]
        self._point_velocity = robot.point_velocity
        leaders = [swivel.joint for swivel in drive.steered]
        spread, offset = np.zeros((len(drive.swivels), len(leaders))), np.zeros(len(drive.swivels))
        for i, swivel in enumerate(drive.swivels):
            if swivel.role == "steered":
                spread[i, leaders.index(swivel.joint)] = 1.0
            elif swivel.role == "mimic":
                spread[i, leaders.index(str(swivel.shares))] = swivel.ratio
                offset[i] = swivel.offset
        base = core.map(lambda part: part[..., : len(R) + BASE_NV, :])
        self._matrix = base.following(spread, offset)

    def maps(self, angles: Array) -> Array:
        """Return the maps (K, 3, 1 + n_steered) at steering angles (K, n_steered), rad.

        Raises:
            SingularBasisError: Some angles fix no one motion.
        """
        inverse, X = self._solve(self._matrix.turn(angles))
        return np.asarray(self._point_velocity @ (X @ (inverse @ self._R) + self._C))

    def jacobian(self, angles: Array, speeds: Array) -> Array:
        """Return the derivatives (K, 3, n_steered) of the twists by the angles.

        Args:
            angles: rad (K, n_steered).
            speeds: The base's speed and the steering rates (K, 1 + n_steered).
        """
        u = self._matrix.turn(angles)
        inverse, X = self._solve(u)
        y = inverse @ (speeds @ self._R.T)[:, :, None]  # (K, n, 1)
        change = self._matrix.rate(u[:, None], np.eye(angles.shape[1])) @ y[:, None]
        change = np.swapaxes(change[..., 0], 1, 2)  # (K, n + 3, n_steered)
        count = len(self._R)
        jacobian = change[:, count:] - X @ (inverse @ change[:, :count])
        return np.asarray(self._point_velocity @ jacobian)

    def _solve(self, u: Array) -> tuple[Array, Array]:
        """Return M⁻¹ (K, n, n) and X (K, 3, n) of each posture."""
        found, count = self._matrix.at(u), len(self._R)
        M = found[:, :count]
        try:
            inverse = np.asarray(np.linalg.inv(M), dtype=float)
        except np.linalg.LinAlgError:
            inverse = np.full(M.shape, np.inf)
        size = np.abs(M).max(axis=(1, 2)) * np.abs(inverse).max(axis=(1, 2))
        if not (size * RANK_MARGIN < 1.0).all():
            raise SingularBasisError("the steered wheels fix no one motion ahead")
        return inverse, found[:, count:]
