"""Robust settings: a search over ranges against a scatter, then validated on a fresh one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.libraries import library
from rpctl.robot.identity import robot_identity
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, write_config
from rpctl.study.design import Design
from rpctl.study.executor import Executor, SerialExecutor
from rpctl.study.gain_search import GainSearch, SearchLog, point_key, range_table, setting
from rpctl.study.identity import code_identity, experiment_identity
from rpctl.study.merits import merits_for
from rpctl.study.optimum import AFTER, BEFORE, CONFIG_FILE, write_optimum
from rpctl.study.run_chunk import RunChunk, RunTask, run_chunk, task_of
from rpctl.study.scatter import Scatter, settings_at
from rpctl.study.store import RunTable, Store, read_runs
from rpctl.study.study import (
    Progress,
    Study,
    chunk_size,
    run_study,
    succeeded,
)

SEARCH_FOLDER = "optimize"
INVERSE_STEPS = 60  # of a bisection: each halves an interval of 1

Evaluate = Callable[[Array], Array]  # of points (P, n) of the unit cube their costs (P,)


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
    search = GainSearch(
        robot, study, out, executor or SerialExecutor(), progress or (lambda done, total: None)
    )
    asked = search.asked
    merits_for(robot, (asked.merit, *study.success))
    folder = out / SEARCH_FOLDER
    _open(search, folder, resume)
    log = SearchLog(folder)
    log.load()
    names = study.scatter.names + asked.ranges.names
    task = task_of(robot, replace(study.experiment, names=names))
    first = start_point(study.experiment.config, asked.ranges)
    minimise(
        partial(_costs, search, task, log), len(asked.ranges.names), asked.population,
        search.generations, study.design.seed, first,
    )  # fmt: skip
    if log.best is None or not np.isfinite(log.lowest):
        raise RpctlError(
            f"no settings within the ranges let any run come to its end; see [scatter] and "
            f"[optimize.parameters] of {out}"
        )
    found = _validate(search, log.best)
    return write_optimum(search, log, found)


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
    """Return the point (n,) of a configuration's own settings; None if one is out of its range.

    Args:
        config: The configuration.
        ranges: The settings and their ranges.
    """
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


def _open(search: GainSearch, folder: Path, resume: bool) -> None:
    """Make the folder of the search, or check that it goes on with the same one."""
    study, asked = search.study, search.asked
    own = {k: v for k, v in vars(asked).items() if k not in ("ranges", "validation", "evaluations")}
    identity = {
        "robot": robot_identity(search.robot),
        "seed": study.design.seed,
        "experiment": experiment_identity(study.experiment, study.scatter),
        "success": dict(study.success),
        "optimize": {**own, "parameters": range_table(asked.ranges)},
        "versions": code_identity(study.design),
    }
    Store(folder, identity).prepare(resume)


def _costs(search: GainSearch, task: RunTask, log: SearchLog, points: Array) -> Array:
    """Return the costs (P,) of points (P, n), each met by the same scatter; keep them."""
    size = search.asked.runs
    new = [k for k, point in enumerate(points) if point_key(point) not in log.costs]
    if new:
        rows = _run_all(search, task, log, points[new])
        for place, k in enumerate(new):
            part = slice(place * size, (place + 1) * size)
            merits = {name: each[part] for name, each in rows.merits.items()}
            success = succeeded(merits, rows.outcomes[part], search.study.success)
            cost = search.asked.cost(merits[search.asked.merit], success)
            log.costs[point_key(points[k])] = cost
    costs = np.array([log.costs[point_key(point)] for point in points])
    if log.keep(points, costs) and log.best is not None:
        write_config(search.config_at(log.best), search.out / CONFIG_FILE)
    search.progress(len(log.history) * search.asked.population * size, search.total)
    return costs


def _run_all(search: GainSearch, task: RunTask, log: SearchLog, points: Array) -> RunTable:
    """Run the scatter with the settings of each point, one point after another."""
    study, asked = search.study, search.asked
    kind = "latin-hypercube" if study.scatter.names else "monte-carlo"
    design = Design(kind, asked.runs, study.design.seed)
    scattered = settings_at(study.scatter, design.points(len(study.scatter.names)))
    settings = asked.ranges.values(points)
    values = np.hstack([np.tile(scattered, (len(points), 1)), np.repeat(settings, asked.runs, 0)])
    numbers = np.tile(np.arange(asked.runs), len(points))
    total = len(values)
    size = study.chunk or chunk_size(total, search.executor.workers)
    rows = np.arange(total)
    chunks = [
        RunChunk(rows[k : k + size], numbers[k : k + size], values[k : k + size])
        for k in range(0, total, size)
    ]
    before = len(log.history) * asked.population * asked.runs
    found, done = {}, before
    for _, table in search.executor.map_chunks(partial(run_chunk, task), chunks):
        found[int(table.index[0])] = table
        done += len(table)
        search.progress(done, search.total)
    return _joined([found[key] for key in sorted(found)])


def _joined(tables: list[RunTable]) -> RunTable:
    first = tables[0]
    return replace(
        first,
        merits={k: np.concatenate([each.merits[k] for each in tables]) for k in first.merits},
        outcomes=sum((each.outcomes for each in tables), ()),
        index=np.concatenate([each.index for each in tables]),
    )


def _validate(search: GainSearch, best: Array) -> dict[str, RunTable]:
    """Run a fresh scatter, the same for both, with the file's settings and with those found."""
    study, asked = search.study, search.asked
    fresh = Design("monte-carlo", asked.validation, study.design.seed + 1)
    configs = {BEFORE: study.experiment.config, AFTER: search.config_at(best)}
    done = search.total - 2 * asked.validation
    tables = {}
    for name, config in configs.items():
        experiment = replace(study.experiment, config=config, seed=fresh.seed)
        tried = replace(
            study, experiment=experiment, design=fresh, worst=0, merit=asked.merit, text=""
        )
        folder = search.out / SEARCH_FOLDER / f"{name}-{_digest(config, fresh)}"
        count = partial(_counted, search, done)
        path = run_study(search.robot, tried, folder, search.executor, count, resume=True)
        tables[name] = read_runs(path)[0]
        done += asked.validation
    return tables


def _counted(search: GainSearch, before: int, done: int, _: int) -> None:
    search.progress(before + done, search.total)


def _digest(config: Config, design: Design) -> str:
    """Return a word for a validation, so that one of other settings does not meet its folder."""
    return sha256(repr((config, design)).encode()).hexdigest()[:8]
