"""The picture of a battery says what the report says."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Rectangle

from rpctl.study.stress_report import VERDICTS, report_of
from rpctl.view.plots.stress import FILLS, SIGNS, stress_figure
from tests.study.stress_samples import GOOD, battery, made_up


def picture(**more: Any) -> tuple[Any, Any]:
    found = battery(**more)
    report = report_of(found, {cell.key: made_up(cell.key) for cell in found.cells}, 0.01)
    return report, stress_figure(report)


def test_each_run_is_a_box_of_its_verdict() -> None:
    report, figure = picture(laws=3)
    panel, key = figure.axes
    boxes = Counter(to_rgb(box.get_facecolor()) for box in panel.patches)
    shown = [
        report.row("rolling", law, stress, level).verdict.name
        for law in report.battery.laws
        for stress in report.battery.stresses_on("rolling")
        for level in stress.levels
    ]
    assert boxes == Counter(to_rgb(FILLS[name]) for name in shown)
    texts = [text.get_text() for text in panel.texts]
    fails = [text for text in texts if text.startswith(SIGNS["fail"])]
    assert len(fails) == shown.count("fail")
    assert {"payload, kg", "slope-across, deg", "unified+integral", "paper+paper"} <= {*texts}
    assert "friction" not in texts  # no plant of the battery has it
    assert {text.get_text() for text in key.texts} >= {"passes", "degrades", "fails"}


def test_boxes_lie_in_the_panel_and_apart() -> None:
    _, figure = picture(laws=3, combinations=9)
    panel = figure.axes[0]
    corners = [box.get_bbox().extents for box in panel.patches if isinstance(box, Rectangle)]
    low, high = np.min(corners, axis=0)[:2], np.max(corners, axis=0)[2:]
    assert (low >= -1e-9).all()
    assert (high <= np.array([panel.get_xlim()[1], panel.get_ylim()[0]]) + 1e-9).all()
    for i, (left, top, right, bottom) in enumerate(corners):
        for x, y, end, floor in corners[:i]:
            apart = min(right, end) - max(left, x), min(bottom, floor) - max(top, y)
            assert min(apart) < 1e-9


def test_pairs_are_bars_of_how_many() -> None:
    report, figure = picture(laws=1, combinations=12)
    (law,) = report.battery.laws
    counts = Counter(row.verdict.name for row in report.combined("rolling", law))
    last = max(box.get_y() for box in figure.axes[0].patches)
    bars = [box for box in figure.axes[0].patches if box.get_y() == last]
    widths = [bar.get_width() for bar in bars]
    np.testing.assert_allclose(
        np.divide(widths, sum(widths)), [counts[name] / 12 for name in VERDICTS if counts[name]]
    )


def test_verdicts_are_told_apart_without_colour() -> None:
    lightness = [np.dot(to_rgb(FILLS[name]), (0.2126, 0.7152, 0.0722)) for name in VERDICTS]
    assert all(lighter - darker > 0.2 for lighter, darker in pairwise(lightness))


def test_a_plant_without_a_stress_says_why() -> None:
    found = replace(battery("payload", "friction", laws=1), plants=("rolling", "slipping"))
    report = report_of(found, {cell.key: made_up(cell.key) for cell in found.cells}, 0.01)
    rolling, slipping, _ = stress_figure(report).axes
    why = "– its wheels cannot slip"
    assert why in [text.get_text() for text in rolling.texts]
    assert why not in [text.get_text() for text in slipping.texts]
    assert len(slipping.patches) == len(rolling.patches) + 5


def test_wheels_that_hang_are_told_above_the_key() -> None:
    found = battery("radius", laws=1)
    low = {cell.key for cell in found.cells if sum(dict(cell.levels).values()) < 0.0}
    figures = {
        cell.key: replace(GOOD, hanging_wheels=("wheel",) if cell.key in low else ())
        for cell in found.cells
    }
    figure = stress_figure(report_of(found, figures, 0.01))
    (note,) = [text for text in figure.texts if text.get_text().startswith("rolling plant, ")]
    assert "radius -3, -2, -1 %: wheel bear nothing" in note.get_text()
    panel, key = (axes.get_position() for axes in figure.axes)
    boxes = key.y1 - 0.14 / figure.get_size_inches()[1]  # tops of those of the key
    assert boxes < note.get_position()[1] < panel.y0
