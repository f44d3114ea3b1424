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
from rpctl.control.horizon.preview import Preview
from rpctl.control.horizon.qp import QuadraticProgram
from rpctl.control.horizon.solver import QP_TOLERANCE, QpSolution, SparseSolver
from rpctl.control.horizon.target import EndEffectorKinematics, Target, TimeScaling, look_ahead
from rpctl.control.obstacles import Disc
from rpctl.reference.named import reference_by_name
from rpctl.reference.quasi_velocities import steering
from tests.control.tight_limits import limited
from tests.robots import write
from tests.vehicles import KINDS, vehicle

STEP = 1e-6
NOW = 4.0  # s: the reference is at its full speed


def written(
    robot: Robot, law: Horizon, off: Array, rng: np.random.Generator
) -> tuple[Planner, PredictedMotion, Target, QuadraticProgram]:
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
    return run, motion, target, run.program.build(run.linearise(motion, target))


def residuals(qp: QuadraticProgram, found: QpSolution) -> dict[str, float]:
    """Return what is left of the Karush-Kuhn-Tucker conditions, over the size of their terms."""
    H = qp.P + qp.P.T
    H.setdiag(qp.P.diagonal())
    x, room = found.x, qp.h - qp.G @ found.x
    pull = qp.G.T @ found.z + found.z_upper - found.z_lower
    stationary = H @ x + qp.c + qp.A.T @ found.y + pull
    low, high = np.isfinite(qp.lower), np.isfinite(qp.upper)
    gaps = [
        found.z @ room,
        found.z_lower[low] @ (x - qp.lower)[low],
        found.z_upper[high] @ (qp.upper - x)[high],
    ]
    return {
        "stationarity": float(np.abs(stationary).max() / np.abs(qp.c).max()),
        "dynamics": float(np.abs(qp.A @ x).max()),
        "rows": float(max(-room.min(initial=0.0), 0.0)),
        "bounds": float(max((qp.lower - x).max(), (x - qp.upper).max(), 0.0)),
        "signs": float(-min(found.z.min(initial=0.0), found.z_lower.min(), found.z_upper.min())),
        "gap": float(np.abs(gaps).max() / (1.0 + abs(qp.c @ x))),
    }


@pytest.mark.parametrize(("share", "off"), [(1.0, [0.0, 0.0, 0.0]), (0.4, [-0.6, 0.5, 0.9])])
def test_the_solution_satisfies_its_conditions(
    share: float, off: list[float], rng: np.random.Generator
) -> None:
    robot = limited(rpctl.load("paper"), effort=share, speed=share)
    law = Horizon(base_obstacles=(Disc(9.0, 0.0, 0.2),))
    _, _, _, qp = written(robot, law, np.array(off), rng)
    solver = SparseSolver()
    found = solver.solve(qp)
    assert found.solved
    assert found.z.any() == any(off)  # beside the reference, some limit binds
    for name, residual in residuals(qp, found).items():
        assert residual < 10.0 * QP_TOLERANCE, name


def test_where_nothing_binds_the_bounds_do_not_matter(rng: np.random.Generator) -> None:
    _, _, _, qp = written(rpctl.load("paper"), Horizon(), np.zeros(3), rng)
    solver = SparseSolver()
    free, bounded = solver.solve(qp), solver.bounded(qp)
    assert not free.z.any()
    np.testing.assert_allclose(free.x[: qp.slack], bounded.x[: qp.slack], atol=1e-3)
    assert np.abs(free.x[qp.slack :]).max() < 1e-6


@pytest.mark.parametrize("name", ["paper", "mecanum", "panda", "car-like", "twin"])
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
    found = SparseSolver().unbounded(qp)
    assert found.solved
    scale = np.abs(expected).max()
    np.testing.assert_allclose(
        found.x[run.program.indices.nu_dot].ravel(), expected, atol=1e-4 * max(scale, 1.0)
    )


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
