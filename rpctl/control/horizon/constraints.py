"""What the horizon law keeps to, and what it costs: constraints and errors, linearised."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_discrete_are

from rpctl.arrays import Array
from rpctl.control.horizon.forces import KEPT_LOAD_SPLITS, ForceModel
from rpctl.control.horizon.prediction import Model, StageValues
from rpctl.control.horizon.qp import LinearRows
from rpctl.control.horizon.settings import Bounds, Weights, is_turning
from rpctl.control.horizon.target import Sample
from rpctl.control.obstacles import Disc, HalfPlane, Obstacle, links_among
from rpctl.dynamics.ground_reaction import Contacts
from rpctl.errors import SolverError
from rpctl.robot.collision import WORLD, CollisionModel, Nearest
from rpctl.robot.model import BASE_NV, Robot
from rpctl.robot.pair_motion import approach_rates, joint_limits_travel

GROUND_STRIDE = 3  # steps between the stages with constraints on the ground's reactions
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
        nu, free = motion.nu[1:], np.full((len(braked_nu), BASE_NV), np.inf)
        return (
            StageValues(-self._max_acceleration - motion.nu_dot, -free, lower, -fastest - nu),
            StageValues(self._max_acceleration - motion.nu_dot, free, upper, fastest - nu),
        )


SoftBound = Callable[[Sample], list[LinearRows]]


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
        if not model.steered and not model.casters:  # other casters have no actuators
            self._constant_rates = self._rates(np.zeros(len(model.joints)), np.empty(0))

    def _rates(self, joints: Array, casters: Array) -> Array:
        """Return the map (n, dof) from ν to the wheels' rates over their limits."""
        B = self._model.dynamics.actuation(self._model.configuration(joints, casters=casters))
        return B.T[self._limited] / self._limits[:, None]

    def __call__(self, sample: Sample) -> list[LinearRows]:
        """Return the rows, on ν after each step; none of wheels without limits."""
        if not len(self._limited):
            return []
        motion, moving = sample.motion, self._model.base_columns
        if self._constant_rates is not None:
            rates = np.tile(self._constant_rates, (len(motion.nu_dot), 1, 1))
        else:
            postures = zip(motion.joints[1:], motion.casters[:-1], strict=True)
            rates = np.array([self._rates(*posture) for posture in postures])
        both = np.concatenate([rates, -rates], axis=1)
        value = np.einsum("kij,kj->ki", both, motion.nu[1:]) - 1.0
        return [LinearRows(self._model.indices.nu[:, :moving], value, both[:, :, :moving])]


class ForceBounds:
    """Efforts within their limits, zero-moment point inside the polygon, wheels within their grip.

    The rows of the first step, the one that is carried out, depend on all accelerations. Later
    steps have rows for the ground only, every few stages, and depend on the base's motion
    only: rows that tie all joints together at many stages would cost the QP its sparsity.

    Contacts lift off and touch down, so the wheels' loads are only piecewise linear in the moments.
    A first step bounded by one piece may end in another piece and slip there; it is therefore
    bounded by the last three load splits met.
    """

    def __init__(self, model: Model, forces: ForceModel) -> None:
        self._model, self._forces = model, forces
        self._load_splits: deque[Array] = deque(maxlen=KEPT_LOAD_SPLITS)
        self._stages = every_nth_stage(model.steps, GROUND_STRIDE) if forces.ground else []

    def __call__(self, sample: Sample) -> list[LinearRows]:
        """Return the rows of the efforts, of the ground at once, and of the ground later."""
        motion, forces, count = sample.motion, self._forces, self._forces.efforts
        at, moving = self._model.indices, self._model.base_columns
        now = forces.measured(motion.start, motion.nu[0], motion.nu_dot[0], self._load_splits)[None]
        found = [(at.nu_dot[:1], now[:, :count])]
        if forces.ground is not None:
            later, before = [], [k - 1 for k in self._stages]
            for k in self._stages:
                q = self._model.configuration(motion.joints[k], casters=motion.casters[k])
                later.append(forces.foreseen(q, motion.nu[k], motion.nu_dot[k])[count:])
            by = np.hstack([at.nu_dot[self._stages, :moving], at.nu[before, :moving]])
            found += [(at.nu_dot[:1], now[:, count:]), (by, np.array(later))]
        return [LinearRows(by, rows[:, :, 0], rows[:, :, 1:]) for by, rows in found]


def base_clearance(
    model: Model, obstacles: tuple[Obstacle, ...], radius: float, sample: Sample
) -> list[LinearRows]:
    """Return the clearance of the base, a disc of ``radius`` (m) about P, after each step."""
    points = sample.motion.pose[1:, :2]
    stride = float(np.linalg.norm(np.diff(sample.motion.pose[:, :2], axis=0), axis=1).max())
    jacobian = np.tile(np.eye(2), (len(points), 1, 1))
    rows = LinearRows(model.indices.pose[:, :2], points, jacobian)
    return [_clear(obstacles, radius, rows, stride)]


