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

from rpctl.cli.show_trial import trial_line, trial_table
from rpctl.drive.drive import TYPES_WITH_AXLE
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Certificate
from rpctl.robot.facts import facts
from rpctl.robot.model import Robot

SEVERITY_STYLES = {"error": "bold red", "warning": "yellow", "info": "dim"}
MAX_LISTED_NAMES = 8  # names that a line lists
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
    """Print what a robot is, how one can tell, and what is doubtful."""
    out, known = console(), facts(robot)
    drive = known["drive"]
    out.print(f"[bold]{escape(robot.name)}[/]  {escape(known['file'])}", soft_wrap=True)
    grid = Table.grid(padding=(0, 2))
    for label, text in (*_drive_rows(drive), *_robot_rows(known)):
        grid.add_row(f"[dim]{label}", text)
    out.print(grid)
    if drive["wheels"]:
        out.print()
        out.print(_wheel_table(drive["wheels"]))
        out.print(*_reasons(drive["wheels"]), sep="\n")
    for rows, table in ((drive["swivels"], _swivel_table), (known["joints"], _joint_table)):
        if rows:
            out.print()
            out.print(table(rows))
    remarks = [*_remarks(robot, known["idealised"])]
    if remarks:
        out.print()
        out.print(*remarks, sep="\n")


def _remarks(robot: Robot, idealised: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield markup for what is doubtful, what is idealised, and what was noticed."""
    for doubt in robot.drive.doubts:
        yield f"[yellow]doubt[/] {escape(doubt)}"
    for each in idealised:
        yield f"[dim]idealised[/] {escape(each['sentence'])}"
    contacts = find_contacts(ReducedDynamics(robot))
    for note in contacts.notes if contacts else ():
        yield f"[dim]ground[/] {escape(note)}"
    for finding in robot.findings:
        place = robot.description.path.name + (f":{finding.line}" if finding.line else "")
        style = SEVERITY_STYLES[finding.severity]
        yield f"[{style}]{finding.severity}[/] {escape(f'{place}: {finding.message}')}"


def _drive_rows(drive: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield a label and markup for the drive, its evidence, and its measures."""
    yield "drive", f"[bold]{drive['type']}[/]"
    for sentence in drive["evidence"]:
        yield "", escape(sentence)
    if drive["wheels"]:
        x, y = drive["point"]
        what = "centre of rotation" if drive["type"] == "skid-steer" else "middle of the axle"
        what = what if drive["type"] in TYPES_WITH_AXLE else "origin of the root link"
        yield "track", f"{drive['track']:.4g} m; P, the {what}, at ({x:.4g}, {y:.4g}) m"
        height = round(-drive["ground"], 6) + 0.0
        yield (
            "root link",
            f"forward at {drive['heading_deg']:.4g}°, {height:.4g} m above the ground",
        )


def _reasons(wheels: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield markup that tells why wheels are wheels, those with one reason together."""
    reasons: dict[str, list[str]] = {}
    for wheel in wheels:
        reasons.setdefault(wheel["why"], []).append(wheel["joint"])
    for why, names in reasons.items():
        who = ", ".join(names) if len(reasons) > 1 else "each"
        yield f"[dim]{escape(f'{who} {why}')}[/]"


def _wheel_table(wheels: Sequence[Mapping[str, Any]]) -> Table:
    table = Table("wheel", box=None, header_style="dim", padding=(0, 2, 0, 0))
    table.add_column("radius", justify="right")
    for heading in ("known from", "held by", "driven"):
        table.add_column(heading)
    for heading in ("velocity", "effort"):
        table.add_column(heading, justify="right")
    for wheel in wheels:
        table.add_row(
            escape(wheel["joint"]),
            f"{wheel['radius']:.4g} m",
            escape(wheel["source"]),
            escape(wheel["swivel"] or "root"),
            "yes" if wheel["driven"] else "no",
            _limit(wheel["velocity"], "rad/s"),
            _limit(wheel["effort"], "N·m"),
        )
    return table


def _swivel_table(swivels: Sequence[Mapping[str, Any]]) -> Table:
    headings = ("swivel", "role", "driven", "at x, y", "trail", "because")
    table = Table(*headings, box=None, header_style="dim", padding=(0, 2, 0, 0))
    for swivel in swivels:
        x, y = swivel["pivot"]
        table.add_row(
            escape(swivel["joint"]),
            swivel["role"],
            "yes" if swivel["driven"] else "no",
            f"{x:.4g}, {y:.4g} m",
            f"{-1e3 * swivel['trail']:.3g} mm" if swivel["trail"] else "-",
            escape(swivel["why"]),
        )
    return table


def _robot_rows(known: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield a label and markup for what is known of the whole robot."""
    yield "mass", f"{known['mass']:.4g} kg"
    arm = {joint["name"] for joint in known["joints"]}
    yield "dof", f"{known['dof']} quasi-velocities"
    for name in known["quasi_velocities"]:
        if name not in arm:
            yield "", escape(f"{name}: {known['meanings'][name]}")
    if arm:
        joints = _name_list([joint["name"] for joint in known["joints"]])
        lead = "and the" if len(arm) < known["dof"] else "the"
        yield "", f"{lead} rate{'s' * (len(arm) > 1)} of {joints}"
    yield "end effector", escape(known["end_effector"] or "none")
    if known["estimated_links"]:
        estimated = ", ".join(known["estimated_links"])
        yield "estimated", escape(f"mass and inertia of {estimated}")
    if known["locked"]:
        yield "locked", _name_list(list(known["locked"]))
    if known["mimics"]:
        yield "mimic", escape(", ".join(known["mimics"]))


def _name_list(names: Sequence[str]) -> str:
    """Return a list of names as markup, cut short where it is long."""
    listed = ", ".join(names[:MAX_LISTED_NAMES])
    more = len(names) - MAX_LISTED_NAMES
    return escape(listed) + (f" and {more} more (--json lists them)" if more > 0 else "")


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
    for check in certificate.declared:
        table.add_row("[yellow]![/]", check.name, check.against, f"{check.residual:.1e}", "-",
                      escape(check.entry))  # fmt: skip
    for skipped in certificate.skipped:
        table.add_row("[dim]-[/]", skipped.name, skipped.against, "-", "-", escape(skipped.note))
    out = console()
    out.print(table)
    if certificate.contact is not None:
        out.print(trial_table(certificate.contact, MARKS))
    for against, note in certificate.notes:
        out.print(f"[dim]note[/] {against}: {escape(note)}")
    if certificate.shared:
        out.print(f"[yellow]shared by all derivations[/] {escape('; '.join(certificate.shared))}")
    if certificate.estimated_links:
        names = ", ".join(certificate.estimated_links)
        out.print(f"[yellow]estimated[/] mass and inertia of {escape(names)}")
    for sentence in certificate.idealised:
        out.print(f"[dim]idealised[/] {escape(sentence)}")
    out.print(certificate_line(certificate))


def certificate_line(certificate: Certificate) -> str:
    """Return a certificate in one line of markup."""
    checks = certificate.checks
    trial = certificate.contact
    rows = checks if trial is None else checks + trial.checks
    failed = [f"{check.name} against {check.against}" for check in rows if not check.passed]
    drawn = f"{certificate.samples} random states, seed {certificate.seed}"
    count = f"{len(checks)} checks over {drawn}"
    if trial is not None:
        count += f"; {trial_line(trial)}"
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
        mark = "[yellow]ground[/]" if summary["could_slip"] else "ground"
        mark = "[bold red]ground[/]" if unsafe else mark
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
