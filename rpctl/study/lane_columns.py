"""From the settings of many runs to what the lanes of a compiled loop need, all at once.

What a run of its own would find, by way of a `Plant` and a `Robot` (`simulation/plant.py`,
`robot/variation.py`), is found here for K runs as columns, without K robots.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.drive.scaled_wheels import lifted_wheels
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.model import Robot
from rpctl.robot.patterns import matching
from rpctl.robot.vary import add_friction
from rpctl.simulation.closed_loop import start_configuration
from rpctl.simulation.compiled.lane_inputs import LaneInputs, holding
from rpctl.simulation.compiled.laws.law_settings import settings_of
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.symbols.parameters import Varied
from rpctl.simulation.loop import late
from rpctl.simulation.periods import delay_periods
from rpctl.study.experiment import Experiment, run_seed
from rpctl.study.plant_columns import LINKS, PlantColumns
from rpctl.study.rolling_columns import rolling_columns
from rpctl.study.scatter import TUPLES, with_values

POSITIVE = ("masses", "inertias", "radii", "track", "effort")
NOT_NEGATIVE = ("damping", "joint_friction", "delay", "noise", "dropped", "losses", "payload")
OFFSET = 1e-3  # m, of centres of the robot that stands for all
FRICTION = 0.01  # N·m or N, of a robot that stands for those that lose something
GENTLE = 0.5  # rad: of a slope; steeper ones are looked at one by one
USUAL = (1e-9, 1e2)  # sizes of settings; runs with other ones are looked at one by one


class LaneColumns:
    """The runs of an experiment as columns.

    Args:
        robot: The robot, as its controller knows it, with the configuration's limits.
        experiment: What the runs have in common.
        start: The reference's state at the start.
        duration: Of a run, s.

    Attributes:
        simulated: The robot with what no run changes of the plant, and with losses if any has.
        varied: What differs from run to run.
    """

    def __init__(
        self, robot: Robot, experiment: Experiment, start: ReferenceState, duration: float
    ) -> None:
        self.robot, self.experiment, self._duration = robot, experiment, duration
        # Centres that differ are off the axles of the robot that stands for all: wheels are not
        # taken for round then.
        moved = "plant.centres.", "plant.payload."
        centres = tuple(name for name in experiment.names if name.startswith(moved))
        stands = with_values(experiment.config, centres, np.full(len(centres), OFFSET))
        simulated = stands.plant.simulated_robot(robot)
        self._plant = PlantColumns(robot, experiment)
        self._start = start
        self.simulated = simulated
        self.varied = self._varied()
        if self.varied.losses and simulated.losses is None:  # robots that lose step otherwise
            self.simulated = add_friction(simulated, dict.fromkeys(self.varied.losses, FRICTION))

    def _varied(self) -> Varied:
        joints, links = self.simulated.model.names, self._plant.links
        touched = {
            name
            for field in ("masses", "inertias")
            for pattern in self._plant.scattered(field)
            for name in matching(pattern, links.names, LINKS)
        }
        for path in self._plant.scattered("centres"):
            touched |= set(matching(path.rpartition(".")[0], links.names, LINKS))
        bodies = {b for n, b in zip(links.names, links.body.tolist(), strict=True) if n in touched}
        if self._plant.scattered("payload"):
            bodies.add(self._plant.payload_place()[0])
        lossy: set[str] = set()
        for field, names in (("damping", tuple(self.robot.entries)),
                             ("joint_friction", self.robot.actuators)):  # fmt: skip
            for pattern in self._plant.scattered(field):
                lossy |= set(matching(pattern, names, "joint"))
        if "plant.losses" in self._plant.keys:
            lossy |= self._plant.lossy_joints()
        rolling = bool(self._plant.scattered("radii")) or "plant.track" in self._plant.keys
        return Varied(
            tuple(joints[body + ROOT_JOINT] for body in sorted(bodies)),
            rolling,
            tuple(name for name in self.robot.entries if name in lossy),
            bool(self._plant.scattered("slope")),
        )

    def refusals(self, values: Array) -> dict[int, str]:
        """Return why runs are refused for their settings, by row; the others can be simulated.

        Args:
            values: Settings (K, n).
        """
        found = {}
        for row in np.flatnonzero(self._suspects(values)).tolist():
            reason = self._refusal(values[row])
            if reason is not None:
                found[row] = reason
        return found

    def _suspects(self, values: Array) -> NDArray[np.bool_]:
        """Return which rows (K,) may be refused: none of the others is."""
        sizes = np.abs(values)
        usual = (sizes <= USUAL[1]) & ((values == 0.0) | (sizes >= USUAL[0]))
        for name, k in self._plant.keys.items():
            table, field = name.split(".")[:2]
            if table == "plant" and field in POSITIVE:
                usual[:, k] &= values[:, k] > 0.0
            elif table == "plant" and field in NOT_NEGATIVE:
                usual[:, k] &= values[:, k] >= 0.0
            elif table in ("kinematic", "dynamic"):
                usual[:, k] = False  # a law says itself what it accepts
            if field == "slope":
                usual[:, k] &= sizes[:, k] <= GENTLE
            if name == "plant.delay":
                usual[:, k] &= values[:, k] <= self._duration
            if table == "run":
                usual[:, k] &= bool(self.robot.drive.base_speeds)
        suspects = ~usual.all(axis=1)
        if self.varied.rolling:
            radii, _ = self._plant.wheels(values)
            suspects = suspects | lifted_wheels(self.robot.drive, self.robot.tree, radii).any(1)
        return np.asarray(suspects | self._unsound(np.where(suspects[:, None], 1.0, values)))

    def _refusal(self, values: Array) -> str | None:
        """Return why a run is refused for its settings (n,), or None."""
        try:
            config = with_values(self.experiment.config, self.experiment.names, values)
            if not np.isfinite(values).all():
                raise RpctlError("a setting is not finite; give finite numbers")
            if config.plant.delay > self._duration:
                raise RpctlError(late(config.plant.delay, self._duration))
            start_configuration(self.robot, self._start, config.run.initial_error)
            if self.varied.rolling or self._weak:
                config.plant.simulated_robot(self.robot)
        except RpctlError as error:
            return str(error)
        return None

    @cached_property
    def _weak(self) -> list[int]:
        """The bodies that differ and have a link that is no body of its own.

        The others are bodies whatever the scales and the centres of their links.
        """
        found = set()
        for name, body in zip(
            self._plant.links.names, self._plant.links.body.tolist(), strict=True
        ):
            moments = np.linalg.eigvalsh(self.robot.description.link[name].inertia)
            if moments[0] < 0.0 or moments[2] > moments[0] + moments[1]:
                found.add(body)
        joints = self.simulated.model.names
        return [body for body in sorted(found) if joints[body + ROOT_JOINT] in self.varied.bodies]

    def _unsound(self, values: Array) -> NDArray[np.bool_]:
        """Return in which rows (K,) the sum of links may be no body."""
        if not self._weak:
            return np.zeros(len(values), bool)
        return np.asarray(
            (np.linalg.eigvalsh(self._plant.bodies(values)[:, self._weak]) < 0.0).any((1, 2))
        )

    @cached_property
    def _laws(self) -> list[int]:
        """The columns of settings of laws."""
        return [
            k for name, k in self._plant.keys.items() if name.startswith(("kinematic.", "dynamic."))
        ]

    def lossless(self, values: Array) -> NDArray[np.bool_]:
        """Return which runs (K,) lose nothing although others do: they take other steps.

        Args:
            values: Settings (K, n).
        """
        if not self.varied.losses:
            return np.zeros(len(values), bool)
        lost = self._plant.losses(values).values()
        return np.logical_not(np.any([each.any(axis=1) for each in lost], axis=0))

    def inputs(
        self, dynamics: SymbolicDynamics, values: Array, indices: NDArray[np.int64]
    ) -> LaneInputs:
        """Return what the lanes need of runs that are not refused.

        Args:
            dynamics: Of ``simulated``, with what is ``varied``.
            values: Settings (K, n).
            indices: Numbers of the runs (K,).
        """
        robot, plant = self.robot, self.experiment.config.plant
        count, period = len(values), self.experiment.config.run.control_period
        errors = np.tile(np.array(self.experiment.config.run.initial_error, float), (count, 1))
        for axis, entry in enumerate(TUPLES["initial_error"]):
            self._plant.take(errors[:, axis], f"run.initial_error.{entry}", values)
        delays = np.full(count, plant.delay)
        self._plant.take(delays, "plant.delay", values)
        bias = self._plant.columns("tau_bias", robot.actuators, 0.0, "actuator", values)
        q, p = self._configurations(errors), self._parameters(dynamics, values)
        hold = holding(dynamics).map(count)(q.T, p.T) if count else np.empty((bias.shape[1], 0))
        return LaneInputs(
            q=q,
            errors=errors,
            rest=np.asarray(hold, dtype=float).T - bias,
            bias=bias,
            p=p,
            settings=self._settings(values),
            most=self._plant.saturation(values),
            back=np.array(
                [delay_periods(each, period) for each in delays.tolist()], dtype=np.int64
            ),
            deviations=self._plant.deviations(values),
            offsets=self._plant.offsets(values),
            seeds=tuple(run_seed(self.experiment.seed, index) for index in indices.tolist()),
        )

    def _configurations(self, errors: Array) -> Array:
        """Return q (K, nq) at the start, as ``start_configuration``."""
        robot, pose = self.robot, self._start.pose
        q = np.tile(start_configuration(robot, self._start, (0.0, 0.0, 0.0)), (len(errors), 1))
        theta = pose[2] - errors[:, 2]
        cos, sin = _waves(theta)
        x = pose[0] - cos * errors[:, 0] + sin * errors[:, 1]
        y = pose[1] - sin * errors[:, 0] - cos * errors[:, 1]
        turned = theta - robot.drive.heading
        cos, sin = _waves(turned)
        px, py = robot.drive.point
        q[:, 0], q[:, 1] = x - cos * px + sin * py, y - sin * px - cos * py
        q[:, 2], q[:, 3] = cos, sin
        return q

    def _parameters(self, dynamics: SymbolicDynamics, values: Array) -> Array:
        """Return the parameters (K, n_p) of the simulated robots."""
        numbers: dict[str, Array] = {}
        if self.varied.losses:
            numbers |= self._plant.losses(values)
        if self.varied.slope:
            numbers["lift"] = self._plant.lift(values)
        if self.varied.rolling:
            numbers |= rolling_columns(self.robot, *self._plant.wheels(values))
        return dynamics.parameters(self.simulated, self._plant.bodies(values), numbers)

    def _settings(self, values: Array) -> Array:
        """Return the laws' settings (K, n_s), found once for all runs whose laws are the same."""
        config, known = self.experiment.config, ReducedDynamics(self.robot)
        names = tuple(self.experiment.names[k] for k in self._laws)
        own, which = np.unique(values[:, self._laws], axis=0, return_inverse=True)
        found = []
        for row in own:
            laws = with_values(config, names, row)
            found.append(self._settings_of(laws.kinematic, laws.dynamic, known))
        return np.array(found)[which.ravel()]

    def _settings_of(self, kinematic: Any, dynamic: Any, known: ReducedDynamics) -> Array:
        period = self.experiment.config.run.control_period
        return settings_of(kinematic, dynamic, known, period)[1]


def _waves(angles: Array) -> tuple[Array, Array]:
    """Return cosines and sines of angles (K,), each as if it were alone."""
    cosines, sines = ([wave(x) for x in angles.tolist()] for wave in (math.cos, math.sin))
    return np.array(cosines), np.array(sines)