def arm_clearance(
    obstacles: tuple[Obstacle, ...], radius: float, sample: Sample
) -> list[LinearRows]:
    """Return the clearance of the end effectors, discs of ``radius`` (m), at their stages."""
    places = [
        LinearRows(each.unknowns, each.value[:, :2], each.jacobian[:, :2])
        for each in sample.end_effector
    ]
    # The first stages are one step apart.
    strides = (float(np.linalg.norm(each.value[1] - each.value[0])) for each in places)
    return list(map(partial(_clear, obstacles, radius), places, strides))


def _clear(
    obstacles: tuple[Obstacle, ...], radius: float, points: LinearRows, stride: float
) -> LinearRows:
    """Return level − normal · p, linearised; slack in m.

    Args:
        obstacles: Obstacles to keep clear of.
        radius: Radius about each point, m.
        points: Points p (K, 2), m.
        stride: Distance between successive points, m.
    """
    places = points.value
    lines = [obstacle.linearise(places, radius, stride) for obstacle in obstacles]
    values = [line.level - (line.normal * places).sum(axis=1) for line in lines]
    by = [-np.einsum("ki,kij->kj", line.normal, points.jacobian) for line in lines]
    return LinearRows(points.unknowns, np.column_stack(values), np.stack(by, axis=1))


def contact_radius(robot: Robot, contacts: Contacts | None) -> float:
    """Return the distance of P to the farthest contact, m; 0 for a fixed base."""
    if contacts is None:
        return 0.0
    return float(np.linalg.norm(contacts.points - robot.drive.point, axis=1).max())


def every_nth_stage(steps: int, every: int) -> list[int]:
    """Return every ``every``-th stage, counted back from the last."""
    return list(range(steps - 1, 0, -every))[::-1]


class Cost:
    """Half the weighted sum over the steps of squared errors and of squared accelerations.

    Accelerations are relative to the reference's. The terminal cost stands for everything beyond
    the horizon: for each coordinate it is the cost-to-go (Riccati solution) of a double integrator
    with the same weights.

    Args:
        stage_count: Number of stages with a cost of the end effector, which share its weight.
    """

    def __init__(self, weights: Weights, model: Model, stage_count: int) -> None:
        self._dt = model.dt
        self._end_effector = weights.end_effector * model.steps / stage_count
        base = model.base
        position = [weights.position, weights.position, weights.heading]
        pose = np.tile(position, (model.steps, 1))
        of_joints = np.full(len(model.joints), weights.joints)
        of_joints[: model.steered] = weights.steering
        joints = np.tile(of_joints, (model.steps, 1))
        nu = np.full((model.steps, model.robot.dof), weights.rates)
        rest = {w: _cost_to_go(w, weights, model.dt) for w in {*position, *of_joints.tolist()}}
        pose[-1] = [rest[w][0, 0] for w in position]
        joints[-1] = [rest[w][0, 0] for w in of_joints]
        nu[-1, base:] = [rest[w][1, 1] for w in of_joints]
        nu[-1, :base] = max(P[1, 1] for P in rest.values())
        self.hessian = StageValues(np.full(nu.shape, weights.accelerations), pose, joints, nu)
        self.cross = np.array([rest[w][0, 1] for w in of_joints])
        continuous = (i for i, joint in enumerate(model.joints) if joint.kind == "continuous")
        self._continuous = [i for i in continuous if i >= model.steered]  # the arm's

    def errors(self, sample: Sample) -> StageValues:
        """Return what a motion is off its target by; of ν̇ off the target's."""
        motion, target = sample.motion, sample.target
        pose = motion.pose[1:] - target.pose[1:]
        pose[:, 2] = wrap_angles(pose[:, 2])
        joints = motion.joints[1:] - target.joints[1:]
        joints[:, self._continuous] = wrap_angles(joints[:, self._continuous])
        nu_dot = motion.nu_dot - np.diff(target.nu, axis=0) / self._dt
        return StageValues(nu_dot, pose, joints, motion.nu[1:] - target.nu[1:])

    def end_effector_errors(self, positions: LinearRows, goals: Array) -> LinearRows:
        """Return the end effector's errors, weighted."""
        root = math.sqrt(self._end_effector)
        errors = root * (positions.value - goals)
        return LinearRows(positions.unknowns, errors, root * positions.jacobian)


def _cost_to_go(weight: float, weights: Weights, dt: float) -> Array:
    """Return the cost-to-go (2, 2) of a double integrator's position and rate."""
    A, B = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[0.5 * dt**2], [dt]])
    Q, R = np.diag([weight, weights.rates]), np.array([[weights.accelerations]])
    try:
        return np.asarray(solve_discrete_are(A, B, Q, R))
    except (ValueError, np.linalg.LinAlgError) as error:  # what LAPACK answers differs by machine
        raise SolverError(
            f"weights of {weight:g} for positions, {weights.rates:g} for rates and "
            f"{weights.accelerations:g} for accelerations have no cost beyond the horizon with "
            f"steps of {dt:g} s ({error}); bring them nearer to each other"
        ) from None


def wrap_angles(angles: Array) -> Array:
    """Return angles (rad) wrapped into (−π, π]."""
    return math.pi - (math.pi - angles) % (2.0 * math.pi)


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
