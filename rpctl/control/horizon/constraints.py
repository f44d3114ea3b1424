"""Constraints of the horizon law's QP: hard bounds on each unknown, soft rows for the rest."""

from __future__ import annotations

from collections import deque
from typing import Protocol

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.forces import ForceModel, stack
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.qp import (
    LinearisedConstraint,
    RowBlock,
    StageValues,
)
from rpctl.control.horizon.settings import Bounds, is_turning
from rpctl.control.horizon.target import Sample
from rpctl.control.obstacles import Obstacle
from rpctl.dynamics.ground_reaction import Contacts
from rpctl.robot.model import Robot

GROUND_STRIDE = 3  # steps between the stages with constraints on the ground's reactions
KEPT_LOAD_SPLITS = 3  # last load splits that bound the first step
BRAKING_ROOM = 1e-9  # rad or m: room left to a joint that can only just brake


class HardBounds:
    """Hard bounds of accelerations, speeds and joint positions, as far as they can be kept.

    A speed above its bound, or a position too close to its limit to stop before it, is only asked
    to brake as hard as allowed; so the bounds never contradict each other.
    """

    def __init__(self, model: Model, bounds: Bounds) -> None:
        joints, self._base = model.joints, model.base
        self._linear_speeds = np.flatnonzero(np.logical_not(is_turning(model)))
        self._catch_up, self._dt = bounds.catch_up, model.dt
        self._max_acceleration = bounds.accelerations(model)
        # Between two steps a parabola rises above its chord by at most a dt²/8.
        parabola_height = 0.125 * self._max_acceleration[model.base :] * model.dt**2
        self._lower = np.array([joint.lower for joint in joints]) + parabola_height
        self._upper = np.array([joint.upper for joint in joints]) - parabola_height
        self._max_speed = np.full((model.steps, model.robot.dof), np.inf)
        self._max_speed[:, model.base :] = bounds.share * np.array([j.velocity for j in joints])
        later = np.arange(1, model.steps + 1)[:, None]
        self._braked_speed = later * model.dt * self._max_acceleration  # lost by each step

    def linearise(self, sample: Sample) -> tuple[StageValues, StageValues]:
        """Return lower and upper bounds of the deviations from the predicted motion."""
        motion, base = sample.motion, self._base
        braked_nu = np.sign(motion.nu[0]) * np.maximum(
            np.abs(motion.nu[0]) - self._braked_speed, 0.0
        )
        braked_nu_sums = np.vstack([motion.nu[0], braked_nu[:-1]]) + braked_nu
        stopping_positions = motion.joints[0] + 0.5 * self._dt * np.cumsum(
            braked_nu_sums[:, base:], axis=0
        )
        lower = np.minimum(self._lower, stopping_positions - BRAKING_ROOM) - motion.joints[1:]
        upper = np.maximum(self._upper, stopping_positions + BRAKING_ROOM) - motion.joints[1:]
        fastest = self._max_speed.copy()
        reference_nu = sample.target.nu[1:, self._linear_speeds]
        fastest[:, self._linear_speeds] = (
            np.linalg.norm(reference_nu, axis=1, keepdims=True) + self._catch_up
        )
        fastest = np.maximum(fastest, np.abs(braked_nu) + BRAKING_ROOM)
        nu, free = motion.nu[1:], np.full((len(braked_nu), 3 if base else 0), np.inf)
        return (
            StageValues(-self._max_acceleration - motion.nu_dot, -free, lower, -fastest - nu),
            StageValues(self._max_acceleration - motion.nu_dot, free, upper, fastest - nu),
        )


class SoftBound(Protocol):
    """Soft constraints of one kind."""

    def row_blocks(self, indices: StageValues) -> list[RowBlock]:
        """Return the structure of the rows, in the order of :meth:`linearise`."""

    def linearise(self, sample: Sample) -> list[LinearisedConstraint]:
        """Return the values of the rows about a motion."""


