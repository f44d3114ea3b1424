"""The report of a study's folder: one HTML file that needs no server and no network."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from rpctl.files.writing import write_atomically
from rpctl.robot.model import Robot
from rpctl.study.merits import MERITS
from rpctl.study.sensitivity import Sensitivity, importances
from rpctl.study.statistics import LEVELS, MeritStatistics, envelope
from rpctl.study.study_result import StudyResult, read_result
from rpctl.study.words import (
    Unit,
    grouped,
    merit_words,
    number,
    parameter_words,
    percent,
    share_span,
    unit_of,
)
from rpctl.view.pages.page import asset, badge, escape, policy, section
from rpctl.view.pages.report import report_policy
from rpctl.view.pages.study_charts import envelope_chart, histogram, interval_bars
from rpctl.view.pages.study_map import map_chart
from rpctl.view.pages.study_settings import optimum_section, settings_section
from rpctl.view.pages.study_worst import worst_scene, worst_section
from rpctl.view.plots.study_runs import study_picture

REPORT_FILE, PICTURE_FILE = "study.html", "study.png"
MOST_BARS = 12  # parameters that are shown of a sensitivity
GOOD_SHARE = 0.95  # of runs that succeed: a green badge
METHODS = {
    "sobol": "Share of the variance that a parameter causes, with all that it acts together with "
    "(total Sobol index), and its 95 % interval.",
    "morris": "Mean size of the change over a parameter's range (μ* of Morris), and its 95 % "
    "interval.",
    "rank-correlation": "Rank correlation of a parameter, or of its distance from its median where "
    "that is larger, with the merit, and its 95 % interval: 1 if the merit grows wherever it does, "
    "−1 if it falls.",
}
PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}: study · rpctl</title>
<link rel="icon" href="data:,">
<style>{style}</style>
</head>
<body class="study">
<header class="top">
  <div class="name"><h1>{title}</h1><p class="subtitle">{subtitle}</p></div>
  {figures}
</header>
<main>
{sections}
</main>
</body>
</html>
"""


def write_study_report(folder: str | Path, robot: Robot | None = None) -> Path:
    """Write the report and the picture of a study into its folder.

    Args:
        folder: The study's folder.
        robot: Its robot, as it was loaded; the worst run is simulated again and animated. None
            leaves that out.

    Returns:
        The report.

    Raises:
        RpctlError: The folder holds no study that has come to its end.
    """
    result = read_result(folder)
    write_atomically(Path(folder) / PICTURE_FILE, study_picture(result), follow_links=False)
    path = Path(folder) / REPORT_FILE
    return write_atomically(path, study_page(result, robot), follow_links=False)


def study_page(result: StudyResult, robot: Robot | None = None) -> bytes:
    """Return the page of a study.

    Args:
        result: What the study found.
        robot: Its robot; None: nothing is animated.
    """
    scene = worst_scene(result.worst, robot) if robot is not None else ""
    page = PAGE.format(
        policy=report_policy() if scene else policy(),  # a frame's scripts need both pages' leave
        title=escape(result.robot),
        subtitle=escape(_subtitle(result)),
        style="".join(map(asset, ("palette.css", "report.css", "study.css"))),
        figures=_figures(result),
        sections="\n".join(
            [
                _envelopes(result),
                _importance(result),
                *(_map(result, k) for k in range(len(result.maps))),
                worst_section(result, scene),
                optimum_section(result),
                _quantiles(result),
                _distributions(result),
                settings_section(result),
            ]
        ),
    )
    return page.encode("utf-8", "backslashreplace")


def _subtitle(result: StudyResult) -> str:
    design = result.design
    return (
        f"{grouped(len(result.runs))} runs · {_settings_words(len(result.scatter))} · "
        f"{design.kind}, seed {design.seed} · runs are compared by {merit_words(result.merit)}"
    )


def _figures(result: StudyResult) -> str:
    """Return the share of runs that succeeded, and the study's merit, as the head of the page."""
    of_merit = next((each for each in result.statistics if each.name == result.merit), None)
    success = result.success
    rows = [("Succeeded", percent(success.value), share_span(success))]
    if of_merit is not None:
        unit = _unit(result, of_merit)
        for level, name in ((0.5, "median"), (0.95, "95 % of runs below")):
            found = next(each for each in of_merit.quantiles if each.level == level)
            title = f"{_capital(merit_words(result.merit))}: {name}"
            low, high = number(found.low, unit), number(found.high, unit)
            rows.append((title, number(found.value, unit), f"{low} to {high}"))
    shown = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd><small>{escape(span)}</small></div>"
        for name, value, span in rows
    )
    counts = Counter(result.runs.outcomes).most_common()
    outcomes = " ".join(
        badge(name == "tracked", f"{grouped(count)} {name}") for name, count in counts
    )
    return f'<dl class="figures">{shown}</dl><div class="badges">{outcomes}</div>'


def _unit(result: StudyResult, found: MeritStatistics) -> Unit:
    return unit_of(result.units.get(found.name, ""), found.largest)


