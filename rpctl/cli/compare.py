"""The benchmark: ``rpctl compare``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from rpctl.cli.options import (
    REFERENCE_FIELDS,
    FieldOptions,
    JsonOption,
    LoadOptions,
    RobotArgument,
    read_triple,
    split_names,
    tell,
)
from rpctl.cli.results import run_shown, writable_folder, write_results
from rpctl.cli.terminal import console, escape, new_table
from rpctl.control.registry import DYNAMIC_LAWS
from rpctl.errors import UnknownNameError, require_known
from rpctl.files.records import Plain
from rpctl.reference.sizing import read_smoothing
from rpctl.robot.model import Robot
from rpctl.simulation.config import RunSettings
from rpctl.simulation.merits.outcome import TRACKED
from rpctl.study.cells import CellRunner, References, csv_text
from rpctl.study.compare import (
    INITIAL_ERROR,
    MEASURES,
    PAPER,
    REFERENCES,
    SCENARIOS,
    TIE_RATIO,
    CompareCell,
    CompareRow,
    LawPair,
    Verdict,
    best,
    controllers,
    grid,
    group_rows,
    proposed,
    row_dict,
    verdicts,
)

MM_PER_M, US_PER_S = 1e3, 1e6
TABLE_WIDTH = 136  # characters that the table needs
AUTO = "auto"
FILES = ("compare.json", "compare.csv", "compare.png", "compare.pdf")


@dataclass(frozen=True)
class GridOptions:
    """The options that choose the runs: each law on each reference in each scenario."""

    laws: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help="Kinematic laws, or pairs such as unified+bounded; default: all.",
        ),
    ] = ""
    dynamic: Annotated[
        str,
        typer.Option(
            metavar="|".join((AUTO, *DYNAMIC_LAWS)),
            help="Dynamic law for kinematic laws given without one; auto chooses it for each.",
        ),
    ] = AUTO
    references: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE,...",
            help=f"References, as for `rpctl track`; default: {', '.join(REFERENCES)}.",
        ),
    ] = ""
    scenarios: Annotated[
        str,
        typer.Option(metavar="NAME,...", help=f"Scenarios: {', '.join(SCENARIOS)}; default: all."),
    ] = ""

    def cells(self, robot: Robot, run: RunSettings) -> list[CompareCell]:
        """Return the runs of a robot, scenario by scenario.

        Raises:
            UnknownNameError: There is no such law, scenario or reference.
        """
        dynamic = None if self.dynamic == AUTO else self.dynamic
        pairs = controllers(split_names(self.laws), dynamic, robot)
        scenarios = split_names(self.scenarios) or list(SCENARIOS)
        require_known("scenario", scenarios, SCENARIOS)
        references = split_names(self.references) or list(REFERENCES)
        for name in references:
            if name not in REFERENCES and not Path(name).suffix:
                raise UnknownNameError("reference", name, (*REFERENCES, "FILE.csv", "FILE.toml"))
        return grid(robot, scenarios, references, pairs, run)


@dataclass(frozen=True)
class CompareOptions:
    """How each cell is run, and where the table goes."""

    duration: Annotated[
        float | None,
        typer.Option(metavar="S", help="Duration of each run, s; default: that of the reference."),
    ] = None
    sizing: Annotated[Plain, FieldOptions(RunSettings, REFERENCE_FIELDS)] = field(
        default_factory=dict
    )
    initial_error: Annotated[
        str, typer.Option(metavar="X,Y,THETA", help="Tracking error at the start, m, m, rad.")
    ] = ",".join(map(str, INITIAL_ERROR))
    workers: Annotated[
        int, typer.Option(min=1, help="Number of processes; default: one for each processor.")
    ] = os.cpu_count() or 1
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder to write to; default: runs/ROBOT-compare."),
    ] = None
    log: Annotated[bool, typer.Option("--log", help="Logarithmic axes in the figure.")] = False

    def run(self) -> RunSettings:
        """Return what all runs have in common."""
        sizing = {name: value for name, value in self.sizing.items() if value is not None}
        sizing["smooth"] = read_smoothing(sizing.get("smooth"))
        error = read_triple(self.initial_error)
        return RunSettings(duration=self.duration, initial_error=error, **sizing)


def compare_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    selection: GridOptions,
    settings: CompareOptions,
    as_json: JsonOption = False,
) -> None:
    """Compare pairs of laws over references and scenarios; write a table and a figure.

    The table gives the reason for each combination that cannot run.
    """
    run = settings.run()
    loaded = options.load(robot)
    cells = selection.cells(loaded, run)
    folder = writable_folder(settings.out, loaded.name, "compare", FILES)
    rows = run_shown("compare", CellRunner(References(loaded), timed=True), cells, settings.workers)
    ours = proposed(loaded)
    dicts = [row_dict(row) for row in rows]
    summary = {
        "robot": loaded.name,
        "duration": cells[0].run.duration,
        "initial_error": list(run.initial_error),
        "scenarios": {cell.scenario: SCENARIOS[cell.scenario].summary for cell in cells},
        "controllers": list(dict.fromkeys(str(cell.controller) for cell in cells)),
        "ours": str(ours),
        "rows": dicts,
        "verdicts": [verdict.to_dict() for verdict in verdicts(rows, ours)],
    }
    from rpctl.view.plots.study import study_figure  # imports Matplotlib

    figure = study_figure(rows, loaded.name, ours, settings.log)
    write_results(folder, FILES, summary, figure, csv_text(dicts, [*dicts[0]]))
    tell(as_json, lambda: summary, lambda: show_comparison(rows, ours, folder))


def show_comparison(rows: Sequence[CompareRow], ours: LawPair, folder: Path) -> None:
    """Print a table a scenario, who won, and where the files lie.

    Args:
        rows: The cells' figures.
        ours: The pair of laws whose verdicts are given.
        folder: Where the files lie.
    """
    out = console()
    if not out.is_terminal:
        out.width = TABLE_WIDTH
    for scenario in dict.fromkeys(row.cell.scenario for row in rows):
        out.print(f"\n[bold]{scenario}[/]: {SCENARIOS[scenario].summary}")
        shown = [row for row in rows if row.cell.scenario == scenario]
        out.print(_table(shown, ours))
        _show_notes(out, shown)
    _show_verdicts(out, verdicts(rows, ours), ours)
    out.print(f"wrote [bold]{escape(str(folder))}[/]: compare.json, .csv, .png, .pdf")


def _table(rows: Sequence[CompareRow], ours: LawPair) -> Table:
    """Return the rows of one scenario; the least errors of working laws are green."""
    table = new_table(
        "reference", "law", ">base rms\nmm", ">final\nmm", ">e.e. rms\nmm", ">final\nmm",
        ">peak\neffort", ">rms\neffort", ">limits\nbroken", ">sample\nµs", ">99 %\nµs",
    )  # fmt: skip
    for column in table.columns:
        column.no_wrap = True
    for (_, reference), group in group_rows(rows).items():
        least = [best(group, measure) for measure in ("rms_base", "rms_end_effector")]
        for number, row in enumerate(group):
            name = escape(Path(reference).name) if number == 0 else ""
            law = row.cell.controller
            style = "bold" if law == ours else "default" if law == PAPER else "dim"
            table.add_row(name, f"[{style}]{law}[/]", *_figures(row, least))
    return table


def _figures(row: CompareRow, least: Sequence[tuple[float, LawPair] | None]) -> list[str]:
    figures = row.figures
    if figures.failure is not None:
        return ["[dim]-[/]"] * 9
    broken, failed = len(figures.violations), not figures.succeeded
    return [
        _error_text(figures.rms_base, None if failed else least[0]),
        _error_text(figures.final_base, None),
        _error_text(figures.rms_end_effector, None if failed else least[1]),
        _error_text(figures.final_end_effector, None),
        *(
            "-" if share is None else f"{100 * share:.0f} %"
            for share in (figures.peak_effort, figures.rms_effort)
        ),
        f"[bold red]{broken}[/]" if broken else "0",
        *(
            f"{US_PER_S * (each or 0.0):.0f}"
            for each in (figures.sample_time, figures.sample_time_99)
        ),
    ]


def _error_text(error: float | None, least: tuple[float, LawPair] | None) -> str:
    if error is None:
        return "-"
    summary = f"{MM_PER_M * error:.2f}"
    return f"[green]{summary}[/]" if least and error <= TIE_RATIO * least[0] else summary


def _show_notes(out: Console, rows: Sequence[CompareRow]) -> None:
    """Print why cells did not run, or what became of them and what they broke; alike ones once."""
    notes: dict[tuple[LawPair, str], list[str]] = {}
    for row in rows:
        faults = _faults(row)
        if faults:
            notes.setdefault((row.cell.controller, faults), []).append(
                Path(row.cell.run.reference).name
            )
    for (controller, faults), references in notes.items():
        out.print(f"[dim]{controller}, {escape(', '.join(references))}:[/] {escape(faults)}")


def _faults(row: CompareRow) -> str:
    """Return what a cell's run was short of, in words; nothing where it tracked within limits."""
    figures = row.figures
    if figures.failure is not None:
        return f"did not run: {figures.failure}"
    words = [] if figures.outcome == TRACKED else [figures.outcome]
    if figures.violations:
        words.append(f"broke {', '.join(figures.violations)}")
    return "; ".join(words)


def _show_verdicts(out: Console, found: Sequence[Verdict], ours: LawPair) -> None:
    """Print how many cells the proposed controller won, and each that it did not."""
    if not found:
        return
    with_paper = [verdict for verdict in found if verdict.paper is not None]
    good = sum(not verdict.worse_than_paper for verdict in with_paper)
    out.print(f"\n[bold]{ours}[/] has the least rms error, or within 1 % of it, in "
              f"{sum(verdict.won for verdict in found)} of {len(found)} comparisons; where "
              f"{PAPER} works, it is at least as good in {good} of {len(with_paper)}")  # fmt: skip
    lost = [verdict for verdict in found if not verdict.won]
    if not lost:
        return
    table = new_table("not won", "", "", ">ours, mm", ">paper's", ">least", "by")
    for verdict in lost:
        own, paper, least = (
            "-" if error is None else f"{MM_PER_M * error:.2f}"
            for error in (verdict.ours, verdict.paper, verdict.best)
        )
        table.add_row(
            verdict.scenario,
            escape(Path(verdict.reference).name),
            MEASURES[verdict.measure],
            own,
            f"[yellow]{paper}[/]" if verdict.worse_than_paper else paper,
            least,
            str(verdict.by),
        )
    out.print(table)
