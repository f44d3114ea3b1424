"""The picture of a benchmark: whose errors are where, in mm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

from rpctl.study.compare import PAPER, PROPOSED, Cell, Figures, LawPair, Row
from rpctl.view.plots import style
from rpctl.view.plots.study import GREY, study_figure

OTHERS = LawPair("kanayama", "paper")


def figures(base: float, tip: float | None, *broken: str) -> Figures:
    return Figures(base, 9.0, 9.0, tip, 9.0, 0.5, 0.1, broken, 1e-5, 1e-4, "tracked")


def test_picture_of_a_benchmark() -> None:
    """Errors are drawn in mm: a dot for the base, a ring for the end effector, a line a law."""
    rows = [
        Row(Cell("nominal", "line", PAPER), figures(0.004, 0.02), None),
        Row(Cell("nominal", "line", PROPOSED), figures(0.002, 0.01, "a upper"), None),
        Row(Cell("nominal", "line", OTHERS), figures(0.003, None), None),
        Row(Cell("nominal", "spin", PAPER), None, "it cannot"),
        Row(Cell("nominal", "spin", PROPOSED), figures(0.0005, 0.05), None),
        Row(Cell("delay", "line", PAPER), figures(0.04, 0.08), None),
    ]
    figure = study_figure(rows, "a robot", PROPOSED)
    line, spin, delayed, empty = figure.axes
    assert [axes.get_title() for axes in figure.axes] == ["line", "spin", "", ""]
    for axes, low, high in (
        (line, 2.0, 80.0), (spin, 0.5, 50.0), (delayed, 2.0, 80.0), (empty, 0.5, 50.0)
    ):  # fmt: skip
        assert axes.get_xlim() == pytest.approx((low / 1.6, high * 1.6))
        assert axes.get_ylim() == (3.0, -1.0)  # the first law at the top
        assert axes.get_xscale() == "log"

    def marks(axes: Any) -> list[Any]:
        return [
            (
                each.get_marker(),
                to_hex(each.get_color()),
                list(each.get_xdata()),
                each.get_ydata()[0],
            )
            for each in axes.lines
        ]

    tip, base, grey = style.TIP.lower(), style.BASE.lower(), GREY
    drawn: list[Any] = marks(line)
    assert ("None", tip, pytest.approx([4.0, 20.0]), 0) in drawn
    assert ("o", tip, pytest.approx([4.0]), 0) in drawn
    assert ("None", base, pytest.approx([2.0, 10.0]), 1) in drawn
    assert ("o", base, pytest.approx([2.0]), 1) in drawn
    assert ("o", grey, pytest.approx([3.0]), 2) in drawn
    rings: list[Any] = [
        (to_hex(each.get_markeredgecolor()), *np.concatenate(each.get_data()))
        for each in line.lines
        if each.get_marker() == "o" and to_hex(each.get_markerfacecolor()) == style.PAPER
    ]
    assert rings == [(tip, pytest.approx(20.0), 0), (base, pytest.approx(10.0), 1)]
    broken = [mark for mark in drawn if mark[0] == "^"]
    assert broken == [("^", style.INK, pytest.approx([2.0 / 1.6 * 1.6**0.35]), 1)]
    (failed,) = (mark for mark in marks(spin) if mark[0] == "x")
    assert failed[2:] == (pytest.approx([80.0 / 1.6**0.35]), 0)
    assert not empty.lines
    assert [each.get_text() for each in line.texts] == [
        str(PAPER),
        str(PROPOSED),
        str(OTHERS),
        "nominal",
    ]
    assert [each.get_text() for each in delayed.texts][-1] == "delay"
    texts = [each.get_text() for each in figure.texts]
    assert texts == ["rms error, mm (logarithmic)", "a robot"]
    (named,) = figure.legends
    assert [each.get_text() for each in named.get_texts()] == [
        f"{PROPOSED} (rpctl's)", f"{PAPER} (the paper's)", "others", "base", "end effector",
        "did not run", "broke a limit",
    ]  # fmt: skip


def test_panels_of_a_benchmark_do_not_overlap() -> None:
    """Scenarios go down, references to the right; the ticks are told below the last row."""
    rows = [
        Row(Cell(scenario, reference, PROPOSED), figures(0.001, 0.1), None)
        for scenario in ("nominal", "delay") for reference in ("line", "spin")
    ]  # fmt: skip
    figure = study_figure(rows, "a robot", PROPOSED)
    boxes = [axes.get_position() for axes in figure.axes]
    for box in boxes:
        assert 0.0 < box.x0 < box.x1 < 1.0
        assert 0.0 < box.y0 < box.y1 < 1.0
    (a, b, c, d) = boxes
    assert a.x1 < b.x0
    assert c.y1 < a.y0
    assert (a.y0, c.x0) == pytest.approx((b.y0, a.x0))
    assert d.y1 - d.y0 == pytest.approx(a.y1 - a.y0)
    caption, title = (text.get_position() for text in figure.texts)
    assert caption[0] == pytest.approx(0.5 * (a.x0 + b.x1), abs=0.01)
    assert 0.0 < caption[1] < c.y0
    assert 0.0 < title[0] < a.x0
    assert a.y1 < title[1] < 1.0
    figure.draw_without_rendering()
    labels = [
        [t.get_text() for t in axes.get_xticklabels() if t.get_text()] for axes in figure.axes
    ]
    assert labels[0] == labels[1] == []
    assert {"1", "10", "100"} <= set(labels[2])
    assert "3" not in labels[2]  # a wide axis: of 1, 10 and 100 only
    close = [Row(Cell("nominal", "line", PROPOSED), figures(0.002, 0.004), None)]
    axes = study_figure(close, "a robot", PROPOSED).axes[0]
    axes.figure.draw_without_rendering()  # type: ignore[union-attr]
    assert "3" in [text.get_text() for text in axes.get_xticklabels()]
    apart = [Row(Cell("nominal", "line", PROPOSED), figures(0.00016, 0.005), None)]  # 0.1 to 8 mm
    axes = study_figure(apart, "a robot", PROPOSED).axes[0]
    axes.figure.draw_without_rendering()  # type: ignore[union-attr]
    assert "3" not in [text.get_text() for text in axes.get_xticklabels()]
    nothing = [Row(Cell("nominal", "line", PROPOSED), None, "it cannot")]
    assert study_figure(nothing, "a robot", PROPOSED).axes[0].get_xlim() == (1.0, 10.0)


@pytest.mark.parametrize("references", [1, 2, 8])
def test_names_of_laws_and_the_legend_are_whole(references: int) -> None:
    long = LawPair("a_law_of_somebody_with_a_very_long_name", "and_another_one_for_the_dynamics")
    rows = [
        Row(Cell("nominal", f"path {k}", law), figures(0.004, 0.02), None)
        for k in range(references)
        for law in (PAPER, PROPOSED, long)
    ]
    figure = study_figure(rows, "a robot", PROPOSED)
    figure.draw_without_rendering()
    width, height = figure.get_size_inches() * figure.dpi
    (legend,) = figure.legends
    names = [text for axes in figure.axes for text in axes.texts]
    assert str(long) in [name.get_text() for name in names]
    for box in (legend.get_window_extent(), *(name.get_window_extent() for name in names)):
        assert 0 <= box.x0 < box.x1 <= width
        assert 0 <= box.y0 < box.y1 <= height
    (label,) = (text for text in figure.texts if text.get_text().startswith("rms error"))
    assert label.get_window_extent().y0 >= legend.get_window_extent().y1
