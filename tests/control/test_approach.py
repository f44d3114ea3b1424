"""The stage before a law: a base with a tightest bend drives up to its reference from anywhere."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import (
    Approach,
    Disc,
    Horizon,
    Kanayama,
    PaperKinematic,
    ReducedDynamics,
    Robot,
    UnifiedKinematic,
    set_limits,
    summarize,
    track,
)
from rpctl.control.approach import (
    ApproachingLaw,
    ApproachPlan,
    Pace,
    WayLimits,
    WayToReference,
    plan_approach,
)
from rpctl.control.horizon.law import HorizonLaw
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.named import reference_by_name
from rpctl.robot.sources import find_source
from tests.control.unicycle import NO_JOINTS
from tests.grids import cells
from tests.robots import write

STEP = 1e-5
TIGHTEST = 0.82 / math.tan(0.9)  # m: the bicycle's bend, of its wheelbase and steering limit
FAR = ((0.5, -1.0, 3.11), (-1.4, 1.3, -2.0), (0.0, 0.9, 0.0))


@pytest.fixture(scope="module")
def bicycle() -> Robot:
    return rpctl.load("bicycle")


def plan(robot: Robot, reference: Reference, error: tuple[float, float, float]) -> ApproachPlan:
    dynamics = ReducedDynamics(robot)
    q = robot.configuration_at(reference(2.0).pose + np.array(error), robot.home)
    made = plan_approach(
        dynamics, reference, 2.0, q, np.zeros(robot.dof), WayLimits(1.5 * TIGHTEST, 1.5, math.inf)
    )
    assert made is not None
    return made


def backwards(reference: Reference) -> Reference:
    """Return the same path, driven with the rear ahead."""

    def turned(t: float) -> ReferenceState:
        state, back = reference(t), np.array([-1.0, 0.0, 1.0])
        pose = state.pose + np.array([0.0, 0.0, math.pi])
        return state._replace(
            pose=pose, twist=back * state.twist, twist_dot=back * state.twist_dot, direction=None
        )

    return turned


@pytest.mark.parametrize(
    "name",
    cells(
        ["line", "reverse", "circle", "eight", "circle backwards"],
        ["line", "eight", "circle backwards"],
    ),
)
def test_a_plan_leads_from_the_robot_to_its_reference(bicycle: Robot, name: str) -> None:
    """At both ends pose, speed and curvature are those of the robot and of the reference."""
    reference: Reference = reference_by_name(bicycle, name.split()[0])
    if "backwards" in name:
        reference = backwards(reference)
    for error in FAR:
        way = plan(bicycle, reference, error)
        first, last = (way(t, reference(t)) for t in (2.0, way.joins_at))
        there = reference(way.joins_at)
        off = np.column_stack([first.pose - reference(2.0).pose - error, last.pose - there.pose])
        off[2] = np.remainder(off[2] + 1.0, 2.0 * math.pi) - 1.0
        np.testing.assert_allclose(off, 0.0, atol=1e-8)
        np.testing.assert_array_equal(first.twist, 0.0)
        np.testing.assert_allclose(last.twist, there.twist, atol=1e-8)
        assert way.sense == (1.0 if name in ("line", "circle", "eight") else -1.0)


def test_a_plan_moves_as_its_rates_say(bicycle: Robot, rng: np.random.Generator) -> None:
    """Twist and its rate, the direction and its rates, against differences; without a slip."""
    still = ReferenceState(np.zeros(3), np.zeros(3), np.zeros(3), *[NO_JOINTS] * 3)
    way = plan(bicycle, reference_by_name(bicycle, "reverse"), FAR[0])
    for t in way.begins_at + rng.uniform(0.05, 0.95, 7) * way.pace.duration:
        behind, at, ahead = (way(t + step, still) for step in (-STEP, 0.0, STEP))
        cos, sin = math.cos(at.pose[2]), math.sin(at.pose[2])
        moved = (ahead.pose - behind.pose) / (2.0 * STEP)
        twist = [cos * moved[0] + sin * moved[1], cos * moved[1] - sin * moved[0], moved[2]]
        np.testing.assert_allclose(twist, at.twist, atol=1e-7)
        rate = (ahead.twist - behind.twist) / (2.0 * STEP)
        np.testing.assert_allclose(rate, at.twist_dot, atol=1e-6)
        assert at.direction is not None and ahead.direction is not None
        assert behind.direction is not None
        turned = (ahead.direction - behind.direction) / (2.0 * STEP)
        np.testing.assert_allclose(turned[:2], at.direction[1:], atol=1e-5)
        assert np.cross(at.twist, at.direction[0]) == pytest.approx(0.0, abs=1e-12)
        assert at.twist @ at.direction[0] >= 0.0


def way_of(robot: Robot, reference: Reference, **settings: float) -> ApproachPlan:
    """Return the way of the robot's own stage to a reference, from behind and facing away."""
    dynamics, stage = ReducedDynamics(robot), Approach(**settings).stage(ReducedDynamics(robot))
    assert stage is not None
    q = robot.configuration_at(reference(2.0).pose + FAR[0], robot.home)
    way = stage(dynamics, reference, 2.0, q, np.zeros(robot.dof))
    assert isinstance(way, WayToReference)
    return way.plan


