"""The command that proves the dynamics: ``rpctl verify``; and how a terminal shows a proof."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from rpctl.cli.ci import junit, junit_error, told
from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, tell
from rpctl.cli.terminal import console, escape, new_table, progress_bar
from rpctl.equivalence.certificate import CONTACT_ORACLE, Check, Skipped
from rpctl.equivalence.contact.trial import ContactTrial, Gap
from rpctl.equivalence.onset.trial import ASKEW, INSIDE, SAFE, WITHIN, WRONG, Onset, OnsetTrial
from rpctl.equivalence.scope import Condition
from rpctl.equivalence.verify import Certificate, verify
from rpctl.files.writing import require_writable, write_atomically
from rpctl.robot.model import Robot

MARKS = {True: "[green]✓[/]", False: "[bold red]✗[/]"}
VERDICTS = {
    WITHIN: "[green]✓[/]",
    INSIDE: "[green]✓[/]",
    SAFE: "[yellow]✓[/]",
    ASKEW: "[yellow]–[/]",
    WRONG: "[bold red]✗[/]",
}


@dataclass(frozen=True)
class VerifyOptions:
    """How thoroughly a robot is verified."""

    samples: Annotated[int, typer.Option(min=1, help="Number of random states.")] = 100
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random states.")] = 0
    engines: Annotated[
        str,
        typer.Option(metavar="mujoco|none", help="Physics engine to compare with, too."),
    ] = "mujoco"
    contact: Annotated[
        bool,
        typer.Option(
            "--contact",
            help="Also drive the robot on a plane in MuJoCo, as a free body, and compare.",
        ),
    ] = False
    onset: Annotated[
        bool,
        typer.Option(
            "--onset", help="Also make it slip and tip there, and compare with the predicted onset."
        ),
    ] = False
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the certificate as a page too.")
    ] = None
    junit: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the certificate as JUnit XML too, for a build server."
        ),
    ] = None


def verify_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: VerifyOptions,
    as_json: JsonOption = False,
) -> None:
    """Compare independent derivations of a robot's dynamics; exit 1 if they disagree."""
    if settings.html is not None:
        require_writable(settings.html)
    os.environ.setdefault("MUJOCO_GL", "disable")  # it draws nothing here, and looks for displays
    with told(settings.junit, partial(junit_error, robot)):
        certificate = certify(options.load(robot), settings, options.strict)
    if settings.junit is not None:
        write_atomically(settings.junit, junit(certificate))
    if settings.html is not None:
        from rpctl.view.pages.certificate import write_certificate

        write_certificate(certificate, settings.html)
    tell(as_json, certificate.to_dict, partial(show_certificate, certificate), certificate.passed)


def certify(robot: Robot, settings: VerifyOptions, strict: bool = False) -> Certificate:
    """Verify a robot, with a bar on a terminal.

    Args:
        robot: The robot.
        settings: How thoroughly.
        strict: Whether declared numbers that the shapes contradict fail.
    """
    engines = [] if settings.engines == "none" else settings.engines.split(",")
    samples = settings.samples
    with progress_bar("verify") as advance:
        certificate = verify(
            robot,
            samples,
            seed=settings.seed,
            engines=engines,
            progress=lambda done: advance(done, samples),
            trials=[name for name in ("contact", "onset") if getattr(settings, name)],
        )
    return certificate.strict() if strict else certificate


def show_certificate(certificate: Certificate) -> None:
    """Print every check of a certificate."""
    out = console()
    out.print(_rows(certificate.checks, certificate.skipped, certificate.declared, sampled=True))
    if certificate.contact is not None:
        out.print(_trial_table(certificate.contact))
    if certificate.onset is not None:
        print_onsets(certificate.onset)
    for against, note in certificate.notes:
        out.print(f"[dim]note[/] {against}: {escape(note)}")
    out.print(f"[yellow]scope[/] {escape(certificate.scope.line)}")
    for sentence in certificate.idealised:
        out.print(f"[dim]idealised[/] {escape(sentence)}")
    out.print(certificate_line(certificate))


def _trial_table(trial: ContactTrial) -> Table:
    """Return the rows of a contact trial: the largest gap of each kind, and its band."""
    table = new_table("", f"against {CONTACT_ORACLE}", ">largest gap", ">band", ">of it", "where")
    for check in trial.checks:
        gap, band = check.format_value(check.gap), check.format_value(check.band)
        share, where = f"{100.0 * check.residual:.0f} %", f"at {check.time:.2f} s"
        entry = f"{check.entry} {where}" if check.entry else where
        table.add_row(MARKS[check.passed], check.name, gap, band, share, escape(entry))
    return table