def _envelopes(result: StudyResult) -> str:
    """Return how the errors spread over time."""
    charts = []
    for name, series in result.runs.series.items():
        if name == "lateral_error" or len(result.runs.t) < 2:
            continue
        quantiles = envelope(np.asarray(series, float), LEVELS)
        summary = f"{name.replace('_', ' ')} over time: median, half of the runs, and nine in ten"
        drawn = envelope_chart(result.runs.t, quantiles, result.units.get(name, "") or "m", summary)
        charts.append(
            f"<figure><figcaption>{escape(name.replace('_', ' '))}</figcaption>{drawn}</figure>"
        )
    keys = (
        '<ul class="keys"><li><i class="median"></i>median</li>'
        '<li><i class="inner"></i>25 to 75 %</li><li><i class="outer"></i>5 to 95 %</li></ul>'
    )
    note = "Of all runs at each instant; a run that has ended early counts as worse than any other."
    body = f'<div class="charts">{"".join(charts)}</div><p class="quiet">{note}</p>'
    return section(f"Errors over time{keys}", body)


def _importance(result: StudyResult) -> str:
    """Return what matters: to the study's merit in full, to the others folded up."""
    main = result.sensitivity_of(result.merit)
    if main is None:
        return ""
    failure = [each for each in result.sensitivities if each.merit == "failure"]
    shown = [main, *failure]
    others = [each for each in result.sensitivities if each not in shown]
    body = '<div class="charts">' + "".join(_bars(result, each) for each in shown) + "</div>"
    body += f'<p class="quiet">{escape(METHODS[main.method])}</p>'
    if others:
        more = "".join(_bars(result, each) for each in others)
        body += (
            f'<details><summary>Other merits</summary><div class="charts">{more}</div></details>'
        )
    return section("What matters", body)


def _bars(result: StudyResult, found: Sensitivity) -> str:
    bars = importances(found, MOST_BARS)
    unit = Unit(1.0, "")
    if found.method == "morris":
        largest = max((abs(each.value) for each in bars), default=0.0)
        unit = unit_of(result.units.get(found.merit, ""), largest)
    title = merit_words(found.merit)
    drawn = interval_bars(
        bars, found.method == "rank-correlation", unit, f"What matters to {title}"
    )
    left_out = len(found.ranking) - len(bars)
    more = f'<p class="quiet">and {left_out} that matter less</p>' if left_out > 0 else ""
    return f"<figure><figcaption>{escape(title)}</figcaption>{drawn}{more}</figure>"


def _map(result: StudyResult, k: int) -> str:
    found = result.maps[k]
    drawn = map_chart(found, result.units.get(found.merit, ""))
    note = "Median of the runs in each cell; cells hold about as many runs each."
    if np.isinf(found.median).any():
        note += " Hatched: most runs have no such merit."
    x, y = parameter_words(found.x).name, parameter_words(found.y).name
    title = f"{merit_words(found.merit)} over {x} and {y}"
    body = f'<figure class="map">{drawn}</figure><p class="quiet">{note}</p>'
    return section(escape(_capital(title)), body)


def _quantiles(result: StudyResult) -> str:
    heads = "".join(f"<th>{_level(level)}</th>" for level in LEVELS)
    rows = "".join(_quantile_row(result, each) for each in result.statistics)
    table = (
        f'<div class="wide"><table class="runs"><thead><tr><th>merit</th>{heads}<th>largest</th>'
        f"<th>mean</th><th>runs without it</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
    note = "Below each quantile its 95 % interval, which assumes no distribution."
    return section("Quantiles of all merits", f'{table}<p class="quiet">{note}</p>')


def _quantile_row(result: StudyResult, found: MeritStatistics) -> str:
    unit = _unit(result, found)
    plain = Unit(unit.factor, "")
    cells = "".join(
        f"<td>{number(q.value, plain)}<small>{number(q.low, plain)} … {number(q.high, plain)}"
        "</small></td>"
        for q in found.quantiles
    )
    about = MERITS[found.name].what if found.name in MERITS else ""
    name = merit_words(found.name) + (f" ({unit.name})" if unit.name else "")
    return (
        f'<tr><th title="{escape(about)}">{escape(name)}</th>{cells}'
        f"<td>{number(found.largest, plain)}</td><td>{number(found.mean.value, plain)}</td>"
        f"<td>{grouped(found.missing) if found.missing else '–'}</td></tr>"
    )


def _distributions(result: StudyResult) -> str:
    figures = []
    for name, values in result.runs.merits.items():
        drawn = histogram(values, result.succeeded, result.units.get(name, ""))
        figures.append(
            f"<figure><figcaption>{escape(merit_words(name))}</figcaption>{drawn}</figure>"
        )
    keys = (
        '<ul class="keys"><li><i class="done"></i>succeeded</li>'
        '<li><i class="failed"></i>did not</li><li><i class="median"></i>median</li></ul>'
    )
    return section(
        f"Distribution of each merit{keys}", f'<div class="charts small">{"".join(figures)}</div>'
    )


def _capital(text: str) -> str:
    """Return a text that begins with a capital; unlike ``str.capitalize`` it leaves the rest."""
    return text[:1].upper() + text[1:]


def _level(level: float) -> str:
    return "median" if level == 0.5 else f"{100.0 * level:g} %"


def _settings_words(count: int) -> str:
    return "1 setting differs" if count == 1 else f"{count} settings differ"
