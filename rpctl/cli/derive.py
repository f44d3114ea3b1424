"""The command that writes the equations of motion: ``rpctl derive``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument
from rpctl.cli.streams import print_document, print_json, say
from rpctl.control.bandwidth import USUAL_PERIOD
from rpctl.derive.law import derive_law
from rpctl.derive.write import derive
from rpctl.errors import RpctlError
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
    law: Annotated[
        str | None,
        typer.Option(
            metavar="paper|unified",
            help="Write this kinematic law, its derivative and a dynamic law, down to the efforts; "
            "as C, a controller in one file.",
        ),
    ] = None,
    dynamic: Annotated[
        str, typer.Option(metavar="paper", help="The dynamic law, with --law.")
    ] = "paper",
    precision: Annotated[
        str, typer.Option(metavar="double|float", help="Numbers of the law in C, with --law.")
    ] = "double",
    period: Annotated[
        float,
        typer.Option(
            "--control-period",
            metavar="SECONDS",
            help="Of the loop that will run the law; the joints' prediction times follow from it.",
        ),
    ] = USUAL_PERIOD,
    as_json: JsonOption = False,
) -> None:
    """Write the reduced equations, or a law, in closed form: to read, to publish, or as code."""
    if out is not None:
        require_writable(out)
    shown: dict[str, object] = {"robot": robot, "format": form}
    if law is None:
        _require_law(dynamic, precision)
        text, cost = derive(options.load(robot), form, parameters), None
    elif parameters:
        raise RpctlError("--law has numbers only; leave --parameters out")
    else:
        text, cost = derive_law(options.load(robot), law, dynamic, form, precision, period)
        shown |= {"law": law, "dynamic": dynamic, "operations": cost and asdict(cost)}
    if out is not None:
        write_atomically(out, text.encode())
    if as_json:
        print_json({**shown, "text": text})
    elif out is not None:
        say(f"wrote {out}" + (f"; at most {cost} a sample" if cost else ""))
    else:
        print_document(text)


def _require_law(dynamic: str, precision: str) -> None:
    """Refuse options that only a law has."""
    given = {"--dynamic": dynamic != "paper", "--precision": precision != "double"}
    for name in (option for option, changed in given.items() if changed):
        raise RpctlError(f"{name} is of a law; give --law unified too")
