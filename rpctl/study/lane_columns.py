"""From the settings of many runs to what the lanes of a compiled loop need, all at once.

What a run of its own would find, by way of a `Plant` and a `Robot` (`simulation/plant.py`,
`robot/variation.py`), is found here for K runs as columns, without K robots.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.drive.scaled_wheels import contact_laterals, lifted_wheels, scale_radii, scale_track
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import find_rolling
from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.link_inertias import LinkInertias
from rpctl.robot.model import Robot
from rpctl.robot.patterns import matching
from rpctl.robot.vary import add_friction
from rpctl.simulation.closed_loop import start_configuration
from rpctl.simulation.compiled.lane_inputs import LaneInputs, holding
from rpctl.simulation.compiled.laws.law_settings import settings_of
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.symbols.parameters import Varied
from rpctl.simulation.compiled.symbols.rolling_numbers import rolling_numbers, solved_rows
from rpctl.simulation.loop import late
from rpctl.simulation.noise import Noise, Sensors
from rpctl.simulation.periods import delay_periods
from rpctl.study.experiment import Experiment, run_seed
from rpctl.study.scatter import TUPLES, with_values

LINKS = "link with a mass"
POSITIVE = ("masses", "inertias", "radii", "track")
NOT_NEGATIVE = ("damping", "joint_friction", "delay", "noise", "dropped")
OFFSET = 1e-3  # m, of centres of the robot that stands for all
FRICTION = 0.01  # N·m or N, of a robot that stands for those that lose something
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
        centres = tuple(name for name in experiment.names if name.startswith("plant.centres."))
        stands = with_values(experiment.config, centres, np.full(len(centres), OFFSET))
        simulated = stands.plant.simulated_robot(robot)
        self._links = LinkInertias(robot)
        self._start = start
        self._keys = {name: k for k, name in enumerate(experiment.names)}
        self.simulated = simulated
        self.varied = self._varied()
        if self.varied.losses and simulated.losses is None:  # robots that lose step otherwise
            self.simulated = add_friction(simulated, dict.fromkeys(self.varied.losses, FRICTION))

    def _scattered(self, field: str) -> dict[str, int]:
        """Return the columns of the settings of a field of the plant, by what follows its name."""
        head = f"plant.{field}."
        return {name[len(head) :]: k for name, k in self._keys.items() if name.startswith(head)}

    def _varied(self) -> Varied:
        joints, links = self.simulated.model.names, self._links
        touched = {
            name
            for field in ("masses", "inertias")
            for pattern in self._scattered(field)
            for name in matching(pattern, links.names, LINKS)
        }
        for path in self._scattered("centres"):
            touched |= set(matching(path.rpartition(".")[0], links.names, LINKS))
        bodies = {b for n, b in zip(links.names, links.body.tolist(), strict=True) if n in touched}
        lossy: set[str] = set()
        for field, names in (("damping", tuple(self.robot.entries)),
                             ("joint_friction", self.robot.actuators)):  # fmt: skip
            for pattern in self._scattered(field):
                lossy |= set(matching(pattern, names, "joint"))
        rolling = bool(self._scattered("radii")) or "plant.track" in self._keys
        return Varied(
            tuple(joints[body + ROOT_JOINT] for body in sorted(bodies)),
            rolling,
            tuple(name for name in self.robot.entries if name in lossy),
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
        for name, k in self._keys.items():
            table, field = name.split(".")[:2]
            if table == "plant" and field in POSITIVE:
                usual[:, k] &= values[:, k] > 0.0
            elif table == "plant" and field in NOT_NEGATIVE:
                usual[:, k] &= values[:, k] >= 0.0
            elif table in ("kinematic", "dynamic"):
                usual[:, k] = False  # a law says itself what it accepts
            if name == "plant.delay":
                usual[:, k] &= values[:, k] <= self._duration
            if table == "run":
                usual[:, k] &= bool(self.robot.drive.base_speeds)
        suspects = ~usual.all(axis=1)
        if self.varied.rolling:
            suspects = suspects | self._lifted(values)
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
        for name, body in zip(self._links.names, self._links.body.tolist(), strict=True):
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
            (np.linalg.eigvalsh(self._bodies(values)[:, self._weak]) < 0.0).any((1, 2))
        )

    @cached_property
    def _laws(self) -> list[int]:
        """The columns of settings of laws."""
        return [k for name, k in self._keys.items() if name.startswith(("kinematic.", "dynamic."))]

    def lossless(self, values: Array) -> NDArray[np.bool_]:
        """Return which runs (K,) lose nothing although others do: they take other steps.

        Args:
            values: Settings (K, n).
        """
        if not self.varied.losses:
            return np.zeros(len(values), bool)
        lost = self._losses(values).values()
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
            self._take(errors[:, axis], f"run.initial_error.{entry}", values)
        delays = np.full(count, plant.delay)
        self._take(delays, "plant.delay", values)
        bias = self._columns("tau_bias", robot.actuators, 0.0, "actuator", values)
        q, p = self._configurations(errors), self._parameters(dynamics, values)
        hold = holding(dynamics).map(count)(q.T, p.T) if count else np.empty((bias.shape[1], 0))
        return LaneInputs(
            q=q,
            errors=errors,
            rest=np.asarray(hold, dtype=float).T - bias,
            bias=bias,
            p=p,
            settings=self._settings(values),
            back=np.array(
                [delay_periods(each, period) for each in delays.tolist()], dtype=np.int64
            ),
            deviations=self._deviations(values),
            seeds=tuple(run_seed(self.experiment.seed, index) for index in indices.tolist()),
        )

    def _take(self, column: Array, name: str, values: Array) -> None:
        """Write the settings of a name into a column (K,), if they differ."""
        if name in self._keys:
            column[:] = values[:, self._keys[name]]

    def _columns(
        self, field: str, names: Sequence[str], default: float, kind: str, values: Array
    ) -> Array:
        """Return what a plant's patterns give each of some names (K, n); the last one counts."""
        given: Mapping[str, Any] = getattr(self.experiment.config.plant, field)
        scattered = self._scattered(field)
        found = np.full((len(values), len(names)), default)
        order = {name: place for place, name in enumerate(names)}
        for pattern in dict.fromkeys((*given, *scattered)):
            places = [order[name] for name in matching(pattern, names, kind)]
            value = values[:, [scattered[pattern]]] if pattern in scattered else given[pattern]
            found[:, places] = value
        return found

    def _centres(self, values: Array) -> Array | None:
        """Return the offsets of the links' centres (K, L, 3), m; None: there are none."""
        given, names = self.experiment.config.plant.centres, self._links.names
        scattered: dict[str, dict[str, int]] = {}
        for path, column in self._scattered("centres").items():
            pattern, _, entry = path.rpartition(".")
            scattered.setdefault(pattern, {})[entry] = column
        if not (given or scattered):
            return None
        found = np.zeros((len(values), len(names), 3))
        for pattern in dict.fromkeys((*given, *scattered)):
            offset = np.tile(np.array(given.get(pattern, (0.0, 0.0, 0.0))), (len(values), 1))
            for axis, entry in enumerate(TUPLES["centres"]):
                if entry in scattered.get(pattern, {}):
                    offset[:, axis] = values[:, scattered[pattern][entry]]
            places = [names.index(name) for name in matching(pattern, names, LINKS)]
            found[:, places] = offset[:, None]
        return found

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
            numbers |= self._losses(values)
        if self.varied.rolling:
            numbers |= self._rolling(values)
        return dynamics.parameters(self.simulated, self._bodies(values), numbers)

    def _bodies(self, values: Array) -> Array:
        """Return the pseudo-inertias of the bodies (K, n, 4, 4)."""
        masses, inertias = (
            self._columns(field, self._links.names, 1.0, LINKS, values)
            for field in ("masses", "inertias")
        )
        return self._links.bodies(masses, self._centres(values), inertias)

    def _losses(self, values: Array) -> dict[str, Array]:
        """Return damping and friction (K, nv) of the joints."""
        robot, names = self.robot, tuple(self.robot.entries)
        own = robot.losses
        given = {
            "damping": (names, None if own is None else own.damping, "damping"),
            "friction": (robot.actuators, None if own is None else own.friction, "joint_friction"),
        }
        found = {}
        for kind, (joints, known, field) in given.items():
            total = np.tile(np.zeros(robot.nv) if known is None else known, (len(values), 1))
            index = [robot.velocity_index(name) for name in joints]
            total[:, index] += self._columns(field, joints, 0.0, "joint", values)
            found[kind] = total
        return found

    def _wheels(self, values: Array) -> tuple[Array, Array]:
        """Return radii (K, n_wheels), m, and scales of the track (K,)."""
        names = [wheel.joint for wheel in self.robot.drive.wheels]
        now = np.array([wheel.radius for wheel in self.robot.drive.wheels])
        track = np.full(len(values), self.experiment.config.plant.track)
        self._take(track, "plant.track", values)
        return now * self._columns("radii", names, 1.0, "wheel", values), track

    def _lifted(self, values: Array) -> NDArray[np.bool_]:
        """Return in which rows (K,) a wheel does not reach the ground."""
        radii, _ = self._wheels(values)
        return np.asarray(lifted_wheels(self.robot.drive, self.robot.tree, radii).any(axis=1))

    def _rolling(self, values: Array) -> dict[str, Array]:
        """Return the numbers of rolling of which S is made, stacked (K, ...).

        Where S is constant, a wheel's rate is that of its contact over its radius. Elsewhere the
        rows are eliminated robot by robot, once for each pair of radii and track.
        """
        radii, track = self._wheels(values)
        if find_rolling(self.robot).matrix.harmonics.any():
            return self._eliminated(radii, track)
        drive, tree = self.robot.drive, self.robot.tree
        S = rolling_numbers(self.robot)["S"]
        found = np.tile(S, (len(values), 1, 1))
        moved = (track[:, None] - 1.0) * contact_laterals(drive, tree)
        left = np.array([-np.sin(drive.heading), np.cos(drive.heading)])
        rolling = find_rolling(self.robot)
        for k, wheel in enumerate(drive.wheels):
            index, row = self.robot.velocity_index(wheel.joint), rolling.along[k]
            forward = np.array(wheel.direction) @ np.array([-left[1], left[0]])
            turning = forward / rolling.matrix.constant[row, index]
            rates = S[index] - turning * moved[:, k, None] * S[2]
            found[:, index] = rates * (wheel.radius / radii[:, k, None])
        return {"S": found}

    def _eliminated(self, radii: Array, track: Array) -> dict[str, Array]:
        robot, drive, tree = self.robot, self.robot.drive, self.robot.tree
        rows, known = solved_rows(robot), dict[bytes, dict[str, Array]]()
        keys = []
        for own, scale in zip(radii, track.tolist(), strict=True):
            key = np.append(own, scale).tobytes()
            keys.append(key)
            if key not in known:
                scales = {
                    wheel.joint: radius / wheel.radius
                    for wheel, radius in zip(drive.wheels, own.tolist(), strict=True)
                }
                other = scale_track(scale_radii(drive, tree, scales), tree, scale)
                known[key] = rolling_numbers(replace(robot, drive=other), rows)
        names = known[keys[0]]
        return {name: np.stack([known[key][name] for key in keys]) for name in names}

    def _deviations(self, values: Array) -> Array:
        """Return the deviations of the noise (K, n_noise)."""
        sensors, noise = Sensors(self.robot), self.experiment.config.plant.noise
        found = np.tile(sensors.deviations(noise), (len(values), 1))
        for name in asdict(noise):
            if (path := f"plant.noise.{name}") in self._keys:
                which = sensors.deviations(Noise(**{name: 1.0})) > 0.0
                found[:, which] = values[:, [self._keys[path]]]
        return found

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
