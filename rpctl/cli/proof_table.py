"""The rows of a proof, as a terminal shows them."""

from __future__ import annotations

from collections.abc import Iterable

from rpctl.cli.terminal import console, escape, new_table
from rpctl.equivalence.check import Check, Skipped
from rpctl.equivalence.contact.trial import Gap

MARKS = {True: "[green]✓[/]", False: "[bold red]✗[/]"}


def print_rows(checks: Iterable[Check], skipped: Iterable[Skipped], notes: Iterable[str]) -> None:
    """Print comparisons, those that were not made, and notes.

    Args:
        checks: What was compared.
        skipped: What could not be.
        notes: What else there is to say.
    """
    table = new_table("", "check", "against", ">worst", ">limit", "where")
    for check in checks:
        worst, limit = f"{check.residual:.1e}", f"{check.limit:.0e}"
        if isinstance(check, Gap):
            worst, limit = check.format_value(check.gap), check.format_value(check.band)
        where = check.entry if check.residual > 0.0 else ""
        table.add_row(MARKS[check.passed], check.name, check.against, worst, limit, escape(where))
    for each in skipped:
        table.add_row("[dim]-[/]", each.name, each.against, "-", "-", escape(each.note))
    out = console()
    out.print(table)
    for note in notes:
        out.print(f"[dim]note[/] {escape(note)}")
