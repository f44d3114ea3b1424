"""The configuration of a run: its laws, limits and circumstances, and its file in TOML."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import NoneType
from typing import Annotated, Any

import tomli_w

from rpctl.control.bandwidth import at_bandwidth, knowing_delay
from rpctl.control.controller import default_laws
from rpctl.control.estimation import RATES
from rpctl.control.law import DynamicFunction, DynamicLaw, KinematicFunction, KinematicLaw
from rpctl.control.output_groups import DEAD_TIME
from rpctl.control.registry import (
    DYNAMIC_CHOICE,
    KINEMATIC_CHOICE,
    read_law,
    read_own_laws,
)
from rpctl.control.safeguards import Guards
from rpctl.control.velocity_output import VelocityOutput, as_output, same_kinds
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import RpctlError, require_positive
from rpctl.files import toml
from rpctl.files.records import (
    POSITIVE,
    OneOf,
    Range,
    Record,
    Setting,
    fields_of,
    json_schema,
    read_record,
    to_plain,
)
from rpctl.files.toml import Table
from rpctl.files.writing import write_atomically
from rpctl.reference.load import load_reference
from rpctl.reference.motion import Reference, shown
from rpctl.reference.pose_goal import MAX_DISTANCE
from rpctl.reference.sizing import require_smoothing
from rpctl.robot.model import Robot
from rpctl.robot.vary import set_limits
from rpctl.simulation.plants.plant import Plant

CONTROL_PERIOD = 0.002  # s, where none is asked for
WHOLE_PERIOD_TOLERANCE = 1e-6  # of a period: a quotient this near to a whole number counts as one

MAX_LOGGED = 25_000  # samples: 50 s at 2 ms; an hour of TIAGo then takes under 400 MB of memory
MAX_LOG_EVERY = 2**63 - 1  # a file's largest whole number
HEADER = (
    "# A run of rpctl: rpctl track ROBOT --config FILE. What is left out keeps its default.\n\n"
)


@dataclass(frozen=True)
class LimitOverrides:
    """Limits that replace those of the URDF, by pattern of joint names (``"arm_*"``).

    Attributes:
        effort: Effort limits, N·m or N.
        velocity: Velocity limits, rad/s or m/s.
    """

    effort: Mapping[str, float] = field(default_factory=dict)
    velocity: Mapping[str, float] = field(default_factory=dict)

    def apply(self, robot: Robot) -> Robot:
        """Return a robot with these limits.

        Raises:
            RpctlError: A pattern matches no joint, or a limit is not positive.
        """
        return set_limits(robot, effort=self.effort, velocity=self.velocity)


@dataclass(frozen=True, kw_only=True)
class RunSettings(Record):
    """The circumstances of a run: reference, duration, start, sample times and friction."""

    reference: Annotated[
        str,
        Setting(
            "",
            "Reference",
            "Path of the base or of the end effector: a name, a path file (TOML), or "
            "time-stamped poses (CSV); default: eight.",
            metavar="line|reverse|spin|circle|eight|waypoints|ee-square|FILE",
        ),
    ] = field(default="eight", kw_only=False)
    duration: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "s",
            "Duration",
            "Duration, s; default: that of the laps or of the reference, else 20.",
            metavar="S",
        ),
    ] = field(default=None, kw_only=False)
    initial_error: Annotated[
        tuple[float, float, float],
        Range(-MAX_DISTANCE, MAX_DISTANCE),
        Setting(
            "m, m, rad",
            "Initial error",
            "Tracking error at the start: how far the reference is ahead and to the left of the "
            "robot (m) and turned from it (rad); default: none.",
            metavar="X,Y,THETA",
        ),
    ] = field(default=(0.0, 0.0, 0.0), kw_only=False)
    control_period: Annotated[
        float,
        POSITIVE,
        Setting(
            "s",
            "Control period",
            "Control period, s: the time between two samples, during which efforts are held.",
            metavar="S",
        ),
    ] = CONTROL_PERIOD
    plant_step: Annotated[
        float,
        POSITIVE,
        Setting("s", "Integration step", "Longest step of the plant's integration.", metavar="S"),
    ] = 0.002
    friction: Annotated[
        float,
        POSITIVE,
        Setting(
            "",
            "",
            "Friction coefficient between wheels and ground, for plants that slip and for the "
            f"reported grip; default: {FRICTION:g}.",
        ),
    ] = FRICTION
    size: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "m",
            "",
            "Size of a named reference, m: radius of the circle, half the length of eight and "
            "waypoints, half the side of the square, length of the line; default: one that fits "
            "the robot.",
            metavar="M",
        ),
    ] = None
    speed: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "m/s",
            "",
            "Largest speed along a named reference, m/s (of a spin, rad/s); default: half of "
            "what the robot's limits allow, or less.",
            metavar="M_PER_S",
        ),
    ] = None
    laps: Annotated[
        float | None,
        POSITIVE,
        Setting(
            "", "", "How many times to go round circle, eight or spin; default: 1.", metavar="N"
        ),
    ] = None
    log_every: Annotated[
        int | None,
        Range(1, MAX_LOG_EVERY, "a whole number, 1 or more"),
        Setting(
            "",
            "",
            "Log every Nth sample, and the last; default: such that at most 25 000 are logged.",
            metavar="N",
        ),
    ] = None
    smooth: Annotated[
        float | str | None,
        POSITIVE,
        Setting(
            "m",
            "Reference smoothed by",
            "Smooth the rows of a CSV by at most this distance, root mean square; auto: by as "
            "much as their noise requires.",
            metavar="METRES|auto",
        ),
    ] = None
    retime: Annotated[
        bool,
        Setting(
            "",
            "Reference retimed",
            "Slow a CSV down where it exceeds the robot's limits.",
        ),
    ] = False
    rates: Annotated[
        str | None,
        OneOf(RATES),
        Setting(
            "",
            "Rates",
            "Rates that the controller uses: measured, or estimated by an observer; default: "
            "estimated where they are missing or quantised.",
            metavar="|".join(RATES),
        ),
    ] = None
    delay: Annotated[
        float | None,
        DEAD_TIME,
        Setting(
            "s",
            "Delay that the controller knows",
            "Known time from a measurement to the efforts that answer it, s. The controller "
            "predicts the state over it and raises the joints' bandwidth; the plant has this "
            "delay unless its configuration sets another. Default: 0, with gains that tolerate "
            "50 ms.",
            metavar="S",
        ),
    ] = None
    allow_sag: Annotated[
        bool,
        Setting(
            "",
            "Robot that may sag",
            "Simulate a robot even if a motor is too weak to hold its joint at the start.",
        ),
    ] = False

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        super().__post_init__()
        if type(self.log_every) not in (int, NoneType):
            raise RpctlError(f"log_every is {self.log_every}; give a whole number, 1 or more")
        require_smoothing(self.smooth)

    def log_step(self, periods: int) -> int:
        """Return the number N such that every Nth sample is logged.

        Args:
            periods: Number of control periods of the run.
        """
        return self.log_every or max(1, -(-periods // MAX_LOGGED))

    def load_reference(self, robot: Robot, collisions: bool = True) -> Reference:
        """Return the reference; ``collisions`` as of :func:`rpctl.reference.load.load_reference`.

        Raises:
            UnknownNameError: There is no reference with this name, and no such file.
            RpctlError: The file has faults, or the robot cannot follow the reference.
        """
        return load_reference(
            robot,
            self.reference,
            size=self.size,
            speed=self.speed,
            laps=self.laps,
            smooth=self.smooth,
            retime=self.retime,
            collisions=collisions,
        )


@dataclass(frozen=True, kw_only=True)
class Config:
    """The configuration of a run: everything except the robot.

    Attributes:
        kinematic: The kinematic law, its name, or a plain function.
        dynamic: The dynamic law, its name, or a plain function.
        run: Reference, duration, start, sample times and friction.
        limits: Limits that replace those of the URDF.
        plant: Differences between the simulated robot and the controller's model.
        output: For a robot that takes speeds, the lag with which it follows them, as the controller
            knows it; the dynamic law is then not used. None: the robot takes efforts.
        guards: How the controller treats faults, and the largest rate of efforts.

    Raises:
        UnknownNameError: The name of a law is not known.
        RpctlError: A law is not of its kind.
    """

    kinematic: KinematicLaw | KinematicFunction = field(
        default_factory=lambda: default_laws()[0], kw_only=False
    )
    dynamic: DynamicLaw | DynamicFunction = field(
        default_factory=lambda: default_laws()[1], kw_only=False
    )
    run: RunSettings = field(default_factory=RunSettings, kw_only=False)
    limits: LimitOverrides = field(default_factory=LimitOverrides)
    plant: Plant = field(default_factory=Plant)
    output: VelocityOutput | None = None
    guards: Guards = field(default_factory=Guards)

    def __post_init__(self) -> None:
        """Replace the names of laws by the laws."""
        for kind in LAW_CHOICES:
            object.__setattr__(self, kind, read_law(kind, getattr(self, kind)))

    @property
    def delay(self) -> float:
        """Simulated time from a measurement to the efforts that answer it, s."""
        return self.plant.delay or self.run.delay or 0.0

    def on(self, robot: Robot) -> Config:
        """Return the configuration; for a robot that leans, `Balance` replaces the default law."""
        if robot.drive.leans and self.dynamic == default_laws()[1]:
            return dataclasses.replace(self, dynamic=default_laws(robot)[1])
        return self

    def with_laws(
        self,
        kinematic: str | KinematicLaw | KinematicFunction | None = None,
        dynamic: str | DynamicLaw | DynamicFunction | None = None,
    ) -> Config:
        """Return the configuration with these laws.

        A law that is given by name keeps its settings if the configuration has it already.

        Args:
            kinematic: The kinematic law, its name, or a function; None: the present one.
            dynamic: The dynamic law, its name, or a function; None: the present one.

        Raises:
            UnknownNameError: The name of a law is not known.
            RpctlError: A law is not of its kind.
        """
        given: Table = {"kinematic": kinematic, "dynamic": dynamic}
        made = dataclasses.replace(self, **{k: law for k, law in given.items() if law is not None})
        kept = {
            key: getattr(self, key)
            for key, law in given.items()
            if isinstance(law, str) and type(getattr(made, key)) is type(getattr(self, key))
        }
        return dataclasses.replace(made, **kept)

    def with_output(
        self, output: str | None, lag: float | None = None, dead_time: float | None = None
    ) -> Config:
        """Return the configuration with this output.

        Args:
            output: ``"effort"``, ``"velocity"``, another kind, or kinds by group,
                ``"base=twist,arm_*=position"``. An output of the same kind keeps its settings;
                None: the present one.
            lag: Lag of the speeds, s; None: the present one.
            dead_time: Dead time of the speeds, s; None: the present one.

        Raises:
            RpctlError: There is no such output, or ``lag`` or ``dead_time`` is given for efforts.
        """
        known = self.output if output is None else as_output(read_groups(output))
        if known is not None and self.output is not None and same_kinds(known, self.output):
            known = self.output
        given = {"lag": lag, "dead_time": dead_time}
        changes: dict[str, Any] = {key: x for key, x in given.items() if x is not None}
        if changes and known is None:
            raise RpctlError(
                "--actuator-lag and --dead-time apply to commanded speeds; add --output velocity"
            )
        output_now = None if known is None else dataclasses.replace(known, **changes)
        return dataclasses.replace(self, output=output_now)

    def with_bandwidth(self, bandwidth: float | None) -> Config:
        """Return the configuration with gains for a bandwidth of the arm's joints.

        Args:
            bandwidth: Bandwidth, Hz; None: the present gains.

        Raises:
            RpctlError: The bandwidth is not positive.
        """
        if bandwidth is None:
            return self
        laws = {key: at_bandwidth(getattr(self, key), bandwidth) for key in LAW_CHOICES}
        return dataclasses.replace(self, **laws)

    def with_known_delay(self) -> Config:
        """Return the configuration with the joints' gains for the known delay, ``run.delay``."""
        told = self.run.control_period, self.run.delay
        laws = {key: knowing_delay(getattr(self, key), *told) for key in LAW_CHOICES}
        return dataclasses.replace(self, **laws)

    def with_run(self, **settings: Any) -> Config:
        """Return the configuration with these settings of ``run``; None keeps the present one."""
        given = {key: value for key, value in settings.items() if value is not None}
        return dataclasses.replace(self, run=dataclasses.replace(self.run, **given))


