"""Robust settings: scipy's search over ranges against a scatter, then validated on a fresh one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.bandwidth import USUAL_PERIOD, gains_of, usual_gains
from rpctl.control.controller import default_laws
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.files.writing import make_folder, to_json, write_atomically
from rpctl.libraries import library
from rpctl.robot.model import Robot
from rpctl.robot.vary import scale_masses
from rpctl.simulation.config import CONTROL_PERIOD, Config, RunSettings, write_config
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.starting import DELAY_S, MASS_RATIO
from rpctl.study.cells import References, Row
from rpctl.study.executor import Executor
from rpctl.study.experiment import Design, Progress, RunTable, join_tables
from rpctl.study.merits import merit_unit, merit_words, merits_for, number, unit_of
from rpctl.study.runner import Runner, run_rows
from rpctl.study.scatter import Scatter, settings_at, with_values
from rpctl.study.statistics import CONFIDENCE, Interval, mean, quantile, share
from rpctl.study.store import Journal, identity
from rpctl.study.study import Optimisation, Study, succeeded

SEARCH_FOLDER, JOURNAL_FILE = "optimize", "generations.jsonl"
OPTIMUM_FILE, CONFIG_FILE = "optimum.json", "optimized.toml"
RESAMPLES = 1000  # of the bootstrap
BEFORE, AFTER = "before", "after"  # the file's own settings, and those that were found
BETTER, WORSE, UNCLEAR = "better", "worse", "no clear difference"

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
    search = _Search(robot, study, out, executor or Executor(), progress)
    merits_for(robot, (search.asked.merit, *study.success))
    search.begin(resume)
    search.walk()
    if not np.isfinite(search.lowest):
        raise RpctlError(
            "no settings within the ranges let a run reach its end; see [scatter] and "
            f"[optimize.parameters] of {out}"
        )
    optimum = search.optimum()
    make_folder(out)
    write_atomically(out / OPTIMUM_FILE, (to_json(optimum) + "\n").encode(), follow_links=False)
    return optimum


def start_point(config: Config, ranges: Scatter) -> Array | None:
    """Return the point (n,) of a configuration's own settings; None if one is out of its range."""
    brentq, point = library("scipy.optimize").brentq, []
    for name, distribution in ranges.distributions.items():
        value = setting(config, name)
        low, high = distribution.quantile(np.array([0.0, 1.0])).tolist()
        if value is None or not low <= value <= high:
            return None
        point.append(brentq(lambda p: distribution.quantile(np.array(p)) - value, 0.0, 1.0))  # noqa: B023
    return np.array(point)


def setting(config: Config, path: str) -> float | None:
    """Return a setting of a configuration by its path; None if it is no number there."""
    value: Any = config
    for key in path.split("."):
        value = value.get(key) if isinstance(value, Mapping) else getattr(value, key, None)
    if value is None:  # a gain that the period sets
        value = getattr(usual_gains(config.run.control_period), key.removeprefix("joint_"), None)
    return float(value) if isinstance(value, int | float) else None


