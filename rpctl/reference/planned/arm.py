"""Kinematics of the arm between base and end effector, and its comfortable posture."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.robot.coordinates import Workspace
from rpctl.robot.model import Robot
from rpctl.robot.posture import METRES_PER_RADIAN, rate_columns

POSTURE_DRAWS = 1500  # random postures among which the most comfortable one is taken
SEED = 0  # of these draws: the same robot has the same posture every time
DRAWN_RANGE = 0.7  # of each joint's range, about its middle: where postures are drawn from
HEIGHT_TOLERANCE = 0.08  # m; standard deviation of a comfortable end effector's height
IK_STEPS = 12  # of Newton's method; it starts near and needs three
MAX_IK_STEP = 0.2  # of half a joint's range: the longest of these steps
IK_TOLERANCE = 1e-10  # m: below, it has converged
BRISK_TIME = 1.0  # s; joints that travel less than half their range in it count as slow
LIMIT_JOINT_WEIGHT = 0.02  # weight of a joint at its limit relative to one amid its range
IK_DAMPING = 1e-9  # of the largest eigenvalue: for arms that cannot move along every axis


class Arm:
    """The joints that carry the end effector, as functions of P's pose and their positions.

    Attributes:
        robot: The robot.
        joints: Indices of these joints in ``robot.joints``.
        lower: Their lower limits (n,); an unlimited turning joint has −π about its home.
        upper: Their upper limits (n,).
        velocity: Their velocity limits (n,).
        home: Their home positions (n,).
    """

    def __init__(self, robot: Robot) -> None:
        if robot.end_effector is None:
            raise RpctlError(f"{robot.name} has no arm: its end effector has no path")
        self.robot, self._workspace = robot, Workspace(robot.model)
        self._frame = robot.model.getFrameId(robot.end_effector, pin.FrameType.BODY)
        chain = {joint.name for joint in robot.description.chain(robot.end_effector)}
        chain |= {j.mimic.joint for j in robot.mimics if j.mimic is not None and j.name in chain}
        self.joints = [i for i, joint in enumerate(robot.joints) if joint.name in chain]
        used = [robot.joints[i] for i in self.joints]
        self.home = robot.home[self.joints]
        span = [1.0 if joint.kind == "prismatic" else math.pi for joint in used]
        self.lower = np.maximum([j.lower for j in used], self.home - span)
        self.upper = np.minimum([j.upper for j in used], self.home + span)
        self.half_range = np.maximum(0.5 * (self.upper - self.lower), 1e-6)
        self.middle = 0.5 * (self.upper + self.lower)
        self.velocity = np.array([joint.velocity for joint in used])
        self._columns = rate_columns(robot, [joint.name for joint in used])

    def all_joints(self, positions: Array) -> Array:
        """Return positions of all joints of the robot (n_joints,), those of others at home."""
        joints = self.robot.home.copy()
        joints[self.joints] = positions
        return joints

    def end_effector_pose(self, pose: Array, positions: Array) -> pin.SE3:
        """Return the end effector's pose in the world."""
        q = self.robot.configuration_at(pose, self.all_joints(positions))
        return self.robot.end_effector_pose(self._workspace.data, q)

    def jacobian(self, pose: Array, positions: Array) -> tuple[pin.SE3, Array, Array]:
        """Return the end effector's pose in the world and its Jacobians.

        Returns:
            Its pose; the Jacobians of its linear and angular velocity (6,), in world axes, by the
            rates of P's pose x, y, θ (6, 3) and by the joints' rates (6, n).
        """
        q = self.robot.configuration_at(pose, self.all_joints(positions))
        frame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        model, data = self.robot.model, self._workspace.data
        whole = pin.computeFrameJacobian(model, data, q, self._frame, frame)
        found = pin.updateFramePlacement(model, data, self._frame).copy()
        x, y, _ = found.translation
        base = np.zeros((6, 3))
        base[0, 0] = base[1, 1] = base[5, 2] = 1.0
        base[:2, 2] = pose[1] - y, x - pose[0]
        return found, base, whole @ self._columns

    def solve_ik(self, pose: Array, near: Array, position: Array, rotation: Array | None) -> Array:
        """Return joint positions (n,) near ``near`` by inverse kinematics.

        Newton's method with the least steps relative to the joints' ranges; smooth arguments give
        smooth positions. Limits cut each step, so the target may be missed.

        Args:
            pose: Pose of P (3,).
            near: Joint positions to start from (n,).
            position: Target of the end effector in the world (3,), m.
            rotation: Target orientation (3, 3); None for any.
        """
        positions = near.copy()
        room = 1.0 - np.clip((near - self.middle) / self.half_range, -1.0, 1.0) ** 2
        brisk_range = np.minimum(self.half_range, self.velocity * BRISK_TIME)
        # Slow joints and those near their limits move least.
        weight = brisk_range**2 * (room + LIMIT_JOINT_WEIGHT)
        for _ in range(IK_STEPS):
            found, _, jacobian = self.jacobian(pose, positions)
            miss = pose_error(found, position, rotation)
            if np.abs(miss).max() < IK_TOLERANCE:
                break
            rows = error_rows(jacobian, len(miss))
            square = (rows * weight) @ rows.T
            damping = IK_DAMPING * np.trace(square) * np.eye(len(miss))
            pull = np.linalg.lstsq(square + damping, miss, rcond=None)[0]  # few joints: singular
            step = weight * (rows.T @ pull)
            step /= max(1.0, float(np.abs(step / self.half_range).max()) / MAX_IK_STEP)
            positions = np.clip(positions + step, self.lower, self.upper)
        return positions

    def comfortable_posture(self, height: float | None) -> Array:
        """Return a posture (n,) far from limits and singularities, the end effector ahead.

        Of seeded random postures, the one of the largest manipulability; for a base that drives,
        times how straight ahead of P the end effector is, and how near to a height (m).
        """
        rng = np.random.default_rng(SEED)
        draws = self.middle + DRAWN_RANGE * self.half_range * rng.uniform(
            -1, 1, (POSTURE_DRAWS, len(self.joints))
        )
        return max([self.home, *draws], key=lambda positions: self._comfort(positions, height))

    def _comfort(self, positions: Array, height: float | None) -> float:
        found, _, jacobian = self.jacobian(np.zeros(3), positions)
        values = np.linalg.svd(jacobian[:3] * self.half_range, compute_uv=False)
        score = float(np.prod(values[values > 1e-3 * values[0]])) if values.size else 0.0
        x, y, z = found.translation
        if height is not None:
            score *= math.exp(-0.5 * ((z - height) / HEIGHT_TOLERANCE) ** 2)
        if self.robot.drive.base_speeds:
            score *= max(x, 0.0) / max(math.hypot(x, y), 1e-9) * min(1.0, max(x, 0.0) / 0.3)
        return score


def pose_error(found: pin.SE3, position: Array, rotation: Array | None) -> Array:
    """Return the end effector's error (3 or 6,), m, an angle as what it moves at a lever.

    Args:
        found: Where the end effector is.
        position: Where it should be (3,), m.
        rotation: How it should be turned (3, 3); None leaves that open.
    """
    miss = position - found.translation
    if rotation is None:
        return np.asarray(miss)
    turn = METRES_PER_RADIAN * pin.log3(rotation @ found.rotation.T)
    return np.concatenate([miss, turn])


def error_rows(jacobian: Array, count: int) -> Array:
    """Return the rows (count, k) of a Jacobian (6, k) by which an error of 3 or 6 entries falls."""
    return (np.repeat([[1.0], [METRES_PER_RADIAN]], 3, axis=0) * jacobian)[:count]