class WheelSpeeds:
    """Wheel speeds Bᵀν within their limits, in units of the limits.

    ν is that after each step; powered casters have the angles before it: within a step they turn
    towards the motion, and are fastest while they stand across it.
    """

    def __init__(self, model: Model, bounds: Bounds) -> None:
        joints = {joint.name for joint in model.joints}
        limited, limits = bounds.rates(model.robot)
        wheels = [i for i, k in enumerate(limited) if model.robot.actuators[k] not in joints]
        self._limited, self._limits = limited[wheels], limits[wheels]
        self._model, self._constant_rates = model, None
        if not model.steered and not len(model.casters):  # other casters have no actuators
            self._constant_rates = self._rates(np.zeros(len(model.joints)), np.empty(0))

    def _rates(self, joints: Array, casters: Array) -> Array:
        """Return the map (n, dof) from ν to the wheels' rates over their limits."""
        q = self._model.configuration(joints, casters=casters)
        B = self._model.dynamics.actuation(q)
        return B.T[self._limited] / self._limits[:, None]

    def row_blocks(self, indices: StageValues) -> list[RowBlock]:
        """Return one block, on ν after each step."""
        if not len(self._limited):
            return []
        return [RowBlock(indices.nu[:, : self._model.base_columns], 2 * len(self._limited))]

    def linearise(self, sample: Sample) -> list[LinearisedConstraint]:
        """Return the values of the block."""
        if not len(self._limited):
            return []
        motion = sample.motion
        if self._constant_rates is not None:
            rates = np.broadcast_to(
                self._constant_rates, (len(motion.nu_dot), *self._constant_rates.shape)
            )
        else:
            postures = zip(motion.joints[1:], motion.casters[:-1], strict=True)
            rates = np.array([self._rates(*posture) for posture in postures])
        value = np.einsum("kij,kj->ki", rates, motion.nu[1:])
        jacobian = rates[:, :, : self._model.base_columns]
        return [
            LinearisedConstraint(
                np.hstack([value, -value]) - 1.0, np.concatenate([jacobian, -jacobian], axis=1)
            )
        ]


class ForceBounds:
    """Efforts within their limits, zero-moment point inside the polygon, wheels within their grip.

    The rows of the first step, the one that is carried out, depend on all accelerations. Later
    steps have rows for the ground only, every few stages, and depend on the base's motion
    only: rows that tie all joints together at many stages would cost the QP its sparsity.

    Contacts lift off and touch down, so the wheels' loads are only piecewise linear in the moments.
    A first step bounded by one piece may end in another piece and slip there; it is therefore
    bounded by the last three load splits met.
    """

    def __init__(self, model: Model, bounds: Bounds, forces: ForceModel) -> None:
        self._limited, self._limits = bounds.efforts(model.robot)
        self._model, self._forces, self._ground = model, forces, forces.ground
        self._load_splits: deque[Array] = deque(maxlen=KEPT_LOAD_SPLITS)
        self._ground_stages = every_nth_stage(model.steps, GROUND_STRIDE)

    def row_blocks(self, indices: StageValues) -> list[RowBlock]:
        """Return the blocks of the efforts, of the ground at once, and of the ground later."""
        efforts = RowBlock(indices.nu_dot[:1], 2 * len(self._limited))
        if self._ground is None:
            return [efforts]
        base, now = self._model.base_columns, KEPT_LOAD_SPLITS * self._ground.grip_rows
        before = [k - 1 for k in self._ground_stages]
        later = np.hstack([indices.nu_dot[self._ground_stages, :base], indices.nu[before, :base]])
        at_once = RowBlock(indices.nu_dot[:1], self._ground.edges + now)
        return [efforts, at_once, RowBlock(later, self._ground.rows)]

    def linearise(self, sample: Sample) -> list[LinearisedConstraint]:
        """Return the values of the blocks."""
        motion, model = sample.motion, self._model
        base, dof = model.base_columns, model.robot.dof
        now = self._forces.at(motion.start, motion.nu[0], motion.nu_dot[0], dof, 0, model.dynamics)
        tau = self._forces.efforts(now)[self._limited] / self._limits[:, None]
        both = np.concatenate([tau, -tau])[None]
        efforts = LinearisedConstraint(both[:, :, 0] - 1.0, both[:, :, 1:])
        if self._ground is None:
            return [efforts]
        self._remember(self._ground.load_split(now))
        grips = self._ground.grip(now, np.array(self._load_splits))
        forces = []
        for k in self._ground_stages:
            q = model.configuration(motion.joints[k], casters=motion.casters[k])
            forces.append(self._forces.at(q, motion.nu[k], motion.nu_dot[k], base, base))
        margins = np.vstack([self._ground.tip(now), *grips])[None], self._ground(stack(forces))
        rows = [LinearisedConstraint(-each[:, :, 0], -each[:, :, 1:]) for each in margins]
        return [efforts, *rows]

    def _remember(self, load_split: Array) -> None:
        """Remember a load split; the first stands for the others as well."""
        if not self._load_splits:
            self._load_splits.extend([load_split] * KEPT_LOAD_SPLITS)
        elif not np.array_equal(load_split, self._load_splits[-1]):
            self._load_splits.append(load_split)


