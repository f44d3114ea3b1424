"""The trial of slip and tipping predictions, in words."""

from __future__ import annotations

import math

from rpctl.cli.terminal import console, escape, new_table
from rpctl.equivalence.onset.trial import ASKEW, INSIDE, SAFE, WITHIN, WRONG, Onset, OnsetTrial

VERDICTS = {
    WITHIN: "[green]✓[/]",
    INSIDE: "[green]✓[/]",
    SAFE: "[yellow]✓[/]",
    ASKEW: "[yellow]–[/]",
    WRONG: "[bold red]✗[/]",
}


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
        out.print(f"[dim]untried[/] {escape(each.manoeuvre)} until it {each.ending}: {each.why}")
    for note in trial.notes:
        out.print(f"[dim]note[/] {escape(note)}")
    if not trial.determinate:
        out.print(
            "[dim]note[/] a prediction is that of equally stiff contacts; in brackets from where "
            "one split of the load slips, to where all of them do"
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
    if onset.single:
        return value
    return f"{value} ({onset.could:.3g} to {onset.would:.3g})"


def _amount(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}" if math.isfinite(value) else "never"
