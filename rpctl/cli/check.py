"""The command that proves an exported file again: ``rpctl check``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import CHECK_FAILED, JsonOption, LoadOptions
from rpctl.cli.proof_table import print_rows
from rpctl.cli.streams import print_json
from rpctl.cli.terminal import console, escape
from rpctl.engines.mujoco.check import MjcfCheck


def check_command(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="An MJCF file that `rpctl export` wrote.")
    ],
    options: LoadOptions,
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT",
            help="Compare with this robot, loaded with the options here; else with the one that "
            "the file holds.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Prove an exported file again and name what was edited; exit 1 if it is another robot now."""
    from rpctl.simulation.mjcf_file import check_mjcf

    os.environ.setdefault("MUJOCO_GL", "disable")  # it draws nothing here, and looks for displays
    given = None if robot is None else options.load(robot)
    found = check_mjcf(file, given, options.package_dirs)
    if as_json:
        print_json(found.to_dict())
    else:
        show_check(found)
    if not found.passed:
        raise typer.Exit(CHECK_FAILED)


def show_check(found: MjcfCheck) -> None:
    """Print what was edited, what was compared, and whether the certificate holds."""
    print_rows(found.checks, found.skipped, found.notes)
    out = console()
    for edit in found.edits:
        mark = "[bold red]edited[/]" if edit.matters else "[dim]edited, harmless[/]"
        out.print(f"{mark} {escape(edit.sentence)}")
    own = found.certificate
    said = f"{own.robot}, certificate {own.digest[:16]}, rpctl {own.made_with.get('rpctl', '?')}"
    if found.passed:
        out.print(
            f"[green]✓[/] [bold]holds[/]: the file is the robot that was exported: {escape(said)}"
        )
        return
    count = sum(edit.matters for edit in found.edits)
    why = f"{count} edit{'s' if count != 1 else ''} that can change the motion" if count else (
        ", ".join(check.name for check in found.checks if not check.passed) + " failed"
    )  # fmt: skip
    out.print(f"[bold red]✗[/] [bold]void[/]: {escape(why)}; {escape(said)}")
