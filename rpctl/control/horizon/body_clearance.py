"""Soft rows that keep a robot's links off the ground, off obstacles and off each other.

Of each two joints the nearest pair of shapes counts. With the nearest points p₁, p₂, the unit
vector n from p₁ to p₂ and the distance d, a row asks

    d + n · (J₂(p₂) − J₁(p₁)) δ ≥ margin − slack.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.constraints import SoftBound, every_nth_stage
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.qp import LinearRows
from rpctl.control.horizon.target import Sample
from rpctl.control.obstacles import Disc, HalfPlane, Obstacle, links_among
from rpctl.robot.collision import WORLD, CollisionModel, Nearest
from rpctl.robot.model import BASE_NV
from rpctl.robot.pair_motion import approach_rates, joint_limits_travel

ROWS = 4  # of the nearest joints at a stage
NEAR_STAGES = 2  # first stages that have rows
STRIDE = 3  # steps between the later ones
RANGE_M = 0.1  # m: pairs that are farther than this beyond their margin have no row
HOME_SHARE = 0.5  # of its distance at home: the margin of a pair of links that are nearer by build
HOME_RANGE = 0.5  # of that margin: such a pair has no row as long as it stays as at home
TIE_M = 0.003  # m: of two pairs whose distances differ by no more either may have the row
FAR = -1.0  # m: value of a row that asks nothing


class BodyClearance:
    """Distances of the links at some stages; slack in m.

    A pair's distance is computed only where it may be within reach: since it was computed last,
    the joints' motion can have taken no more than a known bound from it.

    Args:
        margin: Distance that the links keep, m; half of what they have at home, if that is less.

    Attributes:
        stages: Stages that have rows.
    """

    def __init__(self, model: Model, shapes: CollisionModel, margin: float) -> None:
        self._model, self._distances = model, shapes.distances()
        self.stages = sorted(
            {*range(min(NEAR_STAGES, model.steps)), *every_nth_stage(model.steps, STRIDE)}
        )
        robot = model.robot
        rates = approach_rates(shapes, joint_limits_travel(robot))
        self._rates = np.hstack([rates[:, :1], rates])  # |Δx| + |Δy| is no less than the way
        self._joints = np.array([shape.joint for shape in shapes.shapes])[shapes.pairs]  # (n, 2)
        own = self._joints[:, 1] != WORLD
        # A group are the pairs of the same two joints, or of one joint and one obstacle.
        obstacles = np.where(own, -1, shapes.pairs[:, 1])
        keys = np.column_stack([self._joints, obstacles])
        self._group = np.unique(keys, axis=0, return_inverse=True)[1].ravel().tolist()
        home = robot.configuration_at(np.zeros(BASE_NV), robot.home)
        self._by_joints = model.dynamics.basis(home)[:, model.base :].copy()  # v by their rates
        self._by_joints[:BASE_NV] = 0.0
        self._distances.place(home)
        known = np.array([self._distances.distance(pair) for pair in range(len(own))])
        self._margin = np.where(own, np.minimum(margin, HOME_SHARE * known), margin)
        self._range = np.where(self._margin < margin, HOME_RANGE * self._margin, RANGE_M)
        # Of each stage: a stage's posture changes little from one solve to the next.
        self._known = np.tile(known, (len(self.stages), 1))
        self._where = np.tile(self._state(home), (len(self.stages), len(own), 1))

    def __call__(self, sample: Sample) -> list[LinearRows]:
        """Return the rows, on pose and joints."""
        motion, model = sample.motion, self._model
        columns = BASE_NV + len(model.joints)
        value = np.full((len(self.stages), ROWS), FAR)
        jacobian = np.zeros((len(self.stages), ROWS, columns))
        for stage, k in enumerate(self.stages):
            pose = motion.pose[k + 1]
            q = model.configuration(motion.joints[k + 1], pose)
            found = self._nearest_pairs(stage, q)
            if not found:
                continue
            pin.computeJointJacobians(model.robot.model, self._distances.data, q)
            for row, (pair, nearest) in enumerate(found):
                value[stage, row] = self._margin[pair] - nearest.distance
                jacobian[stage, row] = -self._gradient(pair, nearest, pose)
        return [LinearRows(model.pose_and_joints(self.stages), value, jacobian)]

    def _state(self, q: Array) -> Array:
        """Return x, y, heading and the joints' positions: what distances change with."""
        entries = self._model.robot.entries.values()
        return np.array([q[0], q[1], np.arctan2(q[3], q[2]), *(entry.read(q) for entry in entries)])

    def _nearest_pairs(self, stage: int, q: Array) -> list[tuple[int, Nearest]]:
        """Return the pairs that have rows at a stage, in q (nq,), the nearest first."""
        state, known, where = self._state(q), self._known[stage], self._where[stage]
        moved = np.einsum("ij,ij->i", self._rates, np.abs(state - where))
        spare = known - moved - self._margin  # at least
        near = np.flatnonzero(spare < self._range)
        if not len(near):
            return []
        self._distances.place(q)
        best: dict[int, tuple[float, int]] = {}
        for number in near[np.argsort(spare[near])].tolist():
            group = self._group[number]
            if group in best and spare[number] >= best[group][0] - TIE_M:
                continue
            known[number], where[number] = self._distances.distance(number), state
            left = float(known[number] - self._margin[number])
            if left < min(self._range[number], best[group][0] if group in best else np.inf):
                best[group] = left, number
        chosen = [pair for _, pair in sorted(best.values())[:ROWS]]
        return [(pair, self._distances.nearest(pair)) for pair in chosen]

    def _gradient(self, pair: int, nearest: Nearest, pose: Array) -> Array:
        """Return the derivatives of a pair's distance by pose and joints (columns,)."""
        normal, by_v, by_pose = nearest.normal, np.zeros(self._model.robot.nv), np.zeros(BASE_NV)
        robot, data = self._model.robot.model, self._distances.data
        points = (nearest.first, -1.0), (nearest.second, 1.0)
        for joint, (point, sign) in zip(self._joints[pair].tolist(), points, strict=True):
            if joint == WORLD:
                continue
            J = pin.getJointJacobian(robot, data, joint, pin.LOCAL_WORLD_ALIGNED)
            arm = point - data.oMi[joint].translation
            by_v += sign * (normal @ J[:3] + pin.skew(arm) @ normal @ J[3:])
            x, y = point[:2] - pose[:2]
            by_pose += sign * np.array([normal[0], normal[1], x * normal[1] - y * normal[0]])
        return np.concatenate([by_pose, by_v @ self._by_joints])


def body_clearance(
    model: Model,
    margin: float,
    base_obstacles: Sequence[Obstacle],
    end_effector_obstacles: Sequence[Obstacle],
) -> list[SoftBound]:
    """Return the rows that keep a robot's links clear; none where nothing can be touched.

    Args:
        margin: Distance that the links keep, m.
    """
    base, tip = (
        [each for each in obstacles if isinstance(each, Disc | HalfPlane)]
        for obstacles in (base_obstacles, end_effector_obstacles)
    )
    shapes = links_among(model.robot, base, tip)
    return [BodyClearance(model, shapes, margin)] if len(shapes.pairs) else []
