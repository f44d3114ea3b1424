"""Every figure of a summary has the value that paper and pencil give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rpctl import Run, summarize
from rpctl.simulation.merits.summary import violations
from tests.golden import COUNT, TIMES
from tests.runs import vary

DURATION = float(TIMES[-1])


def rms(*values: float) -> float:
    return float((sum(value**2 for value in values) / len(values)) ** 0.5)


def changed(run: Run, name: str, sample: int | slice, column: int, value: float) -> Run:
    """Return a run with one entry of an array, or several of a column, changed."""
    array = np.array(getattr(run.log, name))
    array[sample, column] = value
    entry: dict[str, Any] = {name: array}
    return vary(run, **entry)


def test_figures_of_a_run(golden: Run) -> None:
    summary = summarize(golden)
    figures: dict[str, float] = {
        "rms_base_error": rms(5.0, 0.5, 0.5, 0.13, 0.1, 0.05),
        "final_base_error": 0.05,
        "settled_base_error": 0.13,
        "final_lateral_error": 0.04,
        "rms_end_effector_error": rms(0.7, 0.3, 0.07, 0.03, 0.07, 0.03),
        "final_end_effector_error": 0.03,
        "settled_end_effector_error": 0.07,
        "max_effort_ratio": 0.8,
        "work": 4.0,
        "lost": 3.0,
        "energy_residual": 0.2 / 5.0,
        "constraint_residual": 3e-9,
        "min_tip_over_margin": 0.125,
        "max_slip_ratio": 0.4,
        "friction": 0.7,
        "wall_time": 0.25,
        "realtime_factor": 2.0,
    }
    assert {name: summary.to_dict()[name] for name in figures} == pytest.approx(figures, rel=1e-12)
    assert summary.energy_sentence == (
        "the actuators did 4 J of work; damping, friction and stops dissipated 3 J"
    )
    assert summarize(vary(golden, lost=np.zeros(COUNT))).energy_sentence is None
    assert summary.max_effort_joint == "swing_joint"
    assert summary.limits_violated == ()
    assert summary.kinematic_report == {"softened": 3.0}
    swing, slide = summary.joint_errors
    assert (swing.joint, swing.unit) == ("swing_joint", "rad")
    assert (slide.joint, slide.unit) == ("slide_joint", "m")
    assert [swing.rms, swing.final, swing.settled] == pytest.approx(
        [rms(1.0, 0.5, 0.2, 0.1, 0.3, 0.2), 0.2, 0.3]
    )
    assert [slide.rms, slide.final, slide.settled] == pytest.approx(
        [rms(0.04, 0.03, 0.01, 0.005, 0.02, 0.01), 0.01, 0.02]
    )
    assert [(joint.largest, joint.speed_ratio) for joint in (swing, slide)] == [
        pytest.approx((1.0, 1.2 / 2.0)),
        pytest.approx((0.04, 0.3 / 0.5)),
    ]
    efforts = [(e.actuator, e.peak, e.limit, e.ratio) for e in summary.efforts]
    assert efforts == [
        ("left_wheel_joint", 30.0, 40.0, 0.75),
        ("right_wheel_joint", 50.0, np.inf, 0.0),
        ("steer_joint", 3.0, 15.0, 0.2),
        ("swing_joint", 16.0, 20.0, 0.8),
        ("slide_joint", 60.0, 80.0, 0.75),
    ]


def test_the_second_half_of_an_odd_number_of_samples_has_the_middle_one(golden: Run) -> None:
    arrays: dict[str, Any] = {
        name: a[:5] for name, a in vars(golden.log).items() if isinstance(a, np.ndarray)
    }
    summary = summarize(vary(golden, **arrays))
    assert summary.settled_base_error == pytest.approx(0.5)
    assert summary.joint_errors[1].settled == pytest.approx(0.02)


# Array, its column, limit, and what is told of it: the joint and the kind of limit.
LIMITS: list[tuple[str, int, float, str, str]] = [
    ("tau", 0, 40.0, "left_wheel_joint", "effort"),
    ("tau", 2, -15.0, "steer_joint", "effort"),
    ("tau", 3, -20.0, "swing_joint", "effort"),
    ("tau", 4, 80.0, "slide_joint", "effort"),
    ("rates", 0, -5.0, "left_wheel_joint", "velocity"),
    ("rates", 2, 3.0, "steer_joint", "velocity"),
    ("rates", 3, 2.0, "swing_joint", "velocity"),
    ("rates", 4, -0.5, "slide_joint", "velocity"),
    ("joints", 0, -1.0, "swing_joint", "lower"),
    ("joints", 0, 1.5, "swing_joint", "upper"),
    ("joints", 1, -0.1, "slide_joint", "lower"),
    ("joints", 1, 0.4, "slide_joint", "upper"),
    ("steering", 0, -0.5, "steer_joint", "lower"),
    ("steering", 0, 0.6, "steer_joint", "upper"),
    ("others", 0, -0.3, "flap_joint", "lower"),
    ("others", 0, 0.4, "flap_joint", "upper"),
    ("other_rates", 0, -2.5, "flap_joint", "velocity"),
    ("other_rates", 1, 6.0, "idle_wheel_joint", "velocity"),
]


@pytest.mark.parametrize("case", LIMITS, ids=lambda case: f"{case[3]}-{case[4]}-{case[2]:g}")
def test_each_limit_in_each_direction(golden: Run, case: tuple[str, int, float, str, str]) -> None:
    """A quarter beyond the limit at samples 2 and 3, half as far at 4: told once, the worst of it.

    In the other direction, where the other limit is farther away, the same is allowed.
    """
    array, column, limit, joint, kind = case
    run = changed(golden, array, slice(2, 4), column, 1.25 * limit)
    run = changed(run, array, 4, column, 1.125 * limit)
    (found,) = violations(run)
    assert (found.joint, found.limit) == (joint, kind)
    sign = 1.0 if kind in ("lower", "upper") else np.sign(limit)  # of efforts and rates the size
    assert found.value == pytest.approx(1.25 * limit * sign)
    assert found.allowed == pytest.approx(limit * sign)
    assert found.first_time == pytest.approx(0.2)
    assert found.duration == pytest.approx(3 / COUNT * DURATION)
    assert summarize(run).limits_violated == (found,)


@pytest.mark.parametrize("case", LIMITS, ids=lambda case: f"{case[3]}-{case[4]}-{case[2]:g}")
def test_each_limit_may_be_reached_but_not_passed(
    golden: Run, case: tuple[str, int, float, str, str]
) -> None:
    array, column, limit, joint, kind = case
    assert violations(changed(golden, array, 1, column, limit)) == ()
    size = max(abs(limit), 1.0)  # rounding may pass it by 1e-9 of the limit, and of 1
    assert (
        violations(changed(golden, array, 1, column, limit + 0.5e-9 * np.sign(limit) * size)) == ()
    )
    (found,) = violations(changed(golden, array, 1, column, limit + 2e-9 * np.sign(limit) * size))
    assert (found.joint, found.limit) == (joint, kind)


def test_limits_on_the_far_side_of_zero(golden: Run) -> None:
    """A joint from 2 to 3 rad: rounding may pass 2 by 2e-9, and no more."""
    inside = np.column_stack([np.full(COUNT, 2.5), golden.log.joints[:, 1]])
    run = vary(golden, joints=inside, lower_limits=(2.0, -0.1), upper_limits=(3.0, 0.4))
    assert violations(run) == ()
    assert violations(changed(run, "joints", 3, 0, 2.0 - 1.5e-9)) == ()
    (lower,) = violations(changed(run, "joints", 3, 0, 1.75))
    (upper,) = violations(changed(run, "joints", 3, 0, 3.25))
    assert (lower.limit, upper.limit) == ("lower", "upper")
    assert (abs(lower.value), abs(lower.allowed)) == (1.75, 2.0)
    assert (upper.value, upper.allowed) == (3.25, 3.0)
    below = vary(golden, joints=inside - [5.5, 0.0], lower_limits=(-3.5, -0.1))
    (upper,) = violations(vary(below, upper_limits=(-3.25, 0.4)))
    assert (upper.limit, upper.value, upper.allowed) == ("upper", -3.0, -3.25)


def test_where_there_is_no_limit_nothing_is_broken(golden: Run) -> None:
    run = changed(changed(golden, "tau", 0, 1, 1e6), "rates", 0, 1, -1e6)
    assert violations(run) == ()
    free = vary(run, lower_limits=(-np.inf, -np.inf), upper_limits=(np.inf, np.inf))
    free = changed(changed(free, "joints", 0, 0, 1e6), "joints", 0, 1, -1e6)
    assert violations(free) == ()
    free = vary(free, effort_limits=(np.inf,) * 5)
    summary = summarize(free)
    assert (summary.max_effort_ratio, summary.max_effort_joint) == (None, None)


def test_efforts_of_nothing_use_nothing_of_their_limits(golden: Run) -> None:
    """Only a robot without effort limits has no share of one."""
    still = vary(golden, tau=np.zeros((COUNT, 5)), effort_limits=(np.inf, 40.0, 15.0, 20.0, 80.0))
    summary = summarize(still)
    assert (summary.max_effort_ratio, summary.max_effort_joint) == (0.0, "right_wheel_joint")


def test_limits_that_bound(golden: Run) -> None:
    wheel, slide = summarize(golden).limits_bound
    assert (wheel.joint, wheel.limit) == ("left_wheel_joint", "effort")
    assert (slide.joint, slide.limit) == ("slide_joint", "upper")
    assert [wheel.first_time, slide.first_time] == pytest.approx([0.2, 0.1])
    # P is 0.1 m behind the root link, which is at (0.4, 0.12) m and turned by 0.6 rad.
    assert wheel.first_place == pytest.approx([0.4 - 0.1 * np.cos(0.6), 0.12 - 0.1 * np.sin(0.6)])
    assert wheel.duration == pytest.approx(0.5 * DURATION)
    assert slide.duration == pytest.approx(DURATION / 3.0)
    assert wheel.sentence == (
        "left_wheel_joint effort limit bound from 0.2 s, at (0.32, 0.06) m, 0.25 s in all"
    )
    assert slide.sentence == (
        "slide_joint upper position limit bound from 0.1 s, at (0.10, 0.00) m, 0.17 s in all"
    )
    lower = vary(golden, bound_limits=(("steer_joint", "lower"), ("slide_joint", "velocity")))
    first, second = summarize(lower).limits_bound
    assert first.sentence.startswith("steer_joint lower position limit bound from 0.2 s")
    assert second.sentence.startswith("slide_joint velocity limit bound from 0.1 s")


# Margins (m) and slip ratios at samples 1 to 3, and what is told of them.
GROUND: list[tuple[tuple[float, ...], tuple[float, ...], dict[str, Any]]] = [
    (
        (0.25, 0.125, 0.15),
        (0.2, 0.15, 0.4),
        {"would_tip": False, "would_slip": False,
         "ground": "keeps 0.12 m from tipping and uses 40 % of the grip at friction 0.7"},
    ),
    (
        (0.25, -0.04, -0.125),
        (0.2, 0.15, 0.4),
        {"would_tip": True, "would_slip": False, "min_tip_over_margin": -0.125,
         "ground": "would tip over at 0.2 s, by 0.12 m at worst, and uses 40 % of the grip at "
         "friction 0.7"},
    ),
    (
        (0.25, 0.125, 0.15),
        (0.2, 1.25, 3.5),
        {"would_tip": False, "would_slip": True, "max_slip_ratio": 3.5,
         "ground": "keeps 0.12 m from tipping and would slip at 0.2 s, needing up to 350 % of the "
         "grip at friction 0.7"},
    ),
    (
        (0.0, 0.125, 0.15),
        (1.0, 0.15, 0.4),
        {"would_tip": False, "would_slip": False, "max_slip_ratio": 1.0,
         "ground": "keeps 0 m from tipping and uses 100 % of the grip at friction 0.7"},
    ),
    (
        (0.25, 0.125, 0.15),
        (0.2, 12.0, 10.0),
        {"would_slip": True,
         "ground": "keeps 0.12 m from tipping and would slip at 0.2 s, needing over 10 times the "
         "grip at friction 0.7"},
    ),
    (
        (0.25, 0.125, 0.15),
        (0.2, 0.5, 9.99),
        {"ground": "keeps 0.12 m from tipping and would slip at 0.3 s, needing up to 999 % of the "
         "grip at friction 0.7"},
    ),
]  # fmt: skip


@pytest.mark.parametrize(("margins", "slips", "summary"), GROUND)
def test_what_the_ground_does(
    golden: Run, margins: tuple[float, ...], slips: tuple[float, ...], summary: dict[str, Any]
) -> None:
    tip, slip = np.array(golden.log.tip_margin), np.array(golden.log.slip_ratio)
    tip[1:4], slip[1:4] = margins, slips
    found = summarize(vary(golden, tip_margin=tip, slip_ratio=slip)).to_dict()
    assert {key: found[key] for key in summary} == summary


def test_a_split_of_the_load_that_is_assumed_is_told(golden: Run) -> None:
    summary = summarize(vary(golden, contacts=("a", "b", "c", "d"))).ground.sentence
    assert str(summary).endswith("friction 0.7 (4 contacts, assumed equally stiff)")


def test_ground_without_a_balance(golden: Run) -> None:
    nothing = np.empty((COUNT, 0))
    bare = vary(golden, tip_margin=nothing, slip_ratio=nothing, contact_load=nothing)
    noted = summarize(vary(bare, ground_notes=("a meshed caster", "another note")))
    keys = ("min_tip_over_margin", "max_slip_ratio", "would_slip", "would_tip", "ground")
    assert [noted.to_dict()[key] for key in keys] == [None, None, None, None, "a meshed caster"]
    assert summarize(bare).ground.sentence is None


def test_without_an_arm_or_work_to_speak_of(golden: Run) -> None:
    nothing = np.empty((COUNT, 0))
    summary = summarize(vary(golden, end_effector=None, ee=nothing, ee_ref=nothing))
    keys = [f"{when}_end_effector_error" for when in ("rms", "final", "settled")]
    assert [summary.to_dict()[key] for key in keys] == [None] * 3
    rest = vary(golden, work=np.zeros(COUNT), lost=np.zeros(COUNT), energy=np.full(COUNT, 7.0))
    assert summarize(rest).energy_residual == 0.0
