"""The horizon law's QP: it is the problem that was meant, and its solution is one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.cost import wrap_angles
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.planner import Planner
from rpctl.control.horizon.prediction import PredictedMotion
from rpctl.control.horizon.target import (
    EndEffectorKinematics,
    Preview,
    Target,
    TimeScaling,
    look_ahead,
)
from rpctl.reference.motion import steering
from rpctl.reference.named import reference_by_name
from tests.control.horizon.whole_qp import WholeQp, whole_qp
from tests.robots import write
from tests.vehicles import KINDS, vehicle

STEP = 1e-6
NOW = 4.0  # s: the reference is at its full speed


def written(
    robot: Robot, law: Horizon, off: Array, rng: np.random.Generator
) -> tuple[Planner, PredictedMotion, Target, WholeQp]:
    """Return a QP about a motion from beside the reference."""
    run = law.start(ReducedDynamics(robot), 0.002).planner
    model, reference = run.model, reference_by_name(robot, "eight")
    times = np.asarray(NOW + law.dt * np.arange(law.steps + 1))
    now = np.concatenate([steering(robot, reference(NOW))[0], reference(NOW).joints])
    target = look_ahead(
        model, Preview(robot, reference), TimeScaling(times, np.ones(law.steps + 1)), now
    )
    pose = target.pose[0] + (off if model.base else 0.0)
    nu_dot = 0.1 * rng.normal(size=(law.steps, robot.dof))
    joints = target.joints[0] + 0.01 * rng.normal(size=len(model.joints))
    motion = model.predict(model.configuration(joints, pose), target.nu[0], nu_dot)
    return run, motion, target, whole_qp(run, run.linearise(motion, target))


@pytest.mark.parametrize("name", ["paper", "twin"])
def test_without_bounds_it_is_least_squares(
    name: str, rng: np.random.Generator, tmp_path: Path
) -> None:
    """The same step by differences of the prediction and dense least squares (steps = 6)."""
    source = write(tmp_path, vehicle(name)) if name in KINDS else name
    robot, law = rpctl.load(source), Horizon(steps=6)
    run, motion, target, qp = written(robot, law, np.array([0.02, -0.03, 0.05]), rng)
    reached = EndEffectorKinematics(run.model, [5])

    def errors(nu_dot: Array) -> Array:
        ahead = run.model.predict(motion.start, motion.nu[0], nu_dot.reshape(motion.nu_dot.shape))
        return _weighted(run, ahead, target, reached)

    indices = motion.nu_dot.ravel()
    J = np.column_stack(
        [
            (errors(indices + step) - errors(indices - step)) / (2 * STEP)
            for step in STEP * np.eye(indices.size)
        ]
    )
    expected = np.linalg.lstsq(J, -errors(indices), rcond=None)[0]
    found = qp.free_solution(run.structure.deviations)[run.structure.indices.nu_dot]
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found.ravel(), expected, atol=1e-4 * max(scale, 1.0))


def _weighted(
    run: Planner, ahead: PredictedMotion, target: Target, arm: EndEffectorKinematics
) -> Array:
    """Return the errors whose squares, halved, are the cost."""
    cost, model = run.cost, run.model
    weigh, base = cost.hessian, model.base
    pose = ahead.pose[1:] - target.pose[1:]
    pose[:, 2] = wrap_angles(pose[:, 2])
    joints, nu = ahead.joints[1:] - target.joints[1:], ahead.nu[1:] - target.nu[1:]
    nu_dot = ahead.nu_dot - np.diff(target.nu, axis=0) / model.dt
    rows = [np.sqrt(weigh.nu_dot) * nu_dot, np.sqrt(weigh.joints[:-1]) * joints[:-1]]
    rows += [np.sqrt(weigh.nu[:-1]) * nu[:-1], np.sqrt(weigh.nu[-1, :base]) * nu[-1, :base]]
    rows.append(np.sqrt(weigh.pose) * pose[:, : weigh.pose.shape[1]])
    for i, cross in enumerate(cost.cross):
        P = np.array([[weigh.joints[-1, i], cross], [cross, weigh.nu[-1, base + i]]])
        rows.append(np.linalg.cholesky(P).T @ [joints[-1, i], nu[-1, base + i]])
    position = arm.position(ahead.pose[-1], ahead.joints[-1])
    goal = arm.position(target.pose[-1], target.joints[-1])
    # One stage of six is looked at, so it counts six times.
    rows.append(np.sqrt(6.0 * 200.0) * (position - goal))
    return np.concatenate([np.ravel(row) for row in rows])
