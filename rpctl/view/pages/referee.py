"""The referee's page: all engines' robots on one timeline, how far they are off, and why."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.comparison import EngineGap, gap_text
from rpctl.engines.recording import EngineRecording
from rpctl.engines.referee import Cause, EngineVerdict, beyond
from rpctl.files.writing import write_atomically
from rpctl.robot.model import Robot
from rpctl.view.charts import Chart, Line
from rpctl.view.pages.motion_data import drawn_charts
from rpctl.view.pages.page import Badge, Section, Table, stand_in_entry
from rpctl.view.pages.panel import KEYBOARD, motion_entry, notes_section
from rpctl.view.pages.report import Page, page_bytes
from rpctl.view.scene.scene import free_scene

MODEL = "Reduced model"


@dataclass(frozen=True, eq=False)
class Shown:
    """A motion on the page: its name, and whether its robot is shown at first."""

    name: str
    recording: EngineRecording
    shown: bool = True


def write_referee_page(robot: Robot, verdicts: Sequence[EngineVerdict], path: str | Path) -> Path:
    """Write the referee's page of a robot: one HTML file, whole or not at all.

    Args:
        robot: The robot.
        verdicts: On the engines, at least one.
        path: The file.

    Returns:
        The path.
    """
    return write_atomically(path, referee_page(robot, verdicts))


def referee_page(robot: Robot, verdicts: Sequence[EngineVerdict]) -> bytes:
    """Return the referee's page of a robot.

    Args:
        robot: The robot.
        verdicts: On the engines, at least one.
    """
    shown = list(_shown(verdicts))
    scene = free_scene(robot, [one.recording for one in shown])
    said = dict.fromkeys(note for verdict in verdicts for note in (*verdict.notes, *scene.notes))
    names = ", ".join(f"{verdict.engine} {verdict.version}" for verdict in verdicts)
    entries = [motion_entry(k, one.name, one.shown) for k, one in enumerate(shown)]
    page = Page(
        title=robot.name,
        subtitle=f"the same efforts and the same start · {names}",
        scene_label=f"{robot.name} in {len(shown)} motions, in three dimensions",
        badges=[_badge(verdict) for verdict in verdicts],
        legend=[*entries, *filter(None, [stand_in_entry(scene.stand_ins)])],
        panel=[*map(_verdict_section, verdicts), *notes_section(tuple(said)), KEYBOARD],
        scene=scene,
        data={"plots": drawn_charts(scene.times, _charts(verdicts, shown))},
    )
    return page_bytes(page)


def _shown(verdicts: Sequence[EngineVerdict]) -> Iterator[Shown]:
    """Yield what is drawn: the model, each engine that ran, and mended what disagreed."""
    yield Shown(MODEL, verdicts[0].model)
    for verdict in verdicts:
        if len(verdict.recording.t) > 1:
            yield Shown(verdict.engine, verdict.recording)
        mended = verdict.mended
        if mended is not None and len(mended.t) > 1:
            yield Shown(f"{verdict.engine}, corrected", mended, shown=False)


def _badge(verdict: EngineVerdict) -> Badge:
    worst = beyond(verdict.gaps)
    return Badge(not worst, f"{verdict.engine}: {worst[0].words if worst else 'agrees'}")


def _verdict_section(verdict: EngineVerdict) -> Section:
    """Return what the referee says of an engine: its line, the causes, all gaps."""
    found, word = verdict.trace, "disagrees" if verdict.traced else "disagrees, not traced"
    causes = [_cause(cause, verdict) for cause in (found.causes if found else ())]
    rest = [gap.words for gap in ((*found.cured, *found.remaining) if found else ())]
    told = [] if causes else [verdict.line]
    told += [f"Not explained: {'; '.join(rest)}"] if rest else []
    return Section(
        f"{verdict.engine} {verdict.version} ",
        [Badge(verdict.agrees, "agrees" if verdict.agrees else word)],
        notes=causes,
        paragraphs=told,
        table=Table(("gap", "band", ""), [_gap_row(gap) for gap in verdict.gaps]),
    )


def _cause(cause: Cause, verdict: EngineVerdict) -> tuple[str, str]:
    """Return a cause, what it does alone, and its mend."""
    fault = ", and ".join(switch.fault for switch in cause.switches)
    alone = f"Alone: {cause.gaps[0].words}. " if cause.gaps else ""
    return fault, f". {alone}To correct it, {cause.setting(verdict.friction)}."


def _gap_row(gap: EngineGap) -> tuple[str, list[str]]:
    size, band = gap_text(abs(gap.gap), gap.unit), gap_text(gap.band, gap.unit)
    return gap.name.capitalize(), [size, band, "" if gap.agrees else gap.words]


def _charts(verdicts: Sequence[EngineVerdict], shown: Sequence[Shown]) -> list[Chart]:
    """Return how far each engine is off the model, over time."""
    model = verdicts[0].model

    def off(recording: EngineRecording, name: str) -> Array:
        mine = getattr(recording, name)
        return np.asarray(mine - getattr(model, name)[: len(mine)])

    def energy(recording: EngineRecording) -> Array:
        made = off(recording, "energy") - off(recording, "work")
        return made - made[0]

    kinds: tuple[tuple[str, str, Callable[[EngineRecording], Array], str], ...] = (
        ("Off the model's path", "mm", lambda x: 1e3 * np.hypot(*off(x, "pose")[:, :2].T), ""),
        ("Off the model's heading", "°", lambda x: np.degrees(off(x, "pose")[:, 2]), ""),
        ("Slip of the worst wheel", "m/s",
         lambda x: np.hypot(*np.moveaxis(off(x, "slip"), 2, 0)).max(axis=1),
         "beyond that of the model"),
        ("Load of the worst contact", "N", lambda x: np.abs(off(x, "load")).max(axis=1),
         "off the model's"),
        ("Energy made", "J", energy, "beyond work and the model's losses"),
    )  # fmt: skip
    return [
        _chart(title, unit, find, note, shown, len(model.t)) for title, unit, find, note in kinds
    ]


def _chart(
    title: str,
    unit: str,
    find: Callable[[EngineRecording], Array],
    note: str,
    shown: Sequence[Shown],
    count: int,
) -> Chart:
    """Return a chart of all engines; where one ended early its line does, too."""
    lines = []
    for k, one in enumerate(shown[1:], 1):
        values = np.full(count, np.nan)
        found = find(one.recording)
        values[: len(found)] = found
        lines.append(Line(one.name, unit, values, k))
    return Chart(title, unit, tuple(lines), note=note)
