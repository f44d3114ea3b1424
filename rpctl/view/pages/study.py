"""The report of a study's folder: one HTML file that needs no server and no network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from rpctl.errors import RpctlError
from rpctl.files.writing import write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.config import read_config
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.run.run import Run
from rpctl.study.merits import MERITS
from rpctl.study.optimise import optimum_sentence
from rpctl.study.sensitivity import Sensitivity
from rpctl.study.statistics import LEVELS, MeritStatistics
from rpctl.study.study_result import StudyResult, WorstRun, read_result
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
from rpctl.view.pages.page import Badge, render_page, still_chart
from rpctl.view.pages.report import report_page, report_policy
from rpctl.view.palette import RAMP
from rpctl.view.plots.study_runs import study_picture
from rpctl.view.scene.scene import build_scene
from rpctl.view.study_figures import (
    METHODS,
    ImportanceBars,
    distribution_chart,
    envelope_charts,
    importance_bars,
    map_chart,
)

REPORT_FILE, PICTURE_FILE = "study.html", "study.png"
STYLES = ("report.css", "still_chart.css", "study.css")
MOST_BARS = 12  # parameters that are shown of a sensitivity
DISTRIBUTIONS = {
    "uniform": "uniform, {0} to {1}",
    "log-uniform": "log-uniform, {0} to {1}",
    "normal": "normal, {0} ± {1}",
    "choice": "one of {all}",
}


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
    scene = worst_scene(result.worst, robot) if robot is not None else None
    # A frame's scripts need both pages' leave.
    policy: dict[str, Any] = {} if scene is None else {"policy": report_policy()}
    page = render_page(
        "study.html",
        title=f"{result.robot}: study · rpctl",
        styles=STYLES,
        **policy,
        name=result.robot,
        subtitle=_subtitle(result),
        figures=_figures(result),
        badges=[
            Badge(name == "tracked", f"{grouped(count)} {name}")
            for name, count in Counter(result.runs.outcomes).most_common()
        ],
        envelopes=[_Drawing.of(each) for each in envelope_charts(result)],
        maps=[_map(result, k) for k in range(len(result.maps))],
        ramp=", ".join(RAMP),
        worst=_worst(result),
        worst_title=f"Worst runs by {merit_words(result.merit)}",
        scene=scene,
        optimum=_optimum(result),
        levels=["median" if level == 0.5 else f"{100.0 * level:g} %" for level in LEVELS],
        quantiles=[_quantiles(result, each) for each in result.statistics],
        distributions=_distributions(result),
        scatter=_scatter(result),
        versions=result.details["identity"]["versions"],
        **_importance(result),
    )
    return page.encode("utf-8", "backslashreplace")


@dataclass(frozen=True)
class _Drawing:
    """A chart below its title, or the sentence that stands for it."""

    title: str
    chart: Markup | None = None
    sentence: str = ""

    @classmethod
    def of(cls, chart: Any, title: str = "", small: bool = False) -> _Drawing:
        """Return a chart, or a sentence in its place, as the page shows it."""
        if isinstance(chart, str):
            return cls(title, sentence=chart)
        return cls(title or chart.title, still_chart(chart, small))


def _subtitle(result: StudyResult) -> str:
    design, count = result.design, len(result.scatter)
    settings = "1 setting differs" if count == 1 else f"{count} settings differ"
    return (
        f"{grouped(len(result.runs))} runs · {settings} · {design.kind}, seed {design.seed} · "
        f"runs are compared by {merit_words(result.merit)}"
    )


def _figures(result: StudyResult) -> list[tuple[str, str, str]]:
    """Return the share of runs that succeeded, and the study's merit, as the head of the page."""
    success = result.success
    rows = [("Succeeded", percent(success.value), share_span(success))]
    for each in result.statistics:
        if each.name != result.merit:
            continue
        unit = _unit(result, each)
        names = {0.5: "median", 0.95: "95 % of runs below"}
        for level in (q for q in each.quantiles if q.level in names):
            title = f"{_capital(merit_words(result.merit))}: {names[level.level]}"
            span = f"{number(level.low, unit)} to {number(level.high, unit)}"
            rows.append((title, number(level.value, unit), span))
    return rows


def _unit(result: StudyResult, found: MeritStatistics) -> Unit:
    return unit_of(result.units.get(found.name, ""), found.largest)


class _BarRow(NamedTuple):
    """A bar of what matters: places in per cent of the axis."""

    path: str
    name: str
    bent: bool
    left: float
    width: float
    whisker: tuple[float, float] | None
    value: str


def _importance(result: StudyResult) -> dict[str, Any]:
    """Return what matters: to the study's merit in full, to the others folded up."""
    main = result.sensitivity_of(result.merit)
    if main is None:
        return {"importance": [], "others": [], "method": ""}
    shown = [main, *(each for each in result.sensitivities if each.merit == "failure")]
    others = [each for each in result.sensitivities if each not in shown]

    def drawn(group: Sequence[Sensitivity]) -> list[tuple[ImportanceBars, list[_BarRow]]]:
        every = [importance_bars(result, each, MOST_BARS) for each in group]
        return [(bars, _bar_rows(bars)) for bars in every]

    method = METHODS[main.method]
    return {"importance": drawn(shown), "others": drawn(others), "method": method}


