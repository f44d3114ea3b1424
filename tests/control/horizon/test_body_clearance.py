"""Rows that keep links clear: against central differences, all pairs, and in closed loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import BoundedDynamic, Disc, HalfPlane, Horizon, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.constraints import (
    FAR,
    RANGE_M,
    TIE_M,
    BodyClearance,
    body_clearance,
)
from rpctl.control.horizon.prediction import Model, PredictedMotion
from rpctl.control.horizon.qp import LinearRows
from rpctl.control.horizon.target import Sample, Target
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.pose_goal import goal_of_words
from tests import urdf
from tests.folding import folding
from tests.grids import cells

STEPS, MARGIN = 6, 0.03
PILLAR, WALL = Disc(0.75, 0.15, 0.1), HalfPlane(-1.0, 0.0, -0.9)
PERIOD = 0.01  # s
STEP = 1e-5  # m or rad: of central differences
DIFFERENCE = 2e-3  # of a slope: what the iterations of coal's distances leave of it


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A robot with a hand that turns endlessly and slides."""
    light = urdf.inertial(0.2, (1e-3, 1e-3, 1e-3))
    hand = [
        urdf.link("wrist", light),
        urdf.joint("roll", "continuous", ("forearm", "wrist"), (0.4, 0, 0), "1 0 0"),
        urdf.link("hand", light, urdf.shape('sphere radius="0.05"', xyz="0.03 0.02 0.04")),
        urdf.joint("slide", "prismatic", ("wrist", "hand"), "", "1 0 0", urdf.limit(0, 0.2, 9, 1)),
    ]
    return folding(tmp_path_factory.mktemp("folding"), *hand)


def rows_of(robot: Robot, margin: float = MARGIN) -> tuple[Model, BodyClearance]:
    model = Model(ReducedDynamics(robot), STEPS, 0.1)
    (found,) = body_clearance(model, margin, (PILLAR,), (WALL,))
    assert isinstance(found, BodyClearance)
    return model, found


def sample(model: Model, poses: Array, joints: Array) -> Sample:
    """Return a motion that goes through given poses (N + 1, 3) and joints."""
    still = model.predict(model.configuration(joints[0], poses[0]), *np.split(
        np.zeros((STEPS + 1, model.robot.dof)), [1]
    ))  # fmt: skip
    motion: PredictedMotion = still._replace(pose=poses, joints=joints)
    return Sample(motion, Target(poses, joints, motion.nu), [])


def postures(model: Model, seed: int) -> Sample:
    """Return random postures of which most are near to something."""
    rng = np.random.default_rng(seed)
    poses = rng.uniform(-0.2, 0.2, (STEPS + 1, 3))
    joints = np.column_stack([rng.uniform(-a, a, STEPS + 1) for a in (1.0, 2.5, 3.0, 0.1)])
    joints[:, 3] += 0.1
    return sample(model, poses, joints)


def moved(at: Sample, stage: int, column: int, by: float) -> Sample:
    pose, joints = at.motion.pose.copy(), at.motion.joints.copy()
    if column < 3:
        pose[stage, column] += by
    else:
        joints[stage, column - 3] += by
    return at._replace(motion=at.motion._replace(pose=pose, joints=joints))


def values(model: Model, rows: BodyClearance, at: Sample) -> LinearRows:
    (found,) = rows(at)
    return found


@pytest.mark.parametrize("seed", [1, 2])
def test_rows_are_derivatives_of_distances(robot: Robot, seed: int) -> None:
    model, rows = rows_of(robot)
    at = postures(model, seed)
    found = values(model, rows, at)
    stages = [k + 1 for k in rows.stages]
    checked = 0
    for column in range(3 + len(model.joints)):
        more, less = (
            [values(model, rows, moved(at, k, column, by)).value[i] for i, k in enumerate(stages)]
            for by in (STEP, -STEP)
        )
        slope = (np.array(more) - np.array(less)) / (2.0 * STEP)
        near = (found.value > -RANGE_M + MARGIN) & (found.value < MARGIN - 0.002)
        near &= found.value > FAR  # rows that ask something, of shapes apart
        error = np.abs(slope - found.jacobian[:, :, column])[near]
        assert (error < DIFFERENCE).all(), (column, error)
        checked += len(error)
    assert checked > 25


def test_the_rows_are_those_of_the_nearest_joints(robot: Robot) -> None:
    """What is not computed again is far: the values are those of a fresh start."""
    model, rows = rows_of(robot)
    at = postures(model, 3)
    for k in range(30):
        at = moved(at, 1 + k % STEPS, k % 7, 0.02 * (-1.0) ** k)
        kept = values(model, rows, at).value
        fresh = values(model, rows_of(robot)[1], at).value
        np.testing.assert_allclose(kept, fresh, atol=TIE_M + 1e-4)


CASES = {"ground": ((0.6, 0.9), "the ground"), "own base": ((0.0, 2.9), "itself")}


@pytest.mark.parametrize("case", cells(CASES, slow=["ground"]))
def test_the_arm_stops_before_what_it_would_run_into(case: str, tmp_path: Path) -> None:
    (shoulder, elbow), thing = CASES[case]
    goal = goal_of_words(None, (f"shoulder={shoulder}", f"elbow={elbow}"))
    free, kept = (
        rpctl.track(
            folding(tmp_path), goal, duration=6.0, control_period=PERIOD,
            kinematic=Horizon(body_clearance=clearance), dynamic=BoundedDynamic(),
        )
        for clearance in (None, MARGIN)
    )  # fmt: skip
    summary = rpctl.summarize(free)
    assert summary.outcome == "collided"
    assert summary.collisions[0].to == thing
    assert summary.collisions[0].depth > 0.09
    summary = rpctl.summarize(kept)
    assert summary.outcome == "stuck"
    assert not summary.succeeded
    (nearest,) = (each.distance for each in summary.clearances if each.to == thing)
    assert MARGIN - 0.002 < nearest < MARGIN + 0.01
    assert kept.kinematic_report["softened"] == 0
    assert ("the ground is 3" in summary.outcome_sentence) == (thing == "the ground")
