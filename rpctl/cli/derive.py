"""The command that writes the equations of motion: ``rpctl derive``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument
from rpctl.cli.streams import print_document, print_json, say
from rpctl.control.bandwidth import USUAL_PERIOD
from rpctl.errors import RpctlError
from rpctl.files.writing import require_writable, write_atomically


@dataclass(frozen=True)
class DeriveOptions:
    """What is written of a robot, and where."""

    form: Annotated[
        str, typer.Option("--format", metavar="text|latex|python|c", help="What to write.")
    ] = "text"
    parameters: Annotated[
        bool, typer.Option("--parameters", help="Keep masses and lengths as symbols.")
    ] = False
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Where to write, whole or not at all; else to stdout."),
    ] = None
    law: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.py:CLASS",
            help="Write this kinematic law, its derivative and a dynamic law, down to the efforts; "
            "as C, a controller in one file.",
        ),
    ] = None
    dynamic: Annotated[str, typer.Option(metavar="paper", help="The dynamic law, with --law.")] = (
        "paper"
    )
    precision: Annotated[
        str, typer.Option(metavar="double|float", help="Numbers of the law in C, with --law.")
    ] = "double"
    period: Annotated[
        float,
        typer.Option(
            "--control-period",
            metavar="SECONDS",
            help="Of the loop that will run the law; the joints' prediction times follow from it.",
        ),
    ] = USUAL_PERIOD


def derive_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: DeriveOptions,
    as_json: JsonOption = False,
) -> None:
    """Write the reduced equations, or a law, in closed form: to read, to publish, or as code."""
    from rpctl.derive.write import derive, derive_law  # SymPy takes long to import

    if settings.out is not None:
        require_writable(settings.out)
    shown: dict[str, object] = {"robot": robot, "format": settings.form}
    if settings.law is None:
        _require_law(settings.dynamic, settings.precision)
        text, cost = derive(options.load(robot), settings.form, settings.parameters), None
    elif settings.parameters:
        raise RpctlError("--law has numbers only; leave --parameters out")
    else:
        text, cost = derive_law(
            options.load(robot),
            settings.law,
            settings.dynamic,
            settings.form,
            settings.precision,
            settings.period,
        )
        shown |= {
            "law": settings.law,
            "dynamic": settings.dynamic,
            "operations": cost and asdict(cost),
        }
    if settings.out is not None:
        write_atomically(settings.out, text.encode())
    if as_json:
        print_json({**shown, "text": text})
    elif settings.out is not None:
        say(f"wrote {settings.out}" + (f"; at most {cost} a sample" if cost else ""))
    else:
        print_document(text)


def _require_law(dynamic: str, precision: str) -> None:
    """Refuse options that only a law has."""
    given = {"--dynamic": dynamic != "paper", "--precision": precision != "double"}
    for name in (option for option, changed in given.items() if changed):
        raise RpctlError(f"{name} is of a law; give --law unified too")
