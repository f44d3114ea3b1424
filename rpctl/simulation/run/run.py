"""``Run``: what a simulation logged, and its one-file form (``.npz``, no pickle)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, RunFileError
from rpctl.files.caps import is_folder
from rpctl.files.writing import writing
from rpctl.libraries import library
from rpctl.robot.model import Robot
from rpctl.simulation.run.derived import Derivation
from rpctl.simulation.run.facts import robot_facts
from rpctl.simulation.run.file import read_run, write_run
from rpctl.simulation.run.header import Header
from rpctl.simulation.run.log import Log
from rpctl.simulation.run.part import read_part
from rpctl.simulation.run.reload import load_robot
from rpctl.simulation.run.table import columns, csv_blocks


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Run(Header):
    """A logged motion of K samples, and all that it came from.

    Attributes:
        log: The samples.
        simulated: The robot itself, of a run that was simulated by this process; None of one that
            was read. No file has it.
        digest: SHA-256 digest of its file, which files made from it carry; None where none is
            known.
    """

    log: Log
    simulated: Robot | None = None
    digest: str | None = None

    def __repr__(self) -> str:
        return (
            f"Run({self.robot.name}, {self.config.run.reference}, {self.t[-1] - self.t[0]:.4g} s)"
        )

    @property
    def header(self) -> Header:
        """What it is besides its samples."""
        return Header(**{item.name: getattr(self, item.name) for item in fields(Header)})

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
            path: The file; ``.npz`` is the custom. :mod:`rpctl.simulation.run.file` says how NumPy
                reads it.
            precision: ``"double"`` keeps every bit of places, and seven digits of rates and
                efforts; ``"single"`` keeps seven digits of all but the time.

        Returns:
            The path.

        Raises:
            RpctlError: The file cannot be written, or the precision is not known or too small.
        """
        return write_run(path, self.header, self.log, precision)

    def to_csv(self, path: str | Path) -> Path:
        """Write the samples as CSV, a row a sample; the file is there whole or not at all.

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
        """Return the samples as a ``pandas.DataFrame``, a row a sample, indexed by t (s).

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
        """Read a run: its file, or the folder that the simulation left when it was stopped.

        Args:
            path: A ``run.npz``, or a ``run.part``; the run of that says in a note when it ended.

        Raises:
            RunFileError: The file is missing, is no run, is damaged, or has another schema.
        """
        header, arrays = read_part(path) if is_folder(path) else read_run(path)
        log = Log(arrays, header.bound_limits, _Derived(header, path))
        return run_of(header, log)

    def load_robot(self, package_dirs: Sequence[str | Path] = ()) -> Robot:
        """Return the robot of this run: as it was simulated here, or as the file of a run holds it.

        A run from a file is data that somebody else may have written. Its robot comes from the URDF
        in it; see :func:`rpctl.simulation.run.reload.load_robot`.

        Args:
            package_dirs: Packages, or folders that hold packages: where meshes lie that are not
                around the robot's file. The folders that the run names are not used.

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
