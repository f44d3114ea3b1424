"""The command that writes the equations of motion: ``rpctl derive``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument
from rpctl.cli.streams import print_document, print_json, say
from rpctl.derive.write import derive
from rpctl.files.writing import require_writable, write_atomically


def derive_command(
    robot: RobotArgument,
    options: LoadOptions,
    form: Annotated[
        str, typer.Option("--format", metavar="text|latex|python|c", help="What to write.")
    ] = "text",
    parameters: Annotated[
        bool, typer.Option("--parameters", help="Keep masses and lengths as symbols.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where to write, whole or not at all; else to stdout."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write the reduced equations in closed form: to read, to publish, or as code."""
    if out is not None:
        require_writable(out)
    text = derive(options.load(robot), form, parameters)
    if out is not None:
        write_atomically(out, text.encode())
    if as_json:
        print_json({"robot": robot, "format": form, "text": text})
    elif out is not None:
        say(f"wrote {out}")
    else:
        print_document(text)
