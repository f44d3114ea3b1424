"""The report of a study's folder: one HTML file that needs no server and no network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.errors import RpctlError
from rpctl.files.writing import write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.config import read_config
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.merits.summary import summarize
from rpctl.simulation.run.run import Run
from rpctl.study.merits import (
    MERITS,
    Unit,
    grouped,
    merit_words,
    number,
    parameter_words,
    percent,
    share_span,
    unit_of,
)
from rpctl.study.optimise import optimum_sentence
from rpctl.study.statistics import LEVELS, MeritStatistics
from rpctl.study.study_result import StudyResult, WorstRun, read_result
from rpctl.view.labels import capital
from rpctl.view.pages.page import Badge, render_page
from rpctl.view.pages.report import report_page, report_policy
from rpctl.view.plots.figures import svg_address, to_png
from rpctl.view.plots.study_runs import merits_figure, others_figure, study_runs_figure
from rpctl.view.scene.scene import build_scene

REPORT_FILE, PICTURE_FILE = "study.html", "study.png"
STYLES = ("report.css", "study.css")
DPI = 200
METHODS = {
    "sobol": "Share of the variance that a parameter causes, including interactions (total Sobol "
    "index), and its 95 % interval.",
    "morris": "Mean size of the change over a parameter's range (μ* of Morris), and its 95 % "
    "interval.",
    "rank-correlation": "Rank correlation of a parameter, or of its distance from its median "
    "where that is larger, with the merit, and its 95 % interval: 1 if the "
    "merit always grows with it, −1 if it always falls.",
}
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
    picture = to_png(study_runs_figure(result), DPI)
    write_atomically(Path(folder) / PICTURE_FILE, picture, follow_links=False)
    path = Path(folder) / REPORT_FILE
    return write_atomically(path, study_page(result, robot), follow_links=False)


def study_page(result: StudyResult, robot: Robot | None = None) -> bytes:
    """Return the page of a study.

    Args:
        result: What the study found.
        robot: Its robot; None: nothing is animated.
    """
    scene = worst_scene(result.worst, robot) if robot is not None else None
    main = result.sensitivity_of(result.merit)
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
        pictures=[svg_address(study_runs_figure(result, log)) for log in (False, True)],
        method=None if main is None else METHODS[main.method],
        others=svg_address(others_figure(result)) if len(result.sensitivities) > 1 else "",
        distributions=[svg_address(merits_figure(result, log)) for log in (False, True)],
        worst=_worst(result),
        worst_title=f"Worst runs by {merit_words(result.merit)}",
        scene=scene,
        optimum=_optimum(result),
        levels=["median" if level == 0.5 else f"{100.0 * level:g} %" for level in LEVELS],
        quantiles=[_quantiles(result, each) for each in result.statistics],
        scatter=_scatter(result),
        versions=result.details["identity"]["versions"],
    )
    return page.encode("utf-8", "backslashreplace")


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
    for each in (each for each in result.statistics if each.name == result.merit):
        unit = _unit(result, each)
        for level, name in ((0.5, "median"), (0.95, "95 % of runs below")):
            found = each.quantiles[level]
            title = f"{capital(merit_words(result.merit))}: {name}"
            span = f"{number(found.low, unit)} to {number(found.high, unit)}"
            rows.append((title, number(found.value, unit), span))
    return rows


def _unit(result: StudyResult, found: MeritStatistics) -> Unit:
    return unit_of(result.units.get(found.name, ""), found.largest)


def _quantiles(result: StudyResult, found: MeritStatistics) -> dict[str, Any]:
    """Return a row of the table of quantiles."""
    unit = _unit(result, found)
    plain = Unit(unit.factor, "")
    return {
        "about": MERITS[found.name].what if found.name in MERITS else "",
        "name": merit_words(found.name) + (f" ({unit.name})" if unit.name else ""),
        "cells": [
            (number(q.value, plain), f"{number(q.low, plain)} … {number(q.high, plain)}")
            for q in found.quantiles.values()
        ],
        "rest": [
            number(found.largest, plain),
            number(found.mean.value, plain),
            grouped(found.missing) if found.missing else "–",
        ],
    }


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
    return {"sentence": capital(optimum_sentence(result.optimum)[1]), "rows": rows}


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
            return f"Run {grouped(each.run)}, as rpctl track reports it", page.decode("utf-8")
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
