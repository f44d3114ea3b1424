"""The report of a study: what its charts and tables say is what the runs were."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl.arrays import Array
from rpctl.study.design import Design
from rpctl.study.experiment import RunTable
from rpctl.study.optimise import BETTER, UNCLEAR, WORSE, optimum_sentence
from rpctl.study.sensitivity import (
    ParameterMap,
    Sensitivity,
    parameter_map,
)
from rpctl.study.statistics import Interval, describe, share
from rpctl.study.study import run_study
from rpctl.study.study_file import read_study
from rpctl.study.study_result import StudyResult, WorstRun
from rpctl.study.words import Unit, number, unit_of
from rpctl.view.pages import study
from rpctl.view.pages.page import SIDE, ramp_colour, still_chart
from rpctl.view.pages.report import report_policy
from rpctl.view.palette import RAMP
from rpctl.view.plots.study_runs import study_runs_figure
from rpctl.view.still_chart import Axis, Mark, StillChart, axis_over, fitting
from rpctl.view.study_figures import (
    distribution_chart,
    envelope_charts,
    importance_bars,
    map_chart,
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


def test_short_lengths_are_in_millimetres() -> None:
    assert unit_of("m", 0.5) == (1e3, "mm")
    assert unit_of("m", 1.5) == (1.0, "m")
    assert unit_of("rad", 0.5) == (1.0, "rad")


def test_axes() -> None:
    linear = Axis(0.0, 2.0)
    np.testing.assert_allclose(linear.at(np.array([-1.0, 0.5, 2.0, np.inf])), [0, 0.25, 1, 1])
    np.testing.assert_allclose(linear.ticks(), [0.0, 0.5, 1.0, 1.5, 2.0])
    log = Axis(1.0, 100.0, log=True)
    np.testing.assert_allclose(log.at(np.array([0.0, 1.0, 10.0, 1e3])), [0, 0, 0.5, 1])
    np.testing.assert_allclose(log.value(np.array([0.0, 0.5])), [1.0, 10.0])
    np.testing.assert_allclose(log.ticks(), [1.0, 3.0, 10.0, 30.0, 100.0])


def test_an_axis_is_logarithmic_over_decades_only() -> None:
    assert axis_over(np.array([0.0, 1.0, 1000.0])).log
    assert not axis_over(np.array([1.0, 2.0, np.inf])).log
    assert axis_over(np.array([1.0, 2.0])).low == 0.0
    negative = axis_over(np.array([-3.0, 2.0]))
    assert negative.low < -3.0 < 2.0 < negative.high


def test_lines_and_bands_go_through_their_points() -> None:
    x, axis = np.array([0.0, 2.0]), Axis(0.0, 4.0)
    line = Mark(x, np.array([0.0, 1.0]), "base")
    band = Mark(x, np.array([4.0, np.inf]), "tip", floor=np.zeros(2))
    steps = Mark(np.array([0.0, 1.0, 2.0]), np.array([1.0, 0.0]), "c3", floor=np.zeros(2))
    chart = StillChart("a", Axis(0.0, 2.0, "<t>"), axis, (line, band, steps), summary="said")
    page = still_chart(chart)
    lines, bands, bars = re.findall(r'style="(?:fill|stroke)[^"]*" d="([^"]*)"', page)
    assert lines == f"M0.0 {SIDE}.0L{SIDE}.0 750.0"
    assert bands == f"M0.0 0.0L{SIDE}.0 0.0L{SIDE}.0 {SIDE}.0L0.0 {SIDE}.0Z"
    assert bars == f"M0.0 {SIDE}.0L0.0 750.0L500.0 750.0L500.0 {SIDE}.0Z"
    assert "stroke:var(--base)" in page and "fill:var(--c3)" in page
    assert "&lt;t&gt;" in page and 'aria-label="said"' in page


def test_envelopes_are_the_quantiles_of_all_runs() -> None:
    (chart,) = envelope_charts(result())
    outer, inner, median = chart.marks
    values = np.sort(1e3 * result().runs.series["base_error"][:, 0])
    assert chart.y.label == "error (mm)"
    assert values[18] < median.y[0] < values[21]  # of 40 runs
    assert outer.floor is not None and inner.floor is not None
    for low, high in ((outer.floor, inner.floor), (inner.floor, median.y), (median.y, inner.y)):
        assert (low < high).all()


def test_histograms_stack_runs_that_failed_on_those_that_did_not() -> None:
    values = np.array([1.0, 1.0, 1.0, 2.0, np.inf])
    good = np.array([True, True, False, False, False])
    chart = distribution_chart("work", values, good, "J")
    assert isinstance(chart, StillChart)
    done, failed, median = chart.marks
    assert (done.y.sum(), failed.y.sum(), done.y.max(), failed.y.max()) == (2, 4, 2, 3)
    np.testing.assert_array_equal(failed.floor, done.y)
    assert median.x.tolist() == [1.0, 1.0]
    assert chart.summary == "Distribution over 4 runs, median 1 J"


def test_a_merit_that_all_runs_share_is_a_sentence() -> None:
    good = np.array([True, False])
    told = distribution_chart("a", np.array([-0.18, -0.18]), good, "rad")
    assert told == "−0.18 rad in 2 of 2 runs"
    assert distribution_chart("a", np.array([np.inf, np.nan]), good, "rad") == "No run has it."


def test_bars_and_their_intervals() -> None:
    found = result().sensitivities[0]
    bars = importance_bars(result(), found, 1)
    assert (bars.axis.low, bars.axis.high, bars.left_out, bars.rank) == (-1.0, 1.0, 1, True)
    page = study.study_page(result()).decode()
    assert 'class="bar" style="left:50.0%;width:40.0%"' in page
    assert 'class="whisker" style="left:85.0%;width:10.0%"' in page
    assert 'class="bar either" style="left:50.0%;width:30.0%"' in page
    shares = replace(found, method="sobol", measures={"total": found.measures["from_middle"]})
    assert importance_bars(result(), shares, 2).axis == Axis(0.0, 0.7)


def test_the_ramp_grows_lighter() -> None:
    def luminance(colour: str) -> float:
        red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    assert (ramp_colour(0.0), ramp_colour(1.0), ramp_colour(2.0)) == (RAMP[0], RAMP[-1], RAMP[-1])
    shades = [luminance(ramp_colour(share)) for share in np.linspace(0.0, 1.0, 40)]
    assert np.all(np.diff(shades) > 0.0)


def test_a_map_says_what_each_cell_holds() -> None:
    found = ParameterMap(
        "rms_base_error", "p", "q", np.array([0.0, 1.0, 3.0]), np.array([0.0, 1.0]),
        np.array([[0.01, np.inf]]), np.array([[7, 9]]),
    )  # fmt: skip
    chart, unit = map_chart(found, "m")
    drawn = still_chart(chart)
    assert unit == Unit(1e3, "mm")
    assert "p 0 to 1, q 0 to 1: 10 mm, 7 runs" in drawn
    assert "p 1 to 3, q 0 to 1: ∞, 9 runs" in drawn
    boxes = re.findall(r'<rect x="([\d.]+)" y="([\d.]+)" width="([\d.]+)" height="([\d.]+)"', drawn)
    np.testing.assert_allclose(
        np.array(boxes, float), [[0, 0, 333.3, 1000], [333.3, 0, 666.7, 1000]], atol=0.1
    )


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


def test_the_page_says_what_the_study_found() -> None:
    page = study.study_page(result()).decode()
    found = result().statistics[0].quantiles
    for text in (
        ">75 %<",
        ">58.8 to 87.3 %<",
        number(found[2].value, Unit(1e3, "mm")),
        "40 runs · 1 setting differs · monte-carlo, seed 3",
        "<b>Run 39</b>",
        "<code>rpctl track x</code>",
        ">0.8<",
        'title="b">b<small>either side of its median</small></span>',
        ">0.6<",
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
    assert optimum_sentence(OPTIMUM).text == (
        "better: 95 % quantile of base error, rms goes from 20 mm to 15 mm on 50 fresh runs, −25 % "
        "(95 % interval −35 to −20 %)"
    )
    for low, high, verdict in ((-0.01, 0.01, UNCLEAR), (0.001, 0.002, WORSE), (-2, -1, BETTER)):
        change = {"value": 0.5 * (low + high), "low": low, "high": high}
        changed = {**OPTIMUM, "validation": {**OPTIMUM["validation"], "change": change}}
        assert optimum_sentence(changed).verdict == verdict


def test_labels_below_a_chart_do_not_touch() -> None:
    assert fitting([1.0, 2.0, 3.0], 20) == [1.0, 2.0, 3.0]
    for ticks in ([-0.0257, -0.0256, -0.0255, -0.0254], [1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2]):
        kept = fitting(ticks, 20)
        assert 1 <= len(kept) < len(ticks)
        assert sum(len(number(each)) + 2 for each in kept) <= 20


def test_the_page_shows_settings_that_were_found() -> None:
    page = study.study_page(result(optimum=OPTIMUM)).decode()
    assert ">kinematic horizon (s)</th><td>0.5</td><td>0.25</td><td>0.1 to 1</td>" in page
    assert f"<p>B{optimum_sentence(OPTIMUM).text[1:]}</p>" in page


def test_a_study_of_one_setting_and_one_kind_of_run_has_a_page() -> None:
    bare = result(maps=(), sensitivities=(), worst=())
    page = study.study_page(bare).decode()
    assert "What matters" not in page
    assert "Worst runs" not in page


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
        "Distribution: base error, rms",
        "Median over what matters most",
        "What matters: base error, rms",
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
