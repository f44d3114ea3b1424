"""The command that closes the loop: ``rpctl track``, and its options."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpctl.cli.options import (
    REFERENCE_FIELDS,
    FieldOptions,
    JsonOption,
    LoadOptions,
    RobotArgument,
    default_folder,
    read_triple,
    tell,
)
from rpctl.cli.summary import show_reference, show_summary
from rpctl.cli.terminal import console, escape, progress_bar
from rpctl.cli.verify import VerifyOptions, certificate_line, certify
from rpctl.control.output_groups import OUTPUT_WORDS
from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.control.velocity_output import VelocityOutput
from rpctl.errors import RpctlError
from rpctl.files.records import Plain
from rpctl.files.signals import held_signals
from rpctl.files.writing import require_writable
from rpctl.reference.motion import Reference
from rpctl.reference.pose_goal import GOAL, goal_of_words, is_goal
from rpctl.reference.sizing import read_smoothing
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings, read_config, whole_periods, write_config
from rpctl.simulation.loop.backend import BACKENDS, require_backend
from rpctl.simulation.loop.budget import Budget
from rpctl.simulation.loop.track import (
    default_duration,
    require_affordable,
    require_held,
    simulate,
)
from rpctl.simulation.merits.expectation import expect
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.starting import PLANTS, plant_by_name
from rpctl.simulation.run.part import PART_FOLDER, PartWriter
from rpctl.simulation.run.run import Run

if TYPE_CHECKING:
    from rpctl.equivalence.verify import Certificate
    from rpctl.view.run_folder import RunFolder
    from rpctl.view.serve.live import Broadcast


@dataclass(frozen=True)
class ConfigOptions:
    """The options that choose laws, reference and circumstances of a run."""

    named: Annotated[Plain, FieldOptions(RunSettings, ("reference",))] = field(default_factory=dict)
    goal: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,THETA",
            help="Pose to drive to from the origin, in place of --reference: m, m, rad.",
        ),
    ] = None
    arm_goal: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=POSITION",
            help="Final position of a joint of the arm, rad or m. Repeatable.",
        ),
    ] = None
    run: Annotated[
        Plain,
        FieldOptions(
            RunSettings,
            (
                "duration",
                *REFERENCE_FIELDS,
                "initial_error",
                "log_every",
                "allow_sag",
                "delay",
                "rates",
            ),
        ),
    ] = field(default_factory=dict)
    kinematic: Annotated[
        str | None,
        typer.Option(
            metavar="|".join((*KINEMATIC_LAWS, "FILE.py:CLASS")),
            help="Kinematic law, or a class in a Python file of yours; default: unified.",
        ),
    ] = None
    dynamic: Annotated[
        str | None,
        typer.Option(metavar="paper|bounded|integral", help="Dynamic law; default: integral."),
    ] = None
    output: Annotated[
        str | None,
        typer.Option(
            metavar=OUTPUT_WORDS,
            help="What the controller commands: efforts; velocity, the speeds of base and arm; "
            "twist, wheel-speeds or steering of the base, and the arm's rates; positions of "
            "an arm; or each group by itself, such as base=twist,arm_*=position. Default: "
            "effort.",
        ),
    ] = None
    late: Annotated[
        Plain,
        FieldOptions(VelocityOutput, ("lag", "dead_time"), {"lag": "--actuator-lag"}),
    ] = field(default_factory=dict)
    plant: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(PLANTS),
            help="Simulated robot: ideal, the controller's model; perturbed, that model with the "
            "differences under [plant] of the configuration, or usual ones; slipping, on "
            "tyres that slip; contact, in MuJoCo. Default: that of the configuration, or "
            "ideal.",
        ),
    ] = None
    grip: Annotated[Plain, FieldOptions(RunSettings, ("friction",))] = field(default_factory=dict)
    sampled: Annotated[Plain, FieldOptions(RunSettings, ("control_period",))] = field(
        default_factory=dict
    )
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Configuration file (TOML): laws, their settings, limits, "
            "plant; options override it.",
        ),
    ] = None
    save_config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the configuration in use to a file.")
    ] = None
    bandwidth: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            help="Bandwidth of the arm's joints, Hz; default: what the control period and a "
            "delay of 50 ms allow, 2.5 at 2 ms. `rpctl tune` compares bandwidths.",
        ),
    ] = None

    def read(self) -> Config:
        """Return the configuration: the file's or the default one, changed by the other options.

        Raises:
            RpctlError: An option is wrong, or the file cannot be read.
        """
        config = Config() if self.config is None else read_config(self.config)
        config = config.with_output(self.output, **self.late)
        config = config.with_laws(self.kinematic, self.dynamic).with_bandwidth(self.bandwidth)
        run = {**self.run, **self.grip, **self.sampled, "reference": self._reference()}
        if "initial_error" in run:
            run["initial_error"] = read_triple(run["initial_error"])
        return config.with_run(**{**run, "smooth": read_smoothing(run.get("smooth"))})

    def with_plant(self, config: Config, robot: Robot) -> Config:
        """Return a configuration whose plant is the one that is asked for.

        Args:
            config: The configuration; its plant says the differences from the robot.
            robot: The robot.

        Raises:
            UnknownNameError: There is no such plant.
        """
        if self.plant is None:
            return config
        return replace(config, plant=plant_by_name(self.plant, robot, config.plant))

    def _reference(self) -> str | None:
        if self.goal is None and not self.arm_goal:
            return self.named.get("reference")
        if self.named:
            raise RpctlError("--goal and --arm-goal replace the reference; leave out --reference")
        return goal_of_words(self.goal, self.arm_goal or ())


@dataclass(frozen=True)
class ResultOptions:
    """The options that choose what is shown and written of a run, and where."""

    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder to write to; a run in it is replaced. Default: runs/ROBOT-REFERENCE, "
            "with a number appended if that holds a run.",
        ),
    ] = None
    max_megabytes: Annotated[
        float,
        typer.Option(
            metavar="MB",
            min=0.1,
            help="Largest size of the report; rpctl simplifies meshes to keep it.",
        ),
    ] = 6.0
    live: Annotated[
        bool, typer.Option("--live", help="Show the simulation in a browser, in real time.")
    ] = False
    png: Annotated[
        bool, typer.Option("--png", help="Write a picture of the scene too; needs a browser.")
    ] = False
    single: Annotated[
        bool,
        typer.Option(
            "--single",
            help="Write the run in single precision (7 digits), except time.",
        ),
    ] = False
    perturbed: Annotated[
        bool,
        typer.Option(
            help="Estimate the error with 10 % more mass, wheel friction and a delay, in a "
            "second run a third as long, unless the configuration has a [plant] of its own.",
        ),
    ] = True

    collisions: Annotated[
        bool,
        typer.Option(
            help="Look for collisions of the links with obstacles, the ground and each other."
        ),
    ] = True
    backend: Annotated[
        str,
        typer.Option(
            metavar="|".join(BACKENDS),
            help="Code that simulates: compiled, machine code that is built in a second or two "
            "and cached; pinocchio, Python; auto, the faster. Results agree to rounding.",
        ),
    ] = BACKENDS[0]

    def perturbs(self, config: Config) -> bool:
        """Return whether to tell what to expect: not where the user has set a plant himself."""
        return self.perturbed and config.plant == Plant()

    def require_possible(self, robot: str, what: str) -> Path:
        """Return the folder; refuse what could not be written or drawn, before the simulation.

        Args:
            robot: The robot's name.
            what: The reference's.

        Raises:
            RpctlError: The folder cannot be written to, there is no browser for a picture, or no
                such backend.
        """
        from rpctl.view.run_folder import FIGURE_FILE, REPORT_FILE, RUN_FILE, SUMMARY_FILE

        require_backend(self.backend)
        folder = self.out or default_folder(robot, what, RUN_FILE)
        for name in (RUN_FILE, SUMMARY_FILE, FIGURE_FILE, REPORT_FILE):
            require_writable(folder / name, makes_folder=True)
        if self.png:
            from rpctl.view.film import require_browser

            require_browser()
        return folder

    def write(self, run: Run, folder: Path) -> RunFolder:
        """Write the files of a run."""
        from rpctl.view.run_folder import write_folder  # matplotlib and meshcat load only here

        with progress_bar("draw"):
            written = write_folder(
                run, folder, self.max_megabytes, "single" if self.single else "double"
            )
            if self.png:
                from rpctl.view.film import SCENE_FILE, write_still

                write_still(replace(run, digest=written.digest), folder / SCENE_FILE)
        return written


def track_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: ConfigOptions,
    samples: Annotated[
        int,
        typer.Option(
            min=0, help="Random states at which to verify the dynamics first; 0 for none."
        ),
    ] = 20,
    results: ResultOptions,
    as_json: JsonOption = False,
) -> None:
    """Simulate a robot that tracks a reference; write the run, a summary, plots and a report.

    Exit 1 if the outcome is neither `tracked` nor `late`, if a limit of the URDF was broken, or if
    the dynamics failed verification.
    """
    config = settings.read()
    loaded = config.limits.apply(options.load(robot))
    config = settings.with_plant(config, loaded)
    reference = config.run.load_reference(loaded, results.collisions)
    if settings.save_config is not None:
        write_config(config, settings.save_config, schema=True)
    folder = results.require_possible(loaded.name, reference_label(config.run.reference))
    output = console(stderr=as_json)
    output.print(
        f"[bold]{escape(loaded.name)}[/]: {loaded.dof} quasi-velocities, {loaded.drive.type} drive"
    )
    for doubt in loaded.drive.doubts:
        output.print(f"[yellow]doubt[/] {escape(doubt)}")
    named = getattr(reference, "sizing", None) is not None
    require_held(loaded, config, None if named else reference)
    show_reference(output, loaded, reference, options.strict)
    budget = require_affordable(loaded, config, reference)
    certificate = None
    if samples:
        certificate = certify(loaded, VerifyOptions(samples, engines="none"), options.strict)
        output.print(certificate_line(certificate))
    task = _Task(loaded, config, reference, certificate, budget)
    written = _simulate(task, results, folder, output.print)
    passed = written.summary.succeeded and (certificate is None or certificate.passed)
    tell(as_json, written.to_dict, partial(show_summary, written, folder), passed)


@dataclass(frozen=True)
class _Task:
    """What is simulated: the robot has the configuration's limits."""

    robot: Robot
    config: Config
    reference: Reference
    certificate: Certificate | None
    budget: Budget


