"""The report of a study: what its charts and tables say is what the runs were."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import rpctl
from rpctl.arrays import Array
from rpctl.study.experiment import Design, RunTable
from rpctl.study.merits import Unit, number
from rpctl.study.optimise import BETTER, UNCLEAR, WORSE, optimum_sentence
from rpctl.study.statistics import (
    Interval,
    ParameterMap,
    Sensitivity,
    describe,
    parameter_map,
    share,
)
from rpctl.study.study import run_study
from rpctl.study.study_file import read_study
from rpctl.study.study_result import StudyResult, WorstRun
from rpctl.view.pages import study
from rpctl.view.pages.report import report_policy
from rpctl.view.plots import style
from rpctl.view.plots.study_runs import (
    draw_distribution,
    draw_envelope,
    draw_importance,
    draw_map,
    span_of,
    study_runs_figure,
)
from tests.view.chromium import chromium

HOSTILE = "plant.<script>alert(1)</script>"


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.01234, Unit(1e3, "mm"), "12.3 mm"),
        (-2.0, Unit(1.0, ""), "−2"),
        (123456.0, Unit(1.0, "J"), "123456 J"),
        (math.inf, Unit(1e3, "mm"), "∞"),
        (math.nan, Unit(1e3, "mm"), "–"),
    ],
)
def test_numbers(value: float, unit: Unit, text: str) -> None:
    assert number(value, unit) == text


def test_axes() -> None:
    """They are linear unless a logarithm is asked for and has positive values; 32 bins."""
    values = np.array([1.0, 100.0, np.nan])
    linear, log = span_of(np.array([0.0, 25.0, np.inf])), span_of(values, log=True)
    assert span_of(values).scale == span_of(np.array([-1.0, 9.0]), log=True).scale == "linear"
    assert span_of(np.zeros(3), log=True).scale == "linear"
    assert (linear.low, linear.high, linear.scale) == (0.0, 26.0, "linear")
    assert (log.low, log.high, log.scale) == pytest.approx((1.0 / 1.15, 115.0, "log"))
    assert linear.edges()[16] == pytest.approx(13.0)
    assert log.edges()[16] == pytest.approx(10.0)
    assert len(log.edges()) == 33


def axes_of(draw: Callable[..., object], *given: Any) -> Any:
    """Return what is drawn."""
    axes = Figure().add_subplot()
    draw(*given, axes)
    return axes


def test_the_median_of_an_envelope_is_that_of_all_runs() -> None:
    axes = axes_of(draw_envelope, result(), "base_error")
    (median,) = axes.lines
    values = np.sort(1e3 * result().runs.series["base_error"][:, 0])
    assert axes.get_ylabel() == "error (mm)"
    assert values[18] < median.get_ydata()[0] < values[21]  # of 40 runs
    outer, inner = (np.ptp(band.get_paths()[0].vertices[:, 1]) for band in axes.collections)
    assert 0.0 < inner < outer


def test_histograms_stack_runs_that_failed_on_those_that_did_not() -> None:
    values, good = (
        np.array([1.0, 1.0, 1.0, 2.0, np.inf]),
        np.array([True, True, False, False, False]),
    )
    runs = replace(result().runs, merits={"work": values})
    axes = axes_of(
        draw_distribution, result(runs=runs, succeeded=good, units={"work": "J"}), "work"
    )
    done, failed = ([bar.get_height() for bar in bars] for bars in axes.containers)
    assert (sum(done), sum(failed), max(done), max(failed)) == (2, 2, 2, 1)
    tops = [bar.get_y() for bar in axes.containers[1]]
    assert tops == done
    assert axes.lines[0].get_xdata() == [1.0, 1.0]
    for same, told in ((-0.18, "−0.18 J in 5 of 5 runs"), (np.inf, "no value in 0 of 5 runs")):
        runs = replace(runs, merits={"work": np.full(5, same)})
        made = result(runs=runs, succeeded=good, units={"work": "J"})
        assert axes_of(draw_distribution, made, "work").texts[0].get_text() == told


def test_outliers_leave_room_for_the_others_on_a_linear_axis() -> None:
    """Of 0.01, 0.02 ... 0.99 and 50 m, 95 % are below 0.96 m: it ends before 3 m, with a bar."""
    values = np.append(np.linspace(0.01, 0.99, 99), 50.0)
    runs = replace(result().runs, merits={"rms_base_error": values})
    made = result(runs=runs, succeeded=np.ones(100, bool))
    plain, log = (
        axes_of(partial(draw_distribution, log=log), made, "rms_base_error")
        for log in (False, True)
    )
    bars = [bar.get_height() for bar in plain.containers[0]]
    assert (sum(bars), bars[-1]) == (100, 1) and sum(bar > 0 for bar in bars) > 9
    assert plain.get_xlim()[1] < 3e3 and plain.get_xlabel().endswith("; the last bar: all beyond")
    assert (plain.get_xscale(), log.get_xscale()) == ("linear", "log")
    assert log.get_xlim()[1] > 50.0 and "beyond" not in log.get_xlabel()


def test_bars_and_their_intervals() -> None:
    found = result().sensitivities[0]
    axes = axes_of(draw_importance, result(), found)
    assert [bar.get_width() for bar in axes.patches] == [0.8, 0.6]
    assert [to_hex(bar.get_facecolor()) for bar in axes.patches] == [
        style.BASE.lower(), style.TIP.lower()]  # fmt: skip
    whiskers = axes.collections[0].get_segments()
    assert [line[:, 0].tolist() for line in whiskers] == [
        pytest.approx([0.7, 0.9]), pytest.approx([0.5, 0.7])]  # fmt: skip
    assert axes.get_xlim() == (-1.0, 1.0)


def test_a_map_shows_medians_in_the_unit_of_its_scale() -> None:
    found = ParameterMap(
        "rms_base_error", "p", "q", np.array([0.0, 1.0, 3.0]), np.array([0.0, 1.0]),
        np.array([[0.01, np.inf]]), np.array([[7, 9]]),
    )  # fmt: skip
    axes = axes_of(draw_map, result(maps=(found,)))
    assert axes.collections[0].get_array().tolist() == [[10.0, pytest.approx(10.0)]]
    assert axes.figure.axes[1].get_ylabel() == "base error, rms (mm)"


RUNS, TIMES = 40, 5


def result(folder: Path = Path(), **changes: Any) -> StudyResult:
    """Return a study of 40 runs, of which 30 succeed and one has no merit."""
    rng = np.random.default_rng(5)
    parameters: Mapping[str, Array] = {HOSTILE: rng.uniform(size=RUNS), "b": rng.normal(size=RUNS)}
    values = np.append(np.linspace(0.01, 0.4, RUNS - 1), np.inf)
    good = np.arange(RUNS) < 30
    series = np.outer(values, np.linspace(1.0, 0.1, TIMES)).astype(np.float32)
    runs = RunTable(
        np.arange(RUNS), parameters, {"rms_base_error": values}, {"base_error": series},
        np.linspace(0.0, 1.0, TIMES), tuple(np.where(good, "tracked", "away").tolist()),
        ("",) * RUNS,
    )  # fmt: skip
    intervals = (Interval(0.8, 0.7, 0.9), Interval(-0.1, -0.4, 0.2))
    other = (Interval(0.3, 0.1, 0.4), Interval(0.6, 0.5, 0.7))
    found = Sensitivity("rms_base_error", "rank-correlation", tuple(parameters),
                        {"rank_correlation": intervals, "from_middle": other}, 1)  # fmt: skip
    x, y = parameters.values()
    made = StudyResult(
        folder, "a <robot>", runs, good, "rms_base_error", {"rms_base_error": "m"},
        Design("monte-carlo", RUNS, 3), {HOSTILE: {"normal": [0.0, 1.0, -math.inf, math.inf]}},
        share(30, RUNS), (describe("rms_base_error", values),), (found,),
        (parameter_map("rms_base_error", (HOSTILE, "b"), x, y, values, 2),),
        (WorstRun(39, math.inf, "diverging", "it <left>", "worst-1.toml", "rpctl track x"),),
        None, {"identity": {"versions": {"numpy": "1"}}},
    )  # fmt: skip
    return replace(made, **changes)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let pages hold no figures, which take their time."""
    monkeypatch.setattr(study, "svg_address", lambda figure: "data:,")


