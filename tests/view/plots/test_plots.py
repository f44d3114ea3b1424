from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rpctl
from rpctl import Run
from rpctl.view.charts import PANELS
from rpctl.view.plots import style
from rpctl.view.plots.figures import (
    find_panels,
    save_figure,
    tracking_figure,
    tracking_image,
)
from tests.grids import cells
from tests.runs import vary
from tests.view.samples import short_run


def titles(run: Run) -> list[str]:
    return [axes.get_title(loc="left").partition(")  ")[2] for axes in tracking_figure(run).axes]


def test_all_panels_of_a_mobile_manipulator(paper_run: Run) -> None:
    assert titles(paper_run) == [
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


@pytest.mark.parametrize("name", cells(("tiago_dual", "panda", "arm"), (), ("arm",)))
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


@pytest.mark.slow
def test_pdf_is_made_of_lines_and_whole_letters(paper_run: Run, tmp_path: Path) -> None:
    first, again = (
        save_figure(paper_run, tmp_path / name, column=True).read_bytes()
        for name in ("a.pdf", "b.pdf")
    )
    assert first == again
    assert b"/FontFile2" in first
    assert b"/Type3" not in first
    assert b"/Subtype /Image" not in first
    assert f"/MediaBox [ 0 0 {88 / 25.4 * 72:.3f}".encode()[:22] in first


def test_panels_are_chosen_by_name(paper_run: Run, tmp_path: Path) -> None:
    # It comes near to nothing, and does not lean.
    known = tuple(name for name in PANELS if name not in ("clearance", "tilt"))
    assert tuple(panel.name for panel, _ in find_panels(paper_run)) == known
    figure = tracking_figure(paper_run, panels=["tip", "base"])
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "(a)  End-effector error",
        "(b)  Base error",
    ]
    assert not figure.legends
    with pytest.raises(rpctl.RpctlError, match="did you mean paths"):
        save_figure(paper_run, tmp_path / "a.pdf", panels=["pths"])
    with pytest.raises(rpctl.RpctlError, match=r"a\.svg.*\.pdf or \.png"):
        save_figure(paper_run, tmp_path / "a.svg")


def test_names_cannot_become_formulas(paper_run: Run) -> None:
    evil = (r"$\bad{$", *paper_run.robot.actuators[1:])
    figure = tracking_figure(vary(paper_run, actuators=evil))
    figure.draw_without_rendering()
    assert "bad" in figure.legends[0].get_texts()[0].get_text()


def paths(run: Run) -> Any:
    figure = tracking_figure(run, panels=["paths"])
    figure.draw_without_rendering()
    return figure.axes[0]


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
