"""Figures of merit: each is what its name says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot, Run, summarize, track
from rpctl.files.writing import to_json
from rpctl.simulation.merits.slip_and_tip import LoadRange
from rpctl.simulation.merits.summary import Summary, binding_limits, violations
from tests.robots import SET_A, platform, write
from tests.runs import vary
from tests.vehicles import Parts, vehicle


@pytest.fixture(scope="module")
def run(paper: Robot) -> Run:
    return track(paper, "eight", duration=1.0, initial_error=(0.1, 0.0, 0.0))


def test_errors(run: Run) -> None:
    e = np.zeros_like(run.log.e)
    e[:, 0], e[:, 1] = 0.3, -0.4
    e[-1, :2] = 0.06, -0.08
    e[:, 4] = -0.02
    figures = summarize(vary(run, e=e))
    assert figures.final_base_error == pytest.approx(0.1)
    assert figures.final_lateral_error == pytest.approx(0.08)
    assert figures.settled_base_error == pytest.approx(0.5)
    assert figures.rms_base_error == pytest.approx(0.5, rel=1e-2)
    slide = figures.joint_errors[1]
    assert slide.joint == "arm_prismatic_joint"
    assert slide.unit == "m"
    assert slide.rms == pytest.approx(0.02)
    assert slide.final == 0.02


def test_efforts(run: Run) -> None:
    tau = np.zeros_like(run.tau)
    tau[7, 1] = -20.0
    figures = summarize(vary(run, tau=tau))
    assert figures.max_effort_ratio == 0.5
    assert figures.max_effort_joint == "wheel_right_joint"
    assert figures.limits_violated == ()


def test_violations_name_the_limit_and_the_time(run: Run) -> None:
    tau, rates, joints = run.tau.copy(), run.log.rates.copy(), run.log.joints.copy()
    tau[10:20, 0] = -41.0
    rates[30, 3] = 0.7
    joints[40, 1] = 0.34
    found = violations(vary(run, tau=tau, rates=rates, joints=joints))
    assert [(f.joint, f.limit) for f in found] == [
        ("wheel_left_joint", "effort"),
        ("arm_prismatic_joint", "velocity"),
        ("arm_prismatic_joint", "lower"),
    ]
    assert found[0].first_time == pytest.approx(run.t[10])
    assert found[0].duration == pytest.approx(0.02, rel=0.01)
    assert found[0].value == 41.0
    assert found[0].allowed == 40.0
    assert (found[2].value, found[2].allowed) == (0.34, 0.35)


def test_lower_limits_are_told_as_the_joint_counts(run: Run) -> None:
    """On either side of zero: a joint of ±2.6 rad, and one of 0.35 to 0.95 m."""
    assert (run.robot.lower_limits, run.robot.upper_limits) == ((-2.6, 0.35), (2.6, 0.95))
    for column, lowest, allowed in ((0, -2.7, -2.6), (1, -0.1, 0.35), (1, 0.3, 0.35)):
        joints = run.log.joints.copy()
        joints[5:8, column] = lowest
        (found,) = violations(vary(run, joints=joints))
        assert (found.limit, found.value, found.allowed) == ("lower", lowest, allowed)
    joints[5:8, 1] = 1.1
    (found,) = violations(vary(run, joints=joints))
    assert (found.limit, found.value, found.allowed) == ("upper", 1.1, 0.95)


def geared(tmp_path: Path) -> Robot:
    """Return a car with an arm joint that a flap mimics: twice as far, and 0.1 rad beyond."""
    parts = Parts([])
    parts.link("flap", 0.5)
    limit = '<limit lower="-0.3" upper="0.4" effort="9" velocity="1.5"/>'
    follows = '<mimic joint="arm_joint" multiplier="2" offset="0.1"/>'
    ends = ("base", "flap")
    parts.joint("flap_joint", "prismatic", ends, "0 0 0.5", "0 0 1", limit + follows)
    flap = "".join(parts.xml)
    return rpctl.load(write(tmp_path, vehicle("car-like").replace("</robot>", f"{flap}</robot>")))


def test_mimic_joints_break_limits_too(tmp_path: Path) -> None:
    robot = geared(tmp_path)
    run = track(robot, "eight", duration=0.1, initial_error=(0.1, 0.0, 0.0))
    flap = run.robot.other_names.index("flap_joint")
    arm = run.robot.joint_names.index("arm_joint")
    np.testing.assert_allclose(
        run.log.others[:, flap], 2.0 * run.log.joints[:, arm] + 0.1, atol=1e-6
    )
    rate = run.nu[:, run.robot.quasi_velocities.index("arm_joint")]
    np.testing.assert_allclose(run.log.other_rates[:, flap], 2.0 * rate, atol=1e-12)
    others, rates = np.zeros_like(run.log.others), np.zeros_like(run.log.other_rates)
    quiet = vary(run, others=others.copy(), other_rates=rates.copy())
    assert violations(quiet) == ()
    others[10:20, flap], others[30:, flap], rates[40, flap] = -2.0, 0.5, -1.6
    found = violations(vary(run, others=others, other_rates=rates))
    assert [(f.joint, f.limit, f.value, f.allowed) for f in found] == [
        ("flap_joint", "velocity", 1.6, 1.5),
        ("flap_joint", "lower", -2.0, -0.3),
        ("flap_joint", "upper", 0.5, 0.4),
    ]
    assert found[1].first_time == pytest.approx(run.t[10])


def test_joints_without_an_actuator_have_velocity_limits(tmp_path: Path) -> None:
    """A follower, which no motor turns here, and a front wheel that rolls along."""
    path = write(
        tmp_path,
        vehicle("car-like").replace(
            '<parent link="steer_left_fork"/>',
            '<limit velocity="30"/><parent link="steer_left_fork"/>',
        ),
    )
    expected = write(tmp_path, 'type = "car-like"\n[[swivel]]\njoint = "steer_right"\n'
                 "driven = false\n", "drive.toml")  # fmt: skip
    run = track(rpctl.load(path, drive=expected), "circle", duration=0.05)
    assert not {"steer_right", "front_left"} & set(run.robot.actuators)
    rates, steering = run.log.other_rates.copy(), run.log.steering.copy()
    rates[7, run.robot.other_names.index("steer_right")] = 6.5
    rates[9, run.robot.other_names.index("front_left")] = -31.0
    steering[11, run.robot.steering_names.index("steer_right")] = -1.3
    found = violations(vary(run, other_rates=rates, steering=steering))
    assert [(f.joint, f.limit, f.value, f.allowed) for f in found] == [
        ("steer_right", "lower", -1.3, -1.2),
        ("front_left", "velocity", 31.0, 30.0),
        ("steer_right", "velocity", 6.5, 6.0),
    ]


def test_a_limit_counts_once(run: Run) -> None:
    """A driven wheel's rate is in the log twice."""
    wheel = run.robot.other_names.index("wheel_left_joint")
    rates, others = run.log.rates.copy(), run.log.other_rates.copy()
    rates[3, 0] = others[3, wheel] = 1e3
    (found,) = violations(vary(run, rates=rates, other_rates=others))
    assert (found.joint, found.limit) == ("wheel_left_joint", "velocity")


