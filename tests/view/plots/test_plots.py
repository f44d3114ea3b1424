from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rpctl
from rpctl import Robot, Run
from rpctl.view.chart import PANELS
from rpctl.view.plots import style
from rpctl.view.plots.figures import (
    save_figure,
    tracking_figure,
    tracking_image,
)
from rpctl.view.plots.panels import find_panels
from rpctl.view.plots.paths import half_plane
from tests.grids import cells
from tests.runs import vary
from tests.view.samples import PILLAR, short_run, with_obstacles


def unlimited(run: Run) -> Run:
    return vary(run, effort_limits=(np.inf,) * len(run.robot.actuators))


def titles(run: Run) -> list[str]:
    return [axes.get_title(loc="left").partition(")  ")[2] for axes in tracking_figure(run).axes]


def test_figure_is_as_wide_as_a_page(paper_run: Run) -> None:
    with Image.open(io.BytesIO(tracking_image(paper_run))) as image:
        assert image.width == pytest.approx(180 / 25.4 * 200, abs=1)
        assert image.info["dpi"] == pytest.approx((200, 200), abs=0.1)
        assert len(np.unique(np.asarray(image.convert("L")))) > 20
        shades, counts = np.unique(np.asarray(image.convert("RGB")), axis=None, return_counts=True)
        assert shades[counts.argmax()] == 255  # the paper is white, not nearly


def test_all_panels_of_a_mobile_manipulator(tiago_run: Run) -> None:
    assert titles(tiago_run) == [
        "Paths",
        "Base error",
        "Joint errors",
        "End-effector error",
        "Base speeds",
        "Joint speeds",
        "Efforts, limits dashed",
        "Tip-over margin, limit dashed",
        "Grip at friction 0.7, limit dashed",
    ]


def test_errors_are_drawn_as_they_are(tiago_run: Run) -> None:
    _, base, joints, tip, speeds, rates, *_ = tracking_figure(tiago_run).axes
    distance = 1e3 * np.linalg.norm(tiago_run.log.ee_ref - tiago_run.log.ee, axis=1)
    assert tip.lines[0].get_ydata() == pytest.approx(distance)
    for axes, first in ((base, 0), (joints, 3)):
        for i, line in enumerate(axes.lines):
            assert np.asarray(line.get_ydata()) == pytest.approx(
                np.abs(tiago_run.log.e[:, first + i]), abs=2e-12
            )
    assert speeds.lines[0].get_ydata() == pytest.approx(tiago_run.nu[:, 0])
    for i, line in enumerate(rates.lines):
        assert line.get_ydata() == pytest.approx(tiago_run.nu[:, 2 + i])


def test_robot_without_an_arm(cart: Robot) -> None:
    run = short_run(cart, 0.5)
    assert run.log.ee.shape[1] == 0
    assert titles(run) == ["Paths", "Base error", "Base speeds", "Efforts without limits, N·m"]


def test_efforts_without_limits_are_grouped_by_unit(paper_run: Run) -> None:
    assert titles(unlimited(paper_run))[-4:-2] == [
        "Efforts without limits, N·m",
        "Efforts without limits, N",
    ]


def test_efforts_partly_limited(paper_run: Run) -> None:
    run = vary(paper_run, effort_limits=(10.0, np.inf, 5.0, np.inf))
    assert titles(run)[-5:-2] == [
        "Efforts, limits dashed",
        "Efforts without limits, N·m",
        "Efforts without limits, N",
    ]


def test_broken_limit_stays_within_the_panel(paper_run: Run) -> None:
    peak = np.abs(paper_run.tau).max(axis=0)
    axes = tracking_figure(vary(paper_run, effort_limits=tuple(0.5 * peak))).axes[-3]
    low, high = axes.get_ylim()
    share = paper_run.tau / (0.5 * peak)
    assert low < share.min()
    assert share.max() < high


def test_margins_are_drawn_with_their_limits(paper_run: Run) -> None:
    margin, slip = paper_run.log.tip_margin - 0.3, 0.5 * paper_run.log.slip_ratio
    run = vary(paper_run, tip_margin=margin, slip_ratio=slip)
    tip, grip = tracking_figure(run).axes[-2:]
    for axes, limit, values in ((tip, 0.0, margin), (grip, 1.0, slip)):
        dashed, line = axes.lines
        assert dashed.get_ydata() == [limit, limit]
        assert line.get_ydata() == pytest.approx(values)
        low, high = axes.get_ylim()
        assert low <= min(limit, values.min())
        assert high > max(limit, values.max())


