"""The commands about files of robots: ``rpctl expand`` and ``rpctl robots``. They load no robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from rpctl.cli.options import JsonOption, PackageDirOption, XacroArgsOption
from rpctl.cli.terminal import console, new_table, print_json
from rpctl.cli.words import read_words
from rpctl.description.expansion import expand
from rpctl.description.read_settings import read_settings
from rpctl.errors import format_finding
from rpctl.robot.catalog import ENTRIES


def expand_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A .xacro file. It is evaluated.")],
    package_dir: PackageDirOption = None,
    words: XacroArgsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print the URDF that a .xacro becomes; the lines of messages are those of this text."""
    expansion = expand(file, read_settings(package_dir or (), read_words(words)))
    for finding in expansion.findings:
        typer.echo(format_finding(str(file), finding), err=True)
    if as_json:
        print_json({"file": str(file), "text": expansion.text})
    else:
        typer.echo(expansion.text, nl=False)


def robots_command(as_json: JsonOption = False) -> None:
    """List the catalogue: the project's own robots and those of example-robot-data."""
    if as_json:
        print_json(
            [
                {"name": e.name, "base": e.base, "summary": e.summary, "file": str(e.path)}
                for e in ENTRIES
            ]
        )
        return
    table = new_table("name", "base", "what it is")
    for entry in ENTRIES:
        table.add_row(entry.name, entry.base, escape(entry.summary))
    console().print(table)
