"""The command line: parse, call, print."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from rpctl import __version__
from rpctl.cli.compare import compare_command
from rpctl.cli.options import (
    CHECK_FAILED,
    DensityOption,
    DriveOption,
    JsonOption,
    LockOption,
    PackageDirOption,
    RobotArgument,
    StrictOption,
    certify,
    load_robot,
)
from rpctl.cli.show import (
    show_catalogue,
    show_certificate,
    show_robot,
)
from rpctl.cli.track import track_command
from rpctl.cli.view import plot_command, view_command
from rpctl.description.expansion import expand
from rpctl.description.packages import require_folders
from rpctl.errors import RpctlError, format_finding
from rpctl.files.writing import to_json
from rpctl.robot.catalog import ENTRIES
from rpctl.robot.facts import facts

app = typer.Typer(
    help="From any wheeled robot's URDF to a verified model, predictive control and an animation.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

INTERRUPTED = 130

Command = TypeVar("Command", bound=Callable[..., Any])


def _guarded(command: Command) -> Command:
    """Turn an error that a user can mend into one message and an exit code."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> Any:
        try:
            return command(*args, **kwargs)
        except RpctlError as error:
            typer.echo(str(error), err=True)
            raise typer.Exit(error.exit_code) from None
        except MemoryError:
            typer.echo("out of memory; is the file or a cap (RPCTL_MAX_...) too large?", err=True)
            raise typer.Exit(RpctlError.exit_code) from None
        except KeyboardInterrupt:
            typer.echo("interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None

    return run  # type: ignore[return-value]


@app.command("inspect", epilog="Example: rpctl inspect tiago --lock 'head_*'")
@_guarded
def inspect_command(
    robot: RobotArgument,
    lock: LockOption = None,
    drive: DriveOption = None,
    density: DensityOption = None,
    strict: StrictOption = False,
    package_dir: PackageDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show what a robot is: drive, wheels, joints, and what is doubtful in its file."""
    loaded = load_robot(robot, drive, lock, density, strict, package_dir)
    if as_json:
        _print_json(facts(loaded))
    else:
        show_robot(loaded)


@app.command("verify", epilog="Example: rpctl verify tiago --samples 200 --seed 7")
@_guarded
def verify_command(
    robot: RobotArgument,
    lock: LockOption = None,
    drive: DriveOption = None,
    density: DensityOption = None,
    strict: StrictOption = False,
    package_dir: PackageDirOption = None,
    samples: Annotated[int, typer.Option(min=1, help="Number of random states.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random states.")] = 0,
    engines: Annotated[
        str,
        typer.Option(metavar="mujoco|none", help="Other physics engines that take part."),
    ] = "mujoco",
    contact: Annotated[
        bool,
        typer.Option("--contact", help="Let it roll on a plane, too, as a free body in MuJoCo."),
    ] = False,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the certificate as a page, too.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare independent derivations of a robot's dynamics; exit 1 if they disagree."""
    wanted = [] if engines == "none" else engines.split(",")
    loaded = load_robot(robot, drive, lock, density, strict, package_dir)
    certificate = certify(loaded, samples, seed, wanted, strict, contact)
    if html is not None:
        from rpctl.view.pages.certificate import write_certificate

        write_certificate(certificate, html)
    if as_json:
        _print_json(certificate.to_dict())
    else:
        show_certificate(certificate)
    if not certificate.passed:
        raise typer.Exit(CHECK_FAILED)


@app.command("derive", epilog="Example: rpctl derive paper --format latex > paper.tex")
@_guarded
def derive_command(
    robot: RobotArgument,
    lock: LockOption = None,
    drive: DriveOption = None,
    density: DensityOption = None,
    strict: StrictOption = False,
    package_dir: PackageDirOption = None,
    form: Annotated[
        str, typer.Option("--format", metavar="text|latex|python|c", help="What to write.")
    ] = "text",
    parameters: Annotated[
        bool, typer.Option("--parameters", help="Keep masses and lengths as symbols.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write the reduced equations in closed form: to read, to publish, or as code."""
    from rpctl.derive.write import derive  # SymPy and CasADi load only once needed

    text = derive(load_robot(robot, drive, lock, density, strict, package_dir), form, parameters)
    if as_json:
        _print_json({"robot": robot, "format": form, "text": text})
    else:
        typer.echo(text, nl=False)


app.command(
    "track", epilog="Example: rpctl track tiago --reference eight --initial-error 0.1,-0.1,0.1"
)(_guarded(track_command))
app.command("view", epilog="Example: rpctl view tiago, or rpctl view runs/tiago-eight")(
    _guarded(view_command)
)
app.command("plot", epilog="Example: rpctl plot runs/tiago-eight --out tiago.pdf")(
    _guarded(plot_command)
)
app.command("compare", epilog="Example: rpctl compare tiago --references line,eight")(
    _guarded(compare_command)
)


@app.command("expand", epilog="Example: rpctl expand robot.urdf.xacro > robot.urdf")
@_guarded
def expand_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A .xacro file. It is evaluated.")],
    package_dir: PackageDirOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print the URDF that a .xacro becomes; the lines of messages are those of this text."""
    text, findings = expand(file, require_folders(package_dir or ()))
    for finding in findings:
        typer.echo(format_finding(str(file), finding), err=True)
    if as_json:
        _print_json({"file": str(file), "text": text})
    else:
        typer.echo(text, nl=False)


@app.command("robots", epilog="Example: rpctl robots --json")
@_guarded
def robots_command(as_json: JsonOption = False) -> None:
    """List the catalogue: the project's own robots and those of example-robot-data."""
    rows = [
        {"name": e.name, "base": e.base, "summary": e.summary, "file": str(e.path)} for e in ENTRIES
    ]
    if as_json:
        _print_json(rows)
        return
    show_catalogue(rows)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rpctl {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def _print_json(value: object) -> None:
    typer.echo(to_json(value))


def main() -> None:
    """Run the command line."""
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
