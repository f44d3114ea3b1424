"""Robust settings: scipy's search over ranges against a scatter, then validated on a fresh one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.writing import make_folder, to_json, write_atomically
from rpctl.libraries import library
from rpctl.robot.inspection import robot_identity
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, write_config
from rpctl.study.design import Design
from rpctl.study.executor import Executor
from rpctl.study.experiment import Progress, RunTable, join_tables
from rpctl.study.journal import Journal
from rpctl.study.merits import merits_for
from rpctl.study.provenance import code_identity, experiment_identity
from rpctl.study.runner import RunChunk, Runner
from rpctl.study.scatter import Scatter, settings_at, with_values
from rpctl.study.statistics import CONFIDENCE, Interval, mean, quantile, share
from rpctl.study.store import read_runs
from rpctl.study.study import Optimisation, Study, chunk_size, run_study, succeeded
from rpctl.study.words import merit_unit, merit_words, number, unit_of

SEARCH_FOLDER, JOURNAL_FILE = "optimize", "generations.jsonl"
OPTIMUM_FILE, CONFIG_FILE = "optimum.json", "optimized.toml"
INVERSE_STEPS = 60  # of a bisection: each halves an interval of 1
RESAMPLES = 1000  # of the bootstrap
BEFORE, AFTER = "before", "after"  # the file's own settings, and those that were found
BETTER, WORSE, UNCLEAR = "better", "worse", "no clear difference"

Evaluate = Callable[[Array], Array]  # of points (P, n) of the unit cube their costs (P,)
Judged = tuple[Array, NDArray[np.bool_]]  # a merit of each run, and which runs succeeded


def optimise(
    robot: Robot,
    study: Study,
    out: Path,
    executor: Executor | None = None,
    progress: Progress | None = None,
    resume: bool = False,
) -> Mapping[str, Any]:
    """Find settings of small cost over the scatter, and write them as ``optimized.toml``.

    Every set of settings meets the same scattered plants, starts and noise. What is found is then
    compared with the file's own settings on a fresh scatter. Ctrl-C keeps the best so far.

    Args:
        robot: The robot, as it was loaded.
        study: The study; it says what to optimise.
        out: The folder to write to.
        executor: What runs the chunks; None: this process.
        progress: Called with the runs done and their number.
        resume: Whether to go on with what the folder holds.

    Returns:
        What ``optimum.json`` holds.

    Raises:
        RpctlError: There is nothing to optimise, or the folder holds something else.
    """
    worker, notify = executor or Executor(), progress or (lambda done, total: None)
    search = _Search(robot, study, out, worker, notify)
    merits_for(robot, (search.asked.merit, *study.success))
    search.begin(resume)
    first = start_point(study.experiment.config, study.ranges)
    dimension, seed = len(study.ranges.names), study.settings.seed
    minimise(search.costs, dimension, search.population, search.generations, seed, first)
    if not np.isfinite(search.lowest):
        raise RpctlError(
            f"no settings within the ranges let any run come to its end; see [scatter] and "
            f"[optimize.parameters] of {out}"
        )
    optimum = search.optimum(search.validated())
    make_folder(out)
    write_atomically(out / OPTIMUM_FILE, (to_json(optimum) + "\n").encode(), follow_links=False)
    return optimum


def minimise(
    costs: Evaluate,
    dimension: int,
    population: int,
    generations: int,
    seed: int,
    first: Array | None,
) -> None:
    """Walk with differential evolution through the unit cube; all follows from the seed.

    Args:
        costs: Returns the costs (P,) of points (P, n).
        dimension: n.
        population: P.
        generations: How many, the first one with them.
        seed: Of the search.
        first: A point that is tried first, or None.
    """
    start = library("scipy.stats").qmc.LatinHypercube(dimension, rng=seed).random(population)
    if first is not None:
        start[0] = first
    library("scipy.optimize").differential_evolution(
        lambda x: costs(np.ascontiguousarray(x.T)),
        [(0.0, 1.0)] * dimension,
        init=start,
        maxiter=generations - 1,
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=np.random.default_rng(seed),
    )


def start_point(config: Config, ranges: Scatter) -> Array | None:
    """Return the point (n,) of a configuration's own settings; None if one is out of its range."""
    point = []
    for name, distribution in zip(ranges.names, ranges.distributions, strict=True):
        value = setting(config, name)
        low, high = distribution.quantile(np.array([0.0, 1.0])).tolist()
        if value is None or not low <= value <= high:
            return None
        a, b = 0.0, 1.0
        for _ in range(INVERSE_STEPS):
            middle = 0.5 * (a + b)
            below = float(distribution.quantile(np.array(middle))) < value
            a, b = (middle, b) if below else (a, middle)
        point.append(b)
    return np.array(point)


