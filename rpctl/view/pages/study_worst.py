"""The worst runs of a study: what replays them, and the worst one animated."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.config import read_config
from rpctl.simulation.loop import simulate
from rpctl.simulation.run import Run
from rpctl.simulation.summary import summarize
from rpctl.study.study_result import StudyResult, WorstRun
from rpctl.study.words import grouped, merit_words, number, unit_of
from rpctl.view.pages.page import badge, escape, section
from rpctl.view.pages.report import report_page
from rpctl.view.scene.scene import build_scene


def worst_section(result: StudyResult, scene: str) -> str:
    """Return the worst runs, what replays them, and the worst one animated."""
    if not result.worst:
        return ""
    unit = unit_of(result.units.get(result.merit, ""), max(each.value for each in result.worst))
    rows = "".join(
        f'<li><b>Run {grouped(each.run)}</b> <span class="value">{number(each.value, unit)}</span> '
        f"{badge(each.outcome == 'tracked', each.outcome)}"
        f'<p class="quiet">{escape(each.reason)}</p>'
        + (f"<code>{escape(each.command)}</code>" if each.command else "")
        + "</li>"
        for each in result.worst
    )
    title = f"Worst runs by {merit_words(result.merit)}"
    return section(escape(title), f'<ol class="worst">{rows}</ol>{scene}')


def worst_scene(worst: Sequence[WorstRun], robot: Robot) -> str:
    """Return the report of the worst run that can be simulated, as a frame of a page.

    Args:
        worst: The worst runs, the worst first.
        robot: Their robot.
    """
    for each in worst:
        if each.command:
            run = replayed(Path(each.config), robot)
            if isinstance(run, Run):
                page = report_page(run, robot, build_scene(robot, run), summarize(run))
                text = html.escape(page.decode("utf-8"))
                title = f"Run {grouped(each.run)}, as rpctl track reports it"
                return (
                    f'<p class="scene-name">{title}</p>'
                    f'<iframe title="{title}" loading="lazy" srcdoc="{text}"></iframe>'
                )
    return ""


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
