"""The command that writes the equations of motion: ``rpctl derive``."""

from __future__ import annotations

from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument
from rpctl.cli.streams import print_document, print_json
from rpctl.derive.write import derive


def derive_command(
    robot: RobotArgument,
    options: LoadOptions,
    form: Annotated[
        str, typer.Option("--format", metavar="text|latex|python|c", help="What to write.")
    ] = "text",
    parameters: Annotated[
        bool, typer.Option("--parameters", help="Keep masses and lengths as symbols.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write the reduced equations in closed form: to read, to publish, or as code."""
    text = derive(options.load(robot), form, parameters)
    if as_json:
        print_json({"robot": robot, "format": form, "text": text})
    else:
        print_document(text)
