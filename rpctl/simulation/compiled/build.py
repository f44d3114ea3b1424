"""Closed loops as machine code: built once, kept on disk, and checked against Pinocchio's.

Many runs are made of one block by block, as many side by side as there are lanes.
"""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.control.fragment import law_fragment
from rpctl.control.law import LawSample, Rest, as_law
from rpctl.control.law_kernel import (
    laws_key,
    require_answers,
    require_same,
    require_within_limits,
)
from rpctl.control.safeguards import Guards
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.cache import cached
from rpctl.kernels.machine_code import code_key, native_lanes
from rpctl.kernels.program import Buffer, Program, Rows
from rpctl.kernels.stored import stored
from rpctl.reference.motion import Reference, ReferenceState, tabulate
from rpctl.robot.inspection import robot_identity
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.lanes import CHUNK, LaneInputs, Lanes, fill, same_inputs
from rpctl.simulation.compiled.loop import CompiledLoop, LoopProgram, LoopShape, loop_program
from rpctl.simulation.compiled.merit_fold import FIRST, MeritFold
from rpctl.simulation.config import Config, delay_periods
from rpctl.simulation.merits.measures import spans_of
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.rolling import advance

MOST_KEPT = 8  # loops of a process: each takes some MB
STATES, SEED = 3, 20210601
SPREAD = 0.05  # of positions about home and of speeds, m, rad and their rates
FAR = 20.0  # times that: how far off its reference a robot is where limits bind

_kept: deque[tuple[Robot, Robot, str, CompiledLoop]] = deque(maxlen=MOST_KEPT)


def compiled_loop(
    known: ReducedDynamics, simulated: ReducedDynamics, config: Config
) -> CompiledLoop:
    """Return the loop of one lane for a configuration, checked; it may have been built before.

    Args:
        known: The robot's dynamics as the controller knows them.
        simulated: Those of the simulated robot.
        config: Laws and circumstances.

    Raises:
        DiffersError: The loop's numbers are not Python's.
    """
    shape = shape_of(known, config)
    structure = repr((shape, config.kinematic, config.dynamic))
    for *robots, kept_structure, loop in _kept:
        same = robots[0] is known.robot and robots[1] is simulated.robot
        if same and kept_structure == structure:
            return loop
    loop = build_loop(known.robot, SymbolicDynamics(simulated.robot), config, shape)
    require_equal(loop, known, simulated, config)
    _kept.append((known.robot, simulated.robot, structure, loop))
    return loop


def shape_of(
    known: ReducedDynamics, config: Config, scattered: Iterable[str] = (), folded: bool = False
) -> LoopShape:
    """Return what is compiled into the loop of a configuration.

    Args:
        known: The robot's dynamics as the controller knows them.
        config: Laws and circumstances.
        scattered: Paths of settings that differ from run to run.
        folded: Whether samples are folded to what merits need, or else logged.
    """
    run, plant, far = config.run, config.plant, None
    approach = getattr(config.kinematic, "approach", None)
    if approach is not None and approach.stage(known) is not None:
        far = approach.distance, approach.heading
    touched = {".".join(path.split(".")[:2]) for path in scattered}
    return LoopShape(
        run.control_period,
        run.plant_step,
        delayed=delay_periods(plant.delay, run.control_period) > 0 or "plant.delay" in touched,
        noisy=bool(plant.noise or plant.sensor_bias)
        or not touched.isdisjoint(("plant.noise", "plant.sensor_bias")),
        saturated=plant.effort != 1.0 or "plant.effort" in touched,
        far=far,
        folded=folded,
    )


def build_loop(
    known: Robot, simulated: SymbolicDynamics, config: Config, shape: LoopShape, lanes: int = 1
) -> CompiledLoop:
    """Return a closed loop as machine code, from disk if it was ever built.

    Args:
        known: The robot that the controller computes with.
        simulated: Dynamics of the simulated robot.
        config: The laws.
        shape: What else is compiled in.
        lanes: How many runs go side by side.
    """
    laws: tuple[Any, Any] = config.kinematic, config.dynamic

    def make() -> tuple[LoopProgram, list[Program]]:
        law = law_fragment(*laws, SymbolicDynamics(known), shape.period)
        program = loop_program(law, simulated, shape)
        return program, [program.start, program.sample]

    key = loop_key((known, simulated.robot), simulated.varied, laws, shape, lanes)
    program, codes = stored(key, make, lanes)
    return CompiledLoop(simulated.robot, simulated.parameters_of(simulated.robot), program, *codes)


def loop_key(
    robots: tuple[Robot, Robot], varied: object, laws: tuple[Any, Any], shape: LoopShape, lanes: int
) -> bytes:
    """Return a hash of all that a loop depends on.

    Args:
        robots: The robot that the controller computes with, and the simulated one.
        varied: What of the latter is a parameter.
        laws: The laws.
        shape: What else is compiled in.
        lanes: How many runs go side by side.
    """
    identities = [robot_identity(robot) for robot in robots]
    return code_key(identities, varied, laws_key(*laws, robots[0]), shape, lanes)


