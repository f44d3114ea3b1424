"""The plane from above, of a run that is known on paper: paths, poses, and obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

import rpctl
from rpctl import Run
from rpctl.view.plots import style
from tests.golden import COUNT
from tests.runs import vary
from tests.view.readers import curves, labelled, panel
from tests.view.samples import with_obstacles


def test_paths_are_drawn_from_where_the_robot_was(golden: Run) -> None:
    axes = panel(golden, "paths")
    drawn = labelled(axes)
    assert drawn["base"] == pytest.approx(golden.log.base[:, :2])
    assert drawn["end effector"] == pytest.approx(golden.log.ee[:, :2])
    assert drawn["desired"] == pytest.approx(golden.base_ref[:, :2])
    base, tip = curves(axes, style.DESIRED)
    assert base == pytest.approx(golden.base_ref[:, :2])
    assert tip == pytest.approx(golden.log.ee_ref[:, :2])
    (base,) = curves(axes, style.BASE)
    assert base == pytest.approx(golden.log.base[:, :2])
    (tip,) = curves(axes, style.TIP)
    assert tip == pytest.approx(golden.log.ee[:, :2])
    starts = {
        line.get_markeredgecolor(): np.column_stack(line.get_data())
        for line in axes.lines
        if line.get_marker() == "o" and np.size(line.get_xdata())
    }
    assert starts[style.BASE] == pytest.approx(golden.log.base[:1, :2])
    assert starts[style.TIP] == pytest.approx(golden.log.ee[:1, :2])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x, m", "y, m")
    assert axes.get_aspect() == 1.0


def straight(golden: Run, length: float) -> Run:
    """Return the run of a robot that goes straight up y, its forward direction to the right."""
    k = np.arange(COUNT) / (COUNT - 1)
    root = np.column_stack([np.full(COUNT, 2.0), length * k, np.zeros(COUNT), np.ones(COUNT)])
    q = np.hstack([root, golden.q[:, 4:]])
    base = np.column_stack([root[:, 0], root[:, 1] - 0.1, np.full(COUNT, np.arctan2(0.8, 0.6))])
    return vary(golden, q=q, base=base)


def test_robot_is_drawn_along_its_own_path(golden: Run) -> None:
    """Its contacts are 0.8 m apart; it goes 2 m in 0.5 s, and may be drawn every 0.96 m."""
    askew = ((0.7, 0.1), (-0.1, 0.3), (-0.1, -0.3))  # no mirror image of itself
    axes = panel(vary(straight(golden, 2.0), contact_points=askew), "paths")
    ticks = [c for c in curves(axes, style.INK) if len(c) == 2]
    starts = [2.0 * t / 0.5 - 0.1 for t in (0.0, 0.3, 0.5)]  # every 0.25 s, at the next sample
    assert [tick[0].tolist() for tick in ticks] == [pytest.approx([2.0, y]) for y in starts]
    for tick in ticks:
        assert tick[1] - tick[0] == pytest.approx([0.4 * 0.8 * 0.6, 0.4 * 0.8 * 0.8])
    outlines = [patch.get_xy()[:-1] for patch in axes.patches if len(patch.get_xy())]  # type: ignore[attr-defined]
    assert len(outlines) == 2 * 3  # filled and edged
    for filled, edged, y in zip(outlines[0:6:2], outlines[1:6:2], (0.0, 1.2, 2.0), strict=True):
        corners = {(1.9, y + 0.7), (1.7, y - 0.1), (2.3, y - 0.1)}
        assert {tuple(np.round(c, 9)) for c in filled} == {tuple(np.round(c, 9)) for c in corners}
        assert filled == pytest.approx(edged)
    named = axes.get_legend_handles_labels()[1]
    assert named == [
        "base",
        "end effector",
        "desired",
        "start",
        "contacts and heading, every 0.25 s",
    ]


def test_obstacles_and_how_near_each_body_may_come(golden: Run) -> None:
    """The base reaches as far as its contacts lie from P: to the front wheel, 0.8 m."""
    column, wall = rpctl.Disc(1.0, -0.75, 0.25), rpctl.HalfPlane(0.0, 2.0, -1.0)  # y ≥ −1
    post = rpctl.Disc(0.5, 1.5, 0.125)
    axes = panel(with_obstacles(golden, column, wall, tip=(post,)), "paths")
    drawn: list[Any] = [*axes.patches, *axes.artists]
    circles = [
        (*patch.center, patch.radius, to_hex(patch.get_edgecolor()), patch.get_fill())
        for patch in drawn
        if hasattr(patch, "radius")
    ]
    base, tip = style.BASE_OBSTACLE, style.TIP_OBSTACLE
    assert circles == [
        (1.0, -0.75, 0.25, base, True),
        (1.0, -0.75, pytest.approx(0.25 + 0.8), base, False),
        (0.5, 1.5, 0.125, tip, True),
        (0.5, 1.5, pytest.approx(0.125 + 0.05), tip, False),
    ]
    (kept,) = curves(axes, base)
    assert kept[:, 1] == pytest.approx([-1.0 + 0.8] * 2)
    figure = axes.figure
    figure.draw_without_rendering()  # type: ignore[union-attr]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    assert left < 0.375
    assert right > 1.25
    assert bottom < -1.0
    assert top > 1.625
