"""A run: the closed loop from configuration to log, for as long as the reference asks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from rpctl.arrays import Array
from rpctl.control.law import DynamicFunction, DynamicLaw, KinematicFunction, KinematicLaw
from rpctl.control.output_groups import OutputGroup
from rpctl.control.registry import law_sentences, name_of
from rpctl.control.velocity_output import VelocityOutput, as_output
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.files.records import fields_of
from rpctl.reference.fitting import too_weak
from rpctl.reference.motion import (
    Reference,
    ReferenceState,
    require_pulling,
    require_reference,
    require_state,
)
from rpctl.reference.path_reference import DEFAULT_DURATION
from rpctl.reference.recorded.recording import Recording
from rpctl.reference.sizing import WISHES, SizingRequest
from rpctl.robot.model import Robot
from rpctl.simulation.config import (
    CONFIG_TABLES,
    LAW_CHOICES,
    Config,
    LimitOverrides,
    RunSettings,
    as_config,
)
from rpctl.simulation.loop.backend import run_loop
from rpctl.simulation.loop.budget import Budget, find_budget
from rpctl.simulation.loop.closed_loop import Loop, Watching, start_configuration
from rpctl.simulation.loop.notes import end_note, run_notes
from rpctl.simulation.loop.recorder import LoopSample, Recorder
from rpctl.simulation.merits.collision_facts import NOT_LOOKED_FOR
from rpctl.simulation.merits.collisions import (
    Surroundings,
    find_collisions,
    require_clear_start,
    surroundings,
)
from rpctl.simulation.merits.obstacles import find_obstacles
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.protocol import PlantModel
from rpctl.simulation.plants.starting import PLANTS, plant_by_name
from rpctl.simulation.run.derived import Derivation
from rpctl.simulation.run.facts import ground_facts, robot_facts
from rpctl.simulation.run.header import Header, recorded
from rpctl.simulation.run.log import MIN_SAMPLES
from rpctl.simulation.run.part import PartWriter
from rpctl.simulation.run.run import Run, run_of

if TYPE_CHECKING:
    from typing import Unpack  # of Python 3.11; never imported when it runs

    from rpctl.equivalence.verify import Certificate

SETTLING_S = 1.0  # s, after the end of one that has it


class TrackSettings(TypedDict, total=False):
    """What keywords of :func:`track` may say: names of :class:`~rpctl.Config` and of its run.

    The last four are those of :class:`SimulateOptions`.
    """

    kinematic: str | KinematicLaw | KinematicFunction | None
    dynamic: str | DynamicLaw | DynamicFunction | None
    plant: str | Plant | PlantModel | None
    output: str | Mapping[str, str | OutputGroup] | VelocityOutput | None
    limits: LimitOverrides
    run: RunSettings
    duration: float | None
    initial_error: Sequence[float]
    control_period: float
    plant_step: float
    friction: float
    size: float | None
    speed: float | None
    laps: float | None
    log_every: int | None
    smooth: float | str | None
    retime: bool
    rates: str | None
    delay: float
    allow_sag: bool
    name: str | None
    certificate: Certificate | None
    progress: Callable[[int, int], object] | None
    collisions: bool
    backend: str


TABLES = [name for name in CONFIG_TABLES if name not in LAW_CHOICES]
PASSED_ON = ("certificate", "progress", "collisions", "backend")


def track(
    robot: Robot,
    reference: str | Path | Reference | None = None,
    config: Config | str | Path | None = None,
    *,
    watch: Callable[[float, Array, ReferenceState], object] | None = None,
    **settings: Unpack[TrackSettings],
) -> Run:
    """Simulate a robot that tracks a reference, from rest; return the logged run.

    Args:
        robot: The robot.
        reference: A reference, the name of one (``line``, ``reverse``, ``spin``, ``circle``,
            ``eight``, ``waypoints``, ``ee-square``), or a file (CSV, TOML); None: the config's.
        config: Laws, plant and settings of the run, or the path of their TOML file; None: the
            robot's defaults.
        watch: Called at every sample with the time (s), q (nq,) and the
            :class:`ReferenceState`.
        **settings: Fields of :class:`Config` and of its ``run``, which take precedence over
            ``config``:
            ``duration=20``, ``initial_error=(0.1, 0, 0)``, ``kinematic="horizon"`` (or
            ``rpctl.Horizon(steps=10)``),
            ``plant="slipping"`` (or ``"perturbed"``, ``"contact"``, a :class:`Plant`, a simulator
            of the user), ``output="velocity"``. Further settings: ``name`` of the reference in the
            log, a ``certificate`` to store, ``progress``, which is called with the number of
            finished samples and their total, ``collisions=False`` to skip the check for
            collisions, and the ``backend`` of the loop: ``"compiled"`` machine code,
            ``"pinocchio"`` in Python, or ``"auto"``, the faster one; they agree to rounding.

    Returns:
        The run: samples, outcome and summary.

    Raises:
        DivergedError: The motion is no longer finite.
        UnknownNameError: A setting, a law, a plant or a reference is not known.
        RpctlError: A setting is out of range, the reference does not fit the robot, or a motor
            cannot hold its joint there.
    """
    config = configured(robot, reference, config, {**settings})
    run, own = config.run, None if isinstance(reference, str | Path) else reference
    if own is not None:
        SizingRequest(run.size, run.speed, run.laps).refuse(
            "the reference is a function, with its own pace", *WISHES
        )
    options: Any = {name: value for name, value in settings.items() if name in PASSED_ON}
    require_held(config.limits.apply(robot), config, own)
    options["watch"] = None if watch is None else lambda s: watch(s.t, s.q, s.state)
    return simulate(robot, config, own, **options)


def configured(
    robot: Robot,
    reference: str | Path | Reference | None,
    config: Config | str | Path | None,
    given: Mapping[str, Any],
) -> Config:
    """Return a configuration with a reference and with settings by their names."""
    for what in given:
        if what not in TrackSettings.__annotations__:
            raise UnknownNameError("setting", what, TrackSettings.__annotations__)
    if not isinstance(reference, str | Path | None):
        require_reference(reference)
    config = as_config(config, robot).with_laws(given.get("kinematic"), given.get("dynamic"))
    run = {name: given[name] for name in fields_of(RunSettings) if name in given}
    if "initial_error" in run:
        run["initial_error"] = tuple(run["initial_error"])
    if reference is not None:
        called_so = name_of(reference) if callable(reference) else str(reference)
        run["reference"] = given.get("name") or called_so
    tables = {name: given[name] for name in TABLES if given.get(name) is not None}
    if "plant" in tables:
        tables["plant"] = _as_plant(tables["plant"], robot)
    if "output" in tables:
        tables["output"] = as_output(tables["output"])
    tables["run"] = replace(tables.get("run", config.run), **run)
    return replace(config, **tables)


class SimulateOptions(TypedDict, total=False):
    """Who looks on while a run is simulated, and what is kept with it.

    Attributes:
        certificate: A certificate to keep with the run.
        progress: Called with the samples done and their total.
        watch: Called with every sample; what it takes is not counted as the simulation's. If it or
            ``progress`` fails, it is not called again, and a note of the run tells it.
        ended: Called with what was simulated if an error or Ctrl-C ends the loop early and there
            is a motion to keep; the exception is raised afterwards.
        part: Where the samples are written while they are simulated; :meth:`Run.load` reads its
            folder, also after the process was killed.
        collisions: Whether to look for collisions of its links afterwards, as it is if not given.
        backend: What closes the loop, as of :func:`track`.
    """

    certificate: Certificate | None
    progress: Callable[[int, int], object] | None
    watch: Callable[[LoopSample], object] | None
    ended: Callable[[Run], object]
    part: PartWriter
    collisions: bool
    backend: str


def simulate(
    robot: Robot,
    config: Config,
    reference: Reference | None = None,
    **options: Unpack[SimulateOptions],
) -> Run:
    """Simulate a robot as a configuration says, from rest.

    Args:
        robot: Before the configuration's limits.
        config: Laws, limits, circumstances and plant.
        reference: What the configuration's reference is; None loads it by its name.
        **options: Who looks on, and what is kept with the run.

    Raises:
        DivergedError: The motion left the finite numbers.
        RpctlError: A setting is out of range, the run beyond the caps of time or of its log, the
            reference does not fit the robot, or it starts inside an obstacle.
    """
    robot, ended = config.limits.apply(robot), options.get("ended")
    config = config.on(robot)
    collisions = options.get("collisions", True)
    if reference is None:
        reference = config.run.load_reference(robot, collisions)
    around = _surroundings(robot, config, reference) if collisions else None
    made = _made(robot, config, reference, options)
    recorder, bodies = made.recorder, None
    try:
        run_loop(made.loop, recorder, options.get("backend", "auto"))
        recorder.flush(ends=True)
        if around is not None:
            log = recorder.log()
            bodies = find_collisions(around, log.t, log.q)
    except BaseException as error:
        with suppress(RpctlError):  # what is sound of the last batch is logged
            recorder.flush(ends=True)
        if ended is not None and recorder.rows >= MIN_SAMPLES:
            ended(made.run(robot, () if around is None else (NOT_LOOKED_FOR,), error))
        raise
    return replace(made.run(robot), collisions=bodies)


def _made(robot: Robot, config: Config, reference: Reference, options: SimulateOptions) -> _Made:
    """Return a run that has not begun."""
    steps = require_affordable(robot, config, reference).periods
    config = config.with_run(log_every=config.run.log_step(steps)).with_known_delay()
    if config.output is not None:
        config = replace(config, output=config.output.on(robot))
    loop = Loop(ReducedDynamics(robot), config, reference, steps)
    if (watch := options.get("watch")) is not None:
        loop.watch = Watching("what watched the simulation", watch)
    if (progress := options.get("progress")) is not None:
        loop.progress = Watching("what showed its progress", progress)
    derivation, part = Derivation(loop.dynamics, config), options.get("part")
    recorder = Recorder(derivation, steps, config.run.log_every or 1, part, loop.known)
    made = _Made(_header(loop, derivation, options.get("certificate")), loop, recorder, part)
    if part is not None:
        part.begin(made.header())
    return made


def _header(loop: Loop, derivation: Derivation, certificate: Certificate | None) -> Header:
    """Return what there is to say of a run before it begins."""
    config, reference, robot = loop.config, loop.reference, loop.dynamics.robot
    plant, period = config.plant, config.run.control_period
    recording: Recording | None = getattr(reference, "recording", None)
    dynamic = config.dynamic if config.output is None else None
    known = ReducedDynamics(plant.known_robot(robot))
    return Header(
        robot=robot_facts(robot),
        ground=ground_facts(robot, derivation.contacts, config.run.friction),
        config=recorded(config, loop.steps),
        controller_model=None if plant.controller_model is None else plant.controller_model.name,
        kinematic_report={},
        certificate=None if certificate is None else certificate.to_dict(),
        wall_time=0.0,
        sizing=getattr(reference, "sizing", None),
        recording=None if recording is None else recording.to_dict(),
        law_sentences=law_sentences(known, config.kinematic, dynamic, period),
    )


@dataclass(frozen=True)
class _Made:
    """A run as far as it has come.

    Attributes:
        planned: What there was to say of it before it began.
        loop: Its loop.
        recorder: What was logged.
        part: Where that is written meanwhile.
    """

    planned: Header
    loop: Loop
    recorder: Recorder
    part: PartWriter | None

    def header(self, *notes: str, whole: bool = True) -> Header:
        """Return what there is to say of it now; ``notes`` come last."""
        written = () if self.part is None else self.part.notes
        return replace(
            self.planned,
            **self.loop.known(),
            notes=(*run_notes(self.loop.config, whole), *self.loop.notes, *written, *notes),
            bound_limits=self.recorder.bound_limits,
        )

    def run(
        self, robot: Robot, missed: tuple[str, ...] = (), error: BaseException | None = None
    ) -> Run:
        """Return the run.

        Args:
            robot: Its robot.
            missed: What was left out, in sentences.
            error: What ended it early.
        """
        log, planned = self.recorder.log(), self.planned.config.run
        if error is None:
            return run_of(self.header(), log, robot)
        note = end_note(error, float(log.t[-1]), planned.duration or 0.0)
        header = self.header(*missed, note, whole=False)
        duration = self.recorder.steps * planned.control_period
        return run_of(replace(header, config=header.config.with_run(duration=duration)), log, robot)


def _surroundings(robot: Robot, config: Config, reference: Reference) -> Surroundings | None:
    """Return what its links may run into, if there is anything; it may not start inside of it."""
    obstacles = find_obstacles(config)
    if not obstacles and not robot.joints:
        return None
    around = surroundings(robot, obstacles)
    if obstacles:
        start = start_configuration(robot, reference(0.0), config.run.initial_error)
        require_clear_start(around, start)
    return around


def require_affordable(robot: Robot, config: Config, reference: Reference) -> Budget:
    """Return what a run will cost; refuse it beyond the caps.

    Args:
        robot: The robot.
        config: How it is simulated.
        reference: What is tracked.

    Raises:
        RpctlError: It would take too long, log too much, or never see its plant's delay pass.
    """
    duration = config.run.duration or default_duration(reference)
    require_pulling(robot, reference, duration)
    budget = find_budget(robot, config.run, duration)
    budget.require_within_caps()
    if config.delay > duration:
        raise RpctlError(late(config.delay, duration))
    return budget


def require_held(robot: Robot, config: Config, reference: Reference | None = None) -> None:
    """Refuse a robot that sinks where it starts, unless the configuration lets it.

    Args:
        robot: The robot.
        config: How it is simulated; where it takes speeds, efforts are whatever these take.
        reference: Where it starts, the robot is held; None: at home.

    Raises:
        RpctlError: The limit of an effort is less than what gravity takes.
    """
    if config.run.allow_sag or config.output is not None or config.plant.own is not None:
        return
    if reference is not None:
        require_state(robot, reference(0.0), 0.0)
    if weak := too_weak(ReducedDynamics(robot), reference):
        raise RpctlError(f"{weak}; or allow it to sag with --allow-sag, or allow_sag of [run]")


def late(delay: float, duration: float) -> str:
    """Return that a delay (s) is longer than the run (s), in words."""
    return f"delay is {delay:g} s, longer than the run of {duration:g} s"


def _as_plant(plant: str | Plant | PlantModel, robot: Robot) -> Plant:
    """Return the plant that is meant."""
    if isinstance(plant, str):
        return plant_by_name(plant, robot)
    if isinstance(plant, Plant):
        return plant
    if not isinstance(plant, PlantModel):
        raise RpctlError(
            f"the plant is {plant!r}; give {', '.join(PLANTS)}, a Plant, or an object with "
            "start(robot, rest)"
        )
    return Plant(kind="own", own=plant)


def default_duration(reference: Reference) -> float:
    """Return how long (s) to track a reference if nobody says.

    A named one says it; one with an end is tracked a second longer than it moves, others 20 s.
    """
    if hasattr(reference, "default_duration"):
        return float(reference.default_duration)
    if hasattr(reference, "duration"):
        return float(reference.duration) + SETTLING_S
    return DEFAULT_DURATION
