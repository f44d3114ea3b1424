"""The horizon law's QP: it is the problem that was meant, and condensed it has its solution."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.constraints import wrap_angles
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.planner import Planner
from rpctl.control.horizon.prediction import PredictedMotion, StageValues
from rpctl.control.horizon.qp import CondensedQp, Linearisation, StateDifference
from rpctl.control.horizon.target import (
    EndEffectorKinematics,
    Preview,
    Target,
    TimeScaling,
    look_ahead,
)
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.reference.named import reference_by_name
from tests.catalogue import robot_of
from tests.control.horizon.whole_qp import whole_qp
from tests.control.tight_limits import limited
from tests.differences import slopes
from tests.grids import cells
from tests.robots import SET_A, ball, platform, write
from tests.vehicles import KINDS, vehicle

NOW = 4.0  # s: the reference is at its full speed
STEPS = 8
CLOSE = 2e-6  # what both solvers' tolerances leave
OFF = np.array([-0.3, 0.25, 0.4])


def linearised(
    robot: Robot, law: Horizon, off: Array, rng: np.random.Generator
) -> tuple[Planner, Linearisation, PredictedMotion, Target]:
    """Return a QP about a motion from beside the reference: who made it, and of what."""
    planner, reference = Planner(law, ReducedDynamics(robot)), reference_by_name(robot, "eight")
    model, read = planner.model, Preview(robot, reference)
    times = np.asarray(NOW + law.dt * np.arange(law.steps + 1))
    posture = np.concatenate([read(NOW).angles, read(NOW).state.joints])
    target = look_ahead(model, read, TimeScaling(times, np.ones(len(times))), posture)
    joints = target.joints[0] + 0.02 * rng.normal(size=len(model.joints))
    q = model.configuration(joints, target.pose[0] + (off if model.base else 0.0))
    motion = model.predict(q, target.nu[0], 0.1 * rng.normal(size=(law.steps, robot.dof)))
    return planner, planner.linearise(motion, target), motion, target


def embedded(planner: Planner, values: Linearisation, start: StateDifference) -> Linearisation:
    """Return the values of a QP whose motion starts elsewhere: all of them move by x₀."""
    x0 = planner.structure.embedded(values.jacobian, start)[:, 0]
    moved = StageValues(*(x0[index] for index in planner.structure.indices))
    errors, lower, upper = (
        StageValues(*(part + sign * own for part, own in zip(parts, moved, strict=True)))
        for parts, sign in ((values.errors, 1.0), (values.lower, -1.0), (values.upper, -1.0))
    )
    extra, soft = (
        [
            each._replace(
                value=each.value + np.einsum("kij,kj->ki", each.jacobian, x0[each.unknowns])
            )
            for each in rows
        ]
        for rows in (values.extra, values.soft)
    )
    return Linearisation(values.jacobian, errors, extra, soft, lower, upper)


SOURCES: dict[str, Callable[[Path], Robot]] = {
    "tight": lambda _: limited(robot_of("paper"), effort=0.4, speed=0.4),
    "car": lambda folder: rpctl.load(write(folder, vehicle("car-like"))),
    "omni": lambda _: robot_of("omni"),
    "fixed": lambda _: robot_of("arm"),
    "no arm": lambda folder: rpctl.load(write(folder, platform(SET_A, extra=ball(0.9)))),
}


@pytest.mark.parametrize(
    ("kind", "off"),
    cells(
        [(kind, off) for kind in ("tight", "car", "omni", "fixed", "no arm") for off in (0.0, 1.0)],
        {("tight", 0.0), ("tight", 1.0), ("car", 1.0), ("no arm", 1.0)},
        {("fixed", 1.0), ("omni", 1.0), ("car", 0.0)},
    ),
)
def test_it_has_the_solution_of_the_whole_qp(
    tmp_path: Path, kind: str, off: float, rng: np.random.Generator
) -> None:
    law = Horizon(steps=STEPS, base_obstacles=(Disc(9.0, 0.0, 0.2),))
    planner, values, *_ = linearised(SOURCES[kind](tmp_path), law, off * OFF, rng)
    found = CondensedQp(planner.structure, values).solve(values, np.empty(0, dtype=np.intp))
    expected = whole_qp(planner, values).solution()
    assert found.solved
    np.testing.assert_allclose(found.x, expected, atol=CLOSE * max(np.abs(expected).max(), 1.0))
    if kind == "tight":
        assert bool(len(found.active)) == bool(off)  # beside the reference some limit binds
    again = CondensedQp(planner.structure, values).solve(values, found.active)
    np.testing.assert_allclose(again.x, found.x, atol=1e-7)
    assert again.rounds <= found.rounds


def test_bounds_that_give_way_are_priced(rng: np.random.Generator) -> None:
    """Two walls with less room than the base between them: the slacks are the whole QP's."""
    walls = (HalfPlane(0.0, 1.0, 0.0), HalfPlane(0.0, -1.0, -0.2))
    law = Horizon(steps=STEPS, base_obstacles=walls, base_radius=0.3)
    planner, values, *_ = linearised(rpctl.load("paper"), law, np.zeros(3), rng)
    found = CondensedQp(planner.structure, values).solve(values, np.empty(0, dtype=np.intp))
    expected = whole_qp(planner, values).solution()
    assert found.solved
    assert expected[planner.structure.deviations :].max() > 0.1
    np.testing.assert_allclose(found.x, expected, atol=CLOSE)


