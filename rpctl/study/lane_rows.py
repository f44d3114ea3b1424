"""Rows of rollouts by machine code, several runs side by side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.closed_loop import diverged_at
from rpctl.simulation.compiled.loop import DIVERGED, NO_TROUBLE
from rpctl.simulation.compiled.rollouts import LaneResults, LaneRunner
from rpctl.simulation.merits import SampleMeasures, Totals, merits_of
from rpctl.simulation.outcome import DIVERGING, TRACKED
from rpctl.study.experiment import SERIES, Experiment, RolloutTable
from rpctl.study.lane_columns import LaneColumns
from rpctl.study.merits import REFUSED, SUCCESS, RunVerdict, verdict


class LaneRows:
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
        self._columns = LaneColumns(robot, experiment, reference(0.0), (count - 1) * period)
        self._runner = LaneRunner(
            robot,
            self._columns.simulated,
            self._columns.varied,
            config,
            reference,
            count,
            stride,
            noisy=bool(config.plant.noise or config.plant.sensor_bias)
            or any(n.startswith(("plant.noise.", "plant.sensor_bias.")) for n in names),
            delayed=config.plant.delay > 0.0 or "plant.delay" in names,
            saturated=config.plant.effort != 1.0 or "plant.effort" in names,
        )

    def fill(
        self,
        table: RolloutTable,
        rows: slice,
        values: Array,
        progress: Callable[[int, int], object] | None = None,
    ) -> dict[int, RunVerdict]:
        """Simulate runs, fill their rows of a table, and return what became of them, by row.

        Those that only Python can go on with are left out.

        Args:
            table: The table.
            rows: Which of its rows.
            values: Settings of these runs (K, n).
            progress: Called with the runs done and their number.
        """
        first = rows.start
        refused = self._columns.refusals(values)
        found = {first + row: RunVerdict(REFUSED, reason) for row, reason in refused.items()}
        own = set(np.flatnonzero(self._columns.lossless(values)).tolist()) | refused.keys()
        sound = np.array([row for row in range(len(values)) if row not in own], dtype=np.intp)
        if len(sound):
            dynamics = self._runner.dynamics
            indices = table.indices[rows][sound]
            inputs = self._columns.inputs(dynamics, values[sound], indices)
            results = self._runner.run(inputs, progress)
            found |= self._take(table, first + sound, results)
        return found

    def _take(
        self, table: RolloutTable, rows: NDArray[np.intp], results: LaneResults
    ) -> dict[int, RunVerdict]:
        """Write results into rows of a table, and return what became of the runs."""
        period, found = self._experiment.config.run.control_period, {}
        totals = Totals(*results.totals.T)
        work, lost = results.energy.T
        merits = merits_of(totals, work, lost, self._count, period)
        for k, row in enumerate(rows.tolist()):
            trouble, ended = results.trouble[k], self._count
            if trouble == NO_TROUBLE:
                own = Totals(*results.totals[k])
                found[row] = verdict(own, self._count, self._experiment.tolerance)
                for name in table.merits.keys() - {SUCCESS}:
                    table.merits[name][row] = merits[name][k]
                table.merits[SUCCESS][row] = found[row].outcome == TRACKED
            elif trouble == DIVERGED:
                ended = int(results.trouble_at[k]) + 1
                found[row] = RunVerdict(DIVERGING, diverged_at((ended - 1) * period))
            else:
                continue
            kept = -(-ended // self._stride)
            for name, series in table.series.items():
                place = SampleMeasures._fields.index(SERIES[name])
                series[row, :kept] = results.measures[k, :kept, place]
        return found
