"""What the command line prints for people."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from rpctl.dynamics.contact import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Certificate
from rpctl.robot.facts import facts
from rpctl.robot.model import Robot

STYLES = {"error": "bold red", "warning": "yellow", "info": "dim"}
MARKS = {True: "[green]✓[/]", False: "[bold red]✗[/]"}


def console(stderr: bool = False) -> Console:
    """Return a console that neither colours paths nor breaks lines of piped text."""
    out = Console(stderr=stderr, highlight=False)
    return out if out.is_terminal else Console(stderr=stderr, highlight=False, width=140)


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on a terminal's stderr, nothing when piped; yields ``advance(done, total)``."""
    columns = TextColumn("{task.description:>9}"), BarColumn(), TimeElapsedColumn()
    out = Console(stderr=True)
    with Progress(*columns, console=out, transient=True, disable=not out.is_terminal) as progress:
        task = progress.add_task(label, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def show_robot(robot: Robot) -> None:
    """Print what a robot is."""
    out, known = console(), facts(robot)
    drive = known["drive"]
    out.print(f"[bold]{escape(robot.name)}[/]  {escape(known['file'])}")
    grid = Table.grid(padding=(0, 2))
    grid.add_row("[dim]drive", drive["type"])
    for wheel in drive["wheels"]:
        text = f"{wheel['joint']}: radius {wheel['radius']:.4g} m ({wheel['source']})"
        limits = f"{_limit(wheel['effort'], 'N·m')}, {_limit(wheel['velocity'], 'rad/s')}"
        grid.add_row("[dim]wheel", escape(f"{text}; {limits}"))
    if drive["wheels"]:
        x, y = drive["point"]
        grid.add_row("[dim]track", f"{drive['track']:.4g} m, midpoint P at ({x:.4g}, {y:.4g}) m, "
                     f"forward at {drive['heading_deg']:.4g}° of the root link")  # fmt: skip
    grid.add_row("[dim]mass", f"{known['mass']:.4g} kg")
    grid.add_row("[dim]dof", f"{known['dof']} quasi-velocities: "
                 + escape(", ".join(known["quasi_velocities"])))  # fmt: skip
    grid.add_row("[dim]end effector", escape(known["end_effector"] or "none"))
    if known["estimated_links"]:
        estimated = ", ".join(known["estimated_links"])
        grid.add_row("[dim]estimated", escape(f"mass and inertia of {estimated}"))
    if known["locked"]:
        grid.add_row("[dim]locked", escape(", ".join(known["locked"])))
    if known["mimics"]:
        grid.add_row("[dim]mimic", escape(", ".join(known["mimics"])))
    out.print(grid)
    if known["joints"]:
        out.print(_joint_table(known["joints"]))
    contacts = find_contacts(ReducedDynamics(robot))
    for note in contacts.notes if contacts else ():
        out.print(f"[dim]ground[/] {escape(note)}")
    for finding in robot.findings:
        place = robot.description.path.name + (f":{finding.line}" if finding.line else "")
        style = STYLES[finding.severity]
        out.print(f"[{style}]{finding.severity}[/] {escape(f'{place}: {finding.message}')}")


def _joint_table(joints: Sequence[Mapping[str, Any]]) -> Table:
    table = Table("joint", "type", box=None, header_style="dim", padding=(0, 2, 0, 0))
    for heading in ("lower", "upper", "velocity", "effort"):
        table.add_column(heading, justify="right")
    for joint in joints:
        slides = joint["type"] == "prismatic"
        unit, force = ("m", "N") if slides else ("rad", "N·m")
        table.add_row(
            escape(joint["name"]),
            joint["type"],
            _limit(joint["lower"], unit),
            _limit(joint["upper"], unit),
            _limit(joint["velocity"], f"{unit}/s"),
            _limit(joint["effort"], force),
        )
    return table


def show_certificate(certificate: Certificate) -> None:
    """Print every check of a certificate."""
    table = Table("", "check", "against", box=None, header_style="dim", padding=(0, 2, 0, 0))
    table.add_column("worst", justify="right")
    table.add_column("limit", justify="right")
    table.add_column("where")
    for check in certificate.checks:
        where = f"{check.entry} at sample {check.sample}" if check.residual > 0 else ""
        table.add_row(
            MARKS[check.passed],
            check.name,
            check.against,
            f"{check.residual:.1e}",
            f"{check.limit:.0e}",
            escape(where),
        )
    for skipped in certificate.skipped:
        table.add_row("[dim]-[/]", skipped.name, skipped.against, "-", "-", escape(skipped.note))
    out = console()
    out.print(table)
    for check in certificate.checks:
        if check.note:
            out.print(f"[dim]note[/] {check.against}: {escape(check.note)}")
    if certificate.estimated_links:
        names = ", ".join(certificate.estimated_links)
        out.print(f"[yellow]estimated[/] mass and inertia of {escape(names)}")
    out.print(certificate_line(certificate))


def certificate_line(certificate: Certificate) -> str:
    """Return a certificate in one line of markup."""
    made = certificate.checks
    failed = [f"{check.name} against {check.against}" for check in made if not check.passed]
    drawn = f"{certificate.samples} random states, seed {certificate.seed}"
    count = f"{len(made)} checks over {drawn}"
    if failed:
        return f"{MARKS[False]} [bold]not verified[/]: {', '.join(failed)}; {count}"
    worst = certificate.worst
    return f"{MARKS[True]} [bold]verified[/]: {count}; nearest to its limit: {worst.name}, " \
        f"{worst.residual:.0e} of {worst.limit:.0e}"  # fmt: skip


def show_summary(summary: Mapping[str, Any], folder: Path) -> None:
    """Print the figures of merit of a run, and where its files lie."""
    out = console()
    table = Table("tracking error", box=None, header_style="dim", padding=(0, 2, 0, 0))
    for heading in ("rms", "final", "largest in 2nd half"):
        table.add_column(heading, justify="right")
    for label, key in (("base", "base_error"), ("end effector", "end_effector_error")):
        figures = [summary[f"{when}_{key}"] for when in ("rms", "final", "settled")]
        if None not in figures:
            table.add_row(label, *(f"{1e3 * figure:.3f} mm" for figure in figures))
    for joint in summary["joint_errors"]:
        figures = [joint[when] for when in ("rms", "final", "settled")]
        unit = "mm" if joint["unit"] == "m" else "mrad"
        table.add_row(escape(joint["joint"]), *(f"{1e3 * figure:.3f} {unit}" for figure in figures))
    out.print(table)
    out.print()
    out.print(_effort_table(summary["efforts"]))
    out.print()
    for broken in summary["limits_violated"]:
        out.print(f"[bold red]limit[/] {escape(broken['joint'])} {broken['limit']}: "
                  f"{broken['value']:.4g} where {broken['allowed']:.4g} is allowed, from "
                  f"{broken['first_time']:.3g} s for {broken['duration']:.2g} s")  # fmt: skip
    for bound in summary["limits_bound"]:
        out.print(f"[yellow]limit[/] {escape(bound['told'])}")
    if summary["ground"] is not None:
        unsafe = summary["would_slip"] or summary["would_tip"]
        mark = "[bold red]ground[/]" if unsafe else "ground"
        out.print(f"{mark} {escape(summary['ground'])}")
    out.print(f"simulated {summary['realtime_factor']:.1f} times faster than real time")
    for note in summary["notes"]:
        out.print(f"[yellow]note[/] {escape(note)}")
    size = f"{summary['report_bytes'] / 1e6:.1f} MB"
    out.print(f"report [bold]{escape(str(summary['report']))}[/], {size}   "
              f"(rpctl view {escape(str(folder))})")  # fmt: skip


def _effort_table(efforts: Sequence[Mapping[str, Any]]) -> Table:
    table = Table("effort", box=None, header_style="dim", padding=(0, 2, 0, 0))
    for heading in ("peak", "limit", "share"):
        table.add_column(heading, justify="right")
    for effort in efforts:
        share, limit = effort["ratio"], effort["limit"]
        style = "bold red" if share > 1.0 else ""
        table.add_row(
            escape(effort["actuator"]),
            f"{effort['peak']:.4g}",
            _limit(limit, "").strip(),
            f"{100 * share:.0f} %" if math.isfinite(limit) else "-",
            style=style,
        )
    return table


def show_catalogue(rows: Sequence[Mapping[str, str]]) -> None:
    """Print the robots of the catalogue."""
    table = Table("name", "base", "what it is", box=None, header_style="dim", padding=(0, 2, 0, 0))
    for row in rows:
        table.add_row(row["name"], row["base"], escape(row["summary"]))
    console().print(table)


def _limit(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" if math.isfinite(value) else "-"