def certificate_line(certificate: Certificate) -> str:
    """Return a certificate in one line of markup."""
    checks = certificate.checks
    trial = certificate.contact
    rows = checks if trial is None else checks + trial.checks
    failed = [f"{check.name} against {check.against}" for check in rows if not check.passed]
    onset = certificate.onset
    failed += [onset_label(row) for row in onset.onsets if not row.passed] if onset else []
    count = (
        f"{len(checks)} checks over {certificate.samples} random states, seed {certificate.seed}"
    )
    if trial is not None:
        apart = trial.path.format_value(trial.path.gap)
        count += f"; rolled {trial.distance:.2f} m in MuJoCo, at most {apart} apart"
    if onset is not None:
        count += f"; {onset_line(onset)}"
    if failed:
        return f"{MARKS[False]} [bold]not verified[/]: {', '.join(failed)}; {count}"
    worst = certificate.worst
    return f"{MARKS[True]} [bold]verified[/]: {count}; nearest to its limit: {worst.name}, " \
        f"{worst.residual:.0e} of {worst.limit:.0e}"  # fmt: skip


def print_rows(checks: Iterable[Check], skipped: Iterable[Skipped], notes: Iterable[str]) -> None:
    """Print comparisons, those that were not made, and notes."""
    out = console()
    out.print(_rows(checks, skipped))
    for note in notes:
        out.print(f"[dim]note[/] {escape(note)}")


def _rows(
    checks: Iterable[Check],
    skipped: Iterable[Skipped],
    declared: Iterable[Check] = (),
    sampled: bool = False,
) -> Table:
    """Return a row for each comparison.

    Args:
        checks: What was compared.
        skipped: What could not be.
        declared: What is the user's word, and differs.
        sampled: Whether to tell the sample of the worst.
    """
    table = new_table("", "check", "against", ">worst", ">limit", "where")
    for check in checks:
        worst, limit = f"{check.residual:.1e}", f"{check.limit:.0e}"
        if isinstance(check, Gap):
            worst, limit = check.format_value(check.gap), check.format_value(check.band)
        where = check.entry + f" at sample {check.sample}" * sampled if check.residual > 0.0 else ""
        if isinstance(check, Condition):
            worst, limit, where = check.value, check.bound, check.entry
        table.add_row(MARKS[check.passed], check.name, check.against, worst, limit, escape(where))
    for check in declared:
        cells = (check.name, check.against, f"{check.residual:.1e}", "-", escape(check.entry))
        table.add_row("[yellow]![/]", *cells)
    for each in skipped:
        table.add_row("[dim]-[/]", each.name, each.against, "-", "-", escape(each.note))
    return table


def print_onsets(trial: OnsetTrial) -> None:
    """Print the table of a trial, and what was not tried."""
    table = new_table("", "manoeuvre", "until it", ">friction", ">predicted", ">measured", ">gap",
                      "verdict")  # fmt: skip
    for onset in trial.onsets:
        table.add_row(
            VERDICTS[onset.verdict],
            escape(onset.manoeuvre),
            onset.ending,
            f"{onset.friction:g}",
            _predicted(onset),
            _amount(onset.measured, onset.unit),
            f"{100.0 * onset.gap:+.1f} %",
            f"{WITHIN} {100.0 * onset.tolerance:g} %" if onset.verdict == WITHIN else onset.verdict,
        )
    out = console()
    out.print(table)
    for each in trial.untried:
        out.print(f"[dim]not tried[/] {escape(each.manoeuvre)} until it {each.ending}: {each.why}")
    for note in trial.notes:
        out.print(f"[dim]note[/] {escape(note)}")
    if not trial.determinate:
        out.print(
            "[dim]note[/] predictions assume equally stiff contacts; brackets give the range "
            "from where one load distribution slips to where all do"
        )


def onset_line(trial: OnsetTrial) -> str:
    """Return a trial in a few words."""
    worst = max((abs(row.gap) for row in trial.onsets if row.verdict == WITHIN), default=0.0)
    count = sum(row.verdict == WITHIN for row in trial.onsets)
    return f"slips and tips when predicted: {count} of {len(trial.onsets)} onsets within " \
        f"{100.0 * worst:.1f} %"  # fmt: skip


def onset_label(onset: Onset) -> str:
    """Return the name of an onset whose prediction is wrong."""
    predicted, measured = (_amount(x, onset.unit) for x in (onset.equal, onset.measured))
    return f"{onset.manoeuvre} until it {onset.ending} at {measured}, predicted at {predicted}"


def _predicted(onset: Onset) -> str:
    value = _amount(onset.equal, onset.unit)
    return value if onset.single else f"{value} ({onset.could:.3g} to {onset.would:.3g})"


def _amount(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}" if math.isfinite(value) else "never"