def setting(config: Config, path: str) -> float | None:
    """Return a setting of a configuration by its path; None if it is no number there."""
    value: Any = config
    for key in path.split("."):
        value = value.get(key) if isinstance(value, Mapping) else getattr(value, key, None)
    return float(value) if isinstance(value, int | float) else None


class _Search:
    """A search of one study's settings: what each point has cost, and the best so far.

    Attributes:
        history: The lowest cost after each generation.
    """

    def __init__(
        self, robot: Robot, study: Study, out: Path, executor: Executor, progress: Progress
    ) -> None:
        if study.optimisation is None:
            raise RpctlError("the study says nothing to optimise; write [optimize.parameters]")
        self.robot, self.study, self.asked, self.out = robot, study, study.optimisation, out
        self.executor, self.progress = executor, progress
        self.population = self.asked.population(len(study.ranges.names))
        self.generations = self.asked.evaluations // self.population
        self.history: list[float] = []
        self.lowest = np.inf
        self._best: Array = np.zeros(len(study.ranges.names))
        self._known: dict[bytes, float] = {}  # the costs by point
        self._journal = Journal(out / SEARCH_FOLDER / JOURNAL_FILE, self._identity, "a search")
        names = study.scatter.names + study.ranges.names
        self._runner = Runner(robot, replace(study.experiment, names=names))

    @property
    def _identity(self) -> dict[str, Any]:
        study = self.study
        own = {k: v for k, v in vars(self.asked).items() if k not in ("validation", "evaluations")}
        return {
            "robot": robot_identity(self.robot),
            "seed": study.settings.seed,
            "experiment": experiment_identity(study.experiment, study.scatter),
            "success": dict(study.success),
            "optimize": {**own, "parameters": self._ends()},
            "versions": code_identity(study.design),
        }

    def _ends(self) -> dict[str, list[float]]:
        """Return the ends and the middle of each setting's range, by its path."""
        ranges = self.study.ranges
        shares = np.array([0.0, 0.5, 1.0])
        ends = [distribution.quantile(shares).tolist() for distribution in ranges.distributions]
        return dict(zip(ranges.names, ends, strict=True))

    def begin(self, resume: bool) -> None:
        """Make the journal, or take what it holds: the search walks the same way again."""
        for record in self._journal.begin(resume):
            self._known |= zip(map(_key, record["points"]), record["costs"], strict=True)

    @property
    def total(self) -> int:
        """Number of all runs, the validation's with them."""
        return self.generations * self.population * self.asked.runs + 2 * self.asked.validation

    @property
    def best(self) -> Config:
        """The configuration of the lowest cost."""
        values = self.study.ranges.values(self._best[None])[0]
        return with_values(self.study.experiment.config, self.study.ranges.names, values)

    def costs(self, points: Array) -> Array:
        """Return the costs (P,) of a generation of points (P, n); keep them."""
        new = np.array([point for point in points if _key(point) not in self._known])
        if len(new):
            found = self._costs_of_new(new)
            self._journal.add({"points": new.tolist(), "costs": found})
            self._known |= zip(map(_key, new), found, strict=True)
        costs = np.array([self._known[_key(point)] for point in points])
        at = int(np.argmin(costs))
        if costs[at] < self.lowest:
            self._best, self.lowest = points[at].copy(), float(costs[at])
            write_config(self.best, self.out / CONFIG_FILE)
        self.history.append(self.lowest)
        self.progress(len(self.history) * self.population * self.asked.runs, self.total)
        return costs

    def _costs_of_new(self, points: Array) -> list[float]:
        """Run the scatter with the settings of each point, one point after another."""
        study, asked = self.study, self.asked
        kind = "latin-hypercube" if study.scatter.names else "monte-carlo"
        design = Design(kind, asked.runs, study.settings.seed)
        scattered = settings_at(study.scatter, design.points(len(study.scatter.names)))
        settings = np.repeat(study.ranges.values(points), asked.runs, axis=0)
        values = np.hstack([np.tile(scattered, (len(points), 1)), settings])
        numbers = np.tile(np.arange(asked.runs), len(points))
        rows = np.arange(len(values))
        size = study.settings.chunk or chunk_size(len(values), self.executor.workers)
        parts = [slice(first, first + size) for first in range(0, len(values), size)]
        chunks = [RunChunk(rows[part], numbers[part], values[part]) for part in parts]
        tables, done = [], len(self.history) * self.population * asked.runs
        for _, table in self.executor.map_chunks(self._runner, chunks):
            tables.append(table)
            done += len(table)
            self.progress(done, self.total)
        runs = join_tables(tables, len(values))
        costs = []
        for first in range(0, len(values), asked.runs):
            part = slice(first, first + asked.runs)
            merits = {name: each[part] for name, each in runs.merits.items()}
            success = succeeded(merits, runs.outcomes[part], study.success)
            costs.append(asked.cost(merits[asked.merit], success))
        return costs

    def validated(self) -> dict[str, RunTable]:
        """Run a fresh scatter, the same for both, with the file's settings and with those found."""
        study, asked, tables = self.study, self.asked, {}
        done = self.total - 2 * asked.validation
        settings = replace(
            study.settings, design="monte-carlo", count=asked.validation,
            seed=study.settings.seed + 1, merit=asked.merit, worst=0,
        )  # fmt: skip
        for name, config in {BEFORE: study.experiment.config, AFTER: self.best}.items():
            experiment = replace(study.experiment, config=config, seed=settings.seed)
            tried = replace(study, experiment=experiment, settings=settings, text="")
            # One of other settings does not meet the folder of these.
            digest = sha256(repr((config, tried.design)).encode()).hexdigest()[:8]
            folder = self.out / SEARCH_FOLDER / f"{name}-{digest}"

            def count(more: int, _: int, before: int = done) -> None:
                self.progress(before + more, self.total)

            path = run_study(self.robot, tried, folder, self.executor, count, resume=True)
            tables[name] = read_runs(path)[0]
            done += asked.validation
        return tables

    def optimum(self, tables: Mapping[str, RunTable]) -> dict[str, Any]:
        """Return what was found and how it did in the validation, as JSON says it."""
        asked, study = self.asked, self.study
        ends, after = self._ends(), study.ranges.values(self._best[None])[0].tolist()
        judged = {
            name: (table.merits[asked.merit], study.succeeded(table))
            for name, table in tables.items()
        }
        change = cost_change(asked, judged[BEFORE], judged[AFTER], study.settings.seed)
        smaller = int((judged[AFTER][0] < judged[BEFORE][0]).sum())
        own = ("merit", "statistic", "level", "failure_weight", "method", "runs")
        return {
            **{name: getattr(asked, name) for name in own},
            "evaluations": len(self.history) * self.population,
            "seed": study.settings.seed,
            "settings": {
                name: {
                    "before": setting(study.experiment.config, name),
                    "after": value,
                    "range": ends[name][::2],
                }
                for name, value in zip(study.ranges.names, after, strict=True)
            },
            "cost": self.lowest,
            "history": self.history,
            "validation": {
                "runs": asked.validation,
                "seed": study.settings.seed + 1,
                **{name: _judged(asked, *each) for name, each in judged.items()},
                "better": share(smaller, asked.validation)._asdict(),
                "change": None if change is None else change._asdict(),
            },
            "config": str(write_config(self.best, self.out / CONFIG_FILE)),
        }


