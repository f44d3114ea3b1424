"""The benchmark: ``rpctl compare``."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from rpctl.cli.options import (
    REFERENCE_FIELDS,
    FieldOptions,
    JsonOption,
    LoadOptions,
    RobotArgument,
    default_folder,
    read_triple,
    split_names,
)
from rpctl.cli.streams import print_json
from rpctl.cli.terminal import console, escape, new_table, progress_bar
from rpctl.control.registry import DYNAMIC_LAWS
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.files.records import Plain
from rpctl.files.writing import require_writable, to_json, write_together
from rpctl.reference.sizing import SizingRequest, read_smoothing
from rpctl.simulation.config import RunSettings
from rpctl.simulation.merits.outcome import TRACKED
from rpctl.study.cells import run_cells
from rpctl.study.compare import (
    INITIAL_ERROR,
    MEASURES,
    PAPER,
    REFERENCES,
    SCENARIOS,
    TIE_RATIO,
    Benchmark,
    Cell,
    LawPair,
    Row,
    Verdict,
    best,
    controllers,
    grid,
    group_rows,
    proposed,
    verdicts,
)
from rpctl.study.executor import executor_for
from rpctl.study.stress_report import csv_literal

MM_PER_M, US_PER_S = 1e3, 1e6
DPI = 200
TABLE_WIDTH = 136  # characters that the table needs
AUTO = "auto"
SUFFIXES = (".json", ".csv", ".pdf", ".png")  # of the files


@dataclass(frozen=True)
class GridOptions:
    """The options that choose the runs: each law on each reference in each scenario."""

    laws: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help="Kinematic laws, or pairs as unified+bounded; all if not given.",
        ),
    ] = ""
    dynamic: Annotated[
        str,
        typer.Option(
            metavar="|".join((AUTO, *DYNAMIC_LAWS)),
            help="Dynamic law of kinematic laws that stand alone; auto takes the pairs that tell "
            "most.",
        ),
    ] = AUTO
    references: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE,...",
            help=f"References, as track takes them; {', '.join(REFERENCES)} if not given.",
        ),
    ] = ""
    scenarios: Annotated[
        str, typer.Option(metavar="NAME,...", help=f"Of {', '.join(SCENARIOS)}; all if not given.")
    ] = ""

    def cells(self) -> list[Cell]:
        """Return the runs, scenario by scenario.

        Raises:
            UnknownNameError: There is no such law, scenario or reference.
        """
        pairs = controllers(split_names(self.laws), None if self.dynamic == AUTO else self.dynamic)
        scenarios = split_names(self.scenarios) or list(SCENARIOS)
        for name in scenarios:
            if name not in SCENARIOS:
                raise UnknownNameError("scenario", name, SCENARIOS)
        references = split_names(self.references) or list(REFERENCES)
        for name in references:
            if name not in REFERENCES and not Path(name).suffix:
                raise UnknownNameError("reference", name, (*REFERENCES, "FILE.csv", "FILE.toml"))
        return grid(scenarios, references, pairs)


@dataclass(frozen=True)
class CompareOptions:
    """How each cell is run, and where the table goes."""

    duration: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="Of each run, s; as long as the laps take or the reference moves."
        ),
    ] = None
    sizing: Annotated[Plain, FieldOptions(RunSettings, REFERENCE_FIELDS)] = field(
        default_factory=dict
    )
    initial_error: Annotated[
        str, typer.Option(metavar="X,Y,THETA", help="Tracking error at the start, m, m, rad.")
    ] = ",".join(map(str, INITIAL_ERROR))
    jobs: Annotated[
        int, typer.Option(min=1, help="Processes; as many as there are processors.")
    ] = os.cpu_count() or 1
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write; runs/ROBOT-compare if not given."),
    ] = None


def compare_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    selection: GridOptions,
    settings: CompareOptions,
    as_json: JsonOption = False,
) -> None:
    """Compare pairs of laws over references and scenarios; write a table and a figure.

    A cell that cannot run says why in the table.
    """
    error = read_triple(settings.initial_error)
    cells = selection.cells()
    loaded = options.load(robot)
    folder = settings.out or default_folder(loaded.name, "compare")
    for suffix in SUFFIXES:
        require_writable(folder / f"compare{suffix}", makes_folder=True)
    bench = Benchmark(
        loaded,
        settings.duration,
        error,
        SizingRequest(*(settings.sizing.get(name) for name in REFERENCE_FIELDS[:3])),
        read_smoothing(settings.sizing.get("smooth")),
        bool(settings.sizing.get("retime")),
    )
    with (
        executor_for(min(settings.jobs, len(cells))) as executor,
        progress_bar("compare") as advance,
    ):
        rows = run_cells(bench, cells, executor, advance)
    if all(row.figures is None for row in rows):
        raise RpctlError(f"nothing ran: {rows[0].failure}")
    ours = proposed(loaded)
    summary = _summary(bench, rows, ours)
    _write(folder, summary, rows, ours)
    if as_json:
        print_json(summary)
    else:
        show_comparison(rows, ours, folder)


def _summary(bench: Benchmark, rows: Sequence[Row], ours: LawPair) -> dict[str, Any]:
    """Return all that is known of a benchmark, as JSON says it."""
    cells = [row.cell for row in rows]
    return {
        "robot": bench.robot.name,
        "duration": bench.duration,
        "initial_error": list(bench.initial_error),
        "scenarios": {cell.scenario: SCENARIOS[cell.scenario].summary for cell in cells},
        "controllers": list(dict.fromkeys(str(cell.controller) for cell in cells)),
        "ours": str(ours),
        "rows": [row.to_dict() for row in rows],
        "verdicts": [verdict.to_dict() for verdict in verdicts(rows, ours)],
    }


def _write(folder: Path, summary: Mapping[str, Any], rows: Sequence[Row], ours: LawPair) -> None:
    """Write the table as JSON and CSV, and the picture as PNG and PDF, all of one comparison."""
    from rpctl.view.plots.figures import to_pdf, to_png
    from rpctl.view.plots.study import study_figure

    figure = study_figure(rows, summary["robot"], ours)
    contents = {
        ".json": (to_json(summary) + "\n").encode(),
        ".csv": _csv(summary["rows"]).encode("utf-8", "backslashreplace"),
        ".pdf": to_pdf(figure),
        ".png": to_png(figure, DPI),
    }
    write_together(folder, {f"compare{suffix}": each for suffix, each in contents.items()})


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        cells = {**row, "violations": "; ".join(row["violations"] or ())}
        writer.writerow({name: csv_literal(cell) for name, cell in cells.items()})
    return text.getvalue()


def show_comparison(rows: Sequence[Row], ours: LawPair, folder: Path) -> None:
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


def _table(rows: Sequence[Row], ours: LawPair) -> Table:
    """Return the rows of one scenario; the least errors of working laws are green."""
    table = new_table(
        "reference", "law", ">base rms\nmm", ">final\nmm", ">e.e. rms\nmm", ">final\nmm",
        ">peak\neffort", ">rms\neffort", ">limits\nbroken", ">sample\nµs", ">99 %\nµs",
    )  # fmt: skip
    for column in table.columns:
        column.no_wrap = True
    for (_, reference), group in group_rows(rows):
        least = [best(group, measure) for measure in ("rms_base", "rms_end_effector")]
        for number, row in enumerate(group):
            name = escape(Path(reference).name) if number == 0 else ""
            law = row.cell.controller
            style = "bold" if law == ours else "default" if law == PAPER else "dim"
            table.add_row(name, f"[{style}]{law}[/]", *_figures(row, least))
    return table


def _figures(row: Row, least: Sequence[tuple[float, LawPair] | None]) -> list[str]:
    figures = row.figures
    if figures is None:
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
        f"{US_PER_S * figures.sample_time:.0f}",
        f"{US_PER_S * figures.sample_time_99:.0f}",
    ]


def _error_text(error: float | None, least: tuple[float, LawPair] | None) -> str:
    if error is None:
        return "-"
    summary = f"{MM_PER_M * error:.2f}"
    return f"[green]{summary}[/]" if least and error <= TIE_RATIO * least[0] else summary


def _show_notes(out: Console, rows: Sequence[Row]) -> None:
    """Print why cells did not run, or what became of them and what they broke; alike ones once."""
    notes: dict[tuple[LawPair, str], list[str]] = {}
    for row in rows:
        faults = _faults(row)
        if faults:
            notes.setdefault((row.cell.controller, faults), []).append(
                Path(row.cell.reference).name
            )
    for (controller, faults), references in notes.items():
        out.print(f"[dim]{controller}, {escape(', '.join(references))}:[/] {escape(faults)}")


def _faults(row: Row) -> str:
    """Return what a cell's run was short of, in words; nothing where it tracked within limits."""
    if row.figures is None:
        return f"did not run: {row.failure}"
    words = [] if row.figures.outcome == TRACKED else [row.figures.outcome]
    if row.figures.violations:
        words.append(f"broke {', '.join(row.figures.violations)}")
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
