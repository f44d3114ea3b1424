"""Many runs of one robot that differ in some settings: what they have in common, and their rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import LARGEST, RpctlError, require_known
from rpctl.files.records import POSITIVE, Range, Record
from rpctl.libraries import install_command, library
from rpctl.reference.motion import Reference
from rpctl.simulation.config import Config
from rpctl.simulation.loop.backend import require_backend
from rpctl.simulation.merits.outcome import ON_PATH_M
from rpctl.study.scatter import key_path, with_entries

# What is kept over time, m, by its name in ``simulation.merits.SampleMeasures``.
SERIES = {"base_error": "base", "lateral_error": "lateral", "end_effector_error": "tip"}

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Experiment(Record):
    """What all runs have in common; a pure value.

    Attributes:
        config: What no run changes.
        names: Paths of the settings that each run has its own of, see :mod:`rpctl.study.scatter`.
        seed: Of all that is random.
        merits: Names of the merits that are wanted; None: all that the robot has.
        samples: How many samples over time are kept of a run, at most.
        tolerance: How far from its reference a run that succeeds may be, on average over its last
            quarter, m.
        backend: ``"compiled"``, ``"pinocchio"``, or ``"auto"``: the first that can do it.
        reference: What the configuration's reference is; None loads it by its name.
    """

    config: Config
    names: tuple[str, ...] = ()
    seed: Annotated[int, whole(0)] = 0
    merits: tuple[str, ...] | None = None
    samples: Annotated[int, whole(2)] = 200
    tolerance: Annotated[float, POSITIVE] = ON_PATH_M
    backend: str = "auto"
    reference: Reference | None = None

    def __post_init__(self) -> None:
        """Refuse what is out of range."""
        require_backend(self.backend)
        super().__post_init__()

    def config_of(self, values: Array, index: int) -> Config:
        """Return the configuration of the run of a number with its settings (n,).

        ``rpctl track --config`` replays it.

        Raises:
            RpctlError: A setting is out of range.
        """
        seed = run_seed(self.seed, index)
        return with_entries(self.config, self._paths, [*values.tolist(), seed])

    @cached_property
    def _paths(self) -> list[list[str]]:
        """Where a configuration holds what each run has its own of."""
        return [*(key_path(self.config, name) for name in self.names), ["plant", "seed"]]


def run_seed(seed: int, index: int) -> int:
    """Return the seed of a run's plant, which follows from that of the study and its number."""
    state = np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1, np.uint64)
    return int(state[0] >> np.uint64(1))  # TOML's whole numbers have 63 bits


@dataclass(frozen=True, eq=False, repr=False)
class RunTable:
    """Some runs of an experiment, a row each; K runs, T samples over time.

    Attributes:
        index: Numbers of the runs (K,).
        parameters: Scattered values by name, (K,) each.
        merits: By name (K,), in the units of :data:`rpctl.study.merits.MERITS`; inf of a run that
            came to no end.
        series: Over time, by name (K, T), m; NaN after a run has ended.
        t: Times of the series (T,), s.
        outcomes: What became of each run, in a word of :data:`rpctl.study.merits.RUN_OUTCOMES`.
        reasons: Why, in a sentence.
    """

    index: NDArray[np.int64]
    parameters: Mapping[str, Array]
    merits: Mapping[str, Array]
    series: Mapping[str, Array | NDArray[np.float32]]
    t: Array
    outcomes: tuple[str, ...]
    reasons: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.index)


def join_tables(tables: Sequence[RunTable], count: int) -> RunTable:
    """Return one table of the runs 0 to count − 1 that are in several, each run once."""
    index, rows = np.unique(np.concatenate([each.index for each in tables]), return_index=True)
    index, rows = index[:count], rows[:count]

    def joined(role: str) -> dict[str, Array]:
        columns = [getattr(each, role) for each in tables]
        return {name: np.concatenate([c[name] for c in columns])[rows] for name in columns[0]}

    def listed(role: str) -> tuple[str, ...]:
        words = [word for each in tables for word in getattr(each, role)]
        return tuple(words[row] for row in rows.tolist())

    return RunTable(
        index, joined("parameters"), joined("merits"), joined("series"), tables[0].t,
        listed("outcomes"), listed("reasons"),
    )  # fmt: skip


