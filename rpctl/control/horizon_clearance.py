"""Soft rows that keep the base and the end effector clear of obstacles; slack in metres."""

from __future__ import annotations

import numpy as np

from rpctl.control.horizon_program import Family, Soft, Stages
from rpctl.control.horizon_sample import Sample
from rpctl.control.obstacles import Obstacle
from rpctl.description.records import Array


class BaseClearance:
    """The base, a disc of ``radius`` (m) about P, after each step."""

    def __init__(self, obstacles: tuple[Obstacle, ...], radius: float) -> None:
        self._obstacles, self._radius = obstacles, radius

    def families(self, at: Stages) -> list[Family]:
        """Return one family, on the position of P."""
        return [Family(at.pose[:, :2], len(self._obstacles))]

    def about(self, sample: Sample) -> list[Soft]:
        """Return its numbers."""
        points, goals = sample.motion.pose[1:, :2], sample.target.pose[1:, :2]
        slopes = np.broadcast_to(np.eye(2), (len(points), 2, 2))
        return [_clear(self._obstacles, self._radius, points, goals, slopes)]


class ArmClearance:
    """The end effector, a ball of ``radius`` (m), after some of the steps."""

    def __init__(self, obstacles: tuple[Obstacle, ...], radius: float, stages: list[int]) -> None:
        self._obstacles, self._radius, self._stages = obstacles, radius, stages

    def families(self, at: Stages) -> list[Family]:
        """Return one family, on pose and arm."""
        unknowns = np.hstack([at.pose[self._stages], at.joints[self._stages]])
        return [Family(unknowns, len(self._obstacles))]

    def about(self, sample: Sample) -> list[Soft]:
        """Return its numbers."""
        reach = sample.reach
        if reach is None:
            raise ValueError("a robot without an end effector has no clearance of it")
        points, goals = reach.places[:, :2], reach.goals[:, :2]
        return [_clear(self._obstacles, self._radius, points, goals, reach.slopes[:, :2])]


def _clear(
    obstacles: tuple[Obstacle, ...], radius: float, points: Array, goals: Array, slopes: Array
) -> Soft:
    """Return level − normal · p ≤ slack of points (K, 2) with derivatives (K, 2, unknowns)."""
    lines = [obstacle.linearise(points, goals, radius) for obstacle in obstacles]
    values = [line.level - (line.normal * points).sum(axis=1) for line in lines]
    by = [-np.einsum("ki,kij->kj", line.normal, slopes) for line in lines]
    return Soft(np.column_stack(values), np.stack(by, axis=1))
