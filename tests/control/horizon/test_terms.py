"""The horizon law's terms by paper and pencil: errors, bounds, plans that go on, and the leash."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.control.horizon.constraints import Cost, HardBounds, WheelSpeeds, contact_radius
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.planner import HorizonPlan, Planner
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.settings import Bounds, Weights
from rpctl.control.horizon.target import PaceLimit, Preview, Sample, Target, TimeScaler
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.reference.motion import ReferenceState
from rpctl.reference.named import reference_by_name
from tests.robots import write
from tests.vehicles import vehicle

DT = 0.1  # s


def test_whole_turns_are_no_error_of_a_heading_or_of_a_joint_without_limits(tmp_path: Path) -> None:
    """Steered joints are not wrapped: their targets are, modulo half a turn."""
    text = vehicle("steered").replace(
        '"arm_joint" type="revolute"', '"arm_joint" type="continuous"'
    )
    robot = rpctl.load(write(tmp_path, text))
    model = Model(ReducedDynamics(robot), 2, DT)
    assert (model.steered, len(model.joints)) == (2, 3)
    q, nu = robot.configuration(0.4, 0.5, 0.6, joints={"arm_joint": 0.7}), np.zeros(robot.dof)
    motion = model.predict(q, nu, np.zeros((2, robot.dof)))
    turn = 2.0 * math.pi
    for turns in (-1.0, 0.0, 3.0):
        target = Target(
            motion.pose - [0.1, 0.2, 0.3 + turns * turn],
            motion.joints - [0.4, turn, 0.5 + turns * turn],
            motion.nu,
        )
        errors = Cost(Weights(), model, 1).errors(Sample(motion, target, []))
        np.testing.assert_allclose(errors.pose, np.tile([0.1, 0.2, 0.3], (2, 1)), atol=1e-12)
        np.testing.assert_allclose(errors.joints, np.tile([0.4, turn, 0.5], (2, 1)), atol=1e-12)
    bounded = Model(ReducedDynamics(rpctl.load(write(tmp_path, vehicle("steered")))), 2, DT)
    errors = Cost(Weights(), bounded, 1).errors(Sample(motion, target, []))
    assert errors.joints[0, 2] == pytest.approx(0.5 + 3.0 * turn)  # a limit is in between


def test_a_plan_is_read_and_shifted_between_its_steps() -> None:
    plan = HorizonPlan(1.0, DT, np.array([5.0]), np.array([[10.0], [20.0], [40.0]]))
    for t, nu, nu_dot in ((1.0, 5.0, 10), (1.05, 5.5, 10), (1.125, 6.5, 20), (1.225, 9.0, 40),
                          (1.4, 16.0, 40), (0.95, 4.5, 10)):  # fmt: skip
        nu_found, nu_dot_found = plan.command(t)
        assert nu_found == pytest.approx(nu) and nu_dot_found == pytest.approx(nu_dot)
    for t, ahead in (
        (1.0, (10, 20, 40)),
        (1.025, (12.5, 25, 30)),
        (1.125, (25, 30, 0)),
        (1.225, (30, 0, 0)),
        (1.4, (0, 0, 0)),
        (0.9, (10, 20, 40)),
    ):
        assert plan.shifted(t)[:, 0] == pytest.approx(ahead, abs=1e-9)


@pytest.mark.parametrize("obstacle", [HalfPlane(0.0, -3.0, -1.3), Disc(1.54, 1.55, 0.12)])
@pytest.mark.parametrize("whose", ["end effector", "base"])
def test_what_keeps_clear_of_obstacles_has_rows(paper: Robot, whose: str, obstacle: Any) -> None:
    """The distance that is missing; a disc is larger, as a chord must not cut it."""
    tip = whose == "end effector"
    law = Horizon(
        steps=12,
        end_effector_radius=0.07,
        base_radius=0.4,
        end_effector_obstacles=(obstacle,) if tip else (),
        base_obstacles=() if tip else (obstacle,),
    )
    planner, reference = Planner(law, ReducedDynamics(paper)), reference_by_name(paper, "eight")
    model, radius = planner.model, 0.07 if tip else 0.4
    q, nu = paper.configuration_at(reference(0.0).pose, paper.home), np.array([0.5, 0.2, 0.1, 0.0])
    motion = model.predict(q, nu, np.tile([0.1, 0.2, -0.3, 0.1], (12, 1)))
    target = Target(motion.pose, motion.joints, motion.nu)
    stages = [0, 1, 2, 6, 11] if tip else list(range(12))  # the next ones, and every fifth
    data = paper.model.createData()
    configurations = [
        model.configuration(*at) for at in zip(motion.joints, motion.pose, strict=True)
    ]
    tips = np.array([paper.end_effector_pose(data, q).translation[:2] for q in configurations])
    places = (tips if tip else motion.pose[:, :2])[1:][stages]
    if isinstance(obstacle, Disc):
        steps = np.linalg.norm(np.diff(places[:2] if tip else motion.pose[:, :2], axis=0), axis=1)
        grown = math.hypot(0.12 + radius, 0.5 * steps.max())
        missing = grown - np.hypot(places[:, 0] - 1.54, places[:, 1] - 1.55)
    else:
        missing = radius - (-places[:, 1] + 1.3)
    rows = [each for each in planner.linearise(motion, target).soft if len(each.value) in (5, 12)]
    (found,) = (each for each in rows if each.value.shape[1] == 1)
    np.testing.assert_allclose(found.value[:, 0], missing, atol=1e-12)


def test_hard_bounds_let_a_motion_brake(paper: Robot) -> None:
    """Accelerations: 2 m/s², 4 rad/s², and a joint's full speed of 2 rad/s or .6 m/s in .25 s."""
    dynamics = ReducedDynamics(paper)
    model = Model(dynamics, 3, DT)
    q = paper.configuration(
        0.0, 0.0, 0.0, joints=dict(zip(paper.joint_names, (2.5, 0.36), strict=True))
    )
    motion = model.predict(q, np.array([1.2, 9.0, 3.5, -0.9]), np.full((3, 4), 0.3))
    nu = np.tile([0.3, 5.0, 0.0, 0.0], (4, 1))
    sample = Sample(motion, Target(motion.pose, motion.joints, nu), [])
    lower, upper = HardBounds(model, Bounds()).linearise(sample)
    most = np.array([2.0, 4.0, 8.0, 2.4])
    np.testing.assert_allclose(upper.nu_dot, np.tile(most - 0.3, (3, 1)))
    np.testing.assert_allclose(lower.nu_dot, np.tile(-most - 0.3, (3, 1)))
    # Speeds: .5 m/s beyond the reference's .3, .97 of a joint's; or what braking leaves.
    fastest = np.array([[1.0, 2.7, 0.66], [0.8, 1.94, 0.582], [0.8, 1.94, 0.582]])
    moving = motion.nu[1:, [0, 2, 3]]
    np.testing.assert_allclose(upper.nu[:, [0, 2, 3]], fastest - moving, atol=1e-8)
    np.testing.assert_allclose(lower.nu[:, [0, 2, 3]], -fastest - moving, atol=1e-8)
    assert (upper.nu[:, 1] == math.inf).all() and (lower.nu[:, 1] == -math.inf).all()
    # Positions: limits of ±2.6 rad and .35 to .95 m, less a dt²/8; or where braking ends.
    most = np.array([[2.81, 0.947], [3.04, 0.947], [3.19, 0.947]])
    least = np.array([[-2.59, 0.282], [-2.59, 0.228], [-2.59, 0.198]])
    np.testing.assert_allclose(upper.joints, most - motion.joints[1:], atol=1e-8)
    np.testing.assert_allclose(lower.joints, least - motion.joints[1:], atol=1e-8)


