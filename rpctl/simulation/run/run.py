"""``Run``: what a simulation logged, and its one-file form (``.npz``, no pickle)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property
from glob import escape
from pathlib import Path
from typing import Any

from rpctl.arrays import Array
from rpctl.description.packages import require_folders
from rpctl.description.records import Description
from rpctl.description.urdf.reader import parse
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, RunFileError
from rpctl.files.caps import is_folder, read_source
from rpctl.files.writing import writing
from rpctl.libraries import library
from rpctl.robot.load import assemble
from rpctl.robot.load_settings import LoadSettings
from rpctl.robot.model import Robot
from rpctl.robot.sources import Source, find_source
from rpctl.robot.vary import with_payload
from rpctl.simulation.run.derived import Derivation
from rpctl.simulation.run.facts import RobotFacts, robot_facts, urdf_bytes
from rpctl.simulation.run.file import read_run, write_run
from rpctl.simulation.run.header import Header
from rpctl.simulation.run.log import Log
from rpctl.simulation.run.part import read_part
from rpctl.simulation.run.table import columns, csv_blocks


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Run(Header):
    """A logged motion of K samples, with its robot and configuration.

    Attributes:
        log: The samples.
        simulated: The robot, if this process simulated the run; None for a run that was read. It is
            not stored in files.
        digest: SHA-256 digest of the run's file, which reports and exports carry; None: unknown.
    """

    log: Log
    simulated: Robot | None = None
    digest: str | None = None

    def __repr__(self) -> str:
        return (
            f"Run({self.robot.name}, {self.config.run.reference}, {self.t[-1] - self.t[0]:.4g} s)"
        )

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the run in one line, and its scene to be played."""
        return str(library("rpctl.view.film").show(self))

    @property
    def header(self) -> Header:
        """Everything except the samples."""
        return Header(**{item.name: getattr(self, item.name) for item in fields(Header)})

    @cached_property
    def summary(self) -> Any:
        """The figures of merit, a :class:`rpctl.Summary`."""
        return library("rpctl.simulation.merits.summary").summarize(self)  # which takes runs

    @property
    def outcome(self) -> str:
        """The outcome in one word: ``tracked``, ``late``, ``diverging``, ..."""
        return str(self.summary.outcome)

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
        """Write the run to one file, atomically.

        Args:
            path: The file, usually ``.npz``. :mod:`rpctl.simulation.run.file` says how NumPy reads
                it.
            precision: ``"double"`` keeps all bits of positions, and seven digits of rates and
                efforts; ``"single"`` keeps seven digits of everything except the time.

        Returns:
            The path.

        Raises:
            RpctlError: The file cannot be written, or the precision is not known or too small.
        """
        return write_run(path, self.header, self.log, precision)

    def to_csv(self, path: str | Path) -> Path:
        """Write the samples as CSV, one row per sample, atomically.

        Args:
            path: The file.

        Returns:
            The path. The columns are those of :func:`rpctl.simulation.run.table.columns`.
        """
        with writing(path) as file:
            for block in csv_blocks(self._columns()):
                file.write(block.encode())
        return Path(path)

    def to_pandas(self) -> Any:
        """Return the samples as a ``pandas.DataFrame``, one row per sample, indexed by t (s).

        The columns are those of :func:`rpctl.simulation.run.table.columns`.

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
        """Read a run from its file, or from the folder of a simulation that was stopped.

        Args:
            path: A ``run.npz``, or a ``run.part``, whose run has a note that says when it ended.

        Raises:
            RunFileError: The file is missing, is not a run, is damaged, or has another schema.
        """
        header, arrays = read_part(path) if is_folder(path) else read_run(path)
        return run_of(header, Log(arrays, header.bound_limits, _Derived(header, path)))

    def load_robot(self, package_dirs: Sequence[str | Path] = ()) -> Robot:
        """Return the robot of the run: the simulated one, or the one in the run's file.

        A file may come from somebody else, so its robot is built from the URDF in it; see
        :func:`load_robot`.

        Args:
            package_dirs: Packages, or folders that contain packages, with meshes that are not
                beside the robot's file. The folders that the run names are not used.

        Raises:
            RpctlError: The robot cannot be built.
        """
        if self.simulated is not None:
            return self.simulated
        return load_robot(self.robot, package_dirs)


def run_of(header: Header, log: Log, simulated: Robot | None = None) -> Run:
    """Return the run that a header and a log make."""
    told = {item.name: getattr(header, item.name) for item in fields(Header)}
    return Run(**told, log=log, simulated=simulated)


class _Derived:
    """Computes what follows from the samples of a file, with the robot that its header brings back.

    Args:
        header: What the run is.
        path: Its file.
    """

    def __init__(self, header: Header, path: str | Path) -> None:
        self._header, self._path = header, path
        self._derivation: Derivation | None = None

    def __call__(self, log: Log, name: str) -> Mapping[str, Array]:
        """Return the arrays of a log that are computed with one of them, by name.

        Raises:
            RunFileError: The robot is not the one that was simulated.
            RpctlError: It cannot be built, or the motion is none of a robot.
        """
        if self._derivation is None:
            robot = load_robot(self._header.robot)
            if robot_facts(robot).coordinates != self._header.robot.coordinates:
                raise RunFileError(f"{self._path}: its samples are not those of its robot")
            self._derivation = Derivation(ReducedDynamics(robot), self._header.config)
        return self._derivation(log, name)


MAX_NAME = 255  # bytes of a file's name
NOWHERE = Path("/nonexistent")  # Debian keeps it free: no mesh and no package lies around it


def load_robot(known: RobotFacts, package_dirs: Sequence[str | Path] = ()) -> Robot:
    """Return the robot of a run.

    Its URDF is the one that the run holds. What lies around the robot's file, as meshes do, is used
    only if that file is there and is, byte for byte, the one of the run: who sends a run can name
    any path in it, but does not know what lies there.

    Args:
        known: What the run holds of its robot.
        package_dirs: Packages, or folders that hold packages, or the folder where the robot's file
            lies now. Folders that the run names are not used.

    Raises:
        RunFileError: The URDF is not the one that the run tells of.
        RpctlError: The robot cannot be built.
    """
    folders = require_folders(package_dirs)
    elsewhere = Source((*folders, NOWHERE)[0] / _file_name(known))
    source = next(_unchanged(known, folders), elsewhere)
    description = _kept(known, source.path)
    settings = LoadSettings(
        drive=known.drive,
        lock={escape(name): position for name, position in known.locked.items()},
        density=known.density,
        end_effector=known.end_effector,
        package_dirs=tuple(map(str, folders)),
        xacro_args=known.xacro_args,
        ignore_missing_packages=known.ignore_missing_packages,
        home=known.home,
        free=("*",),  # nothing but what was locked
        losses=known.losses,
        armature=False if known.armature is None else dict(known.armature) or True,
    )
    description = replace(description, read_with=source.read_settings(settings))
    robot = assemble(source, description, settings)
    for link, mass, com, inertia in known.payloads:
        robot = with_payload(robot, link, mass, com=com, inertia=inertia)
    return replace(robot, name=known.name, source=known.source)


def has_surroundings(robot: Robot) -> bool:
    """Return whether the file of a robot is known to be there, so that its meshes may be, too."""
    return robot.description.path.parent != NOWHERE


def _unchanged(known: RobotFacts, folders: Sequence[Path]) -> Iterator[Source]:
    """Yield the robot's file, where it is there and has the run's digest."""
    for source in _places(known, folders):
        try:
            data = read_source(source.path)
        except RpctlError:
            continue
        if hashlib.sha256(data).hexdigest() == known.file_sha256:
            yield source


def _places(known: RobotFacts, folders: Sequence[Path]) -> Iterator[Source]:
    """Yield where the robot's file may lie: where it lay, and in folders that the user declares."""
    path = Path(known.source)
    if path.is_absolute():
        yield Source(path)
    elif len(path.parts) == 1:
        with suppress(RpctlError, OSError):  # a name that is not known here, or none at all
            yield find_source(known.source)
    for folder in folders:
        yield Source(folder / _file_name(known))


def _file_name(known: RobotFacts) -> str:
    """Return the name of the robot's file; one that no file can have is replaced."""
    name = Path(known.source).name
    return name if name.isprintable() and 0 < len(name) <= MAX_NAME else "robot.urdf"


def _kept(known: RobotFacts, path: Path) -> Description:
    """Return the description in the URDF that the run holds, as if it lay at a path."""
    data = urdf_bytes(known)
    if hashlib.sha256(data).hexdigest() != known.urdf_sha256:
        raise RunFileError(f"{known.name}: the URDF in the run does not match the hash in the run")
    return replace(
        parse(path, data),
        expanded=known.file_sha256 != known.urdf_sha256,
        file_sha256=known.file_sha256,
    )