def _key(point: Any) -> bytes:
    """Return a point (n,) as the key of what it costs."""
    return np.ascontiguousarray(point, float).tobytes()


def _judged(asked: Optimisation, values: Array, success: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the cost of a validation, and its parts with their intervals."""
    known = values[np.isfinite(values)]
    statistic = mean(known)
    if asked.statistic == "quantile" and len(known):
        statistic = quantile(known, asked.level)
    elif asked.statistic == "worst" and len(known):  # which has no upper end
        statistic = Interval(asked.figure(known), asked.figure(known), np.inf)
    return {
        "cost": asked.cost(values, success),
        "statistic": statistic._asdict(),
        "mean": mean(known)._asdict(),
        "success": share(int(success.sum()), len(success))._asdict(),
        "largest": float(known.max()) if len(known) else None,
        "missing": int(len(values) - len(known)),
    }


def cost_change(asked: Optimisation, before: Judged, after: Judged, seed: int) -> Interval | None:
    """Return by how much the cost grows from some settings to others, and its 95 % interval.

    Both met the same plants, so that runs are drawn in pairs (percentile bootstrap). None: a
    largest value has no such interval, nor has a cost that is not finite.

    Args:
        asked: What is optimised.
        before: The merit of each run (N,) with the one, and which runs succeeded.
        after: The same with the other.
        seed: Of the draws.
    """
    costs = [asked.cost(*each) for each in (before, after)]
    if asked.statistic == "worst" or not np.isfinite(costs).all():
        return None
    rng, count = np.random.default_rng(seed), len(before[0])
    changes = np.empty(RESAMPLES)
    for k in range(RESAMPLES):
        drawn = rng.integers(count, size=count)
        first, second = (asked.cost(each[0][drawn], each[1][drawn]) for each in (before, after))
        changes[k] = second - first if first != second else 0.0
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(changes, [tail, 1.0 - tail], method="nearest").tolist()
    return Interval(costs[1] - costs[0], low, high)


class OptimumVerdict(NamedTuple):
    """Whether settings are :data:`BETTER`, :data:`WORSE`, or neither, and a sentence on it."""

    verdict: str
    text: str


def statistic_words(optimum: Mapping[str, Any]) -> str:
    """Return what a search made small, as ``95 % quantile of base error, rms``."""
    name = {"quantile": f"{100.0 * optimum['level']:g} % quantile", "worst": "largest"}
    statistic = name.get(optimum["statistic"], optimum["statistic"])
    return f"{statistic} of {merit_words(optimum['merit'])}"


def optimum_sentence(optimum: Mapping[str, Any]) -> OptimumVerdict:
    """Return whether the settings found are better than the file's on fresh runs, and by how much.

    Args:
        optimum: What ``optimum.json`` holds.
    """
    checked = optimum["validation"]
    costs = [checked[name]["cost"] for name in (BEFORE, AFTER)]
    before, after = (math.inf if each is None else float(each) for each in costs)
    kept = checked["change"]  # none of a largest value
    value = after - before if math.isfinite(before) or math.isfinite(after) else 0.0
    change = Interval(**kept) if kept else Interval(value, value, value)
    verdict = BETTER if change.high < 0.0 else WORSE if change.low > 0.0 else UNCLEAR
    unit = unit_of(merit_unit(optimum["merit"]), max(before, after))
    failed = any(checked[name]["success"]["value"] < 1.0 for name in (BEFORE, AFTER))
    weighted = ", with what failures cost," if optimum["failure_weight"] > 0.0 and failed else ""
    text = (
        f"{verdict}: {statistic_words(optimum)}{weighted} goes from {number(before, unit)} to "
        f"{number(after, unit)} on {checked['runs']} fresh runs"
    )
    if before > 0.0 and math.isfinite(change.value):
        text += f", {_percent(change.value / before)}"
        if kept:
            low, high = (_percent(each / before) for each in (change.low, change.high))
            text += f" (95 % interval {low.removesuffix(' %')} to {high})"
    return OptimumVerdict(verdict, text)


def _percent(ratio: float) -> str:
    """Return a relative change in per cent, with its sign."""
    return ("+" if ratio > 0.0 else "−" if ratio < 0.0 else "") + f"{100.0 * abs(ratio):.3g} %"
