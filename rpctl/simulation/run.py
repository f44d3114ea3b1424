"""``Run``: what a simulation logged, and its one-file form (``.npz``, no pickle)."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile

from rpctl.arrays import Array
from rpctl.drive.drive import Drive
from rpctl.errors import RunFileError
from rpctl.files.writing import write_atomically
from rpctl.robot.load import load
from rpctl.robot.model import Robot

SCHEMA = 3
OLDER_SCHEMA = (
    2  # it lacks what others than the arm's joints do, and the notes; they are empty then
)
META_ENTRY = "meta"  # the one entry of the file that is text: JSON
OPTIONAL_ENTRIES = (
    "load_range",
    "slip_range",
)  # entries that older files lack, and that may be NaN or inf


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A logged motion of K samples; arrays are read-only.

    Attributes:
        t: Time (K,), s.
        q: Configuration (K, nq).
        nu: Quasi-velocities (K, dof); m/s, rad/s.
        tau: Actuator efforts from each sample on (K, n_act); N·m or N.
        rates: Rate of each actuator's joint (K, n_act), wheels included; rad/s or m/s.
        nu_d: Quasi-velocities that the kinematic law asks for (K, dof).
        nu_ref: Quasi-velocities of the reference (K, dof).
        base: Pose of P (K, 3): x, y in m, heading in rad.
        base_ref: Reference pose of P (K, 3).
        joints: Positions of the arm (K, n_joints); rad or m.
        joints_ref: Their references (K, n_joints).
        steering: Positions of the joints that steer wheels (K, n_steering), rad.
        others: Positions of the other moving joints (K, n_others), wheels and mimic joints
            included; rad or m, those of continuous joints in (−π, π].
        other_rates: Their rates (K, n_others); rad/s or m/s.
        e: Tracking error (K, 3 + n_joints): longitudinal, lateral, heading, joints.
        q_ref: Configuration of the reference robot (K, nq), wheels turned as they would roll.
        ee: Position of the end effector (K, 3), m; (K, 0) for a robot without an arm.
        ee_ref: Its reference (K, 3), m.
        ee_angle: Angle between the end effector's and its reference's orientation (K,), rad.
        energy: Kinetic plus potential energy (K,), J.
        work: Work done by the actuators since the start (K,), J.
        constraint_residual: Largest entry of |A v| (K,); m/s, rad/s.
        wheel_force: Force of the ground on each wheel, forward (K, n_wheels), N.
        axle_force: Force of the ground on each axle, to the left (K, n_axles), N.
        contact_load: Vertical force of the ground on each contact (K, n_contacts), N; (K, 0) where
            the contacts known do not hold a balance. Beyond three contacts, of equal springs.
        zmp: Zero-moment point (K, 2), m; (K, 0) for a fixed base.
        tip_margin: Distance of the zero-moment point to the edge of the support polygon (K,), m;
            negative outside; (K, 0) where it is not defined.
        slip_ratio: Largest of the wheels' horizontal force over friction times load (K,); above 1
            a wheel slips; (K, 0) where it is not defined. The loads are ``contact_load``.
        load_range: Least and largest load of each contact (K, n_contacts, 2) of all splits that
            statics admit, N; NaN where the robot tips. (K, 0) where ``contact_load`` is the only
            split or not defined, and in files of versions that logged none.
        slip_range: Least and largest ``slip_ratio`` of those splits (K, 2); inf where a wheel that
            pushes may bear nothing, NaN where the robot tips; (K, 0) where ``load_range`` is.
        active_limits: 1 where a limit bound the efforts, else 0 (K, n_bound).
        robot: Name of the robot.
        source: What the robot was loaded from.
        urdf_sha256: Digest of its URDF.
        locked: Its frozen joints.
        drive: Its drive, as a dict.
        density: Density from which its missing inertias were estimated, kg/m³, or None.
        package_dirs: Folders where its packages lay.
        quasi_velocities: Names of ν.
        actuators: Names of τ.
        joint_names: Names of the arm's joints.
        units: Unit of each joint's position, ``"rad"`` or ``"m"``.
        effort_limits: Limits of τ; inf where the URDF gives none.
        velocity_limits: Limits of the actuators' rates; inf where the URDF gives none.
        lower_limits: Lower limits of the arm's positions; -inf where there is none.
        upper_limits: Upper limits of the arm's positions; inf where there is none.
        steering_names: Joints that steer wheels.
        steering_limits: Their limits (lower, upper), rad.
        other_names: Moving joints that are not the arm's: wheels', swivels, mimic joints.
        other_limits: Their limits (lower, upper, velocity).
        end_effector: The link that was tracked, or None.
        contacts: Names of the contacts with the ground, wheels first; none for a fixed base.
        contact_points: Their places (x, y) in the root link's frame, joints at 0 or frozen, m.
        axles: Wheels (indices) that share each lateral force.
        ground_notes: What keeps loads and margins from being defined or unique.
        bound_limits: Joint and kind of each limit that ever bound, as the dynamic law told.
        friction: Coefficient between wheels and ground that ``slip_ratio`` is for.
        settings: Reference, laws, horizons, sample times, all as they were simulated.
        notes: Where that is not what was asked for, in sentences.
        certificate: The certificate of the robot's dynamics, as a dict, or None.
        wall_time: What the simulation took, s.
    """

    t: Array
    q: Array
    nu: Array
    tau: Array
    rates: Array
    nu_d: Array
    nu_ref: Array
    base: Array
    base_ref: Array
    joints: Array
    joints_ref: Array
    steering: Array
    others: Array
    other_rates: Array
    e: Array
    q_ref: Array
    ee: Array
    ee_ref: Array
    ee_angle: Array
    energy: Array
    work: Array
    constraint_residual: Array
    wheel_force: Array
    axle_force: Array
    contact_load: Array
    zmp: Array
    tip_margin: Array
    slip_ratio: Array
    load_range: Array
    slip_range: Array
    active_limits: Array
    robot: str
    source: str
    urdf_sha256: str
    locked: Mapping[str, float]
    drive: Mapping[str, Any]
    density: float | None
    package_dirs: tuple[str, ...]
    quasi_velocities: tuple[str, ...]
    actuators: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: tuple[str, ...]
    effort_limits: tuple[float, ...]
    velocity_limits: tuple[float, ...]
    lower_limits: tuple[float, ...]
    upper_limits: tuple[float, ...]
    steering_names: tuple[str, ...]
    steering_limits: tuple[tuple[float, float], ...]
    other_names: tuple[str, ...]
    other_limits: tuple[tuple[float, float, float], ...]
    end_effector: str | None
    contacts: tuple[str, ...]
    contact_points: tuple[tuple[float, float], ...]
    axles: tuple[tuple[int, ...], ...]
    ground_notes: tuple[str, ...]
    bound_limits: tuple[tuple[str, str], ...]
    friction: float
    settings: Mapping[str, Any]
    notes: tuple[str, ...]
    certificate: Mapping[str, Any] | None
    wall_time: float

    def __repr__(self) -> str:
        reference = self.settings.get("reference", "motion")
        return f"Run({self.robot}, {reference}, {self.t[-1] - self.t[0]:.4g} s)"

    def save(self, path: str | Path) -> Path:
        """Write the run to one file; it is there whole or not at all.

        Args:
            path: The file; ``.npz`` is the custom.

        Returns:
            The path.
        """
        meta: dict[str, Any] = {"schema": SCHEMA}
        arrays = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                arrays[item.name] = value
            else:
                meta[item.name] = value
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **{META_ENTRY: json.dumps(meta)}, **arrays)
        return write_atomically(path, buffer.getvalue())

    @staticmethod
    def load(path: str | Path) -> Run:
        """Read a run.

        Raises:
            RunFileError: The file is missing, is no run, is damaged, or has another schema.
        """
        try:
            with Path(path).open("rb") as file:
                stored = np.load(file, allow_pickle=False)
                if not isinstance(stored, NpzFile) or META_ENTRY not in stored:
                    raise RunFileError(f"{path}: not a run of rpctl; give a run.npz that it wrote")
                meta = json.loads(str(stored[META_ENTRY]))
                arrays = {name: stored[name] for name in stored if name != META_ENTRY}
        except OSError as error:
            raise RunFileError(f"{path}: {error.strerror or error}; give a run.npz") from None
        except (ValueError, EOFError, zipfile.BadZipFile, KeyError) as error:
            raise RunFileError(f"{path}: damaged or not a run of rpctl ({error})") from None
        schema = meta.pop("schema", None) if isinstance(meta, dict) else None
        if schema not in (OLDER_SCHEMA, SCHEMA):
            raise RunFileError(
                f"{path}: schema {schema}, this rpctl reads {OLDER_SCHEMA} and {SCHEMA}; track the "
                "robot again"
            )
        values = {**meta, **arrays}
        return _checked(path, _completed(values) if schema == OLDER_SCHEMA else values)

    def load_robot(self, package_dirs: Sequence[str | Path] = ()) -> Robot:
        """Load the robot of this run again.

        Args:
            package_dirs: Where its packages lie now, if not where they lay then.

        Raises:
            RunFileError: Its URDF has changed since.
        """
        robot = load(
            self.source,
            Drive.from_dict(self.drive),
            self.locked,
            self.density,
            self.end_effector,
            package_dirs=package_dirs
            or [folder for folder in self.package_dirs if Path(folder).is_dir()],
        )
        if robot.description.sha256 != self.urdf_sha256:
            raise RunFileError(
                f"{robot.description.path}: the URDF has changed since the run; track it again"
            )
        return robot


