from __future__ import annotations

import base64
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rpctl import Robot, Run
from rpctl.simulation.collision_facts import (
    GROUND,
    SELF,
    Collision,
    CollisionFacts,
    LinkClearance,
)
from rpctl.view.chart import Chart
from rpctl.view.charts import charts, grip_top
from rpctl.view.pages.chart_data import MAX_POINTS, chart_data
from rpctl.view.pages.forces import contact_forces, effort_ratios, overlay
from rpctl.view.pages.timeline import timeline_marks
from tests.runs import vary
from tests.view.samples import short_run


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
    assert line.values[[0, -1]] == pytest.approx([2.0, 0.6])
    assert line.values.min() == pytest.approx(-0.02, abs=0.02)  # the least is between instants
    assert found.limits == (0.0,)
    low = LinkClearance(GROUND, 0.03, 0.0, "arm")
    series = (series[0], (0.5, 0.03, 0.5), series[2])
    both = CollisionFacts((built, low, near), (), (), (), 1e-3, times, series)
    lines = chart(replace(paper_run, collisions=both), "Clearance").lines
    assert [each.label for each in lines] == ["ground", disc.removeprefix("the ")]
    assert "Clearance" not in titles(replace(paper_run, collisions=None))


def test_the_timeline_is_marked_where_links_collide() -> None:
    into = Collision("the ground", "arm <1>", "", 0.02, 2.0, 1.0)
    marks = timeline_marks([into], 0.0, 4.0)
    assert "left:calc(8px + 0.5000*(100% - 16px))" in marks
    assert "width:max(3px, 0.2500*(100% - 16px))" in marks
    assert 'title="arm &lt;1&gt; ran into the ground at 2 s, 20 mm deep' in marks
    assert timeline_marks([into], 0.0, 0.0) == timeline_marks([], 0.0, 4.0) == ""


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


def test_charts_suit_the_robot(paper_run: Run, ur5_run: Run, cart: Robot) -> None:
    assert titles(paper_run) == [
        "Base error",
        "End-effector error",
        "Joint errors",
        "Base speeds",
        "Joint speeds",
        "Efforts",
        "Tip-over margin",
        "Grip used",
        "Ground loads",
    ]
    assert not {"Base error", "Base speeds", "Ground loads"} & set(titles(ur5_run))
    without = titles(short_run(cart, 0.2))
    assert without == ["Base error", "Base speeds", "Efforts without limits, N·m"]


def test_speeds_are_told_by_name(paper_run: Run) -> None:
    names = ("vy", "front_steering_joint", *paper_run.robot.quasi_velocities[2:])
    run = vary(paper_run, quasi_velocities=names)
    (vy,) = chart(run, "Base speeds").lines
    assert (vy.label, vy.unit) == ("vy", "m/s")
    (steering,) = chart(run, "Other speeds").lines
    assert (steering.label, steering.unit) == ("front_steering_joint", "rad/s")
    np.testing.assert_array_equal(steering.values, run.nu[:, 1])
    units = dict(zip(run.robot.joint_names, run.robot.units, strict=True))
    shown_units = [line.unit for line in chart(run, "Joint speeds").lines]
    assert shown_units == [f"{units[name]}/s" for name in names[2:]]
    assert set(shown_units) == {"m/s", "rad/s"}


def test_efforts_are_shares_of_their_limits(paper_run: Run) -> None:
    efforts = chart(paper_run, "Efforts")
    assert efforts.limits == (-100.0, 100.0)
    for line, tau, limit in zip(
        efforts.lines, paper_run.tau.T, paper_run.robot.effort_limits, strict=True
    ):
        np.testing.assert_allclose(line.values, 100.0 * tau / limit)
        np.testing.assert_allclose(line.values * line.scale, tau)
    np.testing.assert_allclose(
        100.0 * effort_ratios(paper_run, np.abs(paper_run.tau)),
        np.abs([line.values for line in efforts.lines]).T,
    )


def shared(run: Run) -> Run:
    """Return a run whose loads are intervals: twice and half of what they were, grip likewise."""
    loads, slips = (
        np.stack([0.5 * run.log.contact_load, 2.0 * run.log.contact_load], axis=2),
        run.log.slip_ratio,
    )
    slips = np.column_stack([0.5 * slips, 2.0 * slips])
    return vary(run, load_range=loads, slip_range=slips)


