"""The command that closes the loop: ``rpctl track``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

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
    read_triple,
)
from rpctl.cli.show import certificate_line, console, progress_bar, show_summary
from rpctl.control.config import Config, read_config, write_config
from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.files.writing import to_json
from rpctl.reference.load import load_reference
from rpctl.robot.vary import set_limits
from rpctl.simulation.log import describe
from rpctl.simulation.loop import default_duration, track
from rpctl.simulation.periods import whole_periods


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
    config_in_use = (Config() if config is None else read_config(config)).with_laws(
        kinematic, dynamic
    )
    config_in_use = config_in_use.with_run(
        reference=reference, duration=duration, initial_error=error, friction=friction
    )
    loaded = load_robot(robot, drive, lock, density, strict, package_dir)
    loaded = set_limits(loaded, config_in_use.limits.effort, config_in_use.limits.velocity)
    path = load_reference(loaded, config_in_use.run.reference)
    if save_config is not None:
        write_config(config_in_use, save_config)
    run_name = f"{loaded.name}-{Path(config_in_use.run.reference).stem}"
    folder = out or Path("runs") / re.sub(r"[^\w.-]", "_", run_name)
    if png:
        from rpctl.view.film.browser import require_browser

        require_browser()  # before the simulation, not after it
    output = console(stderr=as_json)
    output.print(
        f"[bold]{loaded.name}[/]: {loaded.dof} quasi-velocities, {loaded.drive.type} drive"
    )
    certificate = certify(loaded, samples, 0, [], strict) if samples else None
    if certificate is not None:
        output.print(certificate_line(certificate))
    watcher = None
    if live:
        from rpctl.view.scene.obstacles import find_obstacles
        from rpctl.view.serve.live import broadcast

        period = config_in_use.run.control_period
        run_duration = (
            default_duration(path)
            if config_in_use.run.duration is None
            else config_in_use.run.duration
        )
        run_duration = whole_periods(run_duration, period) * period
        obstacles = find_obstacles(describe(config_in_use.kinematic))
        watcher = context.with_resource(
            broadcast(loaded, path, run_duration, output.print, obstacles)
        )
    with progress_bar("simulate") as advance:
        run = track(
            loaded,
            kinematic=config_in_use.kinematic,
            dynamic=config_in_use.dynamic,
            **{**vars(config_in_use.run), "reference": path},
            name=config_in_use.run.reference,
            certificate=certificate,
            progress=advance,
            watch=watcher,
        )
    from rpctl.view.run_folder import REPORT_FILE, write_folder  # matplotlib loads only once needed

    with progress_bar("draw"):
        summary = write_folder(run, folder, max_megabytes)
        if png:
            from rpctl.view.film.film import SCENE_FILE, write_still

            write_still(run, folder / SCENE_FILE)
    if watcher is not None:
        watcher.finish(folder / REPORT_FILE)
    if as_json:
        typer.echo(to_json(summary))
    else:
        show_summary(summary, folder)
    if summary["limits_violated"] or (certificate is not None and not certificate.passed):
        raise typer.Exit(CHECK_FAILED)