def _completed(values: dict[str, Any]) -> dict[str, Any]:
    """Return what an older file holds with what it lacks, empty."""
    nothing = np.empty((np.size(values.get("t", ())), 0))
    lists: dict[str, list[Any]] = {"other_names": [], "other_limits": [], "notes": []}
    return {"others": nothing, "other_rates": nothing.copy(), **lists, **values}


def _checked(path: str | Path, values: dict[str, Any]) -> Run:
    """Return a run from what a file holds, shapes and names checked."""
    for name in OPTIONAL_ENTRIES:
        values.setdefault(name, np.empty((np.size(values.get("t", ())), 0)))
    names = {item.name: item.type for item in fields(Run)}
    missing, extra = names.keys() - values.keys(), values.keys() - names.keys()
    if missing or extra:
        listed = ", ".join(sorted(missing | extra))
        raise RunFileError(f"{path}: entries missing or not known: {listed}")
    lengths = {len(v) for v in values.values() if isinstance(v, np.ndarray) and v.ndim}
    if len(lengths) != 1:
        raise RunFileError(f"{path}: arrays of differing lengths {sorted(lengths)}")
    for name, kind in names.items():
        value = values[name]
        if (kind == "Array") != isinstance(value, np.ndarray):
            raise RunFileError(f'{path}: entry "{name}" is of the wrong kind')
        if isinstance(value, np.ndarray):
            finite = name in OPTIONAL_ENTRIES or np.isfinite(value).all()
            if value.dtype != np.float64 or not finite:
                raise RunFileError(f'{path}: entry "{name}" holds other than finite numbers')
            value.setflags(write=False)
        elif isinstance(value, list):
            values[name] = tuple(tuple(v) if isinstance(v, list) else v for v in value)
    columns = {
        "nu": "quasi_velocities",
        "tau": "actuators",
        "rates": "actuators",
        "joints": "joint_names",
        "others": "other_names",
        "other_rates": "other_names",
        "active_limits": "bound_limits",
    }
    for array, labels in columns.items():
        if values[array].ndim != 2 or values[array].shape[1] != len(values[labels]):
            raise RunFileError(f'{path}: "{array}" does not fit its names')
    contacts = len(values["contacts"])
    shapes = {"contact_load": (contacts,), "load_range": (contacts, 2), "slip_range": (2,)}
    for name, shape in shapes.items():
        if values[name].size and values[name].shape[1:] != shape:
            raise RunFileError(f'{path}: "{name}" does not fit its names')
    return Run(**values)
