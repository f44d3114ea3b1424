"""The contact trial on a terminal."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from rpctl.equivalence.contact.record import ContactTrial
from rpctl.equivalence.row import CONTACT_ORACLE


def trial_table(trial: ContactTrial, marks: dict[bool, str]) -> Table:
    """Return the rows of a trial: the largest gap of each kind, and its band."""
    title = f"against {CONTACT_ORACLE}"
    table = Table("", title, box=None, header_style="dim", padding=(0, 2, 0, 0))
    for heading in ("largest gap", "band", "of it"):
        table.add_column(heading, justify="right")
    table.add_column("where")
    for check in trial.checks:
        gap, band = check.format_value(check.gap), check.format_value(check.band)
        share, where = f"{100.0 * check.residual:.0f} %", f"at {check.time:.2f} s"
        entry = f"{check.entry} {where}" if check.entry else where
        table.add_row(marks[check.passed], check.name, gap, band, share, escape(entry))
    return table


def trial_line(trial: ContactTrial) -> str:
    """Return how far the robot rolled beside MuJoCo, and how close, in words."""
    apart = trial.path.format_value(trial.path.gap)
    return f"rolled {trial.distance:.2f} m in MuJoCo, at most {apart} apart"