def test_a_plan_keeps_bend_and_acceleration(bicycle: Robot) -> None:
    """Half as wide again as the tightest bend; up to .4 m/s²."""
    line = reference_by_name(bicycle, "line")
    way = way_of(bicycle, line)
    times = np.linspace(2.0, way.joins_at, 600)
    twists, rates = (np.array([getattr(way(t, line(t)), name) for t in times])
                     for name in ("twist", "twist_dot"))  # fmt: skip
    moving = np.abs(twists[:, 0]) > 1e-3
    bends = np.abs(twists[moving, 2] / twists[moving, 0])
    assert bends.max() == pytest.approx(1.0 / (1.5 * TIGHTEST), rel=0.05)
    # The ramp is that of the largest speed that was allowed, which the way just does not need.
    assert 0.9 * 0.4 < np.abs(rates[:, 0]).max() <= 0.4 + 1e-12


@pytest.mark.parametrize(
    ("haste", "wheel", "fastest"),
    [
        (1.8, 40.0, 1.8 * 0.3),  # the line's speed, .3 m/s
        (100.0, 40.0, math.sqrt(0.5 * 1.5 * TIGHTEST)),  # .5 m/s² across its arcs
        (100.0, 3.0, 0.8 * 0.2 * 3.0),  # a wheel of .2 m at .8 of 3 rad/s
    ],
)
def test_a_way_is_as_quick_as_it_may_be(
    bicycle: Robot, haste: float, wheel: float, fastest: float
) -> None:
    """It meets the reference at the first half second at which it need not be quicker."""
    robot = set_limits(bicycle, velocity={"wheel_rear_joint": wheel})
    way = way_of(robot, reference_by_name(bicycle, "line"), haste=haste)
    assert 0.95 * fastest < way.pace.speeds[1] <= fastest + 1e-12


def test_a_wheel_that_is_mounted_the_other_way_round_limits_the_way(tmp_path: Path) -> None:
    text = find_source("bicycle").path.read_text(encoding="utf-8")
    old = '<axis xyz="0 1 0"/>\n    <limit effort="40" velocity="18"/>'
    assert old in text
    new = old.replace("0 1 0", "0 -1 0").replace("18", "3")
    robot = rpctl.load(write(tmp_path, text.replace(old, new)), root="planar")
    way = way_of(robot, reference_by_name(robot, "line"), haste=100.0)
    assert 0.95 * 0.48 < way.pace.speeds[1] <= 0.48 + 1e-12


