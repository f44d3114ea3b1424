"""Runs of an experiment by machine code, several side by side, each with numbers of its own.

The configuration of each run says what its plant is; what that makes of the numbers of the compiled
loop is found here for K runs at once, without K robots.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.fragment import settings_of
from rpctl.drive.scaled_wheels import lifted_wheels
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import RpctlError
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.model import Robot
from rpctl.robot.variation import PERTURBATIONS, BuiltNumbers
from rpctl.simulation.compiled.build import LaneResults, LaneRunner
from rpctl.simulation.compiled.lanes import LaneInputs
from rpctl.simulation.compiled.loop import DIVERGED, NO_TROUBLE
from rpctl.simulation.config import Config, delay_periods
from rpctl.simulation.loop.closed_loop import diverged_at, start_configuration
from rpctl.simulation.loop.track import late
from rpctl.simulation.merits.measures import SampleMeasures, Totals, merits_of
from rpctl.simulation.merits.outcome import DIVERGING
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.sensors import Sensors
from rpctl.study.experiment import SERIES, Experiment, RunTable
from rpctl.study.merits import REFUSED, RunVerdict, verdict
from rpctl.study.scatter import with_values

LOSSES = "plant.damping.", "plant.joint_friction."
FRICTION = 0.01  # of a robot that stands for those that lose something, in units of either
PROBES = 0.11, 0.17  # what differs, so much and more of it, tells which numbers it changes
USUAL_SCALE = 1e2  # of wheels and tracks; runs with other ones are looked at one by one
NO_BODY = -1e-9  # of a body's pseudo-inertia: eigenvalues beyond rounding


class Lanes:
    """Simulates runs of an experiment side by side.

    Args:
        robot: The robot, as its controller knows it, with the configuration's limits.
        experiment: What the runs have in common.
        reference: What they track.
        count: Samples of a run.
        stride: Each so-many-th sample is kept over time.

    Raises:
        DiffersError: The compiled loop's numbers are not Python's.
    """

    def __init__(
        self, robot: Robot, experiment: Experiment, reference: Reference, count: int, stride: int
    ) -> None:
        config, names = experiment.config, experiment.names
        self._experiment, self._count, self._stride = experiment, count, stride
        period = config.run.control_period
        self._inputs = LaneColumns(robot, experiment, reference(0.0), (count - 1) * period)
        self._runner = LaneRunner(robot, self._inputs.dynamics, config, names, reference, count)

    def fill(
        self,
        table: RunTable,
        rows: slice,
        values: Array,
        progress: Callable[[int, int], object] | None = None,
    ) -> dict[int, RunVerdict]:
        """Simulate runs, fill their rows of a table, and return what became of them, by row.

        Those that only Python can go on with are left out.
        """
        first = rows.start
        configs = self._inputs.configs(values, table.index[rows])
        verdicts = {
            first + k: RunVerdict(REFUSED, each)
            for k, each in enumerate(configs)
            if isinstance(each, str)
        }
        sound = {k: each for k, each in enumerate(configs) if isinstance(each, Config)}
        if not sound:
            return verdicts
        lossless, inputs = self._inputs.inputs([*sound.values()], self._runner.holding)
        chosen = np.flatnonzero(np.logical_not(lossless))
        if len(chosen):
            results = self._runner.run(inputs.rows(chosen), self._stride, progress)
            verdicts |= self._take(table, first + np.array([*sound])[chosen], results)
        return verdicts

    def _take(
        self, table: RunTable, rows: NDArray[np.intp], results: LaneResults
    ) -> dict[int, RunVerdict]:
        """Write results into rows of a table, and return what became of the runs."""
        period, verdicts = self._experiment.config.run.control_period, {}
        work, lost = results.energy.T
        merits = merits_of(Totals(*results.totals.T), work, lost, self._count, period)
        for k, row in enumerate(rows.tolist()):
            trouble, ended = results.trouble[k], self._count
            if trouble == NO_TROUBLE:
                own = Totals(*results.totals[k])
                verdicts[row] = verdict(own, self._count, self._experiment.tolerance)
                for name, column in table.merits.items():
                    column[row] = merits[name][k]
            elif trouble == DIVERGED:
                ended = int(results.trouble_at[k]) + 1
                verdicts[row] = RunVerdict(DIVERGING, diverged_at((ended - 1) * period))
            else:
                continue
            kept = -(-ended // self._stride)
            for name, series in table.series.items():
                place = SampleMeasures._fields.index(SERIES[name])
                series[row, :kept] = results.measures[k, :kept, place]
        return verdicts


class LaneColumns:
    """The runs of an experiment as columns: what the lanes of a compiled loop begin with.

    Args:
        robot: The robot, as its controller knows it, with the configuration's limits.
        experiment: What the runs have in common.
        start: The reference's state at the start.
        duration: Of a run, s.

    Attributes:
        dynamics: Of the robot that stands for those of all runs, with what differs as parameters.
    """

    def __init__(
        self, robot: Robot, experiment: Experiment, start: ReferenceState, duration: float
    ) -> None:
        self._robot, self._experiment = robot, experiment
        self._start, self._duration = start, duration
        self._known = ReducedDynamics(robot)
        self._last: tuple[object, Array] = (None, np.empty(0))  # laws and their settings
        config, parts = experiment.config, {name: name.split(".") for name in experiment.names}
        names = [n for n, p in parts.items() if p[0] == "plant" and p[1] in PERTURBATIONS]
        lossy = tuple(name for name in names if name.startswith(LOSSES))  # they step otherwise
        stands = with_values(config, lossy, np.full(len(lossy), FRICTION))
        probes = [stands.plant]
        for size in PROBES if names else ():
            some = size * (1.0 + np.modf(np.sqrt(2.0) * np.arange(len(names)))[0])
            probes.append(with_values(stands, tuple(names), some).plant)
        others = BuiltNumbers(robot, probes) if names else None
        self.dynamics = SymbolicDynamics(stands.plant.simulated_robot(robot), others)

    def configs(self, values: Array, indices: NDArray[np.int64]) -> list[Config | str]:
        """Return the configuration of each run, or why it is refused for its settings."""
        configs = [
            self._config(settings, index)
            for settings, index in zip(values, indices.tolist(), strict=True)
        ]
        plants = {k: each.plant for k, each in enumerate(configs) if isinstance(each, Config)}
        for k in np.array([*plants])[self._doubtful([*plants.values()])].tolist():
            configs[k] = self._refusal(plants[k]) or configs[k]
        return configs

    def _doubtful(self, plants: Sequence[Plant]) -> NDArray[np.bool_]:
        """Return which plants (K,) may be those of no robot; that takes a robot to know."""
        if not (plants and self.dynamics.varies):
            return np.zeros(len(plants), bool)
        built, drive = BuiltNumbers(self._robot, plants), self._robot.drive
        own = [wheel.radius for wheel in drive.wheels]
        scales = np.column_stack([built.radii / own, built.track])
        unusual = np.abs(np.log(scales)) > np.log(USUAL_SCALE)
        moments = np.linalg.eigvalsh(built.bodies[:, built.moved])
        hollow = moments[..., 0] < NO_BODY * moments[..., -1]
        lifted = lifted_wheels(drive, self._robot.tree, built.radii)
        return np.asarray(lifted.any(axis=1) | unusual.any(axis=1) | hollow.any(axis=1))

    def _config(self, settings: Array, index: int) -> Config | str:
        """Return the configuration of a run, or why it is refused; that of its plant apart."""
        try:
            config = self._experiment.config_of(settings, index)
            if not np.isfinite(settings).all():
                raise RpctlError("a setting is not finite; give finite numbers")
            if config.plant.delay > self._duration:
                raise RpctlError(late(config.plant.delay, self._duration))
            start_configuration(self._robot, self._start, config.run.initial_error)
        except RpctlError as error:
            return str(error)
        return config

    def _refusal(self, plant: Plant) -> str:
        """Return why there is no robot of a plant; empty if there is."""
        try:
            plant.simulated_robot(self._robot)
            self.dynamics.parameters(BuiltNumbers(self._robot, [plant]))
        except RpctlError as error:
            return str(error)
        return ""

    def inputs(
        self, configs: Sequence[Config], holding: Callable[[Array, Array], Any]
    ) -> tuple[NDArray[np.bool_], LaneInputs]:
        """Return which runs (K,) lose nothing although others do, and what the lanes need of all.

        The former take other steps.

        Args:
            configs: Of the runs that are not refused, one at least.
            holding: Gives the efforts (n_act, K) at a stand of q (nq, K) and parameters (n_p, K).
        """
        robot, plants = self._robot, [config.plant for config in configs]
        period, sensors = self._experiment.config.run.control_period, Sensors(robot)
        errors = np.array([config.run.initial_error for config in configs], float)
        q = np.array([start_configuration(robot, self._start, error) for error in errors])
        bias = np.array([plant.bias(robot) for plant in plants])
        p, lossless = np.empty((len(plants), 0)), np.zeros(len(plants), bool)
        if self.dynamics.varies:
            built = BuiltNumbers(robot, plants)
            p = self.dynamics.parameters(built)
            lossless = np.logical_not((built.damping + built.friction).any(axis=1))
        return lossless & self.dynamics.lossy, LaneInputs(
            q=q,
            rest=np.asarray(holding(q.T, p.T), float).T - bias,
            bias=bias,
            p=p,
            settings=np.array([self._settings(config) for config in configs]),
            most=np.array([plant.saturation(robot) for plant in plants]),
            back=np.array([delay_periods(plant.delay, period) for plant in plants], np.int64),
            deviations=np.array([sensors.row(plant.noise) for plant in plants]),
            offsets=np.array([sensors.row(plant.sensor_bias) for plant in plants]),
            seeds=tuple(plant.seed for plant in plants),
        )

    def _settings(self, config: Config) -> Array:
        """Return the laws' settings (n_s,); the last ones are kept for runs that have the same."""
        laws, period = (config.kinematic, config.dynamic), config.run.control_period
        if self._last[0] != laws:
            self._last = laws, settings_of(*laws, self._known, period)
        return self._last[1]
