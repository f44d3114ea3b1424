"""``Run``: what a simulation logged, and its one-file form (``.npz``, no pickle)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.opening import is_folder
from rpctl.files.writing import writing
from rpctl.libraries import library
from rpctl.reference.sizing import Sizing
from rpctl.robot.model import Robot
from rpctl.simulation.collision_facts import CollisionFacts
from rpctl.simulation.config import Config, config_tables
from rpctl.simulation.facts import GroundFacts, RobotFacts
from rpctl.simulation.log import Log
from rpctl.simulation.part import read_part
from rpctl.simulation.reload import load_robot
from rpctl.simulation.run_file import read_run_file, write_run_file
from rpctl.simulation.run_schema import ARRAYS
from rpctl.simulation.table import columns, csv_blocks


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A logged motion of K samples, and all that it came from.

    Attributes:
        log: The samples.
        robot: The robot.
        ground: How it stands on the ground.
        config: Reference, laws, sample times and plant, all as they were simulated; a law of
            somebody's own is :class:`~rpctl.control.unregistered.Unregistered`.
        controller_model: Name of the robot that the controller computed with; None: this one.
        kinematic_report: What the kinematic law counted, by name.
        notes: Where the configuration is not what was asked for, in sentences.
        certificate: The certificate of the robot's dynamics, as a dict, or None.
        wall_time: What the simulation took, s.
        sizing: How large and fast its named reference is, and why; None of others.
        recording: What became of the rows of its reference's table and what they ask beyond the
            limits, as a dict; None of another reference.
        perturbed: What became of the run with a perturbed plant, as a dict, or None.
        collisions: How near its links came to things, and what they ran into; None where that was
            not looked for, and in older files.
        law_sentences: What its laws ignore and how fast they make the joints; none in older files.
        simulated: The robot itself, of a run that was simulated by this process; None of one that
            was read. No file has it.
        digest: SHA-256 digest of its file, which files made from it carry; None where none is
            known.
    """

    log: Log
    robot: RobotFacts
    ground: GroundFacts
    config: Config
    controller_model: str | None
    kinematic_report: Mapping[str, float]
    notes: tuple[str, ...]
    certificate: Mapping[str, Any] | None
    wall_time: float
    sizing: Sizing | None = None
    recording: Mapping[str, Any] | None = None
    perturbed: Mapping[str, Any] | None = None
    collisions: CollisionFacts | None = None
    law_sentences: tuple[str, ...] = ()
    simulated: Robot | None = None
    digest: str | None = None

    def __repr__(self) -> str:
        return (
            f"Run({self.robot.name}, {self.config.run.reference}, {self.t[-1] - self.t[0]:.4g} s)"
        )

    @property
    def t(self) -> Array:
        """Time (K,), s."""
        return self.log.t

    @property
    def q(self) -> Array:
        """Configuration (K, nq)."""
        return self.log.q

    @property
    def nu(self) -> Array:
        """Quasi-velocities (K, dof); m/s, rad/s."""
        return self.log.nu

    @property
    def tau(self) -> Array:
        """Actuator efforts from each sample on (K, n_act); N·m or N."""
        return self.log.tau

    @property
    def base_ref(self) -> Array:
        """Reference pose of P (K, 3): x, y in m, heading in rad."""
        return self.log.base_ref

    @property
    def joints_ref(self) -> Array:
        """References of the arm's positions (K, n_joints); rad or m."""
        return self.log.joints_ref

    @property
    def q_ref(self) -> Array:
        """Configuration of the reference robot (K, nq), wheels turned as they would roll."""
        return self.log.q_ref

    def save(self, path: str | Path, precision: str = "double") -> Path:
        """Write the run to one file; it is there whole or not at all.

        Args:
            path: The file; ``.npz`` is the custom. :mod:`rpctl.simulation.run_file` says how NumPy
                reads it.
            precision: ``"double"`` keeps every bit; ``"single"`` rounds all but the time to 24
                bits, in half of the room.

        Returns:
            The path.

        Raises:
            RpctlError: The file cannot be written, or the precision is not known or too small.
        """
        meta, arrays = entries_of(self)
        return write_run_file(path, meta, arrays, precision)

    def to_csv(self, path: str | Path) -> Path:
        """Write the samples as CSV, a row a sample; the file is there whole or not at all.

        Args:
            path: The file.

        Returns:
            The path. The columns are those of :func:`rpctl.simulation.table.columns`.
        """
        with writing(path) as file:
            for block in csv_blocks(self._columns()):
                file.write(block.encode())
        return Path(path)

    def to_pandas(self) -> Any:
        """Return the samples as a ``pandas.DataFrame``, a row a sample, indexed by t (s).

        The columns are those of :func:`rpctl.simulation.table.columns`.

        Raises:
            RpctlError: pandas is not installed.
        """
        try:
            pandas = library("pandas")
        except ImportError:
            raise RpctlError("pandas is not installed; run pip install pandas") from None
        return pandas.DataFrame(self._columns()).set_index("t")

    def _columns(self) -> dict[str, Array]:
        return columns(self.log, self.robot, self.ground)

    @staticmethod
    def load(path: str | Path) -> Run:
        """Read a run: its file, or the folder that the simulation left when it was stopped.

        Args:
            path: A ``run.npz``, or a ``run.part``; the run of that says in a note when it ended.

        Raises:
            RunFileError: The file is missing, is no run, is damaged, or has another schema.
        """
        return from_entries(read_part(path) if is_folder(path) else read_run_file(path))

    def load_robot(self, package_dirs: Sequence[str | Path] = (), expand: bool = False) -> Robot:
        """Return the robot of this run: as it was simulated here, or as the file of a run holds it.

        A run from a file is data that somebody else may have written. Its robot comes from the URDF
        in it; see :func:`rpctl.simulation.reload.load_robot`.

        Args:
            package_dirs: Packages, or folders that hold packages: where meshes lie that are not
                around the robot's file. The folders that the run names are not used.
            expand: Whether a .xacro may be evaluated, where an older run does not hold what it
                became.

        Raises:
            RunFileError: The run is an older one that does not hold its robot, and the robot's file
                is not there, has changed since, or is xacro.
            RpctlError: The robot cannot be built.
        """
        if self.simulated is not None:
            return self.simulated
        return load_robot(self.robot, package_dirs, expand)