@pytest.mark.usefixtures("undrawn")
def test_the_page_says_what_the_study_found() -> None:
    page = study.study_page(result()).decode()
    found = result().statistics[0].quantiles
    for text in (
        ">75 %<",
        ">58.8 to 87.3 %<",
        number(found[0.5].value, Unit(1e3, "mm")),
        "40 runs · 1 setting differs · monte-carlo, seed 3",
        "<b>Run 39</b>",
        "<code>rpctl track x</code>",
        "normal, 0 ± 1<",
    ):
        assert text in page, text
    assert "<script" not in page
    assert "it &lt;left&gt;" in page
    assert "script-src 'none'" in page
    assert "&lt;script&gt;" in page


OPTIMUM: dict[str, Any] = {
    "merit": "rms_base_error",
    "statistic": "quantile",
    "level": 0.95,
    "failure_weight": 1.0,
    "settings": {"kinematic.horizon": {"before": 0.5, "after": 0.25, "range": [0.1, 1.0]}},
    "validation": {
        "runs": 50,
        "before": {"cost": 0.02, "success": {"value": 1.0}},
        "after": {"cost": 0.015, "success": {"value": 1.0}},
        "change": {"value": -0.005, "low": -0.007, "high": -0.004},
    },
}


def test_a_sentence_says_whether_settings_are_better() -> None:
    assert optimum_sentence(OPTIMUM)[1] == (
        "better: 95 % quantile of base error, rms goes from 20 mm to 15 mm on 50 fresh runs, −25 % "
        "(95 % interval −35 to −20 %)"
    )
    for low, high, verdict in ((-0.01, 0.01, UNCLEAR), (0.001, 0.002, WORSE), (-2, -1, BETTER)):
        change = {"value": 0.5 * (low + high), "low": low, "high": high}
        changed = {**OPTIMUM, "validation": {**OPTIMUM["validation"], "change": change}}
        assert optimum_sentence(changed)[0] == verdict