def test_what_is_an_interval_has_a_band(paper_run: Run) -> None:
    run = shared(paper_run)
    loads, grip = chart(run, "Ground loads"), chart(run, "Grip used")
    for line, load in zip(loads.lines, run.log.contact_load.T, strict=True):
        assert line.band is not None
        np.testing.assert_array_equal(line.band, [0.5 * load, 2.0 * load])
    (line,) = grip.lines
    assert line.band is not None
    np.testing.assert_allclose(line.band, 100.0 * np.outer([0.5, 2.0], run.log.slip_ratio))
    for each in (loads, grip):
        assert each.note.endswith("shaded: all splits of the load")
    for title in ("Ground loads", "Grip used"):
        assert all(line.band is None for line in chart(paper_run, title).lines)
        assert "shaded" not in chart(paper_run, title).note
    data = chart_data([run], ["run"])
    drawn = next(c for c in data["charts"] if c["title"] == "Ground loads")["variants"][0]["lines"]
    least, most = (floats(text) for text in drawn[1]["band"])
    np.testing.assert_allclose(least, 0.5 * run.log.contact_load[:, 1], rtol=1e-6)
    np.testing.assert_allclose(most, 2.0 * run.log.contact_load[:, 1], rtol=1e-6)
    assert "band" not in data["charts"][0]["variants"][0]["lines"][0]


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
    drawn = floats(line["values"]) * line["scale"]
    assert len(drawn) == len(times) <= MAX_POINTS
    step = 2.0 * float(times[1])
    assert drawn.max() == pytest.approx(55.0)
    assert times[drawn.argmax()] == pytest.approx(run.t[17_777], abs=step)
    assert times[drawn.argmin()] == pytest.approx(run.t[4_321], abs=step)


def test_short_run_keeps_its_samples(paper_run: Run) -> None:
    data = chart_data([paper_run], ["run"])
    np.testing.assert_allclose(floats(data["x"]), paper_run.t, rtol=1e-6)
    base = data["charts"][0]["variants"][0]
    np.testing.assert_allclose(floats(base["lines"][2]["values"]), paper_run.log.e[:, 1], rtol=1e-6)
    assert base["decades"][0] < base["decades"][1]
    json.dumps(data, allow_nan=False)


def test_several_runs_share_time_and_charts(paper: Robot, paper_run: Run) -> None:
    other = short_run(paper, 1.5)
    data = chart_data([paper_run, other], ["a", "b"])
    times = floats(data["x"])
    assert times[-1] == pytest.approx(3.0)
    base = data["charts"][0]
    assert [v["label"] for v in base["variants"]][:2] == ["distance", "longitudinal x₁"]
    first, second = (floats(line["values"]) for line in base["variants"][0]["lines"])
    assert [line["label"] for line in base["variants"][0]["lines"]] == ["a", "b"]
    assert np.isfinite(first).all()
    step = float(times[1])
    assert np.isfinite(second[times <= 1.5]).all()
    assert np.isnan(second[times > 1.5 + 2.0 * step]).all()


def test_forces_of_the_ground(paper: Robot, paper_run: Run) -> None:
    force = contact_forces(paper_run)
    np.testing.assert_array_equal(force[:, :, 2], paper_run.log.contact_load)
    np.testing.assert_allclose(
        force[:, :, 0].sum(axis=1), paper_run.log.wheel_force.sum(axis=1), atol=1e-9
    )
    np.testing.assert_allclose(
        force[:, :, 1].sum(axis=1), paper_run.log.axle_force.sum(axis=1), atol=1e-9
    )
    turned = vary(paper_run, drive=replace(paper_run.robot.drive, heading=0.5 * np.pi))
    np.testing.assert_allclose(contact_forces(turned)[:, :, 1], force[:, :, 0], atol=1e-12)
    np.testing.assert_allclose(contact_forces(turned)[:, :, 0], -force[:, :, 1], atol=1e-12)
    steered = vary(
        paper_run, quasi_velocities=("v", "steering", *paper_run.robot.quasi_velocities[2:])
    )
    assert not contact_forces(steered)[:, :, :2].any()


def test_effort_between_frames_is_not_lost(paper: Robot, paper_run: Run) -> None:
    tau = np.array(paper_run.tau)
    tau[123, 1] = -0.9 * paper_run.robot.effort_limits[1]
    run = vary(paper_run, tau=tau)
    drawn = floats(overlay(paper, run, run.t[:300:10])["effort"]["share"]).reshape(30, -1)
    assert drawn[12, 1] == pytest.approx(0.9)
    assert drawn[13, 1] < 0.9


def test_zero_moment_point_is_told_in_the_robots_frame(paper: Robot, paper_run: Run) -> None:
    frames = np.array([0, 700, 1500])
    stance = overlay(paper, paper_run, paper_run.t[frames])["stance"]
    for (x, y, yaw), (px, py), sample in zip(
        floats(stance["pose"]).reshape(-1, 3),
        floats(stance["zmp"]).reshape(-1, 2),
        frames,
        strict=True,
    ):
        cos, sin = np.cos(yaw), np.sin(yaw)
        world = [x + cos * px - sin * py, y + sin * px + cos * py]
        np.testing.assert_allclose(world, paper_run.log.zmp[sample], atol=1e-6)


def test_nothing_is_drawn_of_ground_that_was_not_logged(ur5: Robot, ur5_run: Run) -> None:
    drawn = overlay(ur5, ur5_run, ur5_run.t[:3])
    assert drawn["stance"] is None
    assert drawn["effort"]["joints"] == [
        ur5.model.getJointId(name) for name in ur5_run.robot.actuators
    ]
