"""What the settings of many runs make of the plant, as columns: bodies, losses, wheels, noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.errors import UnknownNameError
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.link_inertias import LinkInertias
from rpctl.robot.model import Robot
from rpctl.robot.patterns import matching
from rpctl.simulation.noise import Noise, Sensors
from rpctl.study.experiment import Experiment
from rpctl.study.scatter import TUPLES

LINKS = "link with a mass"


class PlantColumns:
    """The plants of an experiment's runs as columns.

    Args:
        robot: The robot, as its controller knows it.
        experiment: What the runs have in common.

    Attributes:
        links: The links that have a mass.
        keys: Columns of the settings by path.
    """

    def __init__(self, robot: Robot, experiment: Experiment) -> None:
        self._robot, self._plant = robot, experiment.config.plant
        self.links = LinkInertias(robot)
        self.keys = {name: k for k, name in enumerate(experiment.names)}

    def scattered(self, field: str) -> dict[str, int]:
        """Return the columns of the settings of a field of the plant, by what follows its name."""
        head = f"plant.{field}."
        return {name[len(head) :]: k for name, k in self.keys.items() if name.startswith(head)}

    def take(self, column: Array, name: str, values: Array) -> None:
        """Write the settings of a name into a column (K,), if they differ.

        Args:
            column: The column.
            name: Path of the setting.
            values: Settings (K, n).
        """
        if name in self.keys:
            column[:] = values[:, self.keys[name]]

    def columns(
        self, field: str, names: Sequence[str], default: float, kind: str, values: Array
    ) -> Array:
        """Return what a plant's patterns give each of some names (K, m); the last one counts.

        Args:
            field: Field of the plant.
            names: Of links or joints, m of them.
            default: What those get that no pattern matches.
            kind: What the names are of.
            values: Settings (K, n).
        """
        given: Mapping[str, Any] = getattr(self._plant, field)
        scattered = self.scattered(field)
        found = np.full((len(values), len(names)), default)
        order = {name: place for place, name in enumerate(names)}
        for pattern in dict.fromkeys((*given, *scattered)):
            places = [order[name] for name in matching(pattern, names, kind)]
            value = values[:, [scattered[pattern]]] if pattern in scattered else given[pattern]
            found[:, places] = value
        return found

    def _centres(self, values: Array) -> Array | None:
        """Return the offsets of the links' centres (K, L, 3), m; None: there are none."""
        given, names = self._plant.centres, self.links.names
        scattered: dict[str, dict[str, int]] = {}
        for path, column in self.scattered("centres").items():
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

    def bodies(self, values: Array) -> Array:
        """Return the pseudo-inertias of the bodies (K, n, 4, 4)."""
        masses, inertias = (
            self.columns(field, self.links.names, 1.0, LINKS, values)
            for field in ("masses", "inertias")
        )
        found = self.links.bodies(masses, self._centres(values), inertias)
        load = self._plant.payload
        if load.mass or self.scattered("payload"):
            body, pose = self.payload_place()
            mass, com = (
                np.full(len(values), load.mass),
                np.tile(np.array(load.com), (len(values), 1)),
            )
            self.take(mass, "plant.payload.mass", values)
            for axis, entry in enumerate(TUPLES["com"]):
                self.take(com[:, axis], f"plant.payload.com.{entry}", values)
            place = pose[:3, 3] + sum(com[:, k, None] * pose[:3, k] for k in range(3))
            point = np.column_stack([place, np.ones(len(values))])
            found[:, body] += mass[:, None, None] * point[:, :, None] * point[:, None]
        return found

    def lift(self, values: Array) -> Array:
        """Return what stands against gravity on the slopes (K, 3), m/s²; see ``on_slope``."""
        angles = np.tile(np.array(self._plant.slope), (len(values), 1))
        for axis, entry in enumerate(TUPLES["slope"]):
            self.take(angles[:, axis], f"plant.slope.{entry}", values)
        along = np.sin(angles)
        up = np.column_stack([along, np.sqrt(1.0 - np.square(along).sum(axis=1))])
        return np.asarray(np.linalg.norm(self._robot.model.gravity.linear) * up)

    def payload_place(self) -> tuple[int, Array]:
        """Return the body that carries the payload, and the pose (4, 4) of its link there."""
        robot = self._robot
        link = self._plant.payload.link_of(robot)
        if not robot.model.existBodyName(link):
            raise UnknownNameError("link", link, robot.description.link)
        frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
        return frame.parentJoint - ROOT_JOINT, np.array(frame.placement.homogeneous)

    def lossy_joints(self) -> set[str]:
        """Return the joints with losses of their own."""
        robot, own = self._robot, self._robot.losses
        if own is None:
            return set()
        lost = (own.damping != 0.0) | (own.friction != 0.0)
        return {name for name in robot.entries if lost[robot.velocity_index(name)]}

    def saturation(self, values: Array) -> Array:
        """Return the efforts (K, n_act) at which the true actuators saturate, N·m or N."""
        scale = np.full(len(values), self._plant.effort)
        self.take(scale, "plant.effort", values)
        found = scale[:, None] * self._robot.effort_limits
        found[scale == 1.0] = np.inf
        return found

    def losses(self, values: Array) -> dict[str, Array]:
        """Return damping and friction (K, nv) of the joints."""
        robot, names = self._robot, tuple(self._robot.entries)
        own = robot.losses
        given = {
            "damping": (names, None if own is None else own.damping, "damping"),
            "friction": (robot.actuators, None if own is None else own.friction, "joint_friction"),
        }
        scale = np.full(len(values), self._plant.losses)
        self.take(scale, "plant.losses", values)
        found = {}
        for kind, (joints, known, field) in given.items():
            total = scale[:, None] * (np.zeros(robot.nv) if known is None else known)
            index = [robot.velocity_index(name) for name in joints]
            total[:, index] += self.columns(field, joints, 0.0, "joint", values)
            found[kind] = total
        return found

    def wheels(self, values: Array) -> tuple[Array, Array]:
        """Return radii (K, n_wheels), m, and scales of the track (K,)."""
        names = [wheel.joint for wheel in self._robot.drive.wheels]
        now = np.array([wheel.radius for wheel in self._robot.drive.wheels])
        track = np.full(len(values), self._plant.track)
        self.take(track, "plant.track", values)
        return now * self.columns("radii", names, 1.0, "wheel", values), track

    def deviations(self, values: Array) -> Array:
        """Return the deviations of the noise (K, n_noise)."""
        return self._measured("noise", Sensors(self._robot).deviations(self._plant.noise), values)

    def offsets(self, values: Array) -> Array:
        """Return the constant errors of what is measured (K, n_noise)."""
        errors = Sensors(self._robot).errors(self._plant.sensor_bias)
        return self._measured("sensor_bias", errors, values)

    def _measured(self, field: str, nominal: Array, values: Array) -> Array:
        """Return what belongs to the entries of a row of noise (K, n_noise).

        Args:
            field: Of the plant.
            nominal: What the plant has (n_noise,).
            values: Settings (K, n).
        """
        found = np.tile(nominal, (len(values), 1))
        for name in asdict(self._plant.noise):
            if (path := f"plant.{field}.{name}") in self.keys:
                which = Sensors(self._robot).deviations(Noise(**{name: 1.0})) > 0.0
                found[:, which] = values[:, [self.keys[path]]]
        return found