class _Search:
    """A search of one study's settings: what each point has cost, and the best so far.

    Attributes:
        history: The lowest cost after each generation.
    """

    def __init__(
        self, robot: Robot, study: Study, out: Path, executor: Executor, progress: Progress | None
    ) -> None:
        if study.optimisation is None:
            raise RpctlError("the study has nothing to optimise; write [optimize.parameters]")
        self.robot, self.study, self.asked, self.out = robot, study, study.optimisation, out
        self.executor, self.progress = executor, progress or (lambda done, total: None)
        self.population = self.asked.population(len(study.ranges.names))
        self.generations = self.asked.evaluations // self.population
        self.history: list[float] = []
        self.lowest, self.found = np.inf, study.experiment.config
        self._done, self._known = 0, dict[bytes, float]()  # runs; the costs by point
        names = study.scatter.names + study.ranges.names
        self._runner = Runner(robot, replace(study.experiment, names=names))

    def begin(self, resume: bool) -> None:
        """Make the journal, or take what it holds: the search walks the same way again."""
        study, own = self.study, asdict(self.asked)
        follows_from = {
            **identity(self.robot, study.experiment, study.scatter, study.design),
            "seed": study.settings.seed,
            "success": dict(study.success),
            "optimize": {
                **{key: own[key] for key in own if key not in ("validation", "evaluations")},
                "parameters": self._ends(),
            },
        }
        self._journal = Journal(self.out / SEARCH_FOLDER / JOURNAL_FILE, follows_from, "a search")
        for record in self._journal.begin(resume):
            self._known |= zip(map(_key, record["points"]), record["costs"], strict=True)

    def _ends(self) -> dict[str, list[float]]:
        """Return the ends of each setting's range, by its path."""
        ends, ranges = np.array([0.0, 1.0]), self.study.ranges.distributions
        return {name: each.quantile(ends).tolist() for name, each in ranges.items()}

    def walk(self) -> None:
        """Walk with differential evolution through the unit cube; all follows from the seed."""
        study, dimension = self.study, len(self.study.ranges.names)
        spread = library("scipy.stats").qmc.LatinHypercube(dimension, rng=study.settings.seed)
        library("scipy.optimize").differential_evolution(
            lambda x: self.costs(np.ascontiguousarray(x.T)),
            [(0.0, 1.0)] * dimension,
            init=spread.random(self.population),
            x0=start_point(study.experiment.config, study.ranges),
            maxiter=self.generations - 1,
            tol=0.0,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=np.random.default_rng(study.settings.seed),
        )

    def costs(self, points: Array) -> Array:
        """Return the costs (P,) of a generation of points (P, n); keep them."""
        study, asked = self.study, self.asked
        new = np.array([point for point in points if _key(point) not in self._known])
        if len(new):
            kind = "latin-hypercube" if study.scatter.names else "monte-carlo"
            design = Design(kind, asked.runs, study.settings.seed)
            judged = self._judged(self._runner, design, study.ranges.values(new))
            costs = [asked.cost(*each) for each in judged]
            self._journal.add({"points": new.tolist(), "costs": costs})
            self._known |= zip(map(_key, new), costs, strict=True)
        found = np.array([self._known[_key(point)] for point in points])
        at = int(np.argmin(found))
        if found[at] < self.lowest:
            values = study.ranges.values(points[at : at + 1])[0]
            self.found = with_values(study.experiment.config, study.ranges.names, values)
            self.lowest = float(found[at])
            write_config(self.found, self.out / CONFIG_FILE)
        self.history.append(self.lowest)
        self._done = len(self.history) * self.population * asked.runs
        return found

    def _judged(self, runner: Runner, design: Design, settings: Array) -> list[Judged]:
        """Run one scatter with each of some settings (P, n); return what became of its runs."""
        study, count = self.study, design.count
        scattered = settings_at(study.scatter, design.points(len(study.scatter.names)))
        values = np.hstack(
            [np.tile(scattered, (len(settings), 1)), np.repeat(settings, count, axis=0)]
        )
        rows, numbers = np.arange(len(values)), np.tile(np.arange(count), len(settings))
        total = self.generations * self.population * self.asked.runs + 2 * self.asked.validation
        tables: list[RunTable] = []
        for table in run_rows(runner, rows, numbers, values, self.executor, study.settings.chunk):
            tables.append(table)
            self._done += len(table)
            self.progress(self._done, total)
        runs = join_tables(tables, len(values))
        success = succeeded(runs.merits, runs.outcomes, study.success)
        merit = runs.merits[self.asked.merit]
        parts = [slice(first, first + count) for first in range(0, len(values), count)]
        return [(merit[part], success[part]) for part in parts]

    def optimum(self) -> dict[str, Any]:
        """Validate what was found on a fresh scatter, and return all of it as JSON says it."""
        asked, study, names = self.asked, self.study, self.study.ranges.names
        seed, judged = study.settings.seed, dict[str, Judged]()
        design = Design(count=asked.validation, seed=seed + 1)
        for name, config in {BEFORE: study.experiment.config, AFTER: self.found}.items():
            runner = Runner(self.robot, replace(study.experiment, config=config, seed=seed + 1))
            (judged[name],) = self._judged(runner, design, np.empty((1, 0)))
        change = cost_change(asked, judged[BEFORE], judged[AFTER], seed)
        smaller = int((judged[AFTER][0] < judged[BEFORE][0]).sum())
        own = ("merit", "statistic", "level", "failure_weight", "method", "runs")
        return {
            **{name: getattr(asked, name) for name in own},
            "evaluations": len(self.history) * self.population,
            "seed": seed,
            "settings": {
                name: {
                    "before": setting(study.experiment.config, name),
                    "after": setting(self.found, name),
                    "range": self._ends()[name],
                }
                for name in names
            },
            "cost": self.lowest,
            "history": self.history,
            "validation": {
                "runs": asked.validation,
                "seed": seed + 1,
                **{name: _figures(asked, *each) for name, each in judged.items()},
                "better": share(smaller, asked.validation)._asdict(),
                "change": None if change is None else change._asdict(),
            },
            "config": str(write_config(self.found, self.out / CONFIG_FILE)),
        }


def _key(point: Any) -> bytes:
    """Return a point (n,) as the key of what it costs."""
    return np.ascontiguousarray(point, float).tobytes()


def _figures(asked: Optimisation, values: Array, success: NDArray[np.bool_]) -> dict[str, Any]:
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

    def change(rows: NDArray[np.intp]) -> float:
        first, second = (asked.cost(each[0][rows], each[1][rows]) for each in (before, after))
        return second - first if first != second else 0.0

    runs = np.arange(len(before[0]))
    if asked.statistic == "worst" or not np.isfinite([change(runs), asked.cost(*after)]).all():
        return None
    with np.errstate(invalid="ignore"):  # a cost may be infinite for what is drawn
        drawn = library("scipy.stats").bootstrap(
            (runs,), change, n_resamples=RESAMPLES, vectorized=False, method="percentile",
            rng=np.random.default_rng(seed),
        ).bootstrap_distribution  # fmt: skip
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(drawn, [tail, 1.0 - tail], method="nearest").tolist()
    return Interval(change(runs), low, high)