def test_a_way_is_looked_for_once_a_second_while_the_base_is_far(bicycle: Robot) -> None:
    dynamics, stage = ReducedDynamics(bicycle), Approach(haste=0.01).stage(ReducedDynamics(bicycle))
    assert stage is not None
    reference, still = reference_by_name(bicycle, "line"), np.zeros(bicycle.dof)
    q = bicycle.configuration_at(reference(0.0).pose + FAR[0], bicycle.home)
    searched = []
    for t in np.arange(0.0, 2.5, 0.125):
        assert stage(dynamics, reference, t, q, still) is reference  # no way is that slow
        searched.append(stage.searched_at)
    assert sorted({*searched}) == [0.0, 1.0, 2.0]
    wanted = reference(0.0).pose
    for off, far in (((0.0, 0.49, 0.0), False), ((0.0, 0.0, 0.79), False), ((0.0, 0.51, 0.0), True),
                     ((0.0, 0.0, 0.81), True), ((0.0, 0.0, math.tau - 0.79), False)):  # fmt: skip
        q = bicycle.configuration_at(wanted - off, bicycle.home)
        assert stage.looks(bicycle, 9.0, wanted, q) is far


def test_a_pace_by_paper_and_pencil() -> None:
    """From rest to 2 m/s within 1 s, on for 2 s, down to 1 m/s: 1 + 4 + 1.5 m."""
    pace = Pace((0.0, 2.0, 1.0), 1.0, 4.0)
    assert pace(0.0) == (0.0, 0.0, 0.0)
    assert pace(1.0) == pytest.approx((1.0, 2.0, 0.0))
    assert pace(2.0) == pytest.approx((3.0, 2.0, 0.0))
    assert pace(3.5)[2] == pytest.approx(-1.875)
    assert pace(4.0) == pytest.approx((6.5, 1.0, 0.0))


@pytest.mark.parametrize("turn", cells([1.0, -1.0], [-1.0]))
def test_a_swerve_drives_to_the_place_of_a_spin_and_stops_there(turn: float) -> None:
    """Its turning rate is the reference's again from there on; its wheels have turned by then."""
    swerve = rpctl.load("swerve")
    spin, dynamics = reference_by_name(swerve, "spin"), ReducedDynamics(swerve)

    def reference(t: float) -> ReferenceState:
        state = spin(t)
        pose, twist, change = (turn * part for part in state[:3])
        return state._replace(pose=pose, twist=twist, twist_dot=change, direction=None)

    q, still = swerve.configuration(1.3, -1.2, 2.0), np.zeros(swerve.dof)
    way = plan_approach(dynamics, reference, 4.0, q, still, WayLimits(0.6, 2.0, math.inf))
    assert way is not None
    there, last = reference(way.joins_at), way(way.joins_at, reference(way.joins_at))
    off = last.pose - there.pose
    np.testing.assert_allclose([*off[:2], math.sin(off[2])], 0.0, atol=1e-8)
    np.testing.assert_allclose(last.twist, 0.0, atol=1e-9)
    assert way.pace.speeds[1] <= 2.0 * 0.6 * abs(there.twist[2]) + 1e-12
    started = UnifiedKinematic().start(dynamics, 0.01)
    assert isinstance(started, ApproachingLaw)


def test_only_bases_with_a_tightest_bend_have_the_stage(bicycle: Robot, paper: Robot) -> None:
    for law in (UnifiedKinematic(), Kanayama()):
        assert not isinstance(law.start(ReducedDynamics(paper), 0.01), ApproachingLaw)
        assert isinstance(law.start(ReducedDynamics(bicycle), 0.01), ApproachingLaw)
    for bare in (PaperKinematic(), UnifiedKinematic(approach=None)):
        assert not isinstance(bare.start(ReducedDynamics(bicycle), 0.01), ApproachingLaw)


