"""What a search for settings found, compared with the file's own on a fresh scatter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.files.writing import make_folder, to_json, write_atomically
from rpctl.simulation.config import write_config
from rpctl.study.gain_search import GainSearch, SearchLog, range_table, setting
from rpctl.study.optimisation import Optimisation
from rpctl.study.statistics import Interval, mean, quantile, share
from rpctl.study.store import RunTable
from rpctl.study.study import OPTIMUM_FILE, succeeded

CONFIG_FILE = "optimized.toml"
BEFORE, AFTER = "before", "after"  # the file's own settings, and those that were found


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
    asked, values = search.asked, table.merits[search.asked.merit]
    success = succeeded(table.merits, table.outcomes, search.study.success)
    known = values[np.isfinite(values)]
    return {
        "cost": asked.cost(values, success),
        "statistic": _interval(asked, known)._asdict(),
        "mean": mean(known)._asdict(),
        "success": share(int(success.sum()), len(success))._asdict(),
        "largest": float(known.max()) if len(known) else None,
        "missing": int(len(values) - len(known)),
    }


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