def _bar_rows(shown: ImportanceBars) -> list[_BarRow]:
    def at(value: float) -> float:
        return round(100.0 * float(shown.axis.at(value)), 2)

    rows = []
    for each in shown.bars:
        left, right = sorted((at(0.0), at(each.value)))
        whisker = None
        if np.isfinite([each.low, each.high]).all():
            whisker = at(each.low), round(at(each.high) - at(each.low), 2)
        name, value = parameter_words(each.name).name, number(each.value, shown.unit)
        width = round(right - left, 2)
        rows.append(_BarRow(each.name, name, shown.bent(each), left, width, whisker, value))
    return rows


def _map(result: StudyResult, k: int) -> dict[str, Any]:
    found = result.maps[k]
    chart, unit = map_chart(found, result.units.get(found.merit, ""))
    known = np.isfinite(found.median)
    ends = found.median[known].min(initial=np.inf), found.median[known].max(initial=-np.inf)
    drawn = _Drawing.of(chart if known.any() else "No run has this merit.", _capital(chart.title))
    lost = bool(np.isinf(found.median).any())
    return {"drawing": drawn, "ends": [number(float(end), unit) for end in ends], "lost": lost}


def _quantiles(result: StudyResult, found: MeritStatistics) -> dict[str, Any]:
    """Return a row of the table of quantiles."""
    unit = _unit(result, found)
    plain = Unit(unit.factor, "")
    return {
        "about": MERITS[found.name].what if found.name in MERITS else "",
        "name": merit_words(found.name) + (f" ({unit.name})" if unit.name else ""),
        "cells": [
            (number(q.value, plain), f"{number(q.low, plain)} … {number(q.high, plain)}")
            for q in found.quantiles
        ],
        "rest": [
            number(found.largest, plain),
            number(found.mean.value, plain),
            grouped(found.missing) if found.missing else "–",
        ],
    }


def _distributions(result: StudyResult) -> list[_Drawing]:
    drawings = []
    for name, values in result.runs.merits.items():
        chart = distribution_chart(name, values, result.succeeded, result.units.get(name, ""))
        drawings.append(_Drawing.of(chart, merit_words(name), small=True))
    return drawings


def _capital(text: str) -> str:
    """Return a text that begins with a capital; unlike ``str.capitalize`` it leaves the rest."""
    return text[:1].upper() + text[1:]


# ---- settings -----------------------------------------------------------------------------


def _optimum(result: StudyResult) -> dict[str, Any] | None:
    """Return the settings that ``--optimize`` found beside those of the file."""
    if result.optimum is None:
        return None
    settings: Mapping[str, Mapping[str, Any]] = result.optimum["settings"]
    rows = []
    for name, each in settings.items():
        before = "–" if each["before"] is None else number(each["before"])
        span = " to ".join(number(end) for end in each["range"])
        rows.append((name, str(parameter_words(name)), [before, number(each["after"]), span]))
    return {"sentence": _capital(optimum_sentence(result.optimum).text), "rows": rows}


def _scatter(result: StudyResult) -> list[tuple[str, str, str]]:
    """Return what differs from run to run: path, name and distribution."""
    words = {name: parameter_words(name) for name in result.scatter}
    return [
        (name, words[name].name, _distribution(each, words[name].unit))
        for name, each in result.scatter.items()
    ]


def _distribution(found: object, unit: str) -> str:
    """Return a distribution as a study file says it, in words, without ends that it has not."""
    if not isinstance(found, Mapping):
        return f"{found} {unit}".rstrip()
    parts = []
    for kind, args in found.items():
        values = args if isinstance(args, list) else [args]
        said = DISTRIBUTIONS.get(kind, "{kind} {all}") if len(values) > 1 else "{kind} {all}"
        shown = [number(each) if isinstance(each, int | float) else str(each) for each in values]
        text = said.format(*shown, kind=kind.replace("-", " "), all=", ".join(shown))
        if kind == "normal" and np.isfinite(values[2:]).any():
            text += f", within {shown[2]} to {shown[3]}"
        parts.append(f"{text} {unit}".rstrip())
    return "; ".join(parts)


# ---- the worst runs -----------------------------------------------------------------------


def _worst(result: StudyResult) -> list[dict[str, Any]]:
    """Return the worst runs, and what replays them."""
    largest = max((each.value for each in result.worst), default=0.0)
    unit = unit_of(result.units.get(result.merit, ""), largest)
    return [
        {
            "run": grouped(each.run),
            "value": number(each.value, unit),
            "badge": Badge(each.outcome == "tracked", each.outcome),
            "reason": each.reason,
            "command": each.command,
        }
        for each in result.worst
    ]


def worst_scene(worst: Sequence[WorstRun], robot: Robot) -> tuple[str, str] | None:
    """Return the title and the report of the worst run that can be simulated; None: there is none.

    Args:
        worst: The worst runs, the worst first.
        robot: Their robot.
    """
    for each in worst:
        run = replayed(Path(each.config), robot) if each.command else None
        if isinstance(run, Run):
            page = report_page(run, robot, build_scene(robot, run), summarize(run))
            title = f"Run {grouped(each.run)}, as rpctl track reports it"
            return title, page.decode("utf-8")
    return None


def replayed(config: Path, robot: Robot) -> Run | RpctlError:
    """Return the run of a configuration; of one that diverges, what comes before.

    Args:
        config: The file.
        robot: The robot, before the configuration's limits.
    """
    kept: list[Run] = []
    try:
        return simulate(robot, read_config(config), ended=kept.append)
    except RpctlError as error:
        return kept[0] if kept else error