def read_groups(output: str) -> str | dict[str, str]:
    """Return the kinds of ``PATTERN=KIND,...`` by pattern; one kind alone is itself.

    Raises:
        RpctlError: A group has no kind.
    """
    if "=" not in output:
        return output
    pairs = [word.strip().rpartition("=") for word in output.split(",")]
    if not all(pattern and kind for pattern, _, kind in pairs):
        raise RpctlError(f"--output {output}: write base=twist,arm_*=position, each with its kind")
    return {pattern: kind for pattern, _, kind in pairs}


LAW_CHOICES = {"kinematic": KINEMATIC_CHOICE, "dynamic": DYNAMIC_CHOICE}
CONFIG_TABLES = tuple(fields_of(Config))


def read_config(path: str | Path) -> Config:
    """Read a configuration; what the file leaves out keeps its default.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    return toml.read(path, config_from_tables, "a configuration file")


def as_config(given: Config | str | Path | None, robot: Robot) -> Config:
    """Return a configuration, or that of a file; None: the robot's default.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults.
        RpctlError: It is no configuration.
    """
    config = read_config(given) if isinstance(given, str | Path) else given or Config()
    if not isinstance(config, Config):
        raise RpctlError(f"config is {shown(given)}; give a rpctl.Config, or the path of its TOML")
    return config.on(robot)


def config_from_tables(data: Table, faults: list[str]) -> Config:
    """Return the configuration of a file's tables; what is wrong is added to the faults.

    A kinematic law of the user's own, ``law = "own.py:MyLaw"``, is run: the file is the user's.
    """
    *first, last = CONFIG_TABLES
    known = f"{', '.join(first)} and {last}"
    faults += [
        f"{key}: a configuration has no such table; it can have {known}"
        for key in data
        if key not in CONFIG_TABLES
    ]
    tables = {key: table for key, table in data.items() if key in CONFIG_TABLES}
    count = len(faults)
    if "kinematic" in tables:
        tables["kinematic"] = read_own_laws(tables["kinematic"], "kinematic", faults)
    if len(faults) > count:
        del tables["kinematic"]
    return read_record(Config, tables, "", faults) or Config()


def write_config(config: Config, path: str | Path, *, schema: bool = False) -> Path:
    """Write a configuration with all its settings as TOML; reading the file restores it.

    Args:
        config: The configuration.
        path: The file.
        schema: Whether to write its JSON Schema, too, as ``FILE.schema.json``; the first line of
            the TOML file names the schema, so that editors complete and check the settings.

    Returns:
        The path.

    Raises:
        RpctlError: A file cannot express the configuration (a law without a name, a simulator in
            Python), or the file cannot be written.
    """
    tables, faults = to_plain(config), list[str]()
    config_from_tables(tables, faults)
    if faults:
        raise RpctlError(f"the configuration cannot be written to a file: {'; '.join(faults)}")
    beside = Path(f"{path}.schema.json")
    head = f"#:schema ./{beside.name}\n{HEADER}" if schema else HEADER
    try:
        if schema:
            write_atomically(beside, f"{json.dumps(json_schema(Config), indent=1)}\n".encode())
        return write_atomically(path, (head + tomli_w.dumps(tables)).encode())
    except UnicodeEncodeError:
        raise RpctlError(
            f"{path}: a file name in the configuration is not UTF-8, which TOML requires; rename "
            "that file"
        ) from None


def whole_periods(duration: float, control_period: float) -> int:
    """Return how many control periods (s) lie within a duration (s); one at least.

    Raises:
        RpctlError: One of them is not positive.
    """
    require_positive("duration", duration)
    require_positive("control_period", control_period)
    return max(1, math.floor(duration / control_period + WHOLE_PERIOD_TOLERANCE))


def delay_periods(delay: float, control_period: float) -> int:
    """Return the number of control periods (s) nearest to a delay (s); halves count up."""
    return math.floor(delay / control_period + 0.5 + WHOLE_PERIOD_TOLERANCE)


def is_whole(time: float, control_period: float, periods: int) -> bool:
    """Return whether a time (s) is that many control periods (s)."""
    return abs(time / control_period - periods) <= WHOLE_PERIOD_TOLERANCE
