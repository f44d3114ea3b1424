"""The benchmark: ``rpctl compare``."""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from rpctl.cli.options import (
    DensityOption,
    DriveOption,
    JsonOption,
    LockOption,
    PackageDirOption,
    RobotArgument,
    StrictOption,
    load_robot,
    read_triple,
)
from rpctl.cli.show import console, progress_bar
from rpctl.control.dynamic import DYNAMIC_LAWS
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.files.writing import to_json, write_atomically
from rpctl.study.scenarios import PAPER, SCENARIOS, Controller, controllers, proposed
from rpctl.study.standings import MEASURES, TIE, Verdict, best, places, verdicts
from rpctl.study.study import INITIAL_ERROR, REFERENCES, Bench, Row, grid, run_grid

MILLI, MICRO = 1e3, 1e6
DPI = 200
WIDTH = 136  # characters that the table needs
AUTO = "auto"


def compare_command(
    robot: RobotArgument,
    lock: LockOption = None,
    drive: DriveOption = None,
    density: DensityOption = None,
    strict: StrictOption = False,
    package_dir: PackageDirOption = None,
    laws: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help="Kinematic laws, or pairs as unified+bounded; all if not given.",
        ),
    ] = "",
    dynamic: Annotated[
        str,
        typer.Option(
            metavar="|".join((AUTO, *DYNAMIC_LAWS)),
            help="Dynamic law of kinematic laws that stand alone; auto takes the pairs that tell "
            "most.",
        ),
    ] = AUTO,
    references: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE,...",
            help=f"References, as track takes them; {', '.join(REFERENCES)} if not given.",
        ),
    ] = "",
    scenarios: Annotated[
        str, typer.Option(metavar="NAME,...", help=f"Of {', '.join(SCENARIOS)}; all if not given.")
    ] = "",
    duration: Annotated[
        float | None,
        typer.Option(metavar="S", help="Of each run, s; as long as the reference moves, or 20."),
    ] = None,
    initial_error: Annotated[
        str, typer.Option(metavar="X,Y,THETA", help="Tracking error at the start, m, m, rad.")
    ] = ",".join(map(str, INITIAL_ERROR)),
    jobs: Annotated[
        int, typer.Option(min=1, help="Processes; as many as there are processors.")
    ] = os.cpu_count() or 1,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write; runs/ROBOT-compare if not given."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run laws on references under trouble; write a table and a picture of all their errors.

    A cell that cannot run says why in the table.
    """
    error = read_triple(initial_error)
    chosen = controllers(_words(laws), None if dynamic == AUTO else dynamic)
    troubles = _words(scenarios) or list(SCENARIOS)
    for name in troubles:
        if name not in SCENARIOS:
            raise UnknownNameError("scenario", name, SCENARIOS)
    paths = _words(references) or list(REFERENCES)
    for name in paths:
        if name not in REFERENCES and not Path(name).suffix:
            raise UnknownNameError("reference", name, (*REFERENCES, "FILE.csv", "FILE.toml"))
    loaded = load_robot(robot, drive, lock, density, strict, package_dir)
    folder = out or Path("runs") / re.sub(r"[^\w.-]", "_", f"{loaded.name}-compare")
    cells = grid(troubles, paths, chosen)
    bench = Bench(loaded, duration, error)
    with progress_bar("compare") as advance:
        rows = run_grid(bench, cells, min(jobs, len(cells)), advance)
    if all(row.figures is None for row in rows):
        raise RpctlError(f"nothing ran: {rows[0].failure}")
    ours = proposed(loaded)
    told = {
        "robot": loaded.name,
        "duration": bench.duration,
        "initial_error": list(error),
        "scenarios": {name: SCENARIOS[name].told for name in troubles},
        "controllers": list(map(str, chosen)),
        "ours": str(ours),
        "rows": [row.to_dict() for row in rows],
        "verdicts": [verdict.to_dict() for verdict in verdicts(rows, ours)],
    }
    _write(folder, told, rows, ours)
    if as_json:
        typer.echo(to_json(told))
    else:
        show(rows, ours, folder)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _write(folder: Path, told: Mapping[str, Any], rows: Sequence[Row], ours: Controller) -> None:
    """Write the table as JSON and CSV, and the picture as PNG and PDF."""
    from rpctl.view.plots.figures import to_pdf, to_png
    from rpctl.view.plots.study import study_figure

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RpctlError(f"{folder}: cannot be made: {error.strerror or error}") from None
    write_atomically(folder / "compare.json", (to_json(told) + "\n").encode())
    write_atomically(folder / "compare.csv", _csv(told["rows"]).encode())
    figure = study_figure(rows, told["robot"], ours)
    write_atomically(folder / "compare.pdf", to_pdf(figure))
    write_atomically(folder / "compare.png", to_png(figure, DPI))


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({**row, "violations": "; ".join(row["violations"] or ())})
    return text.getvalue()


def show(rows: Sequence[Row], ours: Controller, folder: Path) -> None:
    """Print a table a scenario, who won, and where the files lie."""
    out = console()
    if not out.is_terminal:
        out.width = WIDTH
    for scenario in dict.fromkeys(row.cell.scenario for row in rows):
        out.print(f"\n[bold]{scenario}[/]: {SCENARIOS[scenario].told}")
        shown = [row for row in rows if row.cell.scenario == scenario]
        out.print(_table(shown, ours))
        _show_notes(out, shown)
    _show_verdicts(out, verdicts(rows, ours), ours)
    out.print(f"wrote [bold]{escape(str(folder))}[/]: compare.json, .csv, .png, .pdf")


def _table(rows: Sequence[Row], ours: Controller) -> Table:
    """Return the rows of one scenario; the least errors of working laws are green."""
    table = Table("reference", "law", box=None, header_style="dim", padding=(0, 2, 0, 0))
    table.columns[0].no_wrap = table.columns[1].no_wrap = True
    for heading in ("base rms\nmm", "final\nmm", "e.e. rms\nmm", "final\nmm", "peak\neffort",
                    "rms\neffort", "limits\nbroken", "sample\nµs", "99 %\nµs"):  # fmt: skip
        table.add_column(heading, justify="right", no_wrap=True)
    for (_, reference), group in places(rows):
        least = [best(group, measure) for measure in ("rms_base", "rms_end_effector")]
        for number, row in enumerate(group):
            name = escape(Path(reference).name) if number == 0 else ""
            law = row.cell.controller
            style = "bold" if law == ours else "default" if law == PAPER else "dim"
            table.add_row(name, f"[{style}]{law}[/]", *_figures(row, least))
    return table


def _figures(row: Row, least: Sequence[tuple[float, Controller] | None]) -> list[str]:
    figures = row.figures
    if figures is None:
        return ["[dim]-[/]"] * 9
    broken = len(figures.violations)
    return [
        _error(figures.rms_base, None if broken else least[0]),
        _error(figures.final_base, None),
        _error(figures.rms_end_effector, None if broken else least[1]),
        _error(figures.final_end_effector, None),
        *(
            "-" if share is None else f"{100 * share:.0f} %"
            for share in (figures.peak_effort, figures.rms_effort)
        ),
        f"[bold red]{broken}[/]" if broken else "0",
        f"{MICRO * figures.sample_time:.0f}",
        f"{MICRO * figures.sample_time_99:.0f}",
    ]


def _error(error: float | None, least: tuple[float, Controller] | None) -> str:
    if error is None:
        return "-"
    told = f"{MILLI * error:.2f}"
    return f"[green]{told}[/]" if least and error <= TIE * least[0] else told


def _show_notes(out: Console, rows: Sequence[Row]) -> None:
    """Print why cells did not run and which limits were broken, alike ones together."""
    notes: dict[tuple[Controller, str], list[str]] = {}
    for row in rows:
        told = f"did not run: {row.failure}"
        if row.figures is not None:
            told = f"broke {', '.join(row.figures.violations)}"
        if row.figures is None or row.figures.violations:
            notes.setdefault((row.cell.controller, told), []).append(Path(row.cell.reference).name)
    for (controller, told), references in notes.items():
        out.print(f"[dim]{controller}, {escape(', '.join(references))}:[/] {escape(told)}")


def _show_verdicts(out: Console, found: Sequence[Verdict], ours: Controller) -> None:
    """Print how many cells the proposed controller won, and each that it did not."""
    if not found:
        return
    met = [verdict for verdict in found if verdict.paper is not None]
    good = sum(not verdict.worse_than_paper for verdict in met)
    out.print(f"\n[bold]{ours}[/] has the least rms error, or within 1 % of it, in "
              f"{sum(verdict.won for verdict in found)} of {len(found)} comparisons; where "
              f"{PAPER} works, it is at least as good in {good} of {len(met)}")  # fmt: skip
    lost = [verdict for verdict in found if not verdict.won]
    if not lost:
        return
    table = Table("not won", "", "", box=None, header_style="dim", padding=(0, 2, 0, 0))
    for heading in ("ours, mm", "paper's", "least"):
        table.add_column(heading, justify="right")
    table.add_column("by")
    for verdict in lost:
        own, paper, least = (
            "-" if error is None else f"{MILLI * error:.2f}"
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