def test_a_limit_may_be_touched(run: Run) -> None:
    tau = np.zeros_like(run.tau)
    tau[:, 0] = 40.0
    assert violations(vary(run, tau=tau)) == ()


def test_limits_that_bound_are_told(run: Run) -> None:
    assert summarize(run).limits_bound == ()
    active = np.zeros((len(run.t), 2))
    active[100:200, 0] = active[400:500, 0] = active[7, 1] = 1.0
    names = (("wheel_left_joint", "effort"), ("arm_prismatic_joint", "upper"))
    base = run.log.base.copy()
    base[100, :2] = 1.234, -0.5
    wheel, slide = binding_limits(vary(run, active_limits=active, bound_limits=names, base=base))
    assert (wheel.joint, wheel.limit) == names[0]
    assert wheel.first_time == pytest.approx(run.t[100])
    assert wheel.first_place == (1.234, -0.5)
    assert wheel.duration == pytest.approx(0.4, rel=0.01)
    expected = "wheel_left_joint effort limit bound from 0.2 s, at (1.23, -0.50) m, 0.4 s in all"
    assert wheel.sentence == expected
    assert slide.sentence.startswith("arm_prismatic_joint upper position limit bound from 0.014 s")


def test_ground_within_its_margins(run: Run) -> None:
    margin, slip = np.full_like(run.t, 0.4), np.full_like(run.t, 0.1)
    margin[7], slip[9] = 0.123, 0.314
    figures = summarize(vary(run, tip_margin=margin, slip_ratio=slip))
    assert figures.ground.min_tip_over_margin == 0.123
    assert figures.ground.max_slip_ratio == 0.314
    assert figures.ground.would_tip is figures.ground.would_slip is False
    assert figures.ground.friction == 0.7
    sentence = "keeps 0.12 m from tipping and uses 31 % of the grip at friction 0.7"
    assert str(figures.ground.sentence) == sentence
    crowded = vary(run, tip_margin=margin, slip_ratio=slip, contacts=("a",) * 6)
    expected = f"{sentence} (6 contacts, taken as equally stiff)"
    assert summarize(crowded).ground.sentence == expected


