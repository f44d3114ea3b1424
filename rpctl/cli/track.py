"""The command that closes the loop: ``rpctl track``."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpctl.cli.options import (
    CHECK_FAILED,
    JsonOption,
    LapsOption,
    LoadOptions,
    RobotArgument,
    SizeOption,
    SpeedOption,
    default_folder,
    read_triple,
)
from rpctl.cli.streams import print_json
from rpctl.cli.summary import show_sizing, show_summary
from rpctl.cli.terminal import console, escape, progress_bar
from rpctl.cli.verify import certificate_line, certify
from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import RpctlError
from rpctl.files.writing import require_writable
from rpctl.reference.motion import Reference
from rpctl.reference.pose_goal import GOAL, goal_of_words, is_goal
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, read_config, write_config
from rpctl.simulation.expectation import expect
from rpctl.simulation.loop import default_duration, require_affordable, simulate
from rpctl.simulation.periods import whole_periods
from rpctl.simulation.plant import Plant
from rpctl.simulation.run import Run
from rpctl.simulation.spool import PART_FOLDER, Spool

if TYPE_CHECKING:
    from rpctl.view.run_folder import RunFolder
    from rpctl.view.serve.live import Broadcast


@dataclass(frozen=True)
class ConfigOptions:
    """The options that choose laws, reference and circumstances of a run."""

    reference: Annotated[
        str | None,
        typer.Option(
            metavar="line|reverse|spin|circle|eight|waypoints|ee-square|FILE",
            help="Path of the base or of the end effector: a name, a path file (TOML), or "
            "time-stamped poses (CSV); eight if not given.",
        ),
    ] = None
    goal: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,THETA",
            help="Go there instead, from the origin, and stop: m, m and rad.",
        ),
    ] = None
    arm_goal: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=POSITION",
            help="Where a joint of the arm is to be in the end, rad or m. Repeatable.",
        ),
    ] = None
    duration: Annotated[
        float | None,
        typer.Option(
            metavar="S", help="How long, s; as long as the laps take or the reference moves, or 20."
        ),
    ] = None
    size: SizeOption = None
    speed: SpeedOption = None
    laps: LapsOption = None
    initial_error: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,THETA",
            help="Tracking error at the start: how far the reference is ahead and to the left of "
            "the robot (m) and turned from it (rad); none if not given.",
        ),
    ] = None
    log_every: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Log one sample of N, and the last; all if not given."
        ),
    ] = None
    kinematic: Annotated[
        str | None,
        typer.Option(metavar="|".join(KINEMATIC_LAWS), help="Kinematic law; unified if not given."),
    ] = None
    dynamic: Annotated[
        str | None,
        typer.Option(metavar="paper|bounded|integral", help="Dynamic law; paper if not given."),
    ] = None
    friction: Annotated[
        float | None,
        typer.Option(
            help="Friction coefficient of the wheels, to tell if they would slip; "
            f"{FRICTION:g} if not given."
        ),
    ] = None
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Laws, their settings, limits and all else (TOML); options win."
        ),
    ] = None
    save_config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the configuration in use.")
    ] = None

    def read(self) -> Config:
        """Return the configuration: the file's or the default one, changed by the other options.

        Raises:
            RpctlError: An option is wrong, or the file cannot be read.
        """
        error = None if self.initial_error is None else read_triple(self.initial_error)
        config = Config() if self.config is None else read_config(self.config)
        return config.with_laws(self.kinematic, self.dynamic).with_run(
            reference=self._reference(),
            duration=self.duration,
            initial_error=error,
            friction=self.friction,
            size=self.size,
            speed=self.speed,
            laps=self.laps,
            log_every=self.log_every,
        )

    def _reference(self) -> str | None:
        if self.goal is None and not self.arm_goal:
            return self.reference
        if self.reference is not None:
            raise RpctlError("--goal and --arm-goal are a reference themselves; omit --reference")
        return goal_of_words(self.goal, self.arm_goal or ())


@dataclass(frozen=True)
class ResultOptions:
    """The options that choose what is shown and written of a run, and where."""

    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to write; runs/ROBOT-REFERENCE if not given."),
    ] = None
    max_megabytes: Annotated[
        float,
        typer.Option(
            metavar="MB", min=0.1, help="Size of the report; meshes are simplified to keep it."
        ),
    ] = 6.0
    live: Annotated[
        bool, typer.Option("--live", help="Watch in a browser, in real time, while it simulates.")
    ] = False
    png: Annotated[
        bool, typer.Option("--png", help="Write a picture of the scene, too; needs a browser.")
    ] = False
    single: Annotated[
        bool,
        typer.Option(
            "--single",
            help="Write the run's numbers in single precision, 7 digits, in half of the room.",
        ),
    ] = False
    perturbed: Annotated[
        bool,
        typer.Option(
            help="Tell what to expect with 10 % more mass, wheel friction and a delay: another "
            "run, a third as long; not where the configuration has a [plant] of its own.",
        ),
    ] = True

    def perturbs(self, config: Config) -> bool:
        """Return whether to tell what to expect: not where the user has set a plant himself."""
        return self.perturbed and config.plant == Plant()

    def require_possible(self, folder: Path) -> None:
        """Refuse what could not be written or drawn, before the simulation.

        Raises:
            RpctlError: The folder cannot be written to, or there is no browser for a picture.
        """
        from rpctl.view.run_folder import FIGURE_FILE, REPORT_FILE, RUN_FILE, SUMMARY_FILE

        for name in (RUN_FILE, SUMMARY_FILE, FIGURE_FILE, REPORT_FILE):
            require_writable(folder / name, makes_folder=True)
        if self.png:
            from rpctl.view.film.browser import require_browser

            require_browser()

    def write(self, run: Run, folder: Path) -> RunFolder:
        """Write the files of a run."""
        from rpctl.view.run_folder import write_folder  # matplotlib and meshcat load only here

        with progress_bar("draw"):
            written = write_folder(
                run, folder, self.max_megabytes, "single" if self.single else "double"
            )
            if self.png:
                from rpctl.view.film.film import SCENE_FILE, write_still

                write_still(replace(run, digest=written.digest), folder / SCENE_FILE)
        return written


def track_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: ConfigOptions,
    samples: Annotated[
        int, typer.Option(min=0, help="Random states of the certificate; 0 for none.")
    ] = 20,
    results: ResultOptions,
    as_json: JsonOption = False,
) -> None:
    """Close the loop with the predictive controllers; write run, figures, plots and report.

    Exit 1 if the reference was not tracked (stuck, diverging, collided; late is told, and is no
    failure), a limit of the URDF was broken, or the dynamics could not be verified.
    """
    config = settings.read()
    loaded = config.limits.apply(options.load(robot))
    reference = config.run.load_reference(loaded)
    if settings.save_config is not None:
        write_config(config, settings.save_config)
    folder = results.out or default_folder(loaded.name, reference_label(config.run.reference))
    results.require_possible(folder)
    output = console(stderr=as_json)
    output.print(
        f"[bold]{escape(loaded.name)}[/]: {loaded.dof} quasi-velocities, {loaded.drive.type} drive"
    )
    show_sizing(output, getattr(reference, "sizing", None))
    budget = require_affordable(loaded, config, reference)
    certificate = certify(loaded, samples, 0, [], options.strict) if samples else None
    if certificate is not None:
        output.print(certificate_line(certificate))
    watched = _live_page(loaded, reference, config, output.print) if results.live else nullcontext()
    with Spool(folder / PART_FOLDER) as spool, watched as page:
        ended: list[Run] = []
        try:
            with progress_bar("simulate", str(budget)) as advance:
                run = simulate(
                    loaded, config, reference, certificate, advance, page, ended.append, spool
                )
        except BaseException:
            if ended:
                _keep(ended[0], page, results, folder, spool)
            raise
        if page is not None:
            page.end("Simulated")
        if results.perturbs(config):
            run = _with_expectation(run, loaded, config, reference)
        written = _write(run, results, folder, spool)
        if page is not None:
            page.finish(written.report)
    if as_json:
        print_json(written.to_dict())
    else:
        show_summary(written, folder)
    if not written.summary.succeeded or (certificate is not None and not certificate.passed):
        raise typer.Exit(CHECK_FAILED)


def _with_expectation(run: Run, robot: Robot, config: Config, reference: Reference) -> Run:
    """Return a run that tells what became of it with a perturbed plant; it cannot fail it."""
    with progress_bar("perturb"):
        expected = expect(robot, config, reference)
    return replace(run, perturbed=None if expected is None else expected.to_dict())


def _keep(
    run: Run, page: Broadcast | None, results: ResultOptions, folder: Path, spool: Spool
) -> None:
    """Write what was simulated before a run ended early, and say so in one line."""
    if page is not None:
        page.end("Ended")
    written = _write(run, results, folder, spool)
    if page is not None:
        page.finish(written.report)
    console(stderr=True).print(f"{escape(run.notes[-1])}: [bold]{escape(str(written.report))}[/]")


def _write(run: Run, results: ResultOptions, folder: Path, spool: Spool) -> RunFolder:
    """Write the files of a run; its part is removed then, and is told of if they cannot be."""
    try:
        written = results.write(run, folder)
    except BaseException:
        where = escape(str(spool.folder))
        console(stderr=True).print(f"what was simulated is kept: [bold]{where}[/]")
        raise
    spool.remove()
    return written


def reference_label(reference: str) -> str:
    """Return a short name for a reference: its own, its file's without suffix, or "goal"."""
    return GOAL if is_goal(reference) else Path(reference).stem


def _live_page(
    robot: Robot, reference: Reference, config: Config, say: Callable[[str], object]
) -> AbstractContextManager[Broadcast]:
    """Serve the page that shows the simulation while it runs."""
    from rpctl.simulation.obstacles import find_obstacles
    from rpctl.view.serve.live import broadcast

    duration, period = config.run.duration, config.run.control_period
    duration = default_duration(reference) if duration is None else duration
    duration = whole_periods(duration, period) * period
    return broadcast(robot, reference, duration, say, find_obstacles(config))