@pytest.mark.usefixtures("undrawn")
def test_the_page_shows_settings_that_were_found() -> None:
    page = study.study_page(result(optimum=OPTIMUM)).decode()
    assert ">kinematic horizon (s)</th><td>0.5</td><td>0.25</td><td>0.1 to 1</td>" in page
    assert f"<p>B{optimum_sentence(OPTIMUM)[1][1:]}</p>" in page


@pytest.mark.usefixtures("undrawn")
def test_a_study_of_one_setting_and_one_kind_of_run_has_a_page() -> None:
    bare = result(maps=(), sensitivities=(), worst=())
    page = study.study_page(bare).decode()
    assert "Influence on each merit" not in page
    assert "Worst runs" not in page


@pytest.mark.usefixtures("undrawn")
def test_the_worst_run_is_animated_in_a_frame_that_may_run_its_scripts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(study, "worst_scene", lambda worst, robot: ("a", "b"))
    page = study.study_page(result(), robot=object()).decode()  # type: ignore[arg-type]
    policies = re.findall(r'content="(default-src[^"]*)"', page)
    assert policies == [report_policy()]
    assert page.count("<iframe") == 1


def test_the_picture_has_a_panel_for_each_thing_that_was_found() -> None:
    figure = study_runs_figure(result())
    titles = [axes.get_title(loc="left") for axes in figure.get_axes()]
    assert [title for title in titles if title] == [
        "Base error over time",
        "Base error, rms",
        "Median over the two most\ninfluential parameters",
        "Influence on base error, rms",
    ]


@pytest.mark.slow
def test_a_browser_plays_the_worst_run_of_a_study(tmp_path: Path) -> None:
    """Under the policies of both pages: nothing is refused, and nothing is wider than the page."""
    robot = rpctl.load("paper")
    file = tmp_path / "study.toml"
    file.write_text(
        "[study]\ncount = 6\nduration = 0.2\n[scatter]\n"
        '"run.initial_error.y" = { normal = [0.0, 0.05] }\n'
    )
    folder = tmp_path / "out"
    run_study(robot, read_study(file, robot), folder)
    page_file = study.write_study_report(folder, robot)
    assert (folder / study.PICTURE_FILE).read_bytes().startswith(b"\x89PNG")
    faults: list[str] = []
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 390, "height": 800})
        page.on("console", lambda message: faults.append(message.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(page_file.as_uri())
        page.locator("iframe").scroll_into_view_if_needed()
        frame = page.frame_locator("iframe")
        frame.locator("#scene canvas").wait_for()
        frame.locator("#plots canvas").first.wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert [fault for fault in faults if "GL Driver" not in fault and "WebGL" not in fault] == []