def test_ground_beyond_its_margins(run: Run) -> None:
    margin, slip = np.full_like(run.t, 0.4), np.full_like(run.t, 0.1)
    margin[50:60], slip[25] = -0.05, 1.5
    figures = summarize(vary(run, tip_margin=margin, slip_ratio=slip))
    assert figures.ground.would_tip is figures.ground.would_slip is True
    expected = (
        "would tip over at 0.1 s, by 0.05 m at worst, and would slip at 0.05 s, needing up to "
    )
    assert str(figures.ground.sentence) == expected + "150 % of the grip at friction 0.7"
    slip[30] = 400.0
    figures = summarize(vary(run, tip_margin=margin, slip_ratio=slip))
    assert "needing up to over 10 times the grip" not in str(figures.ground.sentence)
    assert "needing over 10 times the grip" in str(figures.ground.sentence)


def split(run: Run, least: float, most: float, equal: float, tips: bool = False) -> Summary:
    """Return the figures of a run on four contacts whose grip is least at 0.2 s, most at 0.1 s."""
    slips, ratio = np.full((len(run.t), 2), 0.05), np.full_like(run.t, 0.05)
    slips[100, 0], slips[50, 1], ratio[70] = least, most, equal
    slips[100, 1] = max(least, slips[100, 1])
    load = np.zeros((len(run.t), 4, 2))
    load[:, :, 0], load[:, :, 1] = 10.0, 20.0
    load[30, 2] = 3.0, 50.0
    if tips:
        slips[:], load[:] = np.nan, np.nan
    slips[7], load[7] = np.nan, np.nan  # it tips for an instant, which tells of no split
    margin = np.full_like(run.t, 0.4)
    margin[7] = -0.1
    changed = vary(
        run,
        contacts=("a", "b", "c", "d"),
        tip_margin=margin,
        slip_ratio=ratio,
        slip_range=slips,
        load_range=load,
    )
    return summarize(changed)


def test_ground_where_the_split_is_not_known(run: Run) -> None:
    figures = split(run, 0.12, 0.31, 0.2)
    assert figures.ground.max_slip_ratio is None
    assert figures.ground.slip_ratio_range == (0.12, 0.31)
    assert figures.ground.equal_springs_slip_ratio == 0.2
    assert figures.ground.would_slip is figures.ground.could_slip is False
    assert str(figures.ground.sentence).endswith(
        "and uses 12 to 31 % of the grip at friction 0.7, as the load splits "
        "(20 % if its 4 contacts are equally stiff)"
    )
    assert figures.ground.contact_loads == tuple(
        LoadRange(name, least, most)
        for name, least, most in (("a", 10, 20), ("b", 10, 20), ("c", 3, 50), ("d", 10, 20))
    )


