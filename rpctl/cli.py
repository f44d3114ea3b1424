"""The command line: parse, call, print."""

from __future__ import annotations

import functools
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from rpctl import __version__
from rpctl.control.dynamic import dynamic_by_name
from rpctl.control.laws import KINEMATIC_LAWS, kinematic_by_name
from rpctl.dynamics.contact import FRICTION
from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.verify import verify
from rpctl.errors import RpctlError
from rpctl.files import to_json
from rpctl.options import (
    DensityOption,
    DriveOption,
    JsonOption,
    LockOption,
    RobotArgument,
    StrictOption,
    load_robot,
    read_triple,
)
from rpctl.robot.catalog import ENTRIES
from rpctl.robot.facts import facts
from rpctl.robot.model import Robot
from rpctl.show import (
    certificate_line,
    console,
    progress_bar,
    show_catalogue,
    show_certificate,
    show_robot,
    show_summary,
)
from rpctl.simulation.loop import track

app = typer.Typer(
    help="From any wheeled robot's URDF to a verified model, predictive control and an animation.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

CHECK_FAILED, INTERRUPTED = 1, 130

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
    as_json: JsonOption = False,
) -> None:
    """Show what a robot is: drive, wheels, joints, and what is doubtful in its file."""
    loaded = load_robot(robot, drive, lock, density, strict)
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
    samples: Annotated[int, typer.Option(min=1, help="Number of random states.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random states.")] = 0,
    engines: Annotated[
        str,
        typer.Option(metavar="mujoco|none", help="Other physics engines that take part."),
    ] = "mujoco",
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the certificate as a page, too.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare independent derivations of a robot's dynamics; exit 1 if they disagree."""
    wanted = [] if engines == "none" else engines.split(",")
    certificate = _certify(load_robot(robot, drive, lock, density, strict), samples, seed, wanted)
    if html is not None:
        from rpctl.view.certificate import write_certificate

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

    text = derive(load_robot(robot, drive, lock, density, strict), form, parameters)
    if as_json:
        _print_json({"robot": robot, "format": form, "text": text})
    else:
        typer.echo(text, nl=False)


@app.command(
    "track", epilog="Example: rpctl track tiago --reference eight --initial-error 0.1,-0.1,0.1"
)
@_guarded
def track_command(
    robot: RobotArgument,
    lock: LockOption = None,
    drive: DriveOption = None,
    density: DensityOption = None,
    strict: StrictOption = False,
    reference: Annotated[
        str, typer.Option(metavar="line|reverse|spin|circle|eight", help="Path of the base.")
    ] = "eight",
    duration: Annotated[float, typer.Option(metavar="S", help="How long, s.")] = 20.0,
    initial_error: Annotated[
        str,
        typer.Option(
            metavar="X,Y,THETA",
            help="Tracking error at the start: how far the reference is ahead and to the left of "
            "the robot (m) and turned from it (rad).",
        ),
    ] = "0,0,0",
    kinematic: Annotated[
        str, typer.Option(metavar="|".join(KINEMATIC_LAWS), help="Kinematic law.")
    ] = "paper",
    dynamic: Annotated[str, typer.Option(metavar="paper", help="Dynamic law.")] = "paper",
    friction: Annotated[
        float, typer.Option(help="Friction coefficient of the wheels, to tell if they would slip.")
    ] = FRICTION,
    samples: Annotated[
        int, typer.Option(min=0, help="Random states of the certificate; 0 for none.")
    ] = 20,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write; runs/ROBOT-REFERENCE if not given."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Close the loop with the predictive controllers; write run, figures, plots and report.

    Exit 1 if a limit of the URDF was broken or the dynamics could not be verified.
    """
    error = read_triple(initial_error)
    laws = kinematic_by_name(kinematic), dynamic_by_name(dynamic)
    loaded = load_robot(robot, drive, lock, density, strict)
    folder = out or Path("runs") / re.sub(r"[^\w.-]", "_", f"{loaded.name}-{reference}")
    say = console(stderr=as_json)
    say.print(f"[bold]{loaded.name}[/]: {loaded.dof} quasi-velocities, {loaded.drive.type} drive")
    certificate = _certify(loaded, samples, 0, []) if samples else None
    if certificate is not None:
        say.print(certificate_line(certificate))
    with progress_bar("simulate") as advance:
        run = track(
            loaded,
            reference,
            duration,
            error,
            *laws,
            friction=friction,
            certificate=certificate,
            progress=advance,
        )
    from rpctl.view.folder import write_folder  # meshcat and matplotlib load only once needed

    with progress_bar("draw"):
        summary = write_folder(run, folder)
    if as_json:
        _print_json(summary)
    else:
        show_summary(summary, folder)
    if summary["limits_violated"] or (certificate is not None and not certificate.passed):
        raise typer.Exit(CHECK_FAILED)


@app.command("view", epilog="Example: rpctl view runs/tiago-eight")
@_guarded
def view_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run's folder or its run.npz.")],
) -> None:
    """Serve a run's report on this machine only, until Ctrl-C."""
    from rpctl.view.folder import find_report
    from rpctl.view.live import serve

    serve(find_report(run), lambda url: typer.echo(f"{url}  (Ctrl-C ends it)"))


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


def _certify(robot: Robot, samples: int, seed: int, engines: list[str]) -> Certificate:
    with progress_bar("verify") as advance:
        return verify(robot, samples, seed, engines, lambda done: advance(done, samples))


def _print_json(value: object) -> None:
    typer.echo(to_json(value))


def main() -> None:
    """Run the command line."""
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