def _simulate(
    task: _Task, results: ResultOptions, folder: Path, say: Callable[[str], object]
) -> RunFolder:
    """Simulate and write; what ends it early, Ctrl-C or an error, leaves the run so far."""
    with PartWriter(folder / PART_FOLDER) as part, _live_page(task, results.live, say) as page:
        ended: list[Run] = []
        try:
            with progress_bar("simulate", task.budget.brief) as advance:
                run = simulate(
                    task.robot,
                    task.config,
                    task.reference,
                    certificate=task.certificate,
                    progress=advance,
                    watch=page,
                    ended=ended.append,
                    part=part,
                    collisions=results.collisions,
                    backend=results.backend,
                )
        except BaseException:
            if ended:
                if page is not None:
                    page.end("Ended")
                report = escape(str(_write(ended[0], page, results, folder, part).report))
                console(stderr=True).print(f"{escape(ended[0].notes[-1])}: [bold]{report}[/]")
            raise
        if page is not None:
            page.end("Simulated")
        if results.perturbs(task.config):
            with _part_told(part), progress_bar("perturb"):
                expected = expect(task.robot, task.config, task.reference)
            run = replace(run, perturbed=None if expected is None else expected.to_dict())
        return _write(run, page, results, folder, part)


def _write(
    run: Run, page: Broadcast | None, results: ResultOptions, folder: Path, part: PartWriter
) -> RunFolder:
    """Write the files of a run and show them to who watched it; its part is removed then.

    A Ctrl-C that comes meanwhile waits until they are whole.
    """
    with held_signals():
        with _part_told(part):
            written = results.write(run, folder)
        part.remove()
    if page is not None:
        page.finish(written.report)
    return written


@contextmanager
def _part_told(part: PartWriter) -> Iterator[None]:
    """Say where the samples are if something keeps the run from being written."""
    try:
        yield
    except BaseException:
        where = escape(str(part.folder))
        console(stderr=True).print(f"the samples so far are kept in [bold]{where}[/]")
        raise


def reference_label(reference: str) -> str:
    """Return a short name for a reference: its own, its file's without suffix, or "goal"."""
    return GOAL if is_goal(reference) else Path(reference).stem


def _live_page(
    task: _Task, wanted: bool, say: Callable[[str], object]
) -> AbstractContextManager[Broadcast | None]:
    """Serve the page that shows the simulation while it runs, if it is wanted."""
    if not wanted:
        return nullcontext()
    from rpctl.simulation.merits.obstacles import find_obstacles
    from rpctl.view.serve.live import broadcast

    period = task.config.run.control_period
    duration = task.config.run.duration or default_duration(task.reference)
    duration = whole_periods(duration, period) * period
    return broadcast(task.robot, task.reference, duration, say, find_obstacles(task.config))