@pytest.mark.parametrize(
    ("least", "most", "certain", "expected"),
    [
        (0.12, 1.4, False, "could slip at 0.1 s, needing 12 to 140 % of the grip at"),
        (0.12, 40.0, False, "could slip at 0.1 s, needing 12 % to over 10 times the grip at"),
        (1.2, 1.4, True, "would slip at 0.2 s, needing 120 to 140 % of the grip at"),
        (1.2, np.inf, True, "would slip at 0.2 s, needing at least 120 % of the grip at"),
        (np.inf, np.inf, True, "would slip at 0.2 s, needing over 10 times the grip at"),
        (
            0.12,
            np.inf,
            False,
            "uses at least 12 % of the grip at friction 0.7, without an upper bound, as a wheel "
            "that pushes may bear nothing (20 % if its 4 contacts are equally stiff)",
        ),
    ],
)
def test_slip_is_certain_or_possible(
    run: Run, least: float, most: float, certain: bool, expected: str
) -> None:
    figures = split(run, least, most, 0.2)
    assert figures.ground.would_slip is certain
    assert figures.ground.could_slip is True
    assert expected in str(figures.ground.sentence)
    ends = json.loads(to_json(figures.ground.slip_ratio_range))
    assert ends == [None if end == np.inf else end for end in (least, most)]


def test_ground_where_all_splits_need_the_same(run: Run) -> None:
    figures = split(run, 0.31, 0.31, 0.31)
    assert figures.ground.max_slip_ratio == 0.31
    assert figures.ground.slip_ratio_range == (0.31, 0.31)
    assert str(figures.ground.sentence).endswith("uses 31 % of the grip at friction 0.7")
    rounded = split(run, 0.3101, 0.3102, 0.31)
    assert rounded.ground.max_slip_ratio is None
    assert "uses 31 % of the grip" in str(rounded.ground.sentence)


def test_ground_of_a_robot_that_tips_all_the_time(run: Run) -> None:
    figures = split(run, 0.1, 0.2, 0.3, tips=True)
    assert figures.ground.would_tip is True
    ground = figures.ground
    assert (ground.slip_ratio_range, ground.contact_loads, ground.would_slip) == (None, None, None)
    assert str(figures.ground.sentence).endswith("at worst, and nothing can be said of its grip")


def test_three_contacts_have_one_number(run: Run) -> None:
    figures = summarize(run)
    slip = figures.ground.max_slip_ratio
    assert figures.ground.slip_ratio_range == (slip, slip)
    assert figures.ground.could_slip is figures.ground.would_slip is False
    assert [(row.name, row.min, row.max) for row in figures.ground.contact_loads or ()] == [
        (name, load.min(), load.max())
        for name, load in zip(run.ground.contacts, run.log.contact_load.T, strict=True)
    ]


def test_a_run_that_logged_no_ranges_tells_of_one_split(run: Run) -> None:
    old = vary(run, contacts=("a",) * 4)
    figures = summarize(old)
    ground = figures.ground
    known = ground.max_slip_ratio, ground.slip_ratio_range, ground.contact_loads
    assert known == (None, None, None)
    assert figures.ground.would_slip is figures.ground.could_slip is None
    slipping = vary(old, slip_ratio=np.full_like(run.t, 1.5))
    assert summarize(slipping).ground.could_slip is True
    assert summarize(slipping).ground.would_slip is None


def test_ground_of_fixed_bases_and_of_wheels_alone(tmp_path: Path) -> None:
    fixed = summarize(track(rpctl.load("panda"), "eight", duration=0.1))
    ground = fixed.ground
    assert (ground.sentence, ground.would_tip, ground.max_slip_ratio) == (None, None, None)
    alone = summarize(track(rpctl.load(write(tmp_path, platform(SET_A))), "circle", duration=0.1))
    assert alone.ground.min_tip_over_margin is alone.ground.would_slip is None
    assert "left_joint, right_joint are known to touch the ground" in str(alone.ground.sentence)
