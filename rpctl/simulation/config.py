"""The configuration of a run: its laws, limits and circumstances, and its file in TOML."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from rpctl.control.bandwidth import at_bandwidth
from rpctl.control.defaults import default_laws
from rpctl.control.law import DynamicFunction, DynamicLaw, KinematicFunction, KinematicLaw
from rpctl.control.registry import (
    DYNAMIC_LAWS,
    KINEMATIC_LAWS,
    dynamic_by_name,
    kinematic_by_name,
)
from rpctl.control.settings import (
    DYNAMIC_REGISTRY,
    KINEMATIC_REGISTRY,
    from_table,
    named_from_table,
    named_to_table,
    to_table,
)
from rpctl.control.velocity_output import VelocityOutput, as_output
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.errors import RpctlError, require_positive, require_within
from rpctl.files import toml
from rpctl.files.toml import Table
from rpctl.files.writing import write_atomically
from rpctl.reference.load import load_reference
from rpctl.reference.motion import Reference
from rpctl.reference.pose_goal import MAX_DISTANCE
from rpctl.reference.sizing import SizingRequest
from rpctl.reference.smooth_wish import require_smoothing
from rpctl.robot.model import Robot
from rpctl.robot.vary import set_limits
from rpctl.simulation.periods import CONTROL_PERIOD
from rpctl.simulation.plant import Plant

HEADER = (
    "# A run of rpctl: rpctl track ROBOT --config FILE. What is left out keeps its default.\n\n"
)


@dataclass(frozen=True)
class LimitOverrides:
    """Limits that replace the URDF's, by pattern of joint names.

    Attributes:
        effort: N·m or N.
        velocity: rad/s or m/s.
    """

    effort: Mapping[str, float] = field(default_factory=dict)
    velocity: Mapping[str, float] = field(default_factory=dict)

    def apply(self, robot: Robot) -> Robot:
        """Return a robot with these limits.

        Raises:
            RpctlError: A pattern matches no joint, or a limit is not positive.
        """
        return set_limits(robot, self.effort, self.velocity)


@dataclass(frozen=True)
class RunSettings:
    """The circumstances of a run: reference, duration, start, sample times and friction.

    Attributes:
        reference: Its name or file.
        duration: s; None: as long as the reference moves.
        initial_error: Tracking error (x1, x2, x3) at the start, m, m, rad.
        control_period: s.
        plant_step: s.
        friction: Coefficient between wheels and ground.
        size: Of a named reference, m; None: as fits the robot.
        speed: Of a named reference, m/s, of a spin rad/s; None: as fits the robot.
        laps: How many times a named reference is gone through; None: once.
        log_every: Each so-many-th sample is logged, and the last; 1 logs all.
        smooth: Of a CSV: metres (root mean square) by which it may miss its rows, or ``auto``.
        retime: Of a CSV: whether it is slowed down where it asks more than the robot's limits.
    """

    reference: str = "eight"
    duration: float | None = None
    initial_error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    control_period: float = CONTROL_PERIOD
    plant_step: float = 0.002
    friction: float = FRICTION
    size: float | None = None
    speed: float | None = None
    laps: float | None = None
    log_every: int = 1
    smooth: float | str | None = None
    retime: bool = False

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        if not (type(self.log_every) is int and self.log_every >= 1):
            raise RpctlError(f"log_every is {self.log_every}; give a whole number, 1 or more")
        for name in ("duration", "control_period", "plant_step", "friction"):
            value = getattr(self, name)
            if value is not None:
                require_positive(name, value)
        SizingRequest(self.size, self.speed, self.laps)
        require_smoothing(self.smooth)
        require_within("initial_error", self.initial_error, MAX_DISTANCE)

    def load_reference(self, robot: Robot, collisions: bool = True) -> Reference:
        """Return the reference; ``collisions`` as of :func:`rpctl.reference.load.load_reference`.

        Raises:
            RpctlError: There is none such, or the robot cannot follow it.
        """
        return load_reference(
            robot,
            self.reference,
            self.size,
            self.speed,
            self.laps,
            self.smooth,
            self.retime,
            collisions,
        )


@dataclass(frozen=True)
class Config:
    """The configuration of a run: everything but the robot.

    Attributes:
        kinematic: The kinematic law, or a plain function.
        dynamic: The dynamic law, or a plain function.
        run: The circumstances.
        limits: Limits that replace the URDF's.
        plant: Differences between the simulated robot and the controller's model.
        output: Of a robot that takes speeds: how it follows them, as the controller knows it, and
            no dynamic law counts; None: its output are efforts.
    """

    kinematic: KinematicLaw | KinematicFunction = field(default_factory=lambda: default_laws()[0])
    dynamic: DynamicLaw | DynamicFunction = field(default_factory=lambda: default_laws()[1])
    run: RunSettings = field(default_factory=RunSettings)
    limits: LimitOverrides = field(default_factory=LimitOverrides)
    plant: Plant = field(default_factory=Plant)
    output: VelocityOutput | None = None

    def with_laws(self, kinematic: str | None, dynamic: str | None) -> Config:
        """Return a configuration with these laws, by name; those that it has keep their settings.

        Raises:
            UnknownNameError: There is no such law.
        """
        laws: Table = {}
        if kinematic is not None and type(self.kinematic) is not KINEMATIC_LAWS.get(kinematic):
            laws["kinematic"] = kinematic_by_name(kinematic)
        if dynamic is not None and type(self.dynamic) is not DYNAMIC_LAWS.get(dynamic):
            laws["dynamic"] = dynamic_by_name(dynamic)
        return dataclasses.replace(self, **laws)

    def with_output(
        self, output: str | None, lag: float | None = None, dead_time: float | None = None
    ) -> Config:
        """Return a configuration with this output.

        Args:
            output: ``"effort"`` or ``"velocity"``, whose settings stay if it is that already; None
                leaves it as it is.
            lag: Of its speeds, s; None leaves it as it is.
            dead_time: Of its speeds, s; None leaves it as it is.

        Raises:
            RpctlError: There is no such output, or efforts have no lag and dead time.
        """
        known = self.output if output is None else as_output(output)
        if known is not None and self.output is not None:
            known = self.output
        given = {"lag": lag, "dead_time": dead_time}
        changes: dict[str, Any] = {key: x for key, x in given.items() if x is not None}
        if changes and known is None:
            raise RpctlError("a lag and a dead time are those of speeds; add --output velocity")
        output_now = None if known is None else dataclasses.replace(known, **changes)
        return dataclasses.replace(self, output=output_now)

    def with_bandwidth(self, bandwidth: float | None) -> Config:
        """Return a configuration whose laws give the joints a bandwidth (Hz); None: their own.

        Raises:
            RpctlError: The bandwidth is not positive.
        """
        if bandwidth is None:
            return self
        laws = {key: at_bandwidth(getattr(self, key), bandwidth) for key in LAW_REGISTRIES}
        return dataclasses.replace(self, **laws)

    def with_run(self, **settings: Any) -> Config:
        """Return a configuration with these settings of ``run``; those that are None stay."""
        given = {key: value for key, value in settings.items() if value is not None}
        return dataclasses.replace(self, run=dataclasses.replace(self.run, **given))


LAW_REGISTRIES = {"kinematic": KINEMATIC_REGISTRY, "dynamic": DYNAMIC_REGISTRY}
TABLES: dict[str, type[RunSettings | LimitOverrides | Plant | VelocityOutput]] = {
    "run": RunSettings,
    "limits": LimitOverrides,
    "plant": Plant,
    "output": VelocityOutput,
}


def read_config(path: str | Path) -> Config:
    """Read a configuration; what the file leaves out keeps its default.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    return toml.read(path, config_from_tables, "a configuration file")


