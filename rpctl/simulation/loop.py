"""A run: the closed loop from configuration to log, for as long as the reference asks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import cast

from rpctl.arrays import Array
from rpctl.control.defaults import default_laws
from rpctl.control.law import DynamicFunction, DynamicLaw, KinematicFunction, KinematicLaw
from rpctl.control.law_sentences import law_sentences
from rpctl.control.returned import require_callable
from rpctl.control.velocity_output import VelocityOutput, as_output
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Certificate
from rpctl.errors import RpctlError
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.path_reference import DEFAULT_DURATION
from rpctl.reference.recording import Recording
from rpctl.reference.sizing import WISHES, SizingRequest
from rpctl.robot.model import Robot
from rpctl.simulation.backend import run_loop
from rpctl.simulation.budget import Budget, find_budget
from rpctl.simulation.closed_loop import LoopRecord, Watcher, start_configuration
from rpctl.simulation.collision_facts import NOT_LOOKED_FOR, CollisionFacts
from rpctl.simulation.collisions import find_collisions, require_clear_start, surroundings
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.derived import Derivation
from rpctl.simulation.facts import ground_facts, robot_facts
from rpctl.simulation.log import MIN_SAMPLES, NO_SAMPLES, Log
from rpctl.simulation.obstacles import find_obstacles
from rpctl.simulation.periods import delay_note, duration_note, log_note
from rpctl.simulation.plant import Plant
from rpctl.simulation.plants.named import PLANTS, plant_by_name
from rpctl.simulation.plants.protocol import PlantModel
from rpctl.simulation.recorded import recorded
from rpctl.simulation.recorder import Recorder
from rpctl.simulation.run import Run, entries_of
from rpctl.simulation.spool import Spool
from rpctl.simulation.watching import Watching

SETTLING_S = 1.0  # s, after the end of one that has it


def track(
    robot: Robot,
    reference: str | Reference = RunSettings.reference,
    duration: float | None = RunSettings.duration,
    initial_error: Sequence[float] = RunSettings.initial_error,
    kinematic: KinematicLaw | KinematicFunction | None = None,
    dynamic: DynamicLaw | DynamicFunction | None = None,
    control_period: float = RunSettings.control_period,
    plant_step: float = RunSettings.plant_step,
    certificate: Certificate | None = None,
    progress: Callable[[int, int], object] | None = None,
    friction: float = RunSettings.friction,
    plant: str | Plant | PlantModel | None = None,
    watch: Callable[[float, Array, ReferenceState], object] | None = None,
    name: str | None = None,
    size: float | None = None,
    speed: float | None = None,
    laps: float | None = None,
    log_every: int = RunSettings.log_every,
    smooth: float | str | None = RunSettings.smooth,
    retime: bool = RunSettings.retime,
    collisions: bool = True,
    output: str | VelocityOutput = "effort",
    backend: str = "auto",
) -> Run:
    """Simulate a robot that tracks a reference, from rest.

    The laws run every ``control_period``, their efforts are held in between (zero-order hold), and
    the plant is integrated in steps of at most ``plant_step``.

    Args:
        robot: The robot.
        reference: A reference, the name of one (``line``, ``reverse``, ``spin``, ``circle``,
            ``eight``, ``waypoints``, ``ee-square``), or a file: ``.csv`` or ``.toml``.
        duration: s; None lasts as long as the laps of a named reference, a second longer than one
            that ends moves, or 20 s. The run ends with the last whole control period within it.
        initial_error: Tracking error (x1, x2, x3) of the base at the start: how far the reference
            is ahead (m), to the left (m) and turned to the left (rad), seen from the robot.
        kinematic: The kinematic law; None takes the default, the unified one.
        dynamic: The dynamic law; None takes the default, within limits with integral action.
        control_period: s.
        plant_step: s.
        certificate: A certificate to keep with the run.
        progress: Called with the samples done and their total. If it or ``watch`` fails, it is not
            called again, and a note of the run tells it.
        friction: Coefficient between wheels and ground, for the grip that the motion uses.
        plant: What the controller drives: ``"ideal"``, ``"perturbed"``, ``"slipping"`` or
            ``"contact"``; a :class:`Plant`, which says how it differs from the controller's model;
            a simulator of one's own, a :class:`~rpctl.simulation.plants.protocol.PlantModel`. None
            is ``"ideal"``.
        watch: Called with the time (s), q (nq,) and the reference at every sample; what it takes
            is not counted as the simulation's.
        name: What the log calls the reference; None: its name or file, or else its type.
        size: Of a named reference, m; None: as fits the robot. See
            :func:`rpctl.reference.load.load_reference`, also for the two that follow.
        speed: Of a named reference, m/s; of a spin rad/s.
        laps: How many times it is gone through.
        log_every: Each so-many-th sample is logged, and the last; 1 logs all. What a long run
            takes of memory and disk falls with it.
        smooth: Of a CSV: metres (root mean square) by which the reference may miss its rows to be
            smooth, or ``auto``, as their noise asks for; None passes every row.
        retime: Of a CSV: whether it is slowed down where it asks more than the robot's limits.
        collisions: Whether to look afterwards for what the links ran into, and how near they came
            to obstacles, the ground and each other; and whether a named reference avoids that.
        output: ``"effort"``; ``"velocity"`` for a robot that takes speeds, or a
            :class:`~rpctl.control.velocity_output.VelocityOutput` that says how it follows them.
            Then no dynamic law counts, and the efforts logged are those that the motion takes.
        backend: ``"compiled"``: the loop as machine code, where there is any for the laws; it takes
            a second or so to build, and is kept on disk. ``"pinocchio"``: in Python. ``"auto"``:
            the quicker one. Their numbers agree to rounding.

    Returns:
        What was logged.

    Raises:
        DivergedError: The motion left the finite numbers.
        RpctlError: A setting is out of range, or the reference does not fit the robot.
    """
    given = {"reference": reference, "kinematic": kinematic, "dynamic": dynamic}
    for what, value in given.items():
        if value is not None and not (what == "reference" and isinstance(value, str)):
            require_callable(what, value)
    usual = default_laws(robot)
    config = Config(
        kinematic=kinematic or usual[0],
        dynamic=dynamic or usual[1],
        run=RunSettings(
            name or (reference if isinstance(reference, str) else _called(reference)),
            duration,
            cast("tuple[float, float, float]", tuple(initial_error)),
            control_period,
            plant_step,
            friction,
            size,
            speed,
            laps,
            log_every,
            smooth,
            retime,
        ),
        plant=_as_plant(plant, robot),
        output=as_output(output),
    )
    watcher = None if watch is None else lambda s: watch(s.t, s.q, s.state)
    if isinstance(reference, str):
        return simulate(
            robot,
            config,
            None,
            certificate,
            progress,
            watcher,
            collisions=collisions,
            backend=backend,
        )
    SizingRequest(size, speed, laps).refuse(
        "the reference is a function, with its own pace", *WISHES
    )
    return simulate(
        robot,
        config,
        reference,
        certificate,
        progress,
        watcher,
        collisions=collisions,
        backend=backend,
    )


def simulate(
    robot: Robot,
    config: Config,
    reference: Reference | None = None,
    certificate: Certificate | None = None,
    progress: Callable[[int, int], object] | None = None,
    watch: Watcher | None = None,
    ended: Callable[[Run], object] | None = None,
    spool: Spool | None = None,
    collisions: bool = True,
    backend: str = "auto",
) -> Run:
    """Simulate a robot as a configuration says, from rest.

    Args:
        robot: The robot, before the configuration's limits.
        config: Laws, limits, circumstances and plant.
        reference: What the configuration's reference is; None loads it by its name.
        certificate: A certificate to keep with the run.
        progress: Called with the samples done and their total.
        watch: Called with every sample; what it takes is not counted as the simulation's. If it or
            ``progress`` fails, it is not called again, and a note of the run tells it.
        ended: Called with what was simulated if an error or Ctrl-C ends the loop early and there
            is a motion to keep; the exception is raised afterwards.
        spool: Where the samples are written while they are simulated; :meth:`Run.load` reads its
            folder, also after the process was killed. None: nowhere.
        collisions: Whether to look for collisions of its links afterwards.
        backend: What closes the loop, as of :func:`track`.

    Raises:
        DivergedError: The motion left the finite numbers.
        RpctlError: A setting is out of range, the run is beyond the caps of time or of its log,
            the reference does not fit the robot, or the robot starts inside an obstacle.
    """
    settings, plant, period = config.run, config.plant, config.run.control_period
    robot = config.limits.apply(robot)
    if reference is None:
        reference = settings.load_reference(robot, collisions)
    steps = require_affordable(robot, config, reference).periods
    notes = () if settings.duration is None else duration_note(settings.duration, period)
    dynamics = ReducedDynamics(robot)
    simulated = plant.simulated_dynamics(dynamics)
    contacts = find_contacts(simulated, settings.friction)
    derivation = Derivation(simulated, contacts, plant.bias(robot), plant.wrenches)
    recording: Recording | None = getattr(reference, "recording", None)
    loop, known = LoopRecord(), plant.known_dynamics(dynamics)
    dynamic = config.dynamic if config.output is None else None
    sentences = law_sentences(known, config.kinematic, dynamic, period)
    speeds = config.output is not None
    recorder = Recorder(derivation, steps, settings.log_every, spool, loop.known, speeds)
    watching = None if watch is None else Watching("what watched the simulation", watch)
    showing = Watching("what showed its progress", progress)
    obstacles = find_obstacles(config)
    around = surroundings(robot, obstacles) if collisions and obstacles else None
    if around is not None:
        start = start_configuration(robot, reference(0.0), settings.initial_error)
        require_clear_start(around, start)

    def run(
        log: Log,
        steps: int,
        notes: tuple[str, ...],
        *ending: str,
        bodies: CollisionFacts | None = None,
    ) -> Run:
        return Run(
            log=log,
            robot=robot_facts(robot),
            ground=ground_facts(contacts, settings.friction),
            config=recorded(config, steps),
            controller_model=plant.controller_model.name if plant.controller_model else None,
            kinematic_report=loop.report,
            notes=(
                *notes,
                *delay_note(plant.delay, period),
                *velocity_note(config),
                *log_note(settings.log_every, period),
                *plant_note(config),
                *loop.notes,
                *(() if watching is None else watching.notes),
                *showing.notes,
                *(() if spool is None else spool.notes),
                *ending,
            ),
            certificate=None if certificate is None else certificate.to_dict(),
            wall_time=loop.wall_time,
            sizing=getattr(reference, "sizing", None),
            recording=None if recording is None else recording.to_dict(),
            collisions=bodies,
            law_sentences=sentences,
            simulated=robot,
        )

    bodies: CollisionFacts | None = None
    looks = collisions and bool(around is not None or robot.joints)
    if spool is not None:
        spool.begin(entries_of(run(NO_SAMPLES, steps, notes))[0])
    try:
        run_loop(dynamics, config, reference, steps, recorder, loop, showing, watching, backend)
        recorder.derive(ends=True)
        log = recorder.log()
        if looks:
            bodies = find_collisions(around or surroundings(robot, ()), log.t, log.q)
    except BaseException as error:
        if ended is not None:
            with suppress(RpctlError):  # what is sound of the last batch is logged
                recorder.derive(ends=True)
            if recorder.rows >= MIN_SAMPLES:
                log = recorder.log()
                note = _end_note(error, float(log.t[-1]), steps * period)
                missed = (NOT_LOOKED_FOR,) if looks else ()
                ended(run(log, recorder.steps, (), *missed, note))
        raise
    return run(log, recorder.steps, notes, bodies=bodies)


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
    budget = find_budget(robot, config.run, duration)
    budget.require_within_caps()
    if config.plant.delay > duration:
        raise RpctlError(late(config.plant.delay, duration))
    return budget


def late(delay: float, duration: float) -> str:
    """Return that a delay (s) is longer than the run (s), in words."""
    return f"delay is {delay:g} s, longer than the run of {duration:g} s"


def plant_note(config: Config) -> tuple[str, ...]:
    """Return the note that something else than rolling wheels moves the robot, or none."""
    plant, friction = config.plant, f"friction {config.run.friction:g}"
    if plant.own is not None:
        return (f"a simulator of the user's, {type(plant.own).__name__}, moved the robot",)
    known = {
        "slipping": f"the robot moved on tyres that slip, {friction}",
        "contact": f"MuJoCo moved the robot: its wheels meet the ground in contacts, {friction}",
    }
    return (known[plant.kind],) if plant.kind in known else ()


def velocity_note(config: Config) -> tuple[str, ...]:
    """Return the note that the robot of a run takes speeds, and how it follows them, or none."""
    output = config.output
    if output is None:
        return ()
    truth = config.plant.velocity_interface(output)
    note = (
        f"the controller sends speeds, which the robot follows {_lateness(truth)}; the efforts are "
        "those that this motion takes"
    )
    if (truth.lag, truth.lags, truth.dead_time) == (output.lag, output.lags, output.dead_time):
        return (note,)
    return (f"{note}; the controller takes them to be followed {_lateness(output)}",)


def _lateness(output: VelocityOutput) -> str:
    """Return how late speeds are followed, in words."""
    lags = "".join(f" ({lag:g} s of {name})" for name, lag in output.lags.items())
    return f"with a lag of {output.lag:g} s{lags} and a dead time of {output.dead_time:g} s"


def _end_note(error: BaseException, t: float, duration: float) -> str:
    """Return the sentence that says when (s) and why a run ended early."""
    reason = "interrupted" if isinstance(error, KeyboardInterrupt) else str(error)
    reason = reason or type(error).__name__
    return f"ended at {t:.4g} of {duration:.4g} s ({reason}); what was simulated is kept"


def _as_plant(plant: str | Plant | PlantModel | None, robot: Robot) -> Plant:
    """Return the plant that is meant."""
    if isinstance(plant, str):
        return plant_by_name(plant, robot)
    if plant is None or isinstance(plant, Plant):
        return plant or Plant()
    if not isinstance(plant, PlantModel):
        raise RpctlError(
            f"the plant is {plant!r}; give {', '.join(PLANTS)}, a Plant, or an object with "
            "start(robot, rest)"
        )
    return Plant(kind="own", own=plant)


def _called(reference: Reference) -> str:
    """Return what a log calls a reference of the user's."""
    return str(getattr(reference, "__name__", type(reference).__name__))


def default_duration(reference: Reference) -> float:
    """Return how long (s) to track a reference if nobody says.

    A named one says it; one with an end is tracked a second longer than it moves, others 20 s.
    """
    if hasattr(reference, "default_duration"):
        return float(reference.default_duration)
    if hasattr(reference, "duration"):
        return float(reference.duration) + SETTLING_S
    return DEFAULT_DURATION
