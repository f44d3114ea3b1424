"""What ``rpctl track`` prints of a run: errors, outcome, efforts, limits, and its files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from rpctl.cli.terminal import console, escape, format_limit, new_table
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.reference.fitting import too_weak
from rpctl.reference.motion import Reference
from rpctl.reference.sizing import Sizing
from rpctl.robot.model import Robot
from rpctl.simulation.merits.collision_facts import clearance_text, collision_texts
from rpctl.simulation.merits.outcome import LATE, TRACKED
from rpctl.simulation.merits.path_error import PathFigures, lag
from rpctl.simulation.merits.summary import EffortPeak, Summary

if TYPE_CHECKING:
    from rpctl.reference.recorded.recording import Recording
    from rpctl.view.run_folder import RunFolder


def show_reference(out: Console, robot: Robot, reference: Reference, strict: bool) -> None:
    """Print where a reference comes from, what was assumed, and what it asks too much.

    That is how large and fast a named one is, what became of the rows of a table, and which
    actuator cannot hold the robot.

    Args:
        strict: Whether to refuse a table that asks too much.

    Raises:
        RpctlError: It asks too much, and that is to be refused.
    """
    sizing: Sizing | None = getattr(reference, "sizing", None)
    recording: Recording | None = getattr(reference, "recording", None)
    if sizing is not None:
        out.print(escape(sizing.sentence))
        if sizing.assumed:
            out.print(f"[yellow]assumed[/] {escape(sizing.assumed)}")
    if recording is not None:
        for change in recording.changes:
            out.print(escape(change))
        if strict and recording.warnings:
            raise RpctlError("the reference asks too much: " + "; ".join(recording.warnings))
        for warning in recording.warnings:
            out.print(f"[bold red]beyond limits[/] {escape(warning)}")
    weak = too_weak(ReducedDynamics(robot), reference)
    if weak and sizing is None:  # a sizing says it itself
        out.print(f"[yellow]note[/] {escape(weak)}")


def show_summary(written: RunFolder, folder: Path) -> None:
    """Print the figures of merit of a run, and where its files lie."""
    out, summary = console(), written.summary
    _show_outcome(out, summary)
    out.print()
    out.print(_error_table(summary))
    if written.perturbed is not None:
        out.print(escape(f"expect, {written.perturbed['sentence']}"))
    out.print()
    out.print(_effort_table(summary.efforts))
    out.print()
    for broken in summary.limits_violated:
        out.print(f"[bold red]limit[/] {escape(broken.joint)} {broken.limit}: {broken.value:.4g}, "
                  f"limit {broken.allowed:.4g}, from {broken.first_time:.3g} s for "
                  f"{broken.duration:.2g} s")  # fmt: skip
    for bound in summary.limits_bound:
        out.print(f"[yellow]limit[/] {escape(bound.sentence)}")
    for collision in collision_texts(summary.collisions):
        out.print(f"[bold red]collision[/] {escape(collision)}")
    if summary.clearances:
        out.print(
            escape(f"smallest distance: {', '.join(map(clearance_text, summary.clearances))}")
        )
    for remark in summary.collision_notes:
        out.print(f"[yellow]note[/] {escape(remark)}")
    ground = summary.ground
    if ground.sentence is not None:
        mark = "[yellow]ground[/]" if ground.could_slip else "ground"
        mark = "[bold red]ground[/]" if ground.would_slip or ground.would_tip else mark
        out.print(f"{mark} {escape(ground.sentence)}")
    if summary.felt_ground is not None:
        out.print(f"plant {escape(summary.felt_ground.sentence)}")
    if summary.energy_sentence is not None:
        out.print(summary.energy_sentence)
    out.print(f"simulated {summary.realtime_factor:.1f} times faster than real time")
    for note in written.notes:
        out.print(f"[yellow]note[/] {escape(note)}")
    size = f"{written.report_bytes / 1e6:.1f} MB"
    out.print(f"report [bold]{escape(str(written.report))}[/], {size}   "
              f"(rpctl view {escape(str(folder))})")  # fmt: skip


def _error_table(summary: Summary) -> Table:
    """Return the errors against time, and those from the reference's path."""
    table = new_table(
        "tracking error", ">rms", ">final", ">largest in 2nd half", ">largest", ">speed"
    )

    def add(
        label: str, figures: Sequence[float | None], unit: str = "mm", speed: float = 0.0
    ) -> None:
        known = [f"{1e3 * figure:.3f} {unit}" for figure in figures if figure is not None]
        if known:
            table.add_row(escape(label), *known, f"{100.0 * speed:.0f} %" if speed else "")

    for label, key in (("base", "base"), ("end effector", "end_effector")):
        add(
            label, [getattr(summary, f"{each}_{key}_error") for each in ("rms", "final", "settled")]
        )
        path: PathFigures | None = getattr(summary, f"{key}_path")
        if path is not None:
            add("  off its path", (path.rms, path.final, path.settled))
    for joint in summary.joint_errors:
        unit = "mm" if joint.unit == "m" else "mrad"
        figures = joint.rms, joint.final, joint.settled, joint.largest
        add(joint.joint, figures, unit, joint.speed_ratio)
    return table


def _show_outcome(out: Console, summary: Summary) -> None:
    """Print what became of the run, how far it was behind, and what its numbers are worth."""
    style = {TRACKED: "green", LATE: "yellow"}.get(summary.outcome, "bold red")
    out.print(f"[{style}]{summary.outcome}[/] {escape(summary.outcome_sentence)}")
    name, path = "base", summary.base_path
    if summary.end_effector_path is not None and not path.length:
        name, path = "end effector", summary.end_effector_path  # of a base that stands
    out.print(f"{name} behind its reference by {lag(path.largest_lag, path.largest_lag_distance)} "
              f"at most, {lag(path.final_lag, path.final_lag_distance)} at the end")  # fmt: skip
    if summary.nominal:
        out.print("[dim]ideal plant: the simulated robot equals the controller's model[/]")


def _effort_table(efforts: Sequence[EffortPeak]) -> Table:
    table = new_table("effort", ">peak", ">limit", ">share", ">jump")
    for effort in efforts:
        share, limit = effort.ratio, effort.limit
        table.add_row(
            escape(effort.actuator),
            f"{effort.peak:.4g}",
            format_limit(limit, ""),
            *(f"{100 * x:.0f} %" if math.isfinite(limit) else "-" for x in (share, effort.chatter)),
            style="bold red" if share > 1.0 else "",
        )
    return table
