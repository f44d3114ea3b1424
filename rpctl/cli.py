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
from rpctl.cli_compare import compare_command
from rpctl.cli_view import plot_command, view_command
from rpctl.control.config import Config, read_config, write_config
from rpctl.control.laws import KINEMATIC_LAWS
from rpctl.description.expansion import expand
from rpctl.description.packages import require_folders
from rpctl.dynamics.contact import FRICTION
from rpctl.equivalence.certificate import Certificate
from rpctl.equivalence.verify import verify
from rpctl.errors import RpctlError, format_finding
from rpctl.files import to_json
from rpctl.options import (
    DensityOption,
    DriveOption,
    JsonOption,
    LockOption,
    PackageDirOption,
    RobotArgument,
    StrictOption,
    load_robot,
    read_triple,
)
from rpctl.reference.load import load_reference
from rpctl.robot.catalog import ENTRIES
from rpctl.robot.facts import facts
from rpctl.robot.model import Robot
from rpctl.robot.vary import set_limits
from rpctl.show import (
    certificate_line,
    console,
    progress_bar,
    show_catalogue,
    show_certificate,
    show_robot,
    show_summary,
)
from rpctl.simulation.loop import lasting, track

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
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the certificate as a page, too.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare independent derivations of a robot's dynamics; exit 1 if they disagree."""
    wanted = [] if engines == "none" else engines.split(",")
    certificate = _certify(
        load_robot(robot, drive, lock, density, strict, package_dir), samples, seed, wanted
    )
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


@app.command(
    "track", epilog="Example: rpctl track tiago --reference eight --initial-error 0.1,-0.1,0.1"
)
@_guarded
def track_command(
    context: typer.Context,
    robot: RobotArgument,
    lock: LockOption = None,
    drive: DriveOption = None,
    density: DensityOption = None,
    strict: StrictOption = False,
    package_dir: PackageDirOption = None,
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="line|reverse|spin|circle|eight|waypoints|ee-square|FILE",
            help="Path of the base or of the end effector: a name, a path file (TOML), or "
            "time-stamped poses (CSV); eight if not given.",
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(metavar="S", help="How long, s; as long as the reference moves, or 20."),
    ] = None,
    initial_error: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,THETA",
            help="Tracking error at the start: how far the reference is ahead and to the left of "
            "the robot (m) and turned from it (rad); none if not given.",
        ),
    ] = None,
    kinematic: Annotated[
        str | None,
        typer.Option(metavar="|".join(KINEMATIC_LAWS), help="Kinematic law; unified if not given."),
    ] = None,
    dynamic: Annotated[
        str | None,
        typer.Option(metavar="paper|bounded|integral", help="Dynamic law; paper if not given."),
    ] = None,
    friction: Annotated[
        float | None,
        typer.Option(
            help="Friction coefficient of the wheels, to tell if they would slip; "
            f"{FRICTION:g} if not given."
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Laws, their settings, limits and all else (TOML); options win."
        ),
    ] = None,
    save_config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the configuration in use.")
    ] = None,
    samples: Annotated[
        int, typer.Option(min=0, help="Random states of the certificate; 0 for none.")
    ] = 20,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write; runs/ROBOT-REFERENCE if not given."),
    ] = None,
    max_megabytes: Annotated[
        float,
        typer.Option(
            metavar="MB", min=0.1, help="Size of the report; meshes are simplified to keep it."
        ),
    ] = 6.0,
    live: Annotated[
        bool, typer.Option("--live", help="Watch in a browser, in real time, while it simulates.")
    ] = False,
    png: Annotated[
        bool, typer.Option("--png", help="Write a picture of the scene, too; needs a browser.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Close the loop with the predictive controllers; write run, figures, plots and report.

    Exit 1 if a limit of the URDF was broken or the dynamics could not be verified.
    """
    error = None if initial_error is None else read_triple(initial_error)
    chosen = (Config() if config is None else read_config(config)).with_laws(kinematic, dynamic)
    chosen = chosen.with_run(
        reference=reference, duration=duration, initial_error=error, friction=friction
    )
    loaded = load_robot(robot, drive, lock, density, strict, package_dir)
    loaded = set_limits(loaded, chosen.limits.effort, chosen.limits.velocity)
    if save_config is not None:
        write_config(chosen, save_config)
    told = f"{loaded.name}-{Path(chosen.run.reference).stem}"
    folder = out or Path("runs") / re.sub(r"[^\w.-]", "_", told)
    if png:
        from rpctl.view.browser import require_browser

        require_browser()  # before the simulation, not after it
    say = console(stderr=as_json)
    say.print(f"[bold]{loaded.name}[/]: {loaded.dof} quasi-velocities, {loaded.drive.type} drive")
    certificate = _certify(loaded, samples, 0, []) if samples else None
    if certificate is not None:
        say.print(certificate_line(certificate))
    watcher = None
    if live:
        from rpctl.view.live import broadcast

        path = load_reference(loaded, chosen.run.reference)
        lasts = lasting(path) if chosen.run.duration is None else chosen.run.duration
        watcher = context.with_resource(broadcast(loaded, path, lasts, say.print))
    with progress_bar("simulate") as advance:
        run = track(
            loaded,
            kinematic=chosen.kinematic,
            dynamic=chosen.dynamic,
            **vars(chosen.run),
            certificate=certificate,
            progress=advance,
            watch=watcher,
        )
    from rpctl.view.folder import REPORT, write_folder  # matplotlib loads only once needed

    with progress_bar("draw"):
        summary = write_folder(run, folder, max_megabytes)
        if png:
            from rpctl.view.film import SCENE, write_still

            write_still(run, folder / SCENE)
    if watcher is not None:
        watcher.finish(folder / REPORT)
    if as_json:
        _print_json(summary)
    else:
        show_summary(summary, folder)
    if summary["limits_violated"] or (certificate is not None and not certificate.passed):
        raise typer.Exit(CHECK_FAILED)


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
