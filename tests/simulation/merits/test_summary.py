"""Figures of merit: each is what its name says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rpctl import Robot, Run, summarize, track
from rpctl.files.writing import to_json
from rpctl.simulation.merits.ground import LoadRange
from rpctl.simulation.merits.summary import Summary, violations
from tests.runs import vary


@pytest.fixture(scope="module")
def run(paper: Robot) -> Run:
    return track(paper, "eight", duration=1.0, initial_error=(0.1, 0.0, 0.0))


def test_a_limit_counts_once(run: Run) -> None:
    """A driven wheel's rate is in the log twice."""
    wheel = run.robot.other_names.index("wheel_left_joint")
    rates, others = run.log.rates.copy(), run.log.other_rates.copy()
    rates[3, 0] = others[3, wheel] = 1e3
    (found,) = violations(vary(run, rates=rates, other_rates=others))
    assert (found.joint, found.limit) == ("wheel_left_joint", "velocity")


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
        "and uses 12 to 31 % of the grip at friction 0.7, depending on how the contacts share "
        "the load (20 % if its 4 contacts are equally stiff)"
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
            "uses at least 12 % of the grip at friction 0.7, with no upper bound, as a wheel "
            "that drives may carry no load (20 % if its 4 contacts are equally stiff)",
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
    assert str(figures.ground.sentence).endswith("at worst, and its grip cannot be computed")


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
