"""Arm motions that keep the robot's links clear of each other and of the ground."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.reference.path_reference import Waves
from rpctl.robot.collision import TOUCH_M, CollisionModel, collision_model
from rpctl.robot.model import Robot
from rpctl.robot.pair_motion import approach_rates, joint_motion, joint_travel

MARGIN_M = 0.01  # m: what links keep where they would touch at the full swing
KEPT_AT_MOST = 0.5  # of a pair's distance at home: links that are near there cannot keep more
STEP = 0.8  # factor by which the swings are reduced until the links are clear
MAX_STEPS = 24  # of these, to half a percent
MEETING_PERIODS = 16  # of the slowest wave, after which the waves meet as at the start
SAMPLES = 2001  # postures that are looked at in this time
KNOWN = 4  # answers that are kept: the references of a robot share its arm's motion
LOOK_M = 2e-3  # m: how far a pair may move on before it is looked at again, at least


def clear_waves(arm: Waves, robot: Robot) -> tuple[Waves, str]:
    """Return an arm's motion that keeps links clear of each other and of the ground.

    Returns:
        The motion, all its swings reduced by one factor where it needs that, and what for; it is
        the same object where it needs nothing.
    """
    if not arm.amplitude.any():
        return arm, ""
    shares = (tuple(each.tolist()) for each in (arm.centre, arm.amplitude, arm.rate))
    factor, why = _clear_factor(collision_model(robot), *shares)
    return (arm if factor == 1.0 else replace(arm, amplitude=factor * arm.amplitude)), why


@lru_cache(maxsize=KNOWN)
def _clear_factor(model: CollisionModel, *shares: tuple[float, ...]) -> tuple[float, str]:
    """Return the factor of the swing that keeps links clear, and what it is for.

    Args:
        *shares: Centre, amplitude and rate of the joints' waves.
    """
    if not len(model.pairs):
        return 1.0, ""
    scan, factor, near = _WaveScan(Waves(*map(np.array, shares)), model), 1.0, None
    for step in range(MAX_STEPS):
        factor = STEP**step
        found = scan.too_near(factor, MARGIN_M if step else TOUCH_M)
        if found is None:
            break
        near = found
    else:
        factor = 0.0
    if near is None:
        return 1.0, ""
    first, second = (model.shapes[k].link for k in model.pairs[near].tolist())
    return factor, f"swing reduced to {100.0 * factor:.0f} % to keep {first} clear of {second}"


class _WaveScan:
    """Follows the pairs of a model along a motion."""

    def __init__(self, arm: Waves, model: CollisionModel) -> None:
        self._arm, self._model, self._distances = arm, model, model.distances()
        ends = np.array([self._configuration(sines) for sines in (0.0, 1.0)])
        self._rates = approach_rates(model, joint_travel(model.robot, ends))
        self._way = self._rates @ joint_motion(model.robot, ends)[0]  # (n,) m: at full swing
        self._distances.place(ends[0])
        home = np.array([self._distances.distance(pair) for pair in range(len(model.pairs))])
        self._home = home  # (n,) m

    def too_near(self, factor: float, margin: float) -> int | None:
        """Return a pair that does not keep its distance at this factor of the swing, or None.

        Between two looks a pair comes no nearer than the joints' motion allows, so it is looked at
        only where it can have come too near.

        Args:
            margin: Distance that pairs keep, m, or ``KEPT_AT_MOST`` of that at home.
        """
        need = np.minimum(margin, KEPT_AT_MOST * self._home)  # (n,) m: what the pairs keep
        slack = self._home - need  # (n,) m: how much nearer they may come
        left = np.flatnonzero(factor * self._way > slack)
        if not left.size:
            return None
        goal = slack[left]
        for sines, gone in zip(self._sines, factor * self._paths(left), strict=True):
            due = np.flatnonzero(gone >= goal)
            if due.size:
                self._distances.place(self._configuration(factor * sines))
            for row in due.tolist():
                pair = int(left[row])
                room = self._distances.distance(pair) - need[pair]
                if room < 0.0:
                    return pair
                goal[row] = gone[row] + max(room, LOOK_M)
        return None

    @cached_property
    def _sines(self) -> Array:
        """The sines (SAMPLES, n_joints) of the joints' waves until they meet again."""
        rate = self._arm.rate
        end = MEETING_PERIODS * 2.0 * math.pi / float(rate.min())
        return np.asarray(np.sin(np.linspace(0.0, end, SAMPLES)[:, None] * rate))

    @cached_property
    def _turned(self) -> Array:
        """How far each joint went since the start (SAMPLES, columns) at the full swing."""
        q = np.array([self._configuration(sines) for sines in self._sines])
        moved = joint_motion(self._model.robot, q)
        return np.vstack([np.zeros((1, moved.shape[1])), np.cumsum(moved, axis=0)])

    def _paths(self, pairs: NDArray[np.intp]) -> Array:
        """Return how much nearer (SAMPLES, n) pairs can have come at the full swing, m."""
        return np.asarray(self._turned @ self._rates[pairs].T)

    def _configuration(self, sines: Array | float) -> Array:
        """Return q (nq,) where the waves have these sines (n_joints,)."""
        joints = self._arm.centre + self._arm.amplitude * sines
        return self._model.robot.configuration_at(np.zeros(3), joints)