def test_a_grip_beyond_all_bounds_keeps_the_limit_in_sight(paper_run: Run) -> None:
    axes = tracking_figure(vary(paper_run, slip_ratio=300.0 * paper_run.log.slip_ratio)).axes[-1]
    assert 1.0 < axes.get_ylim()[1] < 4.0


def test_a_grip_that_is_an_interval_is_a_band(paper_run: Run) -> None:
    slip = paper_run.log.slip_ratio
    run = vary(paper_run, slip_range=np.column_stack([0.5 * slip, 2.0 * slip]))
    (grip,) = tracking_figure(run, panels=["grip"]).axes
    (band,) = grip.collections
    edges = np.asarray(band.get_paths()[0].vertices)
    assert edges[:, 1].min() == pytest.approx(0.5 * slip.min())
    assert edges[:, 1].max() == pytest.approx(2.0 * slip.max())
    assert grip.lines[-1].get_ydata() == pytest.approx(slip)
    legend = grip.get_legend()
    assert legend is not None
    legend_texts = [text.get_text() for text in legend.get_texts()]
    assert legend_texts == ["all splits of the load", "equally stiff contacts"]
    endless = vary(run, slip_range=np.column_stack([slip, np.full_like(slip, np.inf)]))
    (grip,) = tracking_figure(endless, panels=["grip"]).axes
    assert grip.get_ylim()[1] == pytest.approx(1.12 * max(1.0, slip.max()))
    edges = np.asarray(grip.collections[0].get_paths()[0].vertices)
    assert edges[:, 1].max() == grip.get_ylim()[1]
    (plain,) = tracking_figure(paper_run, panels=["grip"]).axes
    assert not plain.collections


@pytest.mark.parametrize("name", cells(("tiago_dual", "panda"), (), ("tiago_dual", "panda")))
def test_many_joints_and_fixed_bases(name: str) -> None:
    robot = rpctl.load(name)
    run = short_run(robot, 0.2)
    figure = tracking_figure(run)
    (legend,) = figure.legends
    assert len(legend.get_texts()) == len(robot.actuators)
    looks = {
        (line.get_color(), line.get_linestyle(), tuple(line._dash_pattern[1] or ()))  # type: ignore[attr-defined]
        for line in legend.get_lines()
    }
    assert len(looks) == len(robot.actuators)
    assert len(tracking_image(run)) > 20_000


def test_perfect_and_shortest_runs(paper_run: Run) -> None:
    arrays = {k: v for k, v in vars(paper_run.log).items() if isinstance(v, np.ndarray)}
    first: dict[str, Any] = {name: array[:1] for name, array in arrays.items()}
    perfect = vary(paper_run, **{**first, "e": np.zeros_like(first["e"])})
    image = Image.open(io.BytesIO(tracking_image(perfect)))
    corner = image.convert("RGB").getpixel((2, 2))
    assert isinstance(corner, tuple)
    assert sum(corner) > 700


def test_robot_is_drawn_where_it_was(paper_run: Run) -> None:
    axes = tracking_figure(paper_run).axes[0]
    corners = np.array(paper_run.ground.points)
    x, y, cosine, sine = paper_run.q[0, :4]
    placed = [x, y] + corners @ np.array([[cosine, sine], [-sine, cosine]])
    drawn = axes.patches[0].get_xy()[:-1]  # type: ignore[attr-defined]
    assert np.array(sorted(drawn.tolist())) == pytest.approx(np.array(sorted(placed.tolist())))
    lines = [np.column_stack(line.get_data()) for line in axes.lines]
    tick = next(line for line in lines if len(line) == 2)
    assert tick[0] == pytest.approx(paper_run.log.base[0, :2])
    turn = np.arctan2(*(tick[1] - tick[0])[::-1])
    assert turn == pytest.approx(paper_run.log.base[0, 2])


@pytest.mark.slow
def test_pdf_is_made_of_lines_and_whole_letters(tiago_run: Run, tmp_path: Path) -> None:
    first, again = (
        save_figure(tiago_run, tmp_path / name, column=True).read_bytes()
        for name in ("a.pdf", "b.pdf")
    )
    assert first == again
    assert b"/FontFile2" in first
    assert b"/Type3" not in first
    assert b"/Subtype /Image" not in first
    assert f"/MediaBox [ 0 0 {88 / 25.4 * 72:.3f}".encode()[:22] in first