def require_equal(
    compiled: CompiledLoop, known: ReducedDynamics, simulated: ReducedDynamics, config: Config
) -> None:
    """Refuse a loop whose efforts or steps are not those of the laws and of Pinocchio's plant.

    Args:
        compiled: The loop.
        known: The robot's dynamics as the controller knows them.
        simulated: Those of the simulated robot.
        config: Laws and circumstances.

    Raises:
        DiffersError: They differ; the quantity is named.
    """
    law: Any = as_law(config.kinematic)
    if getattr(law, "approach", None) is not None:
        law = replace(law, approach=None)
    near = replace(config, kinematic=law, plant=Plant(), guards=Guards())
    rng, answered = np.random.default_rng(SEED), 0
    for off in (*[SPREAD] * STATES, *[FAR * SPREAD] * STATES):
        sample = _random_sample(known.robot, simulated, rng, off)
        computed = _by_machine(compiled, known, near, *sample)
        if computed is None:  # the laws' own business: Python is asked there
            continue
        answered += 1
        if computed["limits"].any():
            require_within_limits(known.robot, computed["efforts"])
        for name, value in _by_pinocchio(known, simulated, near, sample, computed).items():
            require_same(known.robot, name, computed[name], value)
    require_answers(known.robot, answered)


def _random_sample(
    robot: Robot, simulated: ReducedDynamics, rng: np.random.Generator, off: float
) -> tuple[Rest, Array, ReferenceState]:
    """Return a robot at rest, speeds that it then has, and a reference off it (m, rad).

    The speeds are as far from rest as the reference is from the robot.
    """
    n = len(robot.joints)

    def near(center: Array) -> Array:
        return center + SPREAD * rng.normal(size=len(center))

    pose = rng.normal(size=3)
    q = robot.configuration_at(
        pose, near(robot.home), SPREAD * rng.normal(size=len(robot.drive.steered))
    )
    rest = Rest(q, np.asarray(simulated.efforts(q, simulated.bias(q, np.zeros(robot.dof)))))
    twist, rates = near(np.array([0.3, 0.0, 0.2])), near(np.zeros(3))
    state = ReferenceState(
        pose + off * rng.normal(size=3),
        twist,
        rates,
        near(robot.home),
        near(np.zeros(n)),
        near(np.zeros(n)),
    )
    return rest, off * rng.normal(size=robot.dof), state


def _by_pinocchio(
    known: ReducedDynamics,
    simulated: ReducedDynamics,
    config: Config,
    sample: tuple[Rest, Array, ReferenceState],
    computed: Mapping[str, Array],
) -> dict[str, Array]:
    """Return what the laws ask for, and where the robot is a period later.

    Where a limit binds, the efforts are those computed: the law has others without it.
    """
    (rest, nu, state), run = sample, config.run
    kinematic = as_law(config.kinematic).start(known, run.control_period, rest)
    command = kinematic(known, lambda t: state, 0.0, rest.q, nu)
    tau = computed["efforts"]
    if not computed["limits"].any():
        law: Any = config.dynamic
        wanted = LawSample(rest.q, nu, *command)
        tau = law.free_efforts(known, run.control_period, wanted, rest)
    step = advance(simulated, rest.q, nu, tau, run.control_period, run.plant_step)
    return {"desired speeds": command.nu_d, "efforts": tau, "positions": step.q, "speeds": step.nu}


def _by_machine(
    compiled: CompiledLoop,
    known: ReducedDynamics,
    config: Config,
    rest: Rest,
    nu: Array,
    state: ReferenceState,
) -> dict[str, Array] | None:
    """Return the same of the compiled loop; None where its laws have no answer."""
    loop = compiled.program
    inputs = same_inputs(compiled, known, config, rest)
    lanes = Lanes(compiled, known, config, lambda t: state, inputs)
    lanes.workspace[loop.plant.nu][:] = nu[:, None]
    more = {s: Rows(np.empty((1, s.width, len(inputs)))) for s in loop.log.values()}
    if loop.fold is not None and loop.fold.tip is not None:
        more[loop.fold.tip] = Rows(np.zeros((1, loop.fold.tip.width)))
    lanes.advance(0, np.zeros(1), tabulate(known.robot, lambda t: state, np.zeros(1)).rows, more)
    if lanes.workspace[loop.law.failed].any():
        return None
    taken: dict[str, Buffer] = {
        "desired speeds": loop.law.nu_d,
        "efforts": loop.law.tau,
        "limits": loop.law.limits,
        "positions": loop.plant.q,
        "speeds": loop.plant.nu,
    }
    return {name: lanes.workspace[buffer][:, 0] for name, buffer in taken.items()}


_kept_runs: dict[
    tuple[bytes, str], tuple[CompiledLoop, Any]
] = {}  # by key, and numbers of the laws


