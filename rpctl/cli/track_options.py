"""The options of ``rpctl track``: laws, reference and circumstances; what is shown and written."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpctl.cli.options import REFERENCE_FIELDS, FieldOptions, read_triple
from rpctl.cli.terminal import progress_bar
from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.control.velocity_output import VelocityOutput
from rpctl.errors import RpctlError
from rpctl.files.records import Plain
from rpctl.files.writing import require_writable
from rpctl.reference.pose_goal import goal_of_words
from rpctl.reference.sizing import read_smoothing
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings, read_config
from rpctl.simulation.loop.backend import BACKENDS, require_backend
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.starting import PLANTS, plant_by_name
from rpctl.simulation.run.run import Run

if TYPE_CHECKING:
    from rpctl.view.run_folder import RunFolder


@dataclass(frozen=True)
class ConfigOptions:
    """The options that choose laws, reference and circumstances of a run."""

    named: Annotated[Plain, FieldOptions(RunSettings, ("reference",))] = field(default_factory=dict)
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
    run: Annotated[
        Plain,
        FieldOptions(RunSettings, ("duration", *REFERENCE_FIELDS, "initial_error", "log_every")),
    ] = field(default_factory=dict)
    kinematic: Annotated[
        str | None,
        typer.Option(
            metavar="|".join((*KINEMATIC_LAWS, "FILE.py:CLASS")),
            help="Kinematic law, or one of your own; unified if not given.",
        ),
    ] = None
    dynamic: Annotated[
        str | None,
        typer.Option(metavar="paper|bounded|integral", help="Dynamic law; integral if not given."),
    ] = None
    output: Annotated[
        str | None,
        typer.Option(
            metavar="effort|velocity",
            help="What the robot takes: efforts, or speeds of base and arm, which it follows late; "
            "efforts if not given.",
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
            help="What the controller drives: its own model; that with the differences of the "
            "configuration's [plant], or usual ones; a robot on tyres that slip; MuJoCo. As the "
            "configuration says if not given.",
        ),
    ] = None
    grip: Annotated[Plain, FieldOptions(RunSettings, ("friction",))] = field(default_factory=dict)
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Laws, their settings, limits and all else (TOML); options win."
        ),
    ] = None
    save_config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the configuration in use.")
    ] = None
    bandwidth: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            help="Of the arm's joints; what sampling, lateness and their efforts allow, if not "
            "given. `rpctl tune` shows the trade.",
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
        run = {**self.run, **self.grip, "reference": self._reference()}
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
            help="Write places in single precision, too: 7 digits of all but the time.",
        ),
    ] = False
    perturbed: Annotated[
        bool,
        typer.Option(
            help="Tell what to expect with 10 % more mass, wheel friction and a delay: another "
            "run, a third as long; not where the configuration has a [plant] of its own.",
        ),
    ] = True

    collisions: Annotated[
        bool,
        typer.Option(
            help="Look for what the links run into: obstacles, the ground, each other; it takes "
            "about a third as long as the simulation of a long arm."
        ),
    ] = True
    backend: Annotated[
        str,
        typer.Option(
            metavar="|".join(BACKENDS),
            help="What closes the loop: machine code, built in a second or two and kept on disk, "
            "Pinocchio in Python, or what takes less time. The numbers agree to rounding.",
        ),
    ] = BACKENDS[0]

    def perturbs(self, config: Config) -> bool:
        """Return whether to tell what to expect: not where the user has set a plant himself."""
        return self.perturbed and config.plant == Plant()

    def require_possible(self, folder: Path) -> None:
        """Refuse what could not be written or drawn, before the simulation.

        Raises:
            RpctlError: The folder cannot be written to, there is no browser for a picture, or no
                such backend.
        """
        from rpctl.view.run_folder import FIGURE_FILE, REPORT_FILE, RUN_FILE, SUMMARY_FILE

        require_backend(self.backend)
        for name in (RUN_FILE, SUMMARY_FILE, FIGURE_FILE, REPORT_FILE):
            require_writable(folder / name, makes_folder=True)
        if self.png:
            from rpctl.view.film import require_browser

            require_browser()

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