def test_wheels_keep_their_speed_limit(paper: Robot) -> None:
    """Wheels of .15 m, .75 m to either side, at most at .97 of 12 rad/s."""
    model = Model(ReducedDynamics(paper), 1, DT)
    motion = model.predict(
        paper.configuration(), np.array([0.6, 0.2, 0.0, 0.0]), np.array([[3.0, 2.0, 0.0, 0.0]])
    )
    (rows,) = WheelSpeeds(model, Bounds())(
        Sample(motion, Target(motion.pose, motion.joints, motion.nu), [])
    )
    left, right = ((0.9 + side * 0.75 * 0.4) / 0.15 / (0.97 * 12.0) for side in (-1.0, 1.0))
    np.testing.assert_allclose(
        rows.value, [[left - 1.0, right - 1.0, -left - 1.0, -right - 1.0]], atol=1e-12
    )


def test_a_base_reaches_to_its_farthest_contact(tmp_path: Path) -> None:
    """Of P, which lies .1 m behind the root link here; the front wheel is at (.63, .01) m."""
    robot = rpctl.load(write(tmp_path, vehicle("tricycle")))
    assert robot.drive.point == pytest.approx((-0.1, 0.0))
    radius = contact_radius(robot, find_contacts(ReducedDynamics(robot)))
    assert radius == pytest.approx(math.hypot(0.73, 0.01))


