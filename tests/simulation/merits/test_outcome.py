"""Each outcome is found of a log written by hand, and on either side of its borders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Disc, Horizon, Run, summarize
from rpctl.arrays import Array
from rpctl.control.obstacles import HalfPlane
from rpctl.simulation.config import Config
from rpctl.simulation.merits.summary import Summary
from tests.golden import part
from tests.robots import write
from tests.runs import vary
from tests.vehicles import Parts, rear_axle

COUNT = 401
T: Array = np.linspace(0.0, 8.0, COUNT)  # s
SPEED = 0.5  # m/s
QUARTER = COUNT // 4


def line(x: Array, y: Array | float = 0.0) -> Array:
    """Return poses (K, 3) along x, heading along it."""
    return np.column_stack([x, y + 0.0 * x, 0.0 * x])


REFERENCE = line(SPEED * T)


def log(golden: Run, base: Array, base_ref: Array = REFERENCE, t: Array = T, **more: Any) -> Run:
    """Return a run whose P moved as told, of a robot without an arm unless one is given."""
    nothing = np.empty((len(t), 0))
    still = part(golden, np.zeros(len(t), int), t=t)
    bare: dict[str, Any] = {"end_effector": None, "ee": nothing, "ee_ref": nothing}
    return vary(still, **{**bare, "base": base, "base_ref": base_ref, **more})


def with_hand(golden: Run, tip: Array, tip_ref: Array) -> Run:
    """Return a run that tracks with its base, and whose end effector moved as told."""
    return log(golden, REFERENCE, end_effector="slide", ee=tip, ee_ref=tip_ref)


def judged(golden: Run, base: Array, base_ref: Array = REFERENCE, t: Array = T) -> Summary:
    return summarize(log(golden, base, base_ref, t))


def test_tracked(golden: Run) -> None:
    """At its reference after a start 0.3 m beside it."""
    found = judged(golden, line(SPEED * T, 0.3 * np.exp(-2.0 * T)))
    assert found.outcome == "tracked"
    assert found.succeeded
    assert found.outcome_sentence.startswith("base is within ")
    assert found.outcome_sentence.endswith(" µm of its reference in the last tenth of the run")
    assert found.to_dict()["outcome"] == "tracked"
    assert found.to_dict()["outcome_sentence"] == found.outcome_sentence


@pytest.mark.parametrize(("beside", "name"), [(0.0499, "tracked"), (0.0501, "stuck")])
def test_five_centimetres_are_at_the_reference(golden: Run, beside: float, name: str) -> None:
    """Farther beside, the robot moves along and the error stays."""
    found = judged(golden, line(SPEED * T, beside))
    assert found.outcome == name
    if name == "stuck":
        assert found.outcome_sentence == (
            "base moves on, up to 50.1 mm off its path in the last tenth of the run, "
            "and the error does not decay"
        )


@pytest.mark.parametrize(("lag", "name"), [(0.499, "tracked"), (0.501, "late")])
def test_late(golden: Run, lag: float, name: str) -> None:
    """Half a second at .5 m/s: 250 mm behind, and on the path."""
    found = judged(golden, line(np.maximum(SPEED * (T - lag), 0.0)))
    assert found.outcome == name
    assert found.succeeded
    behind = f"0.5 s ({249 if lag < 0.5 else 251} mm) behind its reference (last quarter)"
    assert found.outcome_sentence == f"base is on its path, {behind}"
    assert found.base_path.final_lag == pytest.approx(lag)
    assert found.base_path.settled < 1e-9


def test_a_law_that_slows_down_is_late_and_not_diverging(golden: Run) -> None:
    """Four fifths of the speed: the error against time grows to .8 m, that from the path is 0."""
    found = judged(golden, line(0.8 * SPEED * T))
    assert found.outcome == "late"
    assert found.base_path.largest_lag == pytest.approx(0.2 * T[-1])
    assert found.base_path.final_lag_distance == pytest.approx(0.8)
    assert found.base_path.rms < 1e-9


def test_a_late_robot_breaks_limits_nevertheless(golden: Run) -> None:
    run = log(golden, line(0.8 * SPEED * T))
    tau = np.array(run.tau)
    tau[3, 0] = 41.0
    found = summarize(vary(run, tau=tau))
    assert (found.outcome, found.succeeded) == ("late", False)


@pytest.mark.parametrize(("share", "name"), [(0.049, "stuck"), (0.051, "late")])
def test_stuck(golden: Run, share: float, name: str) -> None:
    """It stops after a second; in the last quarter it moves by a share of what it should."""
    x, last = np.minimum(SPEED * T, 0.5), 3 * COUNT // 4
    to_go = SPEED * T[-1] - 0.5 - share * 3.5
    x[last:] += share * to_go * np.linspace(0.0, 1.0, COUNT - last)
    found = judged(golden, line(x))
    assert found.outcome == name
    assert found.succeeded is (name == "late")
    if name == "stuck":
        assert found.outcome_sentence.startswith("base stands 3.3")


def test_a_robot_that_never_moves_is_stuck_though_its_reference_returns(golden: Run) -> None:
    """Two laps of a circle, the last of which ends where the robot stands."""
    angle = np.linspace(0.0, 4.0 * np.pi, COUNT)
    circle = np.column_stack([np.cos(angle), np.sin(angle), angle])
    assert judged(golden, np.repeat(circle[:1], COUNT, axis=0), circle).outcome == "stuck"


def test_a_robot_that_stands_where_it_should_is_not_stuck(golden: Run) -> None:
    still = np.zeros((COUNT, 3))
    assert judged(golden, still + np.array([[0.049, 0.0, 0.0]]), still).outcome == "tracked"
    found = judged(golden, still + np.array([[0.0, 0.3, 0.0]]), still)
    assert found.outcome == "stuck"
    assert found.outcome_sentence == "base stands 300 mm from its reference"


@pytest.mark.parametrize(("ratio", "name"), [(1.49, "stuck"), (1.51, "diverging")])
def test_diverging(golden: Run, ratio: float, name: str) -> None:
    """From 0.1 m beside the path to so many times as much in the last quarter."""
    beside = np.full(COUNT, 0.1)
    beside[3 * COUNT // 4 :] *= ratio
    found = judged(golden, line(SPEED * T, beside))
    assert found.outcome == name
    assert not found.succeeded
    if name == "diverging":
        assert found.outcome_sentence == (
            "base is up to 151 mm off its path in the last tenth of the run, and at most 100 mm in "
            "the first half"
        )


def test_what_is_not_finite_diverges(golden: Run) -> None:
    base = np.array(REFERENCE)
    base[200, 1] = np.inf
    found = judged(golden, base)
    assert (found.outcome, found.outcome_sentence) == (
        "diverging", "the motion of base has infinite or undefined numbers",
    )  # fmt: skip


@pytest.mark.parametrize(("ratio", "name"), [(0.89, "late"), (0.91, "stuck")])
def test_an_error_that_falls_is_not_stuck(golden: Run, ratio: float, name: str) -> None:
    """Of that in the second quarter; the first quarter does not count."""
    beside = np.full(COUNT, 1.0)
    beside[QUARTER : 2 * QUARTER] = 0.2
    beside[3 * COUNT // 4 :] = 0.2 * ratio
    found = judged(golden, line(SPEED * T, beside))
    assert found.outcome == name
    if name == "late":
        assert found.outcome_sentence.startswith(
            "base is up to 178 mm off its path and nearing, 0 s"
        )


@pytest.mark.parametrize(("duration", "name"), [(4.99, "tracked"), (5.01, "late")])
def test_who_is_still_under_way_is_late(golden: Run, duration: float, name: str) -> None:
    """Nearing its path, and beside where it should be: the error of a start has its time."""
    t = np.linspace(3.0, 3.0 + duration, COUNT)
    reference = line(SPEED * t)
    found = judged(golden, line(SPEED * t, 0.3 * np.exp(-0.2 * (t - 3.0))), reference, t)
    assert (found.outcome, found.succeeded) == (name, True)
    assert " off its path and nearing, 0 s" in found.outcome_sentence


@pytest.mark.parametrize(("duration", "name"), [(1.99, "late"), (2.01, "stuck")])
def test_a_short_run_shows_nothing_steady(golden: Run, duration: float, name: str) -> None:
    t = np.linspace(3.0, 3.0 + duration, COUNT)
    reference = line(SPEED * t)
    found = judged(golden, np.repeat(reference[:1], COUNT, axis=0), reference, t)
    assert found.outcome == name
    if name == "late":
        assert found.outcome_sentence.startswith("the run is too short to judge: base is up to 9")


@pytest.mark.parametrize(("duration", "name"), [(4.99, "late"), (5.01, "stuck")])
def test_the_error_of_a_start_has_its_time(golden: Run, duration: float, name: str) -> None:
    """Moving along 0.3 m beside the path says nothing until the error had time to fall."""
    t = np.linspace(3.0, 3.0 + duration, COUNT)
    reference = line(SPEED * t)
    found = judged(golden, line(SPEED * t, np.full(COUNT, 0.3)), reference, t)
    assert found.outcome == name
    assert ("the run is too short to judge" in found.outcome_sentence) == (name == "late")


def test_the_base_may_be_fine_and_the_end_effector_not(golden: Run) -> None:
    """The worst of both counts; it is named."""
    path = np.column_stack([SPEED * T, np.sin(T), 0.5 + 0.0 * T])
    fine = summarize(with_hand(golden, path + np.array([[0.0, 0.0, 0.01]]), path))
    assert fine.outcome == "tracked"
    assert fine.outcome_sentence.startswith("base is within 0 m of")
    assert fine.end_effector_path is not None
    assert fine.end_effector_path.rms == pytest.approx(0.01, rel=1e-3)
    assert fine.end_effector_path.mean_lateral is None
    low = summarize(with_hand(golden, path - np.array([[0.0, 0.0, 0.2]]), path))
    assert low.outcome == "stuck"
    assert low.outcome_sentence.startswith("end effector moves on, up to 200 mm off its path")
    slow = np.column_stack([SPEED * T, np.sin(np.maximum(T - 0.7, 0.0)), 0.5 + 0.0 * T])
    slow[:, 0] = SPEED * np.maximum(T - 0.7, 0.0)
    late = summarize(with_hand(golden, slow, path))
    assert late.outcome == "late"
    assert late.outcome_sentence.startswith("end effector is on its path, 0.7 s")


def test_a_base_that_turns_on_the_spot_must_turn(golden: Run) -> None:
    """P is where it should be; what counts is half a metre from it."""
    spin = np.column_stack([0.0 * T, 0.0 * T, 0.6 * T])
    assert judged(golden, spin + np.array([[0.0, 0.0, 0.099]]), spin).outcome == "tracked"
    still = judged(golden, 0.0 * spin, spin)
    assert still.outcome == "stuck"
    assert still.outcome_sentence.startswith("heading, 0.5 m from P, stands 2.")
    assert judged(golden, 0.8 * spin, spin).outcome == "late"
    driven = line(SPEED * T) + np.column_stack([0.0 * T, 0.0 * T, 0.0 * T + 1.0])
    assert judged(golden, driven).outcome == "tracked"  # where P goes somewhere, it counts


@pytest.mark.parametrize(
    ("turns", "delay", "name"),
    [(-1, 0.0, "tracked"), (2, 0.0, "tracked"), (-1, 0.1, "tracked"), (0, 0.7, "late")],
)
def test_a_whole_turn_is_no_lag(golden: Run, turns: int, delay: float, name: str) -> None:
    """Five turns at 4 rad/s; the base comes to them the other way round, or a time behind them."""
    spin, came = 4.0 * T, 2.0 * np.pi * turns * (1.0 - np.exp(-2.0 * T))
    late = 4.0 * np.maximum(T - delay, 0.0)
    found = judged(golden, heading(late + came), heading(spin))
    assert found.outcome == name
    if name == "late":
        assert " is on its path, 0.7 s (1.4 m) behind" in found.outcome_sentence


@pytest.mark.parametrize("share", [0.75, 0.8, 0.85])
def test_who_falls_back_by_a_turn_is_late(golden: Run, share: float) -> None:
    """By 4.8, 6.4 or 8 rad after five turns, as far as it can be off by no more than its wrap."""
    assert judged(golden, heading(4.0 * share * T), heading(4.0 * T)).outcome == "late"


def heading(angle: Array) -> Array:
    """Return poses (K, 3) that turn on the spot."""
    return np.column_stack([0.0 * angle, 0.0 * angle, angle])


def config(*obstacles: Disc | HalfPlane, tip: tuple[Disc, ...] = (), radius: float = 0.3) -> Config:
    return Config(Horizon(base_obstacles=obstacles, base_radius=radius, end_effector_obstacles=tip))


@pytest.mark.parametrize(("deep", "name"), [(0.0049, "tracked"), (0.0051, "collided")])
def test_collided(golden: Run, deep: float, name: str) -> None:
    """A base of 0.3 m passes a disc of 0.2 m whose centre is 0.5 m less so much from its way."""
    disc = Disc(2.0, 0.5 - deep, 0.2)
    found = summarize(vary(log(golden, REFERENCE), config=config(Disc(9.0, 9.0, 1.0), disc)))
    assert found.outcome == name
    assert found.succeeded is (name == "tracked")
    if name == "collided":
        assert found.outcome_sentence == (
            f"base ran into the disc at (2, {disc.y:.4g}) m, radius 0.2 m at 4 s, "
            "5.1 mm deep at worst"
        )


def test_collided_with_a_wall_and_with_a_hand(golden: Run) -> None:
    """Of several the deepest is told; the end effector has a radius of its own, 0.05 m."""
    wall, pillar = HalfPlane(-1.0, 0.0, -3.2), Disc(2.0, 0.49, 0.2)
    run = vary(log(golden, REFERENCE), config=config(wall, pillar))
    found = summarize(run)  # ends at x = 4 m, with a radius of 0.3 m, behind a wall at 3.2 m
    assert found.outcome == "collided"
    assert found.outcome_sentence == (
        "base ran into the half-plane, free where x ≤ 3.2 m at 5.82 s, 1.1 m deep at worst"
    )
    path = np.column_stack([SPEED * T, 1.0 + 0.0 * T, 0.5 + 0.0 * T])
    hand = with_hand(golden, path, path)
    assert summarize(vary(hand, config=config(tip=(Disc(2.0, 1.26, 0.2),)))).succeeded
    touched = summarize(vary(hand, config=config(tip=(Disc(2.0, 1.24, 0.2),))))
    assert touched.outcome_sentence.startswith("end effector ran into the disc at (2, 1.24) m")
    armless = vary(log(golden, REFERENCE), config=config(tip=(Disc(2.0, 0.0, 0.2),)))
    assert summarize(armless).outcome == "tracked"


def test_a_base_without_a_radius_reaches_to_its_farthest_contact(golden: Run) -> None:
    """The front wheel, 0.8 m ahead of P."""
    law = Horizon(base_obstacles=(Disc(2.0, 0.99, 0.2),))
    found = summarize(vary(log(golden, REFERENCE), config=Config(law)))
    assert found.outcome_sentence.endswith("10 mm deep at worst")
    law = Horizon(base_obstacles=(Disc(2.0, 1.01, 0.2),))
    assert summarize(vary(log(golden, REFERENCE), config=Config(law))).outcome == "tracked"


def test_whoever_stands_does_not_diverge(golden: Run) -> None:
    """A wall 1 m before the end of the way: on its path until then, and then it stands there."""
    reached = np.minimum(SPEED * T, SPEED * T[-1] - 1.0)
    corner = np.where(reached < SPEED * T, SPEED * T - reached, 0.0)  # the reference turns off
    reference = np.column_stack([reached, corner, 0.0 * T])
    stopped = np.column_stack([reached, 0.0 * T, 0.0 * T])
    found = judged(golden, stopped, reference)
    assert found.outcome == "stuck"
    assert " stands " in found.outcome_sentence
    moving = np.column_stack([reached + corner, 0.0 * T, 0.0 * T])
    assert judged(golden, moving, reference).outcome == "diverging"


def moment(samples: int, usual: float, meanwhile: float) -> Array:
    """Return a column (K,) that has another value for some samples, from 2 s on."""
    values = np.full(COUNT, usual)
    values[100 : 100 + samples] = meanwhile
    return values


@pytest.mark.parametrize(("samples", "name"), [(5, "tips"), (4, "tracked")])
def test_a_robot_whose_weight_leaves_its_contacts_tips(
    golden: Run, samples: int, name: str
) -> None:
    """For a tenth of a second, five samples, or more."""
    found = summarize(log(golden, REFERENCE, tip_margin=moment(samples, 0.1, -0.05)))
    assert (found.outcome, found.succeeded) == (name, name == "tracked")
    if name == "tips":
        assert found.outcome_sentence.startswith(
            "it tips over at 2 s: its weight falls up to 0.05 m"
        )


def test_two_coaxial_wheels_alone_do_not_track(tmp_path: Path) -> None:
    """Planar equations hold it upright; nothing else does, though its path is followed exactly."""
    parts = Parts([])
    parts.link("base", 25.0, com="0 0 0.25")
    rear_axle(parts)
    run = rpctl.track(rpctl.load(write(tmp_path, parts.text("two"))), "line", duration=2.0)
    found = summarize(run)
    assert (found.outcome, found.succeeded) == ("tips", False)
    assert found.outcome_sentence == (
        "it does not stand: only rear_left, rear_right are known to touch the ground, on one line"
    )


def test_a_robot_that_leans_has_tipped(golden: Run) -> None:
    """As its plant tells: 11° about x; at 9° it still stands."""
    for degrees, name in ((11.0, "tips"), (9.0, "tracked")):
        pose = np.zeros((COUNT, 7))
        pose[:, 6], half = 1.0, np.radians(degrees) / 2.0
        pose[300, [3, 6]] = np.sin(half), np.cos(half)
        found = summarize(log(golden, REFERENCE, root_pose=pose, tip_margin=moment(9, 0.1, -0.05)))
        assert found.outcome == name


@pytest.mark.parametrize(("least", "name"), [(1.01, "slips"), (0.99, "tracked")])
def test_only_a_certain_slip_counts(golden: Run, least: float, name: str) -> None:
    """Over all splits of the load the wheel needs more than it has, for a tenth of a second."""
    slips = np.column_stack([moment(5, 0.2, least), moment(5, 0.3, 4.0)])
    found = summarize(log(golden, REFERENCE, tip_margin=moment(0, 0.1, 0.1), slip_range=slips))
    assert found.outcome == name
    if name == "slips":
        assert found.outcome_sentence.startswith("it slips at 2 s: it needs 101 % of the grip")


@pytest.mark.parametrize(("error", "name"), [(0.21, "cannot-hold"), (0.19, "tracked")])
def test_a_joint_thrown_off_its_reference_counts(golden: Run, error: float, name: str) -> None:
    e = np.zeros((COUNT, 3 + len(golden.robot.joint_names)))
    e[200, 3] = -error
    found = summarize(log(golden, REFERENCE, e=e))
    assert found.outcome == name
    e[0, 3] = 0.15  # a start off by so much may overshoot to half as much again
    assert summarize(log(golden, REFERENCE, e=e)).outcome == "tracked"


@pytest.mark.parametrize(("speed", "name"), [(3.01, "cannot-hold"), (2.99, "tracked")])
def test_a_joint_that_races_counts(golden: Run, speed: float, name: str) -> None:
    """Half as fast again as the 2 rad/s that it may turn."""
    rates = np.zeros((COUNT, len(golden.robot.actuators)))
    rates[100, 3] = -speed
    found = summarize(log(golden, REFERENCE, rates=rates))
    assert (found.outcome, found.succeeded) == (name, False)
    assert found.joint_errors[0].speed_ratio == pytest.approx(speed / 2.0)
    if name == "cannot-hold":
        assert found.outcome_sentence == "swing_joint moves at 1.5 times its speed limit"


def test_the_joint_farthest_beyond_its_bound_is_named(golden: Run) -> None:
    """0.3 rad of 0.2 and 0.1 m of 0.05."""
    e = np.zeros((COUNT, 3 + len(golden.robot.joint_names)))
    e[200, 3], e[300, 4] = 0.3, -0.1
    found = summarize(log(golden, REFERENCE, e=e))
    assert (
        found.outcome_sentence
        == "slide_joint is 0.1 m off its reference, beyond 0.05 m from 6 s on"
    )
    assert [joint.largest for joint in found.joint_errors] == [0.3, 0.1]


@pytest.mark.parametrize(("share", "name"), [(0.055, "chatters"), (0.045, "tracked")])
def test_efforts_at_half_of_their_rate_chatter(golden: Run, share: float, name: str) -> None:
    """At 500 Hz they may change by a fifth of their limit each sample: half of that is a tenth."""
    t, limit = T / 10.0, float(golden.robot.effort_limits[0])
    tau = np.zeros((COUNT, len(golden.robot.actuators)))
    tau[::2, 0], tau[1::2, 0] = share * limit, -share * limit
    assert summarize(log(golden, line(SPEED * t), line(SPEED * t), t, tau=tau)).outcome == name


@pytest.mark.parametrize(("share", "name"), [(0.27, "chatters"), (0.24, "tracked")])
def test_efforts_that_leap_each_sample_chatter(golden: Run, share: float, name: str) -> None:
    """±a quarter of the limit, to and fro."""
    limit = float(golden.robot.effort_limits[0])
    tau = np.zeros((COUNT, len(golden.robot.actuators)))
    tau[::2, 0], tau[1::2, 0] = share * limit, -share * limit
    found = summarize(log(golden, REFERENCE, tau=tau))
    assert found.outcome == name
    assert found.efforts[0].chatter == pytest.approx(2.0 * share)
    # What grows evenly does not leap; without a limit there is no share; of a wave of four samples,
    # 0, a, 0, −a, the second differences are 0, 2a, 0, −2a, so it leaps by a/2.
    tau[:, 0], tau[:, 1] = np.linspace(-limit, limit, COUNT), tau[:, 0]
    tau[:, 2] = share * 15.0 * np.sin(0.5 * np.pi * np.arange(COUNT))
    leaps = [each.chatter for each in summarize(log(golden, REFERENCE, tau=tau)).efforts]
    assert leaps == pytest.approx([0.0, 0.0, 0.5 * share, 0.0, 0.0], abs=0.003)