def test_panels_are_chosen_by_name(tiago_run: Run, tmp_path: Path) -> None:
    known = tuple(name for name in PANELS if name != "clearance")  # it comes near to nothing
    assert tuple(panel.name for panel, _ in find_panels(tiago_run)) == known
    figure = tracking_figure(tiago_run, panels=["tip", "base"])
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "(a)  End-effector error",
        "(b)  Base error",
    ]
    assert not figure.legends
    with pytest.raises(rpctl.RpctlError, match="did you mean paths"):
        save_figure(tiago_run, tmp_path / "a.pdf", panels=["pths"])
    with pytest.raises(rpctl.RpctlError, match=r"a\.svg.*\.pdf or \.png"):
        save_figure(tiago_run, tmp_path / "a.svg")


def test_steering_joints_are_base_speeds(paper_run: Run) -> None:
    steered = ("v", "front_steer_joint", *paper_run.robot.quasi_velocities[2:])
    speeds = tracking_figure(vary(paper_run, quasi_velocities=steered), panels=["speeds"]).axes[0]
    legend = speeds.get_legend()
    assert legend is not None
    legend_texts = [text.get_text() for text in legend.get_texts()]
    assert legend_texts == ["v, m/s", "front_steer, rad/s", "reference"]


def test_names_cannot_become_formulas(paper_run: Run) -> None:
    evil = (r"$\bad{$", *paper_run.robot.actuators[1:])
    assert len(tracking_image(vary(paper_run, actuators=evil))) > 20_000


def test_without_loads_there_are_no_margins(paper_run: Run) -> None:
    nothing = np.empty((len(paper_run.t), 0))
    run = vary(paper_run, tip_margin=nothing, slip_ratio=nothing, contact_points=())
    assert titles(run)[-1].startswith("Efforts")


def paths(run: Run) -> Any:
    figure = tracking_figure(run, panels=["paths"])
    figure.draw_without_rendering()
    return figure.axes[0]


def test_obstacles_near_the_paths_are_in_the_picture(paper_run: Run) -> None:
    near, far = rpctl.Disc(1.4, 1.2, 0.3), rpctl.Disc(60.0, 0.0, 1.0)
    axes = paths(
        with_obstacles(paper_run, near, far, rpctl.HalfPlane(0.0, 1.0, -1.2), tip=(PILLAR,))
    )
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert left < 1.1 < 1.7 < right < 20.0
    assert bottom < -1.2 < 1.5 < top
    radii = [patch.radius for patch in axes.artists + axes.patches if hasattr(patch, "radius")]
    reach = np.linalg.norm(np.array(paper_run.ground.points) - paper_run.robot.drive.point, axis=1)
    grown = 0.3 + reach.max(), 1.0 + reach.max(), PILLAR.radius + 0.05
    assert sorted(radii) == pytest.approx(sorted([0.3, 1.0, PILLAR.radius, *grown]))
    levels = [line.get_ydata() for line in axes.lines if len(line.get_ydata()) == 2]
    assert any(np.allclose(level, reach.max() - 1.2) for level in levels)
    labels = axes.get_legend_handles_labels()[1]
    assert labels[-3:-1] == ["obstacle of the base", "obstacle of the end effector"]


def test_paths_stay_in_view_where_obstacles_are_far_or_none(paper_run: Run) -> None:
    far = paths(with_obstacles(paper_run, rpctl.Disc(60.0, 0.0, 1.0)))
    np.testing.assert_array_equal(far.dataLim.get_points(), paths(paper_run).dataLim.get_points())
    assert "obstacle of the base" not in paths(paper_run).get_legend_handles_labels()[1]


@pytest.mark.parametrize("normal", [(0.0, 1.0), (3.0, -4.0), (-1.0, 0.5)])
def test_half_plane_is_hatched_beyond_its_line(normal: tuple[float, float]) -> None:
    plane = rpctl.HalfPlane(*normal, 0.7)
    corners = half_plane(plane, np.array([2.0, -1.0]), 30.0)
    assert plane.distance(corners) == pytest.approx([0.0, 0.0, -30.0, -30.0])
    assert np.linalg.norm(corners[0] - corners[1]) == pytest.approx(60.0)


def test_figure_of_a_long_run_is_of_some_samples(
    paper_run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = len(paper_run.t)
    monkeypatch.setattr(style, "MAX_POINTS", count - 1)
    run = style.sampled(paper_run)
    np.testing.assert_array_equal(run.t, paper_run.t[::2])
    np.testing.assert_array_equal(run.log.contact_load, paper_run.log.contact_load[::2])
    assert run.log.bound_limits == paper_run.log.bound_limits
    monkeypatch.setattr(style, "MAX_POINTS", count)
    assert style.sampled(paper_run) is paper_run