class LaneResults(NamedTuple):
    """What became of K runs.

    Attributes:
        totals: What was folded of the samples (K, n), in the order of ``merits.Totals``.
        energy: Work of the actuators, and what losses took, until the last sample (K, 2), J.
        measures: Of every so-many-th sample (K, T, n), in the order of ``merits.SampleMeasures``.
        trouble: Why a run did not go on (K,), see ``loop.py``; 0 of those that came to their end.
        trouble_at: Number of the sample (K,) at which that was.
    """

    totals: Array
    energy: Array
    measures: Array
    trouble: Array
    trouble_at: Array


class LaneRunner:
    """Runs of one robot along one reference, with settings and parameters of their own.

    Args:
        known: The robot as its controllers know it.
        dynamics: Of the simulated robot, with parameters of what is varied.
        config: What all runs have in common.
        scattered: Paths of the settings that differ from run to run.
        reference: What they track.
        count: Number of samples of a run.

    Attributes:
        holding: Of :func:`holding`, for many runs at a time.

    Raises:
        DiffersError: The loop's numbers are not Python's.
    """

    def __init__(
        self,
        known: Robot,
        dynamics: SymbolicDynamics,
        config: Config,
        scattered: Iterable[str],
        reference: Reference,
        count: int,
    ) -> None:
        self._known, self._config, self._reference = ReducedDynamics(known), config, reference
        self._lanes = native_lanes()
        shape = shape_of(self._known, config, scattered, folded=True)
        self._loop, self.holding = _loop_and_holding(self._known, dynamics, config, shape)
        self._times = config.run.control_period * np.arange(count, dtype=float)
        table = tabulate(known, reference, self._times)
        self._rows, self._tips = table.rows, table.end_effector

    def run(
        self, inputs: LaneInputs, stride: int, progress: Callable[[int, int], object] | None = None
    ) -> LaneResults:
        """Return what became of some runs; none depends on those beside it.

        Args:
            inputs: What they begin with.
            stride: Each so-many-th sample is measured over time.
            progress: Called with the runs done and their number.
        """
        total, blocks, lanes = len(inputs), [], np.arange(self._lanes)
        for first in range(0, total, self._lanes):
            rows = np.minimum(first + lanes, total - 1)  # the last one fills up
            blocks.append(self._block(inputs.rows(rows), stride))
            if progress is not None:
                progress(min(first + self._lanes, total), total)
        columns = zip(*blocks, strict=True)
        return LaneResults(*(np.concatenate(column)[:total] for column in columns))

    def _block(self, inputs: LaneInputs, stride: int) -> LaneResults:
        """Return what became of as many runs as there are lanes."""
        program, count = self._loop.program, len(self._times)
        fold: MeritFold | None = program.fold
        assert fold is not None  # its shape says so
        lanes = Lanes(self._loop, self._known, self._config, self._reference, inputs)
        fill(lanes.workspace, {fold.totals: FIRST[:, None], fold.spans: spans_of(count)[:, None]})
        measures = np.zeros((-(-count // stride), fold.measures.size, self._lanes))
        chunk = -(-CHUNK // stride) * stride
        for first in range(0, count, chunk):
            part = slice(first, first + chunk)
            more = {program.log["measures"]: Rows(measures[first // stride :], stride)}
            if fold.tip is not None:
                more[fold.tip] = Rows(self._tips[part])
            lanes.advance(first, self._times[part], self._rows[part], more)
        at = lanes.workspace
        trouble, trouble_at = at[program.trouble].copy()
        energy = at[program.energy_before].T.copy()
        shown = np.moveaxis(measures, 2, 0)
        return LaneResults(at[fold.totals].T.copy(), energy, shown, trouble, trouble_at)


def _loop_and_holding(
    known: ReducedDynamics, dynamics: SymbolicDynamics, config: Config, shape: LoopShape
) -> tuple[CompiledLoop, Any]:
    """Return a checked loop and what holds its robots; a graph is built if neither ever was."""
    laws: tuple[Any, Any] = config.kinematic, config.dynamic
    robots, lanes = (known.robot, dynamics.robot), native_lanes()
    key = loop_key(robots, dynamics.varied, laws, shape, lanes)
    checked = key, repr(laws)
    if checked not in _kept_runs:
        loop = build_loop(known.robot, dynamics, config, shape, lanes)
        require_equal(loop, known, ReducedDynamics(dynamics.robot), config)
        hold = cached(
            hashlib.sha256(key + b"holding").digest(),
            lambda: holding(dynamics).serialize().encode(),
        )
        while len(_kept_runs) >= MOST_KEPT:
            del _kept_runs[next(iter(_kept_runs))]
        _kept_runs[checked] = loop, casadi.Function.deserialize(hold.decode())
    return _kept_runs[checked]


def holding(dynamics: SymbolicDynamics) -> Any:
    """Return the ``casadi.Function`` of q and p that gives the efforts (n_act, 1) at a stand."""
    q = casadi.SX.sym("q", dynamics.robot.nq)
    force = dynamics.bias(q, casadi.SX(dynamics.robot.dof, 1))
    efforts = casadi.densify(casadi.SX(dynamics.efforts(q, force)))
    return casadi.Function("holding", [q, dynamics.p], [efforts])