RECORDS: dict[str, type[Log | RobotFacts | GroundFacts]] = {
    "log": Log,
    "robot": RobotFacts,
    "ground": GroundFacts,
}
UNSAVED = ("simulated", "digest")  # what a run knows of itself and no file of it can say


def _entry_places() -> dict[str, tuple[str | None, str]]:
    """Return where each entry of the file stands in a run: its record (None: the run), its name."""
    renamed = {
        ("robot", "name"): "robot",
        ("ground", "points"): "contact_points",
        ("ground", "notes"): "ground_notes",
    }
    places: dict[str, tuple[str | None, str]] = {}
    for record, kind in RECORDS.items():
        for item in fields(kind):
            places[renamed.get((record, item.name), item.name)] = record, item.name
    rest = (item.name for item in fields(Run) if item.name not in (*RECORDS, *UNSAVED))
    return {**places, **{name: (None, name) for name in rest}}


ENTRIES = _entry_places()  # the file is flat


def entries_of(run: Run) -> tuple[dict[str, Any], dict[str, Array]]:
    """Return what JSON says of a run and its arrays, by the names of its file's entries."""
    entries = {
        entry: getattr(run if record is None else getattr(run, record), name)
        for entry, (record, name) in ENTRIES.items()
    }
    entries |= {"drive": asdict(run.robot.drive), "config": config_tables(run.config)}
    entries["sizing"] = None if run.sizing is None else run.sizing.to_dict()
    entries["collisions"] = None if run.collisions is None else run.collisions.to_dict()
    arrays = {name: value for name, value in entries.items() if name in ARRAYS}
    return {name: value for name, value in entries.items() if name not in arrays}, arrays


def from_entries(entries: Mapping[str, Any]) -> Run:
    """Return a run from the entries of its file, as records hold them."""
    values: dict[str | None, dict[str, Any]] = {record: {} for record in (None, *RECORDS)}
    for entry, (record, name) in ENTRIES.items():
        values[record][name] = entries[entry]
    records: dict[str, Any] = {name: kind(**values[name]) for name, kind in RECORDS.items()}
    return Run(**records, **values[None])
