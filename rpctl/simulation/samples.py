"""The samples of a closed loop as it hands them over: rows of numbers, and nothing derived."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.reference.motion import ReferenceState
from rpctl.robot.model import Robot

NO_DIRECTION = np.full(9, np.nan)  # of a reference that gives none


class Samples(NamedTuple):
    """K samples of one run, a row each; see :class:`rpctl.simulation.log.Log`.

    The fields from ``pose`` on are those of the reference's state, its nine numbers of direction
    NaN where it gives none. Joint accelerations are not kept: nothing in a log needs them.
    """

    t: Array  # (K,)
    work: Array  # (K,)
    lost: Array  # (K,)
    limits: Array  # (K,) number of the set of limits that bind
    q: Array
    nu: Array
    tau: Array
    nu_d: Array
    nu_cmd: Array  # (K, 0) where efforts are sent
    e: Array
    pose: Array
    twist: Array
    twist_dot: Array
    joints: Array
    joint_rates: Array
    direction: Array
    felt: Array  # (K, w) what only the plant knows, one after another; (K, 0) where it rolls

    def rows(self, chosen: slice | NDArray[np.intp]) -> Samples:
        """Return some of them."""
        return Samples(*(column[chosen] for column in self))

    def is_finite(self) -> NDArray[np.bool_]:
        """Return whether each sample (K,) holds finite numbers, but for what is not given."""
        given = (*self[:-2], self.felt)
        columns = (column.reshape(len(self.t), -1) for column in given)
        return np.asarray(np.isfinite(np.hstack(list(columns))).all(axis=1))

    def state(self, k: int | slice = slice(None)) -> ReferenceState:
        """Return the reference's state at a sample, or at some of them, a row each.

        Of several samples the direction is left out.
        """
        direction = self.direction[k].reshape(-1, 3, 3)[0] if isinstance(k, int) else NO_DIRECTION
        return ReferenceState(
            self.pose[k],
            self.twist[k],
            self.twist_dot[k],
            self.joints[k],
            self.joint_rates[k],
            np.zeros_like(self.joints[k]),
            None if np.isnan(direction.flat[0]) else direction,
        )


class SampleBuffer:
    """Takes samples one by one, each whole or not at all.

    Args:
        robot: The robot.
        rows: How many samples there is room for.
        speeds: Whether speeds are sent.
        felt: How many numbers of a sample only the plant knows.
    """

    def __init__(self, robot: Robot, rows: int, speeds: bool = False, felt: int = 0) -> None:
        n = len(robot.joints)
        widths = [1, 1, 1, 1, robot.nq, robot.dof, len(robot.actuators), robot.dof]
        widths += [robot.dof if speeds else 0, 3 + n, 3, 3, 3, n, n, len(NO_DIRECTION)]
        widths += [felt]
        self._ends = np.cumsum(widths)[:-1]
        self._rows = np.empty((rows, sum(widths)))

    def __len__(self) -> int:
        """Return how many samples there is room for."""
        return len(self._rows)

    def put(
        self,
        k: int,
        numbers: tuple[float, float, float, float],
        arrays: tuple[Array, ...],
        state: ReferenceState,
        felt: Sequence[Array] = (),
    ) -> None:
        """Write a sample.

        Args:
            k: Its place, 0 to one less than the room.
            numbers: ``t``, ``work``, ``lost`` and ``limits``.
            arrays: ``q``, ``nu``, ``tau``, ``nu_d``, ``nu_cmd`` and ``e``.
            state: The reference's.
            felt: What only the plant knows.
        """
        direction = NO_DIRECTION if state.direction is None else np.ravel(state.direction)
        np.concatenate(
            (
                np.array(numbers),
                *arrays,
                state.pose,
                state.twist,
                state.twist_dot,
                state.joints,
                state.joint_rates,
                direction,
                *(np.ravel(array) for array in felt),
            ),
            out=self._rows[k],
        )

    def first(self, count: int) -> Samples:
        """Return the first samples."""
        columns = np.split(self._rows[:count], self._ends, axis=1)
        return Samples(*(column[:, 0] for column in columns[:4]), *columns[4:])