class BaseClearance:
    """Clearance of the base, a disc of ``radius`` (m) about P, after each step; slack in m."""

    def __init__(self, obstacles: tuple[Obstacle, ...], radius: float) -> None:
        self._obstacles, self._radius = obstacles, radius

    def row_blocks(self, indices: StageValues) -> list[RowBlock]:
        """Return one block, on the position of P."""
        return [RowBlock(indices.pose[:, :2], len(self._obstacles))]

    def linearise(self, sample: Sample) -> list[LinearisedConstraint]:
        """Return the values of the block."""
        points = sample.motion.pose[1:, :2]
        stride = float(np.linalg.norm(np.diff(sample.motion.pose[:, :2], axis=0), axis=1).max())
        jacobian = np.broadcast_to(np.eye(2), (len(points), 2, 2))
        return [_clear(self._obstacles, self._radius, points, jacobian, stride)]


class ArmClearance:
    """Clearance of the end effector at some stages; slack in m.

    Args:
        obstacles: Obstacles of the end effector.
        radius: Radius of the end effector, m.
        stages: Stages with this constraint; the first two are one step apart.
    """

    def __init__(self, obstacles: tuple[Obstacle, ...], radius: float, stages: list[int]) -> None:
        self._obstacles, self._radius, self._stages = obstacles, radius, stages

    def row_blocks(self, indices: StageValues) -> list[RowBlock]:
        """Return one block, on pose and joints."""
        unknowns = np.hstack([indices.pose[self._stages], indices.joints[self._stages]])
        return [RowBlock(unknowns, len(self._obstacles))]

    def linearise(self, sample: Sample) -> list[LinearisedConstraint]:
        """Return the values of the block."""
        end_effector = sample.end_effector
        if end_effector is None:
            raise ValueError("a robot without an end effector has no clearance of it")
        points, jacobian = end_effector.positions[:, :2], end_effector.jacobian[:, :2]
        stride = float(np.linalg.norm(points[1] - points[0]))  # the first stages are one step apart
        return [_clear(self._obstacles, self._radius, points, jacobian, stride)]


def _clear(
    obstacles: tuple[Obstacle, ...], radius: float, points: Array, jacobian: Array, stride: float
) -> LinearisedConstraint:
    """Return level − normal · p ≤ slack, linearised.

    Args:
        obstacles: Obstacles to keep clear of.
        radius: Radius about each point, m.
        points: Points p (K, 2), m.
        jacobian: Their derivatives (K, 2, unknowns).
        stride: Distance between successive points, m.
    """
    lines = [obstacle.linearise(points, radius, stride) for obstacle in obstacles]
    values = [line.level - (line.normal * points).sum(axis=1) for line in lines]
    by = [-np.einsum("ki,kij->kj", line.normal, jacobian) for line in lines]
    return LinearisedConstraint(np.column_stack(values), np.stack(by, axis=1))


def contact_radius(robot: Robot, contacts: Contacts | None) -> float:
    """Return the distance of P to the farthest contact, m; 0 for a fixed base."""
    if contacts is None:
        return 0.0
    return float(np.linalg.norm(contacts.points - robot.drive.point, axis=1).max())


def every_nth_stage(steps: int, every: int) -> list[int]:
    """Return every ``every``-th stage, counted back from the last."""
    return list(range(steps - 1, 0, -every))[::-1]