MORRIS_LEVELS = 4  # of each parameter in a trajectory: SALib's default
STREAM = (0, 1)  # spawn key of Monte Carlo's points: the runs' own random numbers have keys (i,)
FEWEST = 2  # levels of a grid, and base points of Sobol's design


def extra(module: str, what: str = "this study needs", of: str = "study") -> Any:
    """Import a module of the extra ``study``, or of another one, and return it.

    Raises:
        RpctlError: It is not installed.
    """
    package = module.partition(".")[0]
    if find_spec(package) is None:
        raise RpctlError(f"{what} {package}; run {install_command(of)}")
    return library(module)


DESIGNS = ("monte-carlo", "grid", "latin-hypercube", "sobol", "morris")


def whole(least: int) -> Range:
    """Return the whole numbers from one on."""
    return Range(least, LARGEST, f"a whole number, {least} or more")


@dataclass(frozen=True)
class Design(Record):
    """A set of points of the unit cube, one a run: quantiles of the scattered parameters.

    Attributes:
        kind: One of :data:`DESIGNS`.
        count: The most runs; a design that needs a certain number takes the largest within.
        seed: Of all that is drawn.
    """

    kind: str = "monte-carlo"
    count: Annotated[int, whole(1)] = 100
    seed: Annotated[int, whole(0)] = 0

    def __post_init__(self) -> None:
        """Refuse what is no design."""
        require_known("design", [self.kind], DESIGNS)
        super().__post_init__()

    def size(self, parameters: int) -> int:
        """Return how many runs there are with so many parameters, without drawing them.

        Raises:
            RpctlError: ``count`` is too small for the design.
        """
        if not parameters and self.kind != "monte-carlo":
            raise RpctlError(f"a {self.kind} design needs parameters; write some under [scatter]")
        step = {"sobol": parameters + 2, "morris": parameters + 1}.get(self.kind, 1)
        least = {"grid": FEWEST**parameters}.get(self.kind, FEWEST * step if step > 1 else 1)
        if self.count < least:
            raise RpctlError(
                f"count is {self.count}; a {self.kind} design of {parameters} parameters needs "
                f"{least} runs at least"
            )
        if self.kind == "grid":
            return max(k**parameters for k in range(self.count + 1) if k**parameters <= self.count)
        blocks = self.count // step
        if self.kind == "sobol":  # its points are balanced in powers of two
            blocks = 1 << (blocks.bit_length() - 1)
        return blocks * step

    def points(self, parameters: int) -> Array:
        """Return the points (size, parameters), each entry in [0, 1].

        Row i of ``monte-carlo`` depends on the seed and on i only: a larger count adds rows. Of a
        grid the last parameter runs fastest; Saltelli's rows for Sobol's indices are, of each base
        point, A, A with one entry of B for each parameter, and B.

        Raises:
            RpctlError: ``count`` is too small for the design, or SALib is not installed.
        """
        size = self.size(parameters)
        if self.kind == "monte-carlo":
            stream = np.random.SeedSequence(self.seed, spawn_key=STREAM)
            return np.random.Generator(np.random.PCG64(stream)).random((size, parameters))
        if self.kind == "grid":
            axis = np.linspace(0.0, 1.0, round(size ** (1.0 / parameters)))
            mesh = np.meshgrid(*[axis] * parameters, indexing="ij")
            return np.stack([each.ravel() for each in mesh], axis=1)
        if self.kind == "latin-hypercube":
            hypercube = library("scipy.stats").qmc.LatinHypercube
            return np.asarray(hypercube(parameters, rng=self.seed).random(size))
        problem, sample = unit_problem(parameters), extra(f"SALib.sample.{self.kind}").sample
        if self.kind == "sobol":
            base = size // (parameters + 2)
            return np.asarray(sample(problem, base, calc_second_order=False, seed=self.seed))
        trajectories = size // (parameters + 1)
        return np.asarray(sample(problem, trajectories, MORRIS_LEVELS, seed=self.seed + 1))


def unit_problem(parameters: int) -> dict[str, object]:
    """Return SALib's description of the unit cube."""
    names = [f"x{j}" for j in range(parameters)]
    return {"num_vars": parameters, "names": names, "bounds": [[0.0, 1.0]] * parameters}
