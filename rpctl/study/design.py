"""Designs of studies: which points of the unit cube are run. All follow from the seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.libraries import library

MORRIS_LEVELS = 4  # of each parameter in a trajectory: SALib's default
STREAM = (0, 1)  # spawn key of Monte Carlo's points: the runs' own random numbers have keys (i,)
INSTALL = "pip install 'rpctl[study]'"
FEWEST = 2  # levels of a grid, and base points of Sobol's design


def extra(module: str) -> Any:
    """Return a module of the libraries of ``rpctl[study]``, imported now.

    Raises:
        RpctlError: It is not installed.
    """
    package = module.partition(".")[0]
    try:
        return library(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise RpctlError(f"this study needs {package}; {INSTALL}") from None


@dataclass(frozen=True)
class Design:
    """A set of points of the unit cube, one a run: quantiles of the scattered parameters.

    Attributes:
        kind: One of :data:`DESIGNS`.
        count: The most runs; a design that needs a certain number takes the largest within.
        seed: Of all that is drawn.
    """

    kind: str = "monte-carlo"
    count: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse what is no design."""
        if self.kind not in DESIGNS:
            raise UnknownNameError("design", self.kind, DESIGNS)
        if self.count < 1:
            raise RpctlError(f"count is {self.count}; give a whole number, 1 or more")
        if self.seed < 0:
            raise RpctlError(f"seed is {self.seed}; give a whole number, 0 or more")

    def size(self, parameters: int) -> int:
        """Return how many runs there are with so many parameters, without drawing them.

        Raises:
            RpctlError: ``count`` is too small for the design.
        """
        if not parameters and self.kind != "monte-carlo":
            raise RpctlError(f"a {self.kind} design has no parameter; write some under [scatter]")
        if self.kind == "grid":
            return _levels(self, parameters) ** parameters
        if self.kind == "sobol":
            return _base_points(self, parameters) * (parameters + 2)
        if self.kind == "morris":
            return _trajectories(self, parameters) * (parameters + 1)
        return self.count

    def points(self, parameters: int) -> Array:
        """Return the points (size, parameters), each entry in [0, 1].

        Row i of ``monte-carlo`` depends on the seed and on i only: a larger count adds rows.

        Raises:
            RpctlError: ``count`` is too small for the design, or SALib is not installed.
        """
        self.size(parameters)
        return DESIGNS[self.kind](self, parameters)


def _monte_carlo(design: Design, parameters: int) -> Array:
    stream = np.random.SeedSequence(design.seed, spawn_key=STREAM)
    return np.random.Generator(np.random.PCG64(stream)).random((design.count, parameters))


def _grid(design: Design, parameters: int) -> Array:
    """Return all corners and what lies evenly between them; the last parameter runs fastest."""
    axis = np.linspace(0.0, 1.0, _levels(design, parameters))
    mesh = np.meshgrid(*[axis] * parameters, indexing="ij")
    return np.stack([each.ravel() for each in mesh], axis=1)


def _latin_hypercube(design: Design, parameters: int) -> Array:
    qmc = library("scipy.stats").qmc
    generator = np.random.default_rng(design.seed)
    return np.asarray(qmc.LatinHypercube(parameters, rng=generator).random(design.count))


def _sobol(design: Design, parameters: int) -> Array:
    """Return Saltelli's rows: of each base point A, A with one entry of B for each, and B."""
    sample = extra("SALib.sample.sobol").sample
    base = _base_points(design, parameters)
    return np.asarray(
        sample(unit_problem(parameters), base, calc_second_order=False, seed=design.seed)
    )


def _morris(design: Design, parameters: int) -> Array:
    sample = extra("SALib.sample.morris").sample
    trajectories = _trajectories(design, parameters)
    problem = unit_problem(parameters)
    return np.asarray(sample(problem, trajectories, MORRIS_LEVELS, seed=design.seed + 1))


def unit_problem(parameters: int) -> dict[str, object]:
    """Return SALib's description of the unit cube."""
    names = [f"x{j}" for j in range(parameters)]
    return {"num_vars": parameters, "names": names, "bounds": [[0.0, 1.0]] * parameters}


def _levels(design: Design, parameters: int) -> int:
    """Return the largest number of levels whose grid has at most ``count`` points."""
    levels = 1
    while (levels + 1) ** parameters <= design.count:
        levels += 1
    return _enough(levels, FEWEST**parameters, design, parameters)


def _base_points(design: Design, parameters: int) -> int:
    """Return the largest power of two that fits: Sobol's points are balanced in such numbers."""
    fitting = design.count // (parameters + 2)
    power = 1 << (fitting.bit_length() - 1) if fitting else 0
    return _enough(power, FEWEST * (parameters + 2), design, parameters)


def _trajectories(design: Design, parameters: int) -> int:
    fitting = design.count // (parameters + 1)
    return _enough(fitting, FEWEST * (parameters + 1), design, parameters)


def _enough(found: int, needed: int, design: Design, parameters: int) -> int:
    """Return a number of levels, points or trajectories, if there are two at least.

    Raises:
        RpctlError: ``count`` is too small.
    """
    if found < FEWEST:
        raise RpctlError(
            f"count is {design.count}; a {design.kind} design of {parameters} parameters needs "
            f"{needed} runs at least"
        )
    return found


DESIGNS: dict[str, Callable[[Design, int], Array]] = {
    "monte-carlo": _monte_carlo,
    "grid": _grid,
    "latin-hypercube": _latin_hypercube,
    "sobol": _sobol,
    "morris": _morris,
}
