"""Runs of an experiment by machine code, several side by side, each with numbers of its own.

The configuration of each run says what its plant is; what that makes of the numbers of the compiled
loop is found here for K runs at once, without K robots.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.drive.scaled_wheels import contact_laterals, lifted_wheels, scale_radii, scale_track
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import find_rolling
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.dynamics.symbols.numbers import Varied, rolling_numbers, solved_rows
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.robot.patterns import by_pattern, matching
from rpctl.robot.variation import LinkInertias, scales_of
from rpctl.robot.vary import add_losses
from rpctl.simulation.compiled.lanes import LaneInputs, holding
from rpctl.simulation.compiled.laws.tracking import settings_of
from rpctl.simulation.compiled.loop import DIVERGED, NO_TROUBLE
from rpctl.simulation.compiled.rollouts import LaneResults, LaneRunner
from rpctl.simulation.config import Config
from rpctl.simulation.loop.closed_loop import diverged_at, start_configuration
from rpctl.simulation.loop.periods import delay_periods
from rpctl.simulation.loop.track import late
from rpctl.simulation.merits.measures import SampleMeasures, Totals, merits_of
from rpctl.simulation.merits.outcome import DIVERGING
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.sensors import Sensors
from rpctl.study.experiment import SERIES, Experiment, RunTable
from rpctl.study.merits import REFUSED, RunVerdict, verdict
from rpctl.study.scatter import with_values

LINKS = "link with a mass"
OFFSET = 1e-3  # m, of centres of the robot that stands for all
FRICTION = 0.01  # N·m or N, of a robot that stands for those that lose something
NOWHERE = (0.0, 0.0, 0.0)
USUAL_SCALE = 1e2  # of wheels and tracks; runs with other ones are looked at one by one


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
        plants = self._inputs.plants
        dynamics = SymbolicDynamics(plants.simulated, plants.varied)
        self._runner = LaneRunner(robot, dynamics, config, names, reference, count)

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
        lossless = self._inputs.plants.lossless([each.plant for each in sound.values()])
        chosen = [k for k, each in zip(sound, lossless, strict=True) if not each]
        if chosen:
            inputs = self._inputs.inputs(self._runner.dynamics, [sound[k] for k in chosen])
            results = self._runner.run(inputs, self._stride, progress)
            verdicts |= self._take(table, first + np.array(chosen), results)
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
    """

    def __init__(
        self, robot: Robot, experiment: Experiment, start: ReferenceState, duration: float
    ) -> None:
        self._robot, self._experiment = robot, experiment
        self._start, self._duration = start, duration
        self.plants = LanePlants(robot, experiment)
        self._known = ReducedDynamics(robot)
        self._last: tuple[object, Array] = (None, np.empty(0))  # laws and their settings

    def configs(self, values: Array, indices: NDArray[np.int64]) -> list[Config | str]:
        """Return the configuration of each run, or why it is refused for its settings."""
        configs = [
            self._config(settings, index)
            for settings, index in zip(values, indices.tolist(), strict=True)
        ]
        plants = {k: each.plant for k, each in enumerate(configs) if isinstance(each, Config)}
        doubtful = self.plants.doubtful([*plants.values()])
        for k, doubt in zip(plants, doubtful, strict=True):
            if doubt:
                configs[k] = self._refusal(plants[k]) or configs[k]
        return configs

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
        except RpctlError as error:
            return str(error)
        return ""

    def inputs(self, dynamics: SymbolicDynamics, configs: Sequence[Config]) -> LaneInputs:
        """Return what the lanes need of runs that are not refused.

        Args:
            dynamics: Of the simulated robot, with what is varied.
            configs: Of the runs, one at least.
        """
        robot, plants = self._robot, [config.plant for config in configs]
        period, sensors = self._experiment.config.run.control_period, Sensors(robot)
        errors = np.array([config.run.initial_error for config in configs], float)
        q = np.array([start_configuration(robot, self._start, error) for error in errors])
        p = self.plants.parameters(dynamics, plants)
        bias = np.array([plant.bias(robot) for plant in plants])
        hold = np.asarray(holding(dynamics).map(len(configs))(q.T, p.T), float)
        return LaneInputs(
            q=q,
            rest=hold.T - bias,
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
            self._last = laws, settings_of(*laws, self._known, period)[1]  # type: ignore[arg-type]
        return self._last[1]


class LanePlants:
    """What the plants of runs make of the numbers of a robot, in stacks.

    Attributes:
        simulated: The robot with what no run changes of the plant, and with losses if any has.
        varied: What differs from run to run.
    """

    def __init__(self, robot: Robot, experiment: Experiment) -> None:
        self._robot, self._names = robot, experiment.names
        self._links = LinkInertias(robot)
        self._wheels = tuple(wheel.joint for wheel in robot.drive.wheels)
        # Centres that differ are off the axles of the robot that stands for all: wheels are not
        # taken for round then.
        centres = tuple(
            n for n in self._names if n.startswith(("plant.centres.", "plant.payload."))
        )
        stands = with_values(experiment.config, centres, np.full(len(centres), OFFSET))
        self._plant = stands.plant
        self.simulated = stands.plant.simulated_robot(robot)
        self.varied = self._varied()
        if self.varied.losses and self.simulated.losses is None:  # robots that lose step otherwise
            losses = dict.fromkeys(self.varied.losses, FRICTION)
            self.simulated = add_losses(self.simulated, {}, losses)

    def _scattered(self, field: str) -> Iterator[str]:
        """Yield what follows a field of the plant in the paths of what differs."""
        head = f"plant.{field}"
        return (n[len(head) + 1 :] for n in self._names if n == head or n.startswith(f"{head}."))

    def _is_scattered(self, *fields: str) -> bool:
        return any(any(True for _ in self._scattered(field)) for field in fields)

    def _varied(self) -> Varied:
        robot, links = self._robot, self._links
        patterns = [*self._scattered("masses"), *self._scattered("inertias")]
        patterns += [path.rpartition(".")[0] for path in self._scattered("centres")]
        touched = {name for each in patterns for name in matching(each, links.names, LINKS)}
        bodies = {b for n, b in zip(links.names, links.body.tolist(), strict=True) if n in touched}
        if self._is_scattered("payload"):
            bodies.add(self._payload_place()[0])
        lossy = {
            name
            for field, names in self._loss_names.items()
            for pattern in self._scattered(field)
            for name in matching(pattern, names, "joint")
        }
        if self._is_scattered("losses") and robot.losses is not None:
            lost = (robot.losses.damping != 0.0) | (robot.losses.friction != 0.0)
            lossy |= {name for name in robot.entries if lost[robot.velocity_index(name)]}
        return Varied(
            tuple(self.simulated.model.names[body + ROOT_JOINT] for body in sorted(bodies)),
            self._is_scattered("radii", "track"),
            tuple(name for name in robot.entries if name in lossy),
            self._is_scattered("slope"),
        )

    @property
    def _loss_names(self) -> dict[str, tuple[str, ...]]:
        return {"damping": tuple(self._robot.entries), "joint_friction": self._robot.actuators}

    def doubtful(self, plants: Sequence[Plant]) -> NDArray[np.bool_]:
        """Return which plants (K,) may be those of no robot; that takes a robot to know."""
        doubtful = np.zeros(len(plants), bool)
        if self.varied.rolling and len(plants):
            radii, track = self._rolling(plants)
            doubtful |= lifted_wheels(self._robot.drive, self._robot.tree, radii).any(1)
            own = np.array([wheel.radius for wheel in self._robot.drive.wheels])
            scales = np.column_stack([radii / own, track])
            doubtful |= ((scales > USUAL_SCALE) | (scales < 1.0 / USUAL_SCALE)).any(1)
        if self._weak and len(plants):
            moments = np.linalg.eigvalsh(self._bodies(plants)[:, self._weak])
            doubtful |= (moments < 0.0).any((1, 2))
        return doubtful

    @cached_property
    def _weak(self) -> list[int]:
        """The bodies that differ and have a link that is no body of its own.

        The others are bodies whatever the scales and the centres of their links.
        """
        weak = set()
        for name, body in zip(self._links.names, self._links.body.tolist(), strict=True):
            moments = np.linalg.eigvalsh(self._robot.description.link[name].inertia)
            if moments[0] < 0.0 or moments[2] > moments[0] + moments[1]:
                weak.add(body)
        joints = self.simulated.model.names
        return [body for body in sorted(weak) if joints[body + ROOT_JOINT] in self.varied.bodies]

    def lossless(self, plants: Sequence[Plant]) -> NDArray[np.bool_]:
        """Return which runs (K,) lose nothing although others do: they take other steps."""
        if not (self.varied.losses and len(plants)):
            return np.zeros(len(plants), bool)
        losses = self._losses(plants).values()
        return np.logical_not(np.any([each.any(axis=1) for each in losses], axis=0))

    def parameters(self, dynamics: SymbolicDynamics, plants: Sequence[Plant]) -> Array:
        """Return the parameters (K, n_p) of the simulated robots."""
        numbers: dict[str, Array] = {}
        if self.varied.losses:
            numbers |= self._losses(plants)
        if self.varied.slope:
            along = np.sin([plant.slope for plant in plants])
            up = np.column_stack([along, np.sqrt(1.0 - np.square(along).sum(axis=1))])
            numbers["lift"] = np.linalg.norm(self._robot.model.gravity.linear) * up
        if self.varied.rolling:
            numbers |= rolling_columns(self._robot, *self._rolling(plants))
        bodies = self._bodies(plants if self.varied.bodies else plants[:1])
        p = dynamics.parameters(self.simulated, bodies, numbers)
        return np.broadcast_to(p, (len(plants), p.shape[-1]))

    def _bodies(self, plants: Sequence[Plant]) -> Array:
        """Return the pseudo-inertias of the bodies (K, n, 4, 4)."""
        names = self._links.names
        masses = np.array([scales_of(plant.masses, names, LINKS) for plant in plants])
        inertias = np.array([scales_of(plant.inertias, names, LINKS) for plant in plants])
        offsets = [by_pattern(plant.centres, names, LINKS) for plant in plants]
        centres = np.array([[each.get(name, NOWHERE) for name in names] for each in offsets])
        bodies = self._links.bodies(masses, centres if centres.any() else None, inertias)
        loads = np.array([(plant.payload.mass, *plant.payload.com) for plant in plants])
        if loads[:, 0].any():
            body, pose = self._payload_place()
            place = pose[:3, 3] + sum(loads[:, k + 1, None] * pose[:3, k] for k in range(3))
            point = np.column_stack([place, np.ones(len(plants))])
            bodies[:, body] += loads[:, 0, None, None] * point[:, :, None] * point[:, None]
        return bodies

    def _payload_place(self) -> tuple[int, Array]:
        """Return the body that carries the payload, and the pose (4, 4) of its link there."""
        robot = self._robot
        link = self._plant.payload.link_of(robot)
        if not robot.model.existBodyName(link):
            raise UnknownNameError("link", link, robot.description.link)
        frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
        return frame.parentJoint - ROOT_JOINT, np.array(frame.placement.homogeneous)

    def _losses(self, plants: Sequence[Plant]) -> dict[str, Array]:
        """Return damping and friction (K, nv) of the joints."""
        robot, own = self._robot, self._robot.losses
        known = {"damping": np.zeros(robot.nv), "friction": np.zeros(robot.nv)}
        if own is not None:
            known = {"damping": own.damping, "friction": own.friction}
        scale = np.array([plant.losses for plant in plants])
        losses = {}
        for (kind, array), (field, names) in zip(
            known.items(), self._loss_names.items(), strict=True
        ):
            losses[kind] = scale[:, None] * array
            for row, plant in zip(losses[kind], plants, strict=True):
                for name, more in by_pattern(getattr(plant, field), names, "joint").items():
                    row[robot.velocity_index(name)] += more
        return losses

    def _rolling(self, plants: Sequence[Plant]) -> tuple[Array, Array]:
        """Return radii (K, n_wheels), m, and scales of the track (K,)."""
        scales = np.array([scales_of(plant.radii, self._wheels, "wheel") for plant in plants])
        radii = np.array([wheel.radius for wheel in self._robot.drive.wheels]) * scales
        return radii, np.array([plant.track for plant in plants])


def rolling_columns(robot: Robot, radii: Array, track: Array) -> dict[str, Array]:
    """Return the numbers of rolling of which S is made, stacked (K, ...).

    Where S is constant, a wheel's rate is that of its contact over its radius. Elsewhere the
    rows are eliminated robot by robot, once for each pair of radii and track.

    Args:
        robot: The robot.
        radii: Of its wheels (K, n_wheels), m.
        track: Scales of its track (K,).
    """
    rolling, drive, tree = find_rolling(robot), robot.drive, robot.tree
    if rolling.matrix.harmonics.any():
        return _eliminated(robot, radii, track)
    S = rolling_numbers(robot)["S"]
    columns = np.tile(S, (len(radii), 1, 1))
    moved = (track[:, None] - 1.0) * contact_laterals(drive, tree)
    left = np.array([-np.sin(drive.heading), np.cos(drive.heading)])
    for k, wheel in enumerate(drive.wheels):
        index, row = robot.velocity_index(wheel.joint), rolling.along[k]
        forward = np.array(wheel.direction) @ np.array([-left[1], left[0]])
        turning = forward / rolling.matrix.constant[row, index]
        rates = S[index] - turning * moved[:, k, None] * S[2]
        columns[:, index] = rates * (wheel.radius / radii[:, k, None])
    return {"S": columns}


def _eliminated(robot: Robot, radii: Array, track: Array) -> dict[str, Array]:
    drive, tree = robot.drive, robot.tree
    rows = solved_rows(robot)
    different, which = np.unique(np.column_stack([radii, track]), axis=0, return_inverse=True)
    numbers = []
    for *own, scale in different.tolist():
        scales = {w.joint: radius / w.radius for w, radius in zip(drive.wheels, own, strict=True)}
        other = scale_track(scale_radii(drive, tree, scales), tree, scale)
        numbers.append(rolling_numbers(replace(robot, drive=other), rows))
    return {name: np.stack([each[name] for each in numbers])[which.ravel()] for name in numbers[0]}