@pytest.mark.parametrize("kind", ["tight", "car"])
def test_another_initial_state_is_embedded(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    """Against the whole QP whose first step of the dynamics starts from the difference."""
    law = Horizon(steps=STEPS, base_obstacles=(Disc(9.0, 0.0, 0.2),))
    planner, values, *_ = linearised(SOURCES[kind](tmp_path), law, OFF, rng)
    model = planner.model
    sizes = (3, 0.02), (len(model.joints), 0.02), (model.robot.dof, 0.05)
    start = StateDifference(*(scale * rng.normal(size=(count, 1)) for count, scale in sizes))
    qp, none = CondensedQp(planner.structure, values), np.empty(0, dtype=np.intp)
    found = qp.solve(embedded(planner, values, start), none)
    assert found.solved
    off = [part[:, 0] for part in start]
    angles, rates = off[1][: model.steered], off[2][: model.base_columns]
    beside = np.concatenate([off[0][2:], angles, rates, 0.0 * rates])
    pose = off[0] + values.jacobian[0] @ beside
    joints = off[1] + model.dt * off[2][model.base :]
    whole = whole_qp(planner, values)
    b = np.zeros_like(whole.b)
    first = np.concatenate([pose, joints, off[2]])
    b[: len(first)] = first
    expected = whole._replace(b=b).solution()
    plan = planner.structure.indices.nu_dot
    scale = np.abs(expected[plan]).max()
    np.testing.assert_allclose(found.x[plan], expected[plan], atol=CLOSE * max(scale, 1.0))


@pytest.mark.parametrize(
    ("kind", "off"), cells([("tight", 0.0), ("tight", 0.25), ("car", 1.0)], {("tight", 0.25)})
)
def test_the_gain_is_the_solutions_derivative(
    tmp_path: Path, kind: str, off: float, rng: np.random.Generator
) -> None:
    """By the initial state, one number after the other; the QP is linear where no bound changes."""
    law = Horizon(steps=STEPS, base_obstacles=(Disc(9.0, 0.0, 0.2),))
    planner, values, *_ = linearised(SOURCES[kind](tmp_path), law, off * OFF, rng)
    qp, none = CondensedQp(planner.structure, values), np.empty(0, dtype=np.intp)
    found = qp.solve(values, none)
    joints, dof = len(planner.model.joints), planner.model.robot.dof
    first, step = planner.structure.indices.nu_dot[0], 1e-5
    differences = []
    for one in np.eye(3 + joints + dof)[:, :, None]:
        sides = []
        for size in (step, -step):
            start = StateDifference(*np.split(size * one, [3, 3 + joints]))
            beside = qp.solve(embedded(planner, values, start), found.active)
            sides.append(beside.x[first])
        straight = np.mean(sides, axis=0)  # no bound changed between the sides
        np.testing.assert_allclose(straight, found.x[first], atol=1e-4 * step)
        differences.append((sides[0] - sides[1]) / (2.0 * step))
    expected = np.transpose(differences)
    np.testing.assert_allclose(qp.gain(values, found.active), expected, atol=1e-3)
    assert bool(len(found.active)) == bool(off)
    assert np.abs(expected).max() > 1.0


STEP = 1e-6


@pytest.mark.parametrize("name", ["paper", "twin"])
def test_without_bounds_it_is_least_squares(
    name: str, rng: np.random.Generator, tmp_path: Path
) -> None:
    """The same step by differences of the prediction and dense least squares (steps = 6)."""
    source = write(tmp_path, vehicle(name)) if name in KINDS else name
    robot, law = rpctl.load(source), Horizon(steps=6)
    run, values, motion, target = linearised(robot, law, np.array([0.02, -0.03, 0.05]), rng)
    reached = EndEffectorKinematics(run.model, [5])

    def errors(nu_dot: Array) -> Array:
        ahead = run.model.predict(motion.start, motion.nu[0], nu_dot.reshape(motion.nu_dot.shape))
        return _weighted(run, ahead, target, reached)

    at = motion.nu_dot.ravel()
    expected = np.linalg.lstsq(slopes(errors, at, STEP), -errors(at), rcond=None)[0]
    found = whole_qp(run, values).free_solution(run.structure.deviations)[
        run.structure.indices.nu_dot
    ]
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
    rows.append(np.sqrt(weigh.pose) * pose)
    for i, cross in enumerate(cost.cross):
        P = np.array([[weigh.joints[-1, i], cross], [cross, weigh.nu[-1, base + i]]])
        rows.append(np.linalg.cholesky(P).T @ [joints[-1, i], nu[-1, base + i]])
    # One stage of six is looked at, so it counts six times.
    rows.append(np.sqrt(6.0 * 200.0) * (arm(ahead).value - arm(target).value))
    return np.concatenate([np.ravel(row) for row in rows])
