"""The picture of a benchmark: whose errors are where, in mm."""

from __future__ import annotations

from typing import Any

import pytest
from matplotlib.colors import to_hex

from rpctl.simulation.config import RunSettings
from rpctl.study.cells import Figures, Row
from rpctl.study.compare import PAPER, PROPOSED, CompareCell, CompareRow, LawPair
from rpctl.view.plots import style
from rpctl.view.plots.study import GREY, study_figure

OTHERS = LawPair("a_law_of_somebody_with_a_very_long_name", "paper")


def row(
    place: str, law: LawPair, base: float | None, tip: float | None, *broken: str
) -> CompareRow:
    scenario, reference = place.split()
    outcome = "refused" if base is None else "tracked"
    figures = Figures(outcome, rms_base=base, rms_end_effector=tip, violations=broken)
    return Row(CompareCell(scenario, law, RunSettings(reference)), figures)


def test_picture_of_a_benchmark() -> None:
    """Errors are drawn in mm: a dot for the base, a ring for the end effector, a line a law."""
    rows = [
        row("nominal line", PAPER, 0.004, 0.02),
        row("nominal line", PROPOSED, 0.002, 0.01, "a upper"),
        row("nominal line", OTHERS, 0.003, None),
        row("nominal spin", PAPER, None, None),
        row("delay line", PAPER, 0.04, 0.08),
    ]
    figure = study_figure(rows, "a robot", PROPOSED)
    line, spin, delayed, empty = figure.axes
    assert [axes.get_title() for axes in figure.axes] == ["line", "spin", "", ""]
    assert [axes.get_ylabel() for axes in figure.axes] == ["nominal", "", "delay", ""]
    assert line.get_xlim() == delayed.get_xlim() and line.get_xscale() == "linear"
    assert -10.0 < line.get_xlim()[0] < 0.0 < 80.0 < line.get_xlim()[1]  # mm, from zero on
    assert study_figure(rows, "a robot", PROPOSED, log=True).axes[0].get_xscale() == "log"
    assert line.yaxis_inverted()  # the first law at the top

    def marks(axes: Any) -> list[Any]:
        return [
            (each.get_marker(), to_hex(each.get_markeredgecolor()), list(each.get_xdata()),
             each.get_ydata()[0])
            for each in axes.lines if each.get_marker() != "None"
        ]  # fmt: skip

    tip, base = style.TIP.lower(), style.BASE.lower()
    assert marks(line) == [
        ("o", tip, pytest.approx([20.0]), 0), ("o", tip, pytest.approx([4.0]), 0),
        ("o", base, pytest.approx([10.0]), 1), ("o", base, pytest.approx([2.0]), 1),
        ("^", style.INK, [0.05], 1), ("o", GREY, pytest.approx([3.0]), 2),
    ]  # fmt: skip
    assert marks(spin) == [("x", GREY, [0.95], 0)]
    assert not empty.lines


def test_names_of_laws_are_whole() -> None:
    figure = study_figure([row("nominal line", OTHERS, 0.004, 0.02)], "a robot", PROPOSED)
    figure.draw_without_rendering()
    (name,) = figure.axes[0].get_yticklabels()
    box = name.get_window_extent()
    assert name.get_text() == str(OTHERS) and box.x0 >= 0
    assert box.x1 <= figure.axes[0].get_window_extent().x0
