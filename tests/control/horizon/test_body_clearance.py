"""Rows that keep links clear: against central differences, all pairs, and in closed loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import BoundedDynamic, Disc, HalfPlane, Horizon, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.body_clearance import (
    FAR,
    RANGE_M,
    ROWS,
    TIE_M,
    BodyClearance,
    body_clearance,
)
from rpctl.control.horizon.prediction import Model, PredictedMotion, make_model
from rpctl.control.horizon.qp import LinearisedConstraint, stage_indices
from rpctl.control.horizon.target import Sample, Target
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.pose_goal import goal_of_words
from tests import urdf
from tests.folding import folding

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
    model = make_model(ReducedDynamics(robot), STEPS, 0.1)
    (found,) = body_clearance(model, margin, (PILLAR,), (WALL,))
    assert isinstance(found, BodyClearance)
    return model, found


def sample(model: Model, poses: Array, joints: Array) -> Sample:
    """Return a motion that goes through given poses (N + 1, 3) and joints."""
    still = model.predict(model.configuration(joints[0], poses[0]), *np.split(
        np.zeros((STEPS + 1, model.robot.dof)), [1]
    ))  # fmt: skip
    motion: PredictedMotion = still._replace(pose=poses, joints=joints)
    return Sample(motion, Target(poses, joints, motion.nu), None)


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


def values(model: Model, rows: BodyClearance, at: Sample) -> LinearisedConstraint:
    (found,) = rows.linearise(at)
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


def test_rows_fit_their_blocks(robot: Robot) -> None:
    model, rows = rows_of(robot)
    (block,) = rows.row_blocks(stage_indices(model))
    found = values(model, rows, postures(model, 1))
    assert found.value.shape == (len(rows.stages), ROWS) == (len(block.unknowns), block.rows)
    assert found.jacobian.shape == (len(rows.stages), ROWS, block.unknowns.shape[1])


def test_far_from_everything_no_row_asks_anything(robot: Robot) -> None:
    model, rows = rows_of(robot)
    at = postures(model, 1)
    at = sample(model, at.motion.pose - (5.0, 0.0, 0.0), np.tile([-0.5, 0.2, 0.0, 0.05], (7, 1)))
    found = values(model, rows, at)
    assert (found.value == FAR).all()
    assert not found.jacobian.any()


CASES = {"ground": ((0.6, 0.9), "the ground"), "own base": ((0.0, 2.9), "itself")}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_arm_stops_before_what_it_would_run_into(case: str, tmp_path: Path) -> None:
    (shoulder, elbow), thing = CASES[case]
    goal = goal_of_words(None, (f"shoulder={shoulder}", f"elbow={elbow}"))
    free, kept = (
        rpctl.track(
            folding(tmp_path), goal, 6.0, control_period=PERIOD,
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


@pytest.mark.slow
def test_a_doorway_that_is_too_narrow_ends_as_stuck_in_words(tmp_path: Path) -> None:
    """The robot is 0.39 m wide, the doorway 0.3 m; a wider one it drives through."""
    found = []
    for half, duration in ((0.3, 18.0), (0.6, 9.0)):
        posts = Disc(2.0, half, 0.15), Disc(2.0, -half, 0.15)
        law = Horizon(base_obstacles=posts, base_radius=0.05, body_clearance=MARGIN)
        run = rpctl.track(
            folding(tmp_path), "line", duration,
            kinematic=law, dynamic=BoundedDynamic(), control_period=PERIOD,
        )  # fmt: skip
        found.append(rpctl.summarize(run))
    assert [each.outcome for each in found] == ["stuck", "tracked"]
    assert not found[0].collisions
    assert "stands " in found[0].outcome_sentence
    assert "the disc at (2, 0.3) m, radius 0.15 m is 3" in found[0].outcome_sentence


@pytest.mark.slow
def test_an_arm_gives_way_to_a_pillar_that_the_base_passes(tmp_path: Path) -> None:
    """The hand sticks out over the edge of the base; a disc is avoided by all of the robot."""
    pillar = Disc(1.5, 0.62, 0.15)
    outcomes = []
    for clearance in (None, MARGIN):
        law = Horizon(base_obstacles=(pillar,), base_radius=0.3, body_clearance=clearance)
        parts = [
            urdf.link(
                "mast",
                urdf.inertial(0.5, (1e-3, 1e-3, 1e-3)),
                urdf.shape('box size="0.04 0.5 0.04"', xyz="0 0.25 0"),
            ),
            urdf.joint(
                "mast_joint", "revolute", ("base", "mast"), (0.2, 0, 0.6), "0 0 1",
                urdf.limit(-3, 3, 20, 2),
            ),
        ]  # fmt: skip
        run = rpctl.track(
            folding(tmp_path, *parts),
            "line",
            9.0,
            kinematic=law,
            dynamic=BoundedDynamic(),
            control_period=PERIOD,
        )
        summary = rpctl.summarize(run)
        outcomes.append(summary.outcome)
        least = min(each.distance for each in summary.clearances if "disc" in each.to)
        assert (least > MARGIN - 0.005) == (clearance is not None)
    assert outcomes[0] == "collided"
    assert outcomes[1] in ("tracked", "late")
