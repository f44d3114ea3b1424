"""Soft rows that keep the base and the end effector clear of obstacles; slack in metres."""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.qp_builder import LinearisedConstraint, RowBlock, StageIndices
from rpctl.control.horizon.target import EndEffectorPoints, Sample, Target
from rpctl.control.obstacles import Obstacle


class BaseClearance:
    """The base, a disc of ``radius`` (m) about P, after each step."""

    def __init__(self, obstacles: tuple[Obstacle, ...], radius: float) -> None:
        self._obstacles, self._radius = obstacles, radius

    def row_blocks(self, indices: StageIndices) -> list[RowBlock]:
        """Return one family, on the position of P."""
        return [RowBlock(indices.pose[:, :2], len(self._obstacles))]

    def linearise(self, sample: Sample) -> list[LinearisedConstraint]:
        """Return its numbers."""
        points = sample.motion.pose[1:, :2]
        stride = float(np.linalg.norm(np.diff(sample.motion.pose[:, :2], axis=0), axis=1).max())
        jacobian = np.broadcast_to(np.eye(2), (len(points), 2, 2))
        return [_clear(self._obstacles, self._radius, points, jacobian, stride)]


class ArmClearance:
    """The end effector, a ball of ``radius`` (m), after some of the steps."""

    def __init__(self, obstacles: tuple[Obstacle, ...], radius: float, stages: list[int]) -> None:
        self._obstacles, self._radius, self._stages = obstacles, radius, stages

    def row_blocks(self, indices: StageIndices) -> list[RowBlock]:
        """Return one family, on pose and arm."""
        unknowns = np.hstack([indices.pose[self._stages], indices.joints[self._stages]])
        return [RowBlock(unknowns, len(self._obstacles))]

    def linearise(self, sample: Sample) -> list[LinearisedConstraint]:
        """Return its numbers."""
        end_effector = sample.end_effector
        if end_effector is None:
            raise ValueError("a robot without an end effector has no clearance of it")
        points, jacobian = end_effector.positions[:, :2], end_effector.jacobian[:, :2]
        stride = float(np.linalg.norm(points[1] - points[0]))  # the first stages are one step apart
        return [_clear(self._obstacles, self._radius, points, jacobian, stride)]


def _clear(
    obstacles: tuple[Obstacle, ...], radius: float, points: Array, jacobian: Array, stride: float
) -> LinearisedConstraint:
    """Return level − normal · p ≤ slack of points (K, 2) with derivatives (K, 2, unknowns)."""
    lines = [obstacle.linearise(points, radius, stride) for obstacle in obstacles]
    values = [line.level - (line.normal * points).sum(axis=1) for line in lines]
    by = [-np.einsum("ki,kij->kj", line.normal, jacobian) for line in lines]
    return LinearisedConstraint(np.column_stack(values), np.stack(by, axis=1))


def base_detour(
    target: Target, start: Array, obstacles: tuple[Obstacle, ...], radius: float, turns: bool
) -> Target:
    """Return a target that leads round what lies between the base and it.

    Args:
        target: The reference ahead.
        start: Position of P now (2,), m.
        obstacles: What the base must keep clear of.
        radius: Of the base, m.
        turns: Whether the base has to head where it goes, backwards where the reference does.
    """
    goals = target.pose[:, :2]
    for obstacle in obstacles:
        goals = obstacle.around(start, goals, radius)
    changed = (goals != target.pose[:, :2]).any(axis=1)
    if not changed.any():
        return target
    pose = target.pose.copy()
    pose[:, :2] = goals
    if turns:
        ahead = goals - start
        back = np.where(target.nu[:, 0] < 0.0, math.pi, 0.0)
        pose[:, 2] = np.where(changed, np.arctan2(ahead[:, 1], ahead[:, 0]) + back, pose[:, 2])
    return target._replace(pose=pose)


def arm_detour(
    end_effector: EndEffectorPoints, obstacles: tuple[Obstacle, ...], radius: float
) -> EndEffectorPoints:
    """Return goals of the end effector that lead round what lies between it and them."""
    goals = end_effector.goals.copy()
    for obstacle in obstacles:
        goals[:, :2] = obstacle.around(end_effector.positions[0, :2], goals[:, :2], radius)
    return end_effector._replace(goals=goals)
