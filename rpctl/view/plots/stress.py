"""The picture of a battery: each law's envelope, a ladder a stress, a panel a plant."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from rpctl.study.cells import REFUSED
from rpctl.study.stress_battery import Stress
from rpctl.study.stress_report import DEGRADE, FAIL, PASS, VERDICTS, StressReport, error_text
from rpctl.view.labels import fold, literal
from rpctl.view.palette import light
from rpctl.view.plots import style
from rpctl.view.plots.style import SMALL_PT, TEXT_PT

BOX_IN, ROW_IN, LEFT_IN, HEAD_IN, LEAST_IN = 0.43, 0.155, 1.5, 1.2, 5.2  # inches
LETTERS_PER_IN = 18.0  # of small text, at least
FEWEST = 5  # boxes that a panel has room for, at least
CELL_PT = SMALL_PT - 1.0
FILLS = {PASS: light("pass"), DEGRADE: light("degrade"), FAIL: light("fail"), REFUSED: style.PAPER}
INKS = {PASS: style.INK, DEGRADE: style.INK, FAIL: style.PAPER, REFUSED: style.DESIRED}
SIGNS = {PASS: "", DEGRADE: "~", FAIL: "×", REFUSED: "–"}
KEYS = {PASS: "passes", DEGRADE: "~ degrades", FAIL: "× fails", REFUSED: "– did not run"}
PAIRS = "two at once: how many"
NOMINAL_EDGE: dict[str, Any] = {"edgecolor": style.INK, "linewidth": 0.9, "zorder": 3}
EDGE: dict[str, Any] = {"edgecolor": style.PAPER, "linewidth": 0.8}


@style.own_settings()
def stress_figure(report: StressReport) -> Figure:
    """Return the figure: from top to bottom the stresses, in each a line a pair of laws.

    A box is a run: its number the larger error of base and end effector in mm, its colour and its
    sign the verdict; the one with nothing stressed has a dark edge.

    Args:
        report: Of the battery.
    """
    battery, laws = report.battery, [str(law) for law in report.battery.laws]
    shown = {stress.name for plant in battery.plants for stress in battery.stresses_on(plant)}
    stresses: list[Stress | None] = [each for each in battery.stresses if each.name in shown]
    stresses += [None] * any(report.combined(*pair) for pair in report.pairs())
    block = len(laws) + 1.5  # lines of a stress: its levels, the laws, a gap
    boxes = max(FEWEST, *(len(stress.levels) for stress in battery.stresses))
    width = max(LEAST_IN, LEFT_IN + boxes * BOX_IN * len(battery.plants))
    notes = [
        fold(f"{plant} plant, {told}", int(LETTERS_PER_IN * width))
        for plant in battery.plants
        for told in report.hanging(plant)
    ]
    lines = block * len(stresses) + "\n".join(notes).count("\n")
    figure = Figure((width, HEAD_IN + ROW_IN * lines), layout="constrained", facecolor=style.PAPER)
    panels = figure.subplots(1, len(battery.plants), squeeze=False, sharey=True)[0]
    for axes, plant in zip(panels, battery.plants, strict=True):
        axes.set(xlim=(0.0, boxes), ylim=(block * len(stresses), 0.0), xticks=[])
        axes.set_frame_on(False)
        axes.tick_params(length=0, labelsize=SMALL_PT)
        axes.set_title(f"{plant} plant", loc="left", **_bold(TEXT_PT))
        for k, stress in enumerate(stresses):
            _ladder(axes, report, plant, stress, block * k)
    _names(panels[0], stresses, laws)
    _words(figure, report, notes)
    return figure


def _bold(size: float) -> dict[str, Any]:
    return {"fontsize": size, "fontweight": "bold", "color": style.INK}


def _ladder(
    axes: Axes, report: StressReport, plant: str, stress: Stress | None, top: float
) -> None:
    """Draw a stress's levels, and below them a line of boxes for each pair of laws.

    Where the stress means nothing it says why; without one it is bars of how many of the runs with
    two stresses at once pass, degrade and fail.
    """
    battery = report.battery
    reason = battery.left_out.get((plant, stress.name)) if stress is not None else None
    look: dict[str, Any] = {"fontsize": CELL_PT, "va": "center", "color": style.DESIRED}
    if reason is not None:
        axes.text(0.0, top + 1.0 + 0.5 * len(battery.laws), literal(f"– {reason}"), **look)
        return
    for i, level in enumerate(stress.levels if stress is not None else ()):
        text = stress.text(level) if stress is not None else ""
        axes.text(i + 0.5, top + 0.5, text, ha="center", **look)
    for j, law in enumerate(battery.laws):
        if stress is None:
            _bar(axes, [row.verdict.name for row in report.combined(plant, law)], top + 1.0 + j)
            continue
        for i, level in enumerate(stress.levels):
            row, place = report.row(plant, law, stress, level), (i, top + 1.0 + j)
            error = error_text(row.figures.late_error)
            _box(axes, row.verdict.name, error, place, nominal=level == stress.nominal)


def _bar(axes: Axes, verdicts: list[str], top: float) -> None:
    left, boxes = 0.0, axes.get_xlim()[1]
    for name in (*VERDICTS, REFUSED):
        count = verdicts.count(name)
        if count:
            width = boxes * count / len(verdicts)
            _box(axes, name, str(count), (left, top), width)
            left += width


def _box(
    axes: Axes,
    verdict: str,
    text: str,
    corner: tuple[float, float],
    width: float = 1.0,
    nominal: bool = False,
) -> None:
    """Draw a box of a verdict with its text; its top left is at the corner."""
    edge = NOMINAL_EDGE if nominal else EDGE
    axes.add_patch(Rectangle(corner, width, 1.0, facecolor=FILLS[verdict], **edge))
    axes.text(corner[0] + 0.5 * width, corner[1] + 0.54, f"{SIGNS[verdict]} {text}".strip(),
              fontsize=CELL_PT, ha="center", va="center", color=INKS[verdict], zorder=4,
              fontweight="bold" if verdict == FAIL else "normal")  # fmt: skip


def _names(axes: Axes, stresses: list[Stress | None], laws: list[str]) -> None:
    """Write the stresses, and the laws of their lines, left of the first panel."""
    places: list[float] = []
    for k in range(len(stresses)):
        places += [k * (len(laws) + 1.5) + 0.5 + j for j in range(len(laws) + 1)]
    titles = [
        PAIRS if stress is None else f"{stress.name}, {stress.unit}".removesuffix(", ")
        for stress in stresses
    ]
    axes.set_yticks(places, [name for title in titles for name in (title, *laws)])
    for k, label in enumerate(axes.get_yticklabels()):
        label.set(**(_bold(SMALL_PT) if k % (len(laws) + 1) == 0 else {"color": style.DESIRED}))


def _words(figure: Figure, report: StressReport, notes: list[str]) -> None:
    """Write the heading, what the boxes mean, and where wheels hang."""
    run = report.battery.run
    told = f"error in mm, rms of the second half of {run.duration:g} s on {run.reference}"
    title = f"{report.battery.robot.name}: envelope of each law\n{told}"
    figure.suptitle(literal(title), x=0.01, ha="left", **_bold(TEXT_PT))
    edge: dict[str, Any] = {"edgecolor": style.DESIRED, "linewidth": 0.4}
    handles = [Patch(facecolor=FILLS[name], label=word, **edge) for name, word in KEYS.items()]
    handles.append(Patch(facecolor=FILLS[PASS], label="nothing stressed", edgecolor=style.INK))
    figure.legend(handles=handles, loc="outside lower left", ncols=5, frameon=False,
                  fontsize=SMALL_PT, handlelength=1.2, alignment="left",
                  title=literal("\n".join(notes)), title_fontsize=SMALL_PT)  # fmt: skip
