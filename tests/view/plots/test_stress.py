"""The picture of a battery says what the report says."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from rpctl.study.stress_report import VERDICTS, report_of
from rpctl.view.plots.stress import FILLS, SIGNS, stress_figure
from tests.study.stress_samples import GOOD, battery, made_up


def picture(**more: Any) -> tuple[Any, Any]:
    found = battery(**more)
    report = report_of(found, {cell.key: made_up(cell.key) for cell in found.cells}, 0.01)
    return report, stress_figure(report)


def test_each_run_is_a_box_of_its_verdict() -> None:
    report, figure = picture(laws=3)
    (panel,) = figure.axes
    boxes = Counter(to_rgb(box.get_facecolor()) for box in panel.patches)
    shown = [
        report.row("rolling", law, stress, level).verdict.name
        for law in report.battery.laws
        for stress in report.battery.stresses_on("rolling")
        for level in stress.levels
    ]
    assert boxes == Counter(to_rgb(FILLS[name]) for name in shown)
    fails = [text for text in panel.texts if text.get_text().startswith(SIGNS["fail"])]
    assert len(fails) == shown.count("fail")
    names = {label.get_text() for label in panel.get_yticklabels()}
    assert {"payload, kg", "slope-across, deg", "unified+integral", "paper+paper"} <= names
    assert "friction" not in names  # no plant of the battery has it


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
    rolling, slipping = stress_figure(report).axes
    why = "– its wheels cannot slip"
    assert why in [text.get_text() for text in rolling.texts]
    assert why not in [text.get_text() for text in slipping.texts]
    assert len(slipping.patches) == len(rolling.patches) + 5


def test_wheels_that_hang_are_told() -> None:
    found = battery("radius", laws=1)
    hangs = replace(GOOD, hanging_wheels=("wheel",))
    figures = {c.key: hangs if sum(dict(c.levels).values()) < 0.0 else GOOD for c in found.cells}
    figure = stress_figure(report_of(found, figures, 0.01))
    (legend,) = figure.legends
    assert "radius -3, -2, -1 %: wheel carry no load" in legend.get_title().get_text()