def test_a_late_law_meets_its_reference_in_its_own_time(bicycle: Robot) -> None:
    """Two seconds late: the way begins at the robot, two seconds ago, and ends on the reference."""
    reference, dynamics = reference_by_name(bicycle, "circle"), ReducedDynamics(bicycle)
    stage, still = Approach().stage(dynamics), np.zeros(bicycle.dof)
    assert stage is not None
    q = bicycle.configuration_at(reference(3.0).pose, bicycle.home)
    assert stage(dynamics, reference, 5.0, q, still, lag=2.0) is reference
    assert stage(dynamics, reference, 5.0, q, still, lag=0.0) is not reference  # 1 m behind it
    stage = Approach().stage(dynamics)
    assert stage is not None
    pose = reference(8.0).pose + FAR[0]
    q = bicycle.configuration_at(pose, bicycle.home)
    way = stage(dynamics, reference, 10.0, q, still, lag=2.0)
    assert isinstance(way, WayToReference)
    np.testing.assert_allclose(way(8.0).pose[:2], pose[:2], atol=1e-12)
    for t in (way.plan.joins_at, 100.0):
        np.testing.assert_array_equal(way(t).pose, reference(t).pose)
    assert stage.approaches == 1
    assert stage.reading(reference) is way
    line = reference_by_name(bicycle, "line")  # another reference from now on: the way goes on
    np.testing.assert_array_equal(stage.reading(line)(8.0).pose, way(8.0).pose)
    np.testing.assert_array_equal(stage.reading(line)(100.0).pose, line(100.0).pose)


def horizon_law(robot: Robot, **settings: Any) -> HorizonLaw:
    law = Horizon(steps=5, asynchronous=False, **settings)
    found = law.start(ReducedDynamics(robot), 0.02)
    assert isinstance(found, HorizonLaw)
    return found


def test_the_horizon_law_has_the_stage_where_a_base_needs_it(bicycle: Robot, paper: Robot) -> None:
    """Where it plans around obstacles, the way up would not know of them."""
    discs = (Disc(50.0, 0.0, 1.0),)
    cases: list[tuple[Robot, dict[str, Any], int | None]] = [
        (bicycle, {}, 1),
        (paper, {}, None),
        (bicycle, {"approach": None}, None),
        (bicycle, {"base_obstacles": discs}, None),
    ]
    for robot, settings, approaches in cases:
        reference = reference_by_name(robot, "circle")
        q = robot.configuration_at(reference(0.0).pose + FAR[0], robot.home)
        law = horizon_law(robot, **settings)
        law(ReducedDynamics(robot), reference, 0.0, q, np.zeros(robot.dof))
        assert law.report().get("approaches") == approaches


COMING = {"unified": UnifiedKinematic(), "paper": PaperKinematic(approach=Approach())}


@pytest.mark.parametrize("name", cells(COMING, slow=["unified"]))
def test_a_car_comes_home_from_behind_and_facing_away(bicycle: Robot, name: str) -> None:
    for error in FAR[:2]:
        run = track(
            bicycle,
            "circle",
            duration=35.0,
            initial_error=error,
            kinematic=COMING[name],
            control_period=0.01,
            plant_step=0.01,
            collisions=False,
        )
        figures = summarize(run)
        assert figures.final_base_error < 1e-3
        assert figures.kinematic_report["approaches"] == 1


@pytest.mark.parametrize(
    "name, reference, output",
    cells(
        [(*case, out) for case in (("car", "reverse"), ("bicycle", "line"))
         for out in ("effort", "velocity")],
        slow=[("car", "reverse", "effort")],
    ),
)  # fmt: skip
def test_no_way_winds_round_where_a_bend_is_enough(name: str, reference: str, output: str) -> None:
    """A car .58 m and .5 rad off drove two circles, and was 4.5 m off after 20 s."""
    robot = rpctl.load(name)
    run = track(robot, reference, duration=20.0, initial_error=(0.3, 0.5, 0.5), output=output,
                control_period=0.02, plant_step=0.02, collisions=False)  # fmt: skip
    assert summarize(run).final_base_error < 1e-3
    assert np.hypot(*(run.q - run.q_ref)[:, :2].T).max() < 0.7


def test_a_bend_begins_over_two_fifths_of_its_radius(bicycle: Robot) -> None:
    """The first arc's radius is 1.5 of the tightest; its bend is half there at a fifth of it."""
    path = plan(bicycle, reference_by_name(bicycle, "line"), FAR[0]).path
    radius = 1.5 * TIGHTEST
    assert path(0.0).curvature[0] == 0.0
    assert abs(path(0.2 * radius).curvature[0]) == pytest.approx(0.5 / radius)
    assert abs(path(0.4 * radius).curvature[0]) == pytest.approx(1.0 / radius)
    assert path(0.4 * radius).curvature[1] == pytest.approx(0.0, abs=1e-12)
