"""What a search for settings found, compared with the file's own on a fresh scatter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.files.writing import make_folder, to_json, write_atomically
from rpctl.simulation.config import write_config
from rpctl.study.gain_search import GainSearch, SearchLog, range_table, setting
from rpctl.study.optimisation import Optimisation
from rpctl.study.statistics import CONFIDENCE, Interval, mean, quantile, share
from rpctl.study.store import RunTable
from rpctl.study.study import OPTIMUM_FILE, succeeded

CONFIG_FILE = "optimized.toml"
RESAMPLES = 1000  # of the bootstrap
BEFORE, AFTER = "before", "after"  # the file's own settings, and those that were found

Judged = tuple[Array, NDArray[np.bool_]]  # a merit of each run, and which runs succeeded


def write_optimum(
    search: GainSearch, log: SearchLog, tables: Mapping[str, RunTable]
) -> dict[str, Any]:
    """Write what was found, and return it as JSON says it.

    Args:
        search: The search.
        log: What it has found.
        tables: The runs of the validation, with the settings before and after.
    """
    asked, study = search.asked, search.study
    best = log.best if log.best is not None else np.zeros(len(asked.ranges.names))
    config = search.config_at(best)
    names = asked.ranges.names
    judged = [_merits(search, tables[name]) for name in (BEFORE, AFTER)]
    change = cost_change(asked, judged[0], judged[1], study.design.seed)
    found: dict[str, Any] = {
        "merit": asked.merit,
        "statistic": asked.statistic,
        "level": asked.level,
        "failure_weight": asked.failure_weight,
        "method": asked.method,
        "evaluations": len(log.history) * asked.population,
        "runs": asked.runs,
        "seed": study.design.seed,
        "settings": {
            name: {
                "before": setting(study.experiment.config, name),
                "after": value,
                "range": list(range_table(asked.ranges)[name])[::2],
            }
            for name, value in zip(names, asked.ranges.values(best[None])[0].tolist(), strict=True)
        },
        "cost": log.lowest,
        "history": log.history,
        "validation": {
            "runs": asked.validation,
            "seed": study.design.seed + 1,
            **{name: _judged(search, table) for name, table in tables.items()},
            "better": _better(search, tables)._asdict(),
            "change": None if change is None else change._asdict(),
        },
        "config": str(write_config(config, search.out / CONFIG_FILE)),
    }
    make_folder(search.out)
    write_atomically(
        search.out / OPTIMUM_FILE, (to_json(found) + "\n").encode(), follow_links=False
    )
    return found


def _judged(search: GainSearch, table: RunTable) -> dict[str, Any]:
    """Return the cost of a validation, and its parts with their intervals."""
    asked, (values, success) = search.asked, _merits(search, table)
    known = values[np.isfinite(values)]
    return {
        "cost": asked.cost(values, success),
        "statistic": _interval(asked, known)._asdict(),
        "mean": mean(known)._asdict(),
        "success": share(int(success.sum()), len(success))._asdict(),
        "largest": float(known.max()) if len(known) else None,
        "missing": int(len(values) - len(known)),
    }


def _merits(search: GainSearch, table: RunTable) -> Judged:
    """Return the merit that is to be small of each run (N,), and which runs succeeded."""
    success = succeeded(table.merits, table.outcomes, search.study.success)
    return table.merits[search.asked.merit], success


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


def _interval(asked: Optimisation, known: Array) -> Interval:
    """Return the statistic of merits (K,) and its interval; of the worst there is no upper end."""
    if asked.statistic == "mean" or not len(known):
        return mean(known)
    if asked.statistic == "quantile":
        return quantile(known, asked.level)
    return Interval(asked.figure(known), asked.figure(known), np.inf)


def _better(search: GainSearch, tables: Mapping[str, RunTable]) -> Interval:
    """Return the share of runs, each with the same plant twice, whose merit became smaller."""
    before, after = (tables[name].merits[search.asked.merit] for name in (BEFORE, AFTER))
    return share(int((after < before).sum()), len(before))
