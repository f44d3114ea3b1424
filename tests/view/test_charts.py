from __future__ import annotations

import base64
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Run
from rpctl.simulation.merits.collision_facts import GROUND, SELF, CollisionFacts, LinkClearance
from rpctl.view.charts import Chart, charts, grip_top
from rpctl.view.pages.motion_data import (
    MAX_POINTS,
    chart_data,
)
from tests.grids import cells
from tests.leaning import leaning
from tests.runs import vary


def floats(text: str) -> np.ndarray[Any, Any]:
    return np.frombuffer(base64.b64decode(text), "<f4")


def titles(run: Run) -> list[str]:
    return [chart.title for chart in charts(run)]


def chart(run: Run, title: str) -> Chart:
    return next(chart for chart in charts(run) if chart.title == title)


def test_clearance_shows_obstacles_and_what_was_come_near_to(paper_run: Run) -> None:
    """The ground at half of a metre is left out, and so are links that are near by build."""
    times = (0.0, 0.5 * float(paper_run.t[-1]), float(paper_run.t[-1]))
    disc = "the disc at (1, 2) m, radius 0.1 m"
    near = LinkClearance(disc, -0.02, 0.25 * times[2], "arm")
    built, far = LinkClearance(SELF, 0.005, 0.0, "a", "b"), LinkClearance(GROUND, 0.5, 0.0, "arm")
    series = ((0.005, 0.006, 0.005), (0.5, 0.5, 0.5), (2.0, 0.4, 0.6))
    facts = CollisionFacts((built, far, near), (), (), (), 1e-3, times, series)
    found = chart(replace(paper_run, collisions=facts), "Clearance")
    (line,) = found.lines
    assert line.label == disc.removeprefix("the ")
    assert line.values[[0, -1]] == pytest.approx([1.0, 0.6])  # what is farther is cut
    assert line.values.min() == pytest.approx(-0.02, abs=0.02)  # the least is between instants
    assert found.limits == (0.0,)
    low = LinkClearance(GROUND, 0.03, 0.0, "arm")
    series = (series[0], (0.5, 0.03, 0.5), series[2])
    both = CollisionFacts((built, low, near), (), (), (), 1e-3, times, series)
    lines = chart(replace(paper_run, collisions=both), "Clearance").lines
    assert [each.label for each in lines] == ["ground", disc.removeprefix("the ")]
    assert "Clearance" not in titles(replace(paper_run, collisions=None))


def stretched(run: Run, count: int) -> Run:
    """Return a run of ``count`` samples over the same time, between the samples of another."""
    t = np.linspace(0.0, run.t[-1], count)
    places = np.searchsorted(run.t, t - 1e-9)
    arrays: dict[str, Any] = {
        name: value[places]
        for name, value in vars(run.log).items()
        if isinstance(value, np.ndarray)
    }
    return vary(run, **{**arrays, "t": t})


def shared(run: Run) -> Run:
    """Return a run whose loads are intervals: twice and half of what they were, grip likewise."""
    loads, slips = (
        np.stack([0.5 * run.log.contact_load, 2.0 * run.log.contact_load], axis=2),
        run.log.slip_ratio,
    )
    slips = np.column_stack([0.5 * slips, 2.0 * slips])
    return vary(run, load_range=loads, slip_range=slips)


def test_a_band_without_an_end_leaves_the_axis_to_the_line(paper_run: Run) -> None:
    slips = np.column_stack([0.5 * paper_run.log.slip_ratio, np.full_like(paper_run.t, 2.5)])
    run = vary(shared(paper_run), slip_range=slips)
    assert grip_top(run) == 2.5
    slips[5, 1], slips[6], slips[7, 1] = np.inf, np.nan, 7.0
    assert grip_top(run) == max(1.0, paper_run.log.slip_ratio.max())
    grip = chart(run, "Grip used")
    assert "(drawn up to 100)" in grip.note
    data = chart_data([run], ["run"])
    json.dumps(data, allow_nan=False)
    drawn = next(c for c in data["charts"] if c["title"] == "Grip used")["variants"][0]["lines"]
    least, most = (floats(edge) for edge in drawn[0]["band"])
    np.testing.assert_array_equal(np.isnan(least), np.arange(len(least)) == 6)
    assert np.isinf(most[[5, 7]]).all()


def test_no_peak_is_lost(paper_run: Run) -> None:
    run = stretched(paper_run, 30_000)
    tau = np.array(run.tau)
    tau[17_777, 0], tau[4_321, 0] = 55.0, -66.0
    data = chart_data([vary(run, tau=tau)], ["run"])
    times = floats(data["x"])
    efforts = next(c for c in data["charts"] if c["title"] == "Efforts")["variants"][0]
    line = efforts["lines"][0]
    drawn = 0.01 * floats(line["values"]) * paper_run.robot.effort_limits[0]
    assert len(drawn) == len(times) <= MAX_POINTS
    step = 2.0 * float(times[1])
    assert drawn.max() == pytest.approx(55.0)
    assert times[drawn.argmax()] == pytest.approx(run.t[17_777], abs=step)
    assert times[drawn.argmin()] == pytest.approx(run.t[4_321], abs=step)


LEANING = ("balancer", "roll"), ("whipple", "pitch")


@pytest.fixture(scope="module")
def upright() -> Run:
    """Return a short run of a balancer."""
    return rpctl.track(leaning("balancer"), "line", duration=0.02, collisions=False)


@pytest.mark.parametrize(("name", "other"), cells(LEANING, LEANING[:1], LEANING[1:]))
def test_the_tilt_is_drawn_against_what_nothing_raises(upright: Run, name: str, other: str) -> None:
    """1.2 rad either way; headings change nothing; a bicycle hardly pitches as it rolls."""
    robot, run = leaning(name), upright
    if name == "whipple":
        run = rpctl.track(robot, "line", duration=0.02, collisions=False)
    tilts, headings = (np.linspace(*ends, len(run.t)) for ends in ((-0.7, 0.9), (-3.0, 3.0)))
    q = [robot.configuration(theta=h, tilt=x) for h, x in zip(headings, tilts, strict=True)]
    found = chart(vary(run, q=np.array(q)), "Tilt")
    assert (found.unit, found.limits) == ("rad", (-1.2, 1.2))
    lines = {line.label: line.values for line in found.lines}
    own = lines.pop("roll" if name == "whipple" else "pitch")
    assert own == pytest.approx(tilts, abs=1e-12)
    assert np.abs(lines[other]).max() < (0.05 if name == "whipple" else 1e-12)


def test_a_small_tilt_fills_its_chart(upright: Run) -> None:
    """0.19 rad of the 1.2 rad beyond which it has fallen."""
    robot = leaning("balancer")
    q = [robot.configuration(tilt=tilt) for tilt in np.linspace(-0.1, 0.19, len(upright.t))]
    found = chart(vary(upright, q=np.array(q)), "Tilt")
    assert found.limits == () and found.note.endswith("fallen beyond ±1.2 rad")


def test_a_level_robot_has_no_tilt(paper_run: Run) -> None:
    assert "Tilt" not in titles(paper_run)
