"""The condensed QP has the solution of the whole one, from any initial state."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.cost import StateDifference, from_another_start
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.planner import Planner
from rpctl.control.horizon.qp import CondensedQp, Linearisation
from rpctl.control.horizon.target import Preview, TimeScaling, look_ahead
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.reference.named import reference_by_name
from tests.control.horizon.whole_qp import whole_qp
from tests.control.tight_limits import limited
from tests.grids import cells
from tests.robots import SET_A, ball, platform, write
from tests.vehicles import vehicle

NOW = 4.0  # s: the reference is at its full speed
STEPS = 8
CLOSE = 2e-6  # what both solvers' tolerances leave
OFF = np.array([-0.3, 0.25, 0.4])


def linearised(
    robot: Robot, law: Horizon, off: Array, rng: np.random.Generator
) -> tuple[Planner, Linearisation]:
    """Return a QP about a motion from beside the reference, and who made it."""
    planner, reference = Planner(law, ReducedDynamics(robot)), reference_by_name(robot, "eight")
    model, read = planner.model, Preview(robot, reference)
    times = np.asarray(NOW + law.dt * np.arange(law.steps + 1))
    posture = np.concatenate([read(NOW).angles, read(NOW).state.joints])
    target = look_ahead(model, read, TimeScaling(times, np.ones(len(times))), posture)
    joints = target.joints[0] + 0.02 * rng.normal(size=len(model.joints))
    q = model.configuration(joints, target.pose[0] + (off if model.base else 0.0))
    motion = model.predict(q, target.nu[0], 0.1 * rng.normal(size=(law.steps, robot.dof)))
    return planner, planner.linearise(motion, target)


def sources(tmp_path: Path) -> dict[str, Robot]:
    return {
        "tight": limited(rpctl.load("paper"), effort=0.4, speed=0.4),
        "car": rpctl.load(write(tmp_path, vehicle("car-like"))),
        "omni": rpctl.load("omni"),
        "fixed": rpctl.load("arm"),
        "no arm": rpctl.load(write(tmp_path, platform(SET_A, extra=ball(0.9)))),
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
    planner, values = linearised(sources(tmp_path)[kind], law, off * OFF, rng)
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
    planner, values = linearised(rpctl.load("paper"), law, np.zeros(3), rng)
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
    planner, values = linearised(sources(tmp_path)[kind], law, OFF, rng)
    model, jacobian = planner.model, values.jacobian
    start = StateDifference(
        0.02 * rng.normal(size=3),
        0.02 * rng.normal(size=len(model.joints)),
        0.05 * rng.normal(size=model.robot.dof),
    )
    embedded = from_another_start(planner.structure, values, start)
    found = CondensedQp(planner.structure, values).solve(embedded, np.empty(0, dtype=np.intp))
    assert found.solved
    pose = start.pose.copy()
    pose[:2] += jacobian.heading[0] * start.pose[2]
    pose += jacobian.nu[0] @ start.nu[: model.base_columns]
    pose += jacobian.steering[0] @ start.joints[: model.steered]
    joints = start.joints + model.dt * start.nu[model.base :]
    qp = whole_qp(planner, values)
    b = np.zeros_like(qp.b)
    b[: len(pose) + len(joints) + len(start.nu)] = np.concatenate([pose, joints, start.nu])
    expected = qp._replace(b=b).solution()
    plan = planner.structure.indices.nu_dot
    scale = np.abs(expected[plan]).max()
    np.testing.assert_allclose(found.x[plan], expected[plan], atol=CLOSE * max(scale, 1.0))
