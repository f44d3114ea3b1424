"""What joints and actuators can do: ``rpctl tune`` their bandwidth, ``rpctl lag`` their lag."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, tell
from rpctl.cli.terminal import console, escape, new_table, progress_bar
from rpctl.control.bandwidth import USUAL_PERIOD, usual_gains
from rpctl.control.registry import gains_sentence
from rpctl.errors import RpctlError, require_positive
from rpctl.robot.model import Robot
from rpctl.simulation.config import RunSettings
from rpctl.study.cells import CellRunner, References, run_cells
from rpctl.study.executor import Executor
from rpctl.study.lag import MAX_DEAD_TIME, ActuatorLag, lag_from
from rpctl.study.optimise import SECONDS, row_dict, tune_cells, tuning_bandwidths


def tune_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    reference: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="Reference, as for `rpctl track`.")
    ] = "eight",
    bandwidth: Annotated[
        str,
        typer.Option(
            metavar="HZ,...",
            help="Bandwidths to try, Hz; default: a quarter to four times the usual one.",
        ),
    ] = "",
    duration: Annotated[
        float, typer.Option(metavar="S", help="Duration of each run, s.")
    ] = SECONDS,
    as_json: JsonOption = False,
) -> None:
    """Compare bandwidths of the arm's joints: error, stiffness, effort, tolerated delay.

    Tries each on a robot 10 % heavier than its model whose efforts act 5 ms late. Exit 1 if none
    tracks within all limits.
    """
    require_positive("--duration", duration)
    loaded = options.load(robot)
    loaded.require_level()
    tried = _read(bandwidth) if bandwidth else tuning_bandwidths(loaded)
    cells = tune_cells(loaded, tried, RunSettings(reference, duration))
    with progress_bar("tune") as advance:
        rows = run_cells(CellRunner(References(loaded)), cells, Executor(), advance)
    results = [row_dict(loaded, row) for row in rows]
    found = {
        "robot": loaded.name,
        "reference": reference,
        "duration": duration,
        "bandwidths": results,
    }
    tell(
        as_json,
        lambda: found,
        lambda: _show(loaded, results),
        any(result["succeeded"] for result in results),
    )


def _read(text: str) -> tuple[float, ...]:
    """Return the numbers of a list by commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise RpctlError(f"--bandwidth {text}: give numbers in Hz, such as 3,6,12") from None


def _show(robot: Robot, results: Sequence[Mapping[str, Any]]) -> None:
    console().print(escape(gains_sentence(usual_gains(USUAL_PERIOD))))
    table = new_table(
        "bandwidth", ">h", ">h1", ">k", ">least stiffness", ">tolerated delay",
        ">peak effort", ">joint error", "outcome",
    )  # fmt: skip
    for each in results:
        effort, error = each["effort_ratio"], each["joint_error"]
        table.add_row(
            f"{each['bandwidth']:.2g} Hz",
            f"{each['horizon']:.2g} s",
            f"{each['horizon_dyn']:.2g} s",
            f"{each['gain']:.2g} 1/s",
            f"{each['stiffness']:.2g} N m/rad",
            f"{1e3 * each['lateness']:.2g} ms",
            "-" if effort is None else f"{100.0 * effort:.0f} %",
            "-" if error is None else f"{1e3 * error:.2g} mrad",
            escape(each["outcome"]),
            style="" if each["succeeded"] else "bold red",
        )
    console().print(table)


def lag_command(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG",
            help="A CSV file with columns t, NAME_commanded and NAME_measured, or a run.npz.",
        ),
    ],
    max_dead_time: Annotated[
        float, typer.Option(metavar="S", help="Longest dead time to try, s.")
    ] = MAX_DEAD_TIME,
    as_json: JsonOption = False,
) -> None:
    """Identify lag and dead time of a robot that takes speeds, from a step in a log."""
    found = lag_from(log, max_dead_time=max_dead_time)
    tell(as_json, found.to_dict, partial(show_lag, found))


def show_lag(found: ActuatorLag) -> None:
    """Print what was identified of each speed, and of all together."""
    out, table = console(), new_table("speed", ">lag", ">dead time", ">residual")
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
    out.print(f"all together, with a residual of {found.residual:.1%} of the motion:\n"
              f"--output velocity --actuator-lag {found.lag:.3g} --dead-time "
              f"{found.dead_time:.3g}")  # fmt: skip