class Limits:
    """Paces of the reference at multiples of a step, instead of those of a robot's limits."""

    def __init__(self, slow_from: int) -> None:
        self._slow_from = slow_from

    def between(self, first: int, last: int) -> list[PaceLimit]:
        return [
            PaceLimit(0.5 if k >= self._slow_from else 9.0, 1.0) for k in range(first, last + 1)
        ]


def scaler(robot: Robot, slow_from: int = 10**9, leash: float = 0.3) -> TimeScaler:
    limits: Any = Limits(slow_from)
    return TimeScaler(Model(ReducedDynamics(robot), 4, DT), limits, 2.0, leash)


def drifting(t: float) -> ReferenceState:
    """Return a state that moves at .5 m/s towards (.6, .8), and heads elsewhere by .7 rad."""
    ahead = 0.5 * np.array([0.6, 0.8])
    cos, sin = math.cos(0.7), math.sin(0.7)
    twist = [cos * ahead[0] + sin * ahead[1], cos * ahead[1] - sin * ahead[0], 0.0]
    rest = np.zeros(3)
    return ReferenceState(np.array([*(t * ahead), 0.7]), np.array(twist), rest, *[rest[:0]] * 3)


def test_the_reference_waits_at_the_end_of_its_leash(tmp_path: Path) -> None:
    """A base .3 m behind where the reference was at 10.05 s; .2 m aside count for nothing."""
    text = vehicle("omni").replace('"arm_joint" type="revolute"', '"arm_joint" type="fixed"')
    robot = rpctl.load(write(tmp_path, text))
    ahead, aside = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    pose = np.array([*(drifting(10.05).pose[:2] - 0.3 * ahead + 0.2 * aside), 0.7])
    scale, read = scaler(robot), Preview(robot, drifting)
    assert scale(read, 10.0, drifting(10.0).pose).times == pytest.approx(10.0 + DT * np.arange(5))
    times = scale(read, 10.1, pose).times
    assert times[0] == pytest.approx(10.05)
    assert scale.largest_lag == pytest.approx(0.05)
    assert scale.reference_time(10.1) == pytest.approx(10.05)
    assert scale(read, 10.2, pose).times[0] == pytest.approx(10.05)  # never back
    assert scale(read, 10.3, pose - 1.0).times[0] == pytest.approx(10.05)


def test_the_pace_falls_in_time(paper: Robot) -> None:
    """To a half from .3 s on; pace² may change by 2 · 1/s · dt in a step, is linear in between."""
    scaling = scaler(paper, slow_from=3)(Preview(paper, reference_by_name(paper, "line")), 0.0,
                                        np.zeros(3))  # fmt: skip
    times, squares = [0.0], [0.85]
    for least, place in ((0, 0.65), (1, 0.45), (2, 0.25), (3, 0.25)):
        times.append(times[-1] + DT * math.sqrt(squares[-1]))
        before = (0.85, 0.65, 0.45, 0.25)[least]
        squares.append(before + (times[-1] / DT - least) * (place - before))
    assert times[1:3] == pytest.approx([0.092195, 0.173780], abs=1e-6)
    np.testing.assert_allclose(scaling.times, times, atol=1e-12)
    np.testing.assert_allclose(scaling.paces, np.sqrt(squares), atol=1e-12)


def test_another_reference_is_another_preview(paper: Robot) -> None:
    line, eight = (reference_by_name(paper, name) for name in ("line", "eight"))
    read = Preview(paper)
    assert [read.follow(each) for each in (line, line, eight)] == [True, False, True]
    np.testing.assert_array_equal(read(3.0).state.pose, eight(3.0).pose)
    assert read.follow(line)
    np.testing.assert_array_equal(read(3.0).state.pose, line(3.0).pose)