def statistic_words(optimum: Mapping[str, Any]) -> str:
    """Return what a search made small, as ``95 % quantile of base error, rms``."""
    name = {"quantile": f"{100.0 * optimum['level']:g} % quantile", "worst": "largest"}
    statistic = name.get(optimum["statistic"], optimum["statistic"])
    return f"{statistic} of {merit_words(optimum['merit'])}"


def optimum_sentence(optimum: Mapping[str, Any]) -> tuple[str, str]:
    """Return whether the settings found are better than the file's on fresh runs, and by how much.

    Args:
        optimum: What ``optimum.json`` holds.

    Returns:
        :data:`BETTER`, :data:`WORSE`, or :data:`UNCLEAR`; and a sentence that begins so.
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
    weighted = (
        ", including the cost of failures," if optimum["failure_weight"] > 0.0 and failed else ""
    )
    text = (
        f"{verdict}: {statistic_words(optimum)}{weighted} goes from {number(before, unit)} to "
        f"{number(after, unit)} on {checked['runs']} fresh runs"
    )
    if before > 0.0 and math.isfinite(change.value):
        text += f", {_percent(change.value / before)}"
        if kept:
            low, high = (_percent(each / before) for each in (change.low, change.high))
            text += f" (95 % interval {low.removesuffix(' %')} to {high})"
    return verdict, text


def _percent(ratio: float) -> str:
    """Return a relative change in per cent, with its sign."""
    return ("+" if ratio > 0.0 else "−" if ratio < 0.0 else "") + f"{100.0 * abs(ratio):.3g} %"


RATIOS = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the usual bandwidth
SECONDS = 4.0  # of each run
PHASE_MARGIN = 1.298  # rad of the open loop, at ...
CROSSOVER = 1.02  # ... times its bandwidth


@dataclass(frozen=True, eq=False)
class TuneCell:
    """A run of a robot whose joints have a bandwidth (Hz).

    The robot is 10 % heavier than its controller knows, and its efforts come 5 ms late.
    """

    bandwidth: float
    prepared: Config

    def config(self, references: References) -> Config:
        """Return the run's configuration; see :class:`rpctl.study.cells.Cell`."""
        return self.prepared


def tune_cells(robot: Robot, bandwidths: Sequence[float], run: RunSettings) -> list[TuneCell]:
    """Return a run with joints of each bandwidth (Hz).

    Raises:
        RpctlError: A bandwidth is not positive.
    """
    plant = Plant(delay=DELAY_S, controller_model=scale_masses(robot, "*", 1.0 / MASS_RATIO))
    config = Config(*default_laws(robot), run=run, plant=plant)
    return [TuneCell(each, config.with_bandwidth(each)) for each in bandwidths]


def tuning_bandwidths(robot: Robot) -> tuple[float, ...]:
    """Return the bandwidths (Hz) to try: about the usual one.

    Raises:
        RpctlError: The robot has no joints but its base's.
    """
    if not robot.joints:
        raise RpctlError(f"{robot.name} has no arm: no joint has a bandwidth to tune")
    return tuple(ratio * usual_gains(USUAL_PERIOD).bandwidth for ratio in RATIOS)


def row_dict(robot: Robot, row: Row[TuneCell]) -> dict[str, Any]:
    """Return a bandwidth (Hz), what follows from it, and how its run went, as JSON says it.

    ``stiffness`` is that before the integral acts, along the arm's direction of least inertia at
    home (N·m/rad or N/m); ``lateness`` how late efforts may come, besides the hold, before the loop
    is unstable (s).
    """
    bandwidth, figures = row.cell.bandwidth, row.figures
    _, h, h1, k = gains_of(bandwidth)
    q, first = robot.configuration_at(np.zeros(3), robot.home), robot.dof - len(robot.joints)
    # The base is free to give way: the joints' part of the inverse, not of the inertia.
    mobility = np.linalg.inv(ReducedDynamics(robot).inertia(q))[first:, first:]
    least = 1.0 / float(np.linalg.eigvalsh(mobility)[-1])
    return {
        "bandwidth": bandwidth,
        "horizon": h,
        "horizon_dyn": h1,
        "gain": k,
        "stiffness": least / (h * h1),
        "lateness": PHASE_MARGIN / (CROSSOVER * 2.0 * math.pi * bandwidth) - 0.5 * CONTROL_PERIOD,
        "outcome": figures.failure or figures.outcome,
        "effort_ratio": figures.joint_effort,
        "joint_error": figures.joint_error,
        "succeeded": figures.succeeded,
    }
