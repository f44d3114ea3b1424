"""Designs of studies: which points of the unit cube are run. All follow from the seed."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Annotated, Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import LARGEST, RpctlError, require_known
from rpctl.files.records import Range, Record
from rpctl.libraries import library

MORRIS_LEVELS = 4  # of each parameter in a trajectory: SALib's default
STREAM = (0, 1)  # spawn key of Monte Carlo's points: the runs' own random numbers have keys (i,)
FEWEST = 2  # levels of a grid, and base points of Sobol's design


def extra(module: str, what: str = "this study needs", of: str = "study") -> Any:
    """Return a module of the libraries of ``rpctl[study]``, or of another extra, imported now.

    Raises:
        RpctlError: It is not installed.
    """
    package = module.partition(".")[0]
    if find_spec(package) is None:
        raise RpctlError(f"{what} {package}; pip install 'rpctl[{of}]'")
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
            raise RpctlError(f"a {self.kind} design has no parameter; write some under [scatter]")
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
            generator = np.random.Generator(np.random.PCG64(stream))
            return generator.random((size, parameters))
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
