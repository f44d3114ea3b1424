"""The command that identifies a robot's actuators: ``rpctl lag``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, tell
from rpctl.cli.terminal import console, escape, new_table
from rpctl.study.lag import MAX_DEAD_TIME, ActuatorLag, lag_from


def lag_command(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG",
            help="CSV with t and columns NAME_commanded and NAME_measured, or a run.npz.",
        ),
    ],
    max_dead_time: Annotated[
        float, typer.Option(metavar="S", help="Longest dead time to look for, s.")
    ] = MAX_DEAD_TIME,
    as_json: JsonOption = False,
) -> None:
    """Identify lag and dead time of a robot that takes speeds, from a step in a log."""
    found = lag_from(log, max_dead_time)
    tell(as_json, found.to_dict, partial(show_lag, found))


def show_lag(found: ActuatorLag) -> None:
    """Print what was identified of each speed, and of all together."""
    out, table = console(), new_table("speed", ">lag", ">dead time", ">left over")
    for each in found.channels:
        table.add_row(
            escape(each.name),
            f"{each.lag:.3g} s",
            f"{each.dead_time:.3g} s",
            f"{each.residual:.2g}",
        )
    out.print(table)
    for name, reason in found.left_out.items():
        out.print(f"[yellow]left out[/] {escape(name)}: {escape(reason)}")
    out.print(f"all together: {found.residual:.1%} of the motion is left over with\n"
              f"--output velocity --actuator-lag {found.lag:.3g} --dead-time "
              f"{found.dead_time:.3g}")  # fmt: skip