def config_from_tables(data: Table, faults: list[str]) -> Config:
    """Return the configuration of a file's tables; what is wrong is added to the faults."""
    given: Table = {}
    for key, table in data.items():
        if key in LAW_REGISTRIES:
            given[key] = named_from_table(table, LAW_REGISTRIES[key], key, faults)
        elif key not in TABLES:
            faults.append(f"{key}: is no table of a configuration; it has kinematic, dynamic, run, "
                          "limits, plant and output")  # fmt: skip
        elif not isinstance(table, dict):
            faults.append(f"{key}: is {table!r}; write [{key}]")
        else:
            given[key] = from_table(TABLES[key], table, key, faults)
    return Config(**{key: made for key, made in given.items() if made is not None})


def config_tables(config: Config) -> Table:
    """Return a configuration as the tables of a file.

    Raises:
        RpctlError: It has a setting that no file can say.
    """
    laws = {key: named_to_table(getattr(config, key), kind) for key, kind in LAW_REGISTRIES.items()}
    rest = {key: getattr(config, key) for key in TABLES}
    return {**laws, **{key: to_table(each) for key, each in rest.items() if each is not None}}


def write_config(config: Config, path: str | Path) -> Path:
    """Write a configuration, complete: reading it gives it back.

    Raises:
        RpctlError: A law has no name or a setting that no file can say; the file cannot be written.
    """
    tables, faults = config_tables(config), list[str]()
    config_from_tables(tables, faults)
    if faults:
        raise RpctlError(f"no file can say the configuration: {'; '.join(faults)}")
    try:
        return write_atomically(path, (HEADER + tomli_w.dumps(tables)).encode())
    except UnicodeEncodeError:
        raise RpctlError(
            f"{path}: TOML is UTF-8, and a name in the configuration is not; rename its file"
        ) from None
