"""The picture of a battery: each law's envelope, a ladder a stress, a panel a plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rpctl.study.stress_battery import REFUSED, Stress
from rpctl.study.stress_report import (
    DEGRADE,
    FAIL,
    PASS,
    VERDICTS,
    StressReport,
    StressRow,
    error_text,
)
from rpctl.view.labels import literal
from rpctl.view.palette import light
from rpctl.view.plots import style
from rpctl.view.plots.figures import to_png
from rpctl.view.plots.style import SMALL_PT, TEXT_PT, text_width

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 200
BOX_IN, GAP_IN, MARGIN_IN = 0.41, 0.16, 0.1  # widths, inches
ROW_IN, LEVELS_IN, BLOCK_GAP_IN = 0.155, 0.15, 0.07  # heights of a law, its levels, a gap; inches
HEAD_IN, FOOT_IN, NOTE_IN = 0.62, 0.36, 0.15
FEWEST = 5  # boxes that a panel has room for, at least
CELL_PT, LEVEL_PT = SMALL_PT - 0.9, SMALL_PT - 1.2
FILLS = {PASS: light("pass"), DEGRADE: light("degrade"), FAIL: light("fail"), REFUSED: style.PAPER}
INKS = {PASS: style.INK, DEGRADE: style.INK, FAIL: style.PAPER, REFUSED: style.DESIRED}
SIGNS = {PASS: "", DEGRADE: "~", FAIL: "×", REFUSED: "–"}
PAIRS = "two at once: how many"
NOMINAL = "nominal"  # among the keys
KEY_GAP_IN = 0.42  # inches: a box, and what is between two of them
KEYS = {
    PASS: "passes",
    DEGRADE: "degrades",
    FAIL: "fails",
    REFUSED: "did not run",
    NOMINAL: "nothing stressed",
}
NOMINAL_EDGE: dict[str, Any] = {"edgecolor": style.INK, "linewidth": 0.9, "zorder": 3}
EDGE: dict[str, Any] = {"edgecolor": style.PAPER, "linewidth": 0.8}


def stress_image(report: StressReport) -> bytes:
    """Return the picture as the bytes of a PNG."""
    return to_png(stress_figure(report), DPI)


@dataclass(frozen=True)
class _LadderBlock:
    """The ladder of one stress: where it stands, inches below the top of the panels."""

    stress: Stress
    top: float


@style.own_settings()
def stress_figure(report: StressReport) -> Figure:
    """Return the figure: from top to bottom the stresses, in each a line a pair of laws.

    A box is a run: its number the larger error of base and end effector in mm, its colour and its
    sign the verdict; the one with nothing stressed has a dark edge.

    Args:
        report: Of the battery.
    """
    from matplotlib.figure import Figure

    battery = report.battery
    laws = [str(law) for law in battery.laws]
    blocks, height = _blocks(report)
    names = [*laws, *(_title(stress) for stress in battery.stresses)]
    names += [PAIRS] if _has_pairs(report) else []
    notes = [f"{plant} plant, {told}" for plant in battery.plants for told in report.hanging(plant)]
    foot = FOOT_IN + NOTE_IN * len(notes)
    labels = 0.12 + max(text_width(name, SMALL_PT) for name in names)
    panel = BOX_IN * max(FEWEST, *(len(stress.levels) for stress in battery.stresses))
    width = 2 * MARGIN_IN + labels + (panel + GAP_IN) * len(battery.plants)
    widest = max(text_width(text, SMALL_PT) for text in (_subtitle(report), *notes))
    widest = max(widest, _key_width())
    width = max(width, MARGIN_IN + widest)
    full = HEAD_IN + height + foot
    figure = Figure((width, full))
    figure.set_facecolor(style.PAPER)
    for k, plant in enumerate(battery.plants):
        left = MARGIN_IN + labels + (panel + GAP_IN) * k
        place = (left / width, foot / full, panel / width, height / full)
        axes = figure.add_axes(place)
        _panel(axes, report, plant, blocks, (panel, height))
        if k == 0:
            _names(axes, blocks, laws, labels)
    _heading(figure, report, width, full)
    _key(figure, width, full)
    for k, note in enumerate(reversed(notes)):
        figure.text(MARGIN_IN / width, (FOOT_IN + NOTE_IN * (k - 0.3)) / full, literal(note),
                    fontsize=SMALL_PT, color=style.DESIRED)  # fmt: skip
    return figure


def _title(stress: Stress) -> str:
    return f"{stress.name}, {stress.unit}" if stress.unit else stress.name


def _blocks(report: StressReport) -> tuple[list[_LadderBlock], float]:
    """Return the ladders that any plant has from the top down, and their height, inches."""
    battery, blocks, top = report.battery, [], 0.0
    shown = {stress.name for plant in battery.plants for stress in battery.stresses_on(plant)}
    for stress in battery.stresses:
        if stress.name in shown:
            blocks.append(_LadderBlock(stress, top))
            top += LEVELS_IN + ROW_IN * len(battery.laws) + BLOCK_GAP_IN
    more = LEVELS_IN + ROW_IN * len(battery.laws) if _has_pairs(report) else 0.0
    return blocks, top + more


def _has_pairs(report: StressReport) -> bool:
    return any(report.combined(*pair) for pair in report.pairs())


def _panel(
    axes: Axes,
    report: StressReport,
    plant: str,
    blocks: Sequence[_LadderBlock],
    size: tuple[float, float],
) -> None:
    """Draw the ladders of one plant; where a stress means nothing it says why.

    Args:
        axes: Of the panel.
        report: Of the battery.
        plant: Kind of the plant.
        blocks: The ladders.
        size: Width and height, inches.
    """
    axes.set(xlim=(0.0, size[0]), ylim=(size[1], 0.0))
    axes.axis("off")
    axes.set_title(literal(f"{plant} plant"), loc="left", fontsize=TEXT_PT, fontweight="bold",
                   color=style.INK, pad=3)  # fmt: skip
    battery = report.battery
    for block in blocks:
        reason = battery.left_out.get((plant, block.stress.name))
        if reason is not None:
            middle = block.top + LEVELS_IN + 0.5 * ROW_IN * len(battery.laws)
            axes.text(0.02, middle, literal(f"– {reason}"), fontsize=LEVEL_PT, va="center",
                      color=style.DESIRED)  # fmt: skip
            continue
        _ladder(axes, report, plant, block)
    if _has_pairs(report):
        _pairs(axes, report, plant, size)


def _ladder(axes: Axes, report: StressReport, plant: str, block: _LadderBlock) -> None:
    """Draw one ladder: its levels, and below them a line of boxes for each pair of laws."""
    stress, box = block.stress, BOX_IN
    for i, level in enumerate(stress.levels):
        axes.text((i + 0.5) * box, block.top + 0.55 * LEVELS_IN, stress.text(level),
                  fontsize=LEVEL_PT, ha="center", va="center", color=style.DESIRED)  # fmt: skip
    for j, law in enumerate(report.battery.laws):
        top = block.top + LEVELS_IN + j * ROW_IN
        for i, level in enumerate(stress.levels):
            row = report.row(plant, law, stress, level)
            _box(axes, row.verdict.name, _text(row), (i * box, top), box, level == stress.nominal)


def _box(
    axes: Axes, verdict: str, text: str, corner: tuple[float, float], width: float, nominal: bool
) -> None:
    """Draw a box with its text.

    Args:
        axes: Of the panel.
        verdict: That fills it.
        text: What stands in it.
        corner: Its top left, inches.
        width: Its width, inches.
        nominal: Whether nothing is stressed.
    """
    from matplotlib.patches import Rectangle

    size = (width - 0.02, ROW_IN - 0.02) if nominal else (width, ROW_IN)
    shift = 0.01 if nominal else 0.0
    place = (corner[0] + shift, corner[1] + shift)
    edge = NOMINAL_EDGE if nominal else EDGE
    axes.add_patch(Rectangle(place, *size, facecolor=FILLS[verdict], **edge))
    axes.text(corner[0] + 0.5 * width, corner[1] + 0.54 * ROW_IN, text, fontsize=CELL_PT,
              ha="center", va="center", color=INKS[verdict], zorder=4,
              fontweight="bold" if verdict == FAIL else "normal")  # fmt: skip


def _text(row: StressRow) -> str:
    """Return the sign of a verdict and the error in mm, in few characters."""
    return f"{SIGNS[row.verdict.name]} {error_text(row.figures.error)}".strip()


def _pairs(axes: Axes, report: StressReport, plant: str, size: tuple[float, float]) -> None:
    """Draw bars: how many of the runs with two stresses at once pass, degrade and fail.

    Args:
        axes: Of the panel.
        report: Of the battery.
        plant: Kind of the plant.
        size: Of the panel, inches.
    """
    laws = report.battery.laws
    top = size[1] - ROW_IN * len(laws)
    for j, law in enumerate(laws):
        rows = report.combined(plant, law)
        left = 0.0
        for name in (*VERDICTS, REFUSED):
            count = sum(row.verdict.name == name for row in rows)
            if count:
                width = size[0] * count / len(rows)
                text = f"{SIGNS[name]} {count}".strip()
                _box(axes, name, text, (left, top + j * ROW_IN), width, False)
                left += width


def _names(axes: Axes, blocks: Sequence[_LadderBlock], laws: Sequence[str], width: float) -> None:
    """Write the stresses, and the laws of their lines, left of the first panel."""
    bold: dict[str, Any] = {"fontweight": "bold", "color": style.INK}
    titles = [(block.top, _title(block.stress)) for block in blocks]
    height = axes.get_ylim()[0]
    tops = {top for top, _ in titles}
    last = max(tops, default=0.0) + LEVELS_IN + ROW_IN * len(laws) + BLOCK_GAP_IN
    if height - last > 0.5 * ROW_IN:
        titles.append((last, PAIRS))
    for top, title in titles:
        axes.text(-width, top + 0.55 * LEVELS_IN, title, fontsize=SMALL_PT, va="center", **bold)
        for j, law in enumerate(laws):
            middle = top + LEVELS_IN + (j + 0.54) * ROW_IN
            axes.text(-0.06, middle, law, fontsize=LEVEL_PT, ha="right", va="center",
                      color=style.INK if j == 0 else style.DESIRED)  # fmt: skip


def _heading(figure: Figure, report: StressReport, width: float, height: float) -> None:
    battery = report.battery
    figure.text(MARGIN_IN / width, 1.0 - 0.1 / height,
                literal(f"{battery.robot.name}: envelope of each law"), va="top",
                fontsize=TEXT_PT + 1.0, fontweight="bold", color=style.INK)  # fmt: skip
    figure.text(MARGIN_IN / width, 1.0 - 0.27 / height, literal(_subtitle(report)), va="top",
                fontsize=SMALL_PT, color=style.DESIRED)  # fmt: skip


def _subtitle(report: StressReport) -> str:
    run = report.battery.run
    return f"error in mm, rms of the second half of {run.duration:g} s on {run.reference}"


def _key(figure: Figure, width: float, height: float) -> None:
    """Draw what the boxes mean."""
    axes = figure.add_axes((0.0, 0.0, 1.0, FOOT_IN / height))
    axes.set(xlim=(0.0, width), ylim=(FOOT_IN, 0.0))
    axes.axis("off")
    left = MARGIN_IN
    for name, word in KEYS.items():
        nominal = name == NOMINAL
        verdict, text = (PASS, "") if nominal else (name, SIGNS[name])
        _box(axes, verdict, text, (left, 0.14), 0.22, nominal)
        axes.text(left + 0.28, 0.14 + 0.54 * ROW_IN, word, fontsize=SMALL_PT, va="center",
                  color=style.INK)  # fmt: skip
        left += KEY_GAP_IN + text_width(word, SMALL_PT)


def _key_width() -> float:
    return sum(KEY_GAP_IN + text_width(word, SMALL_PT) for word in KEYS.values())
