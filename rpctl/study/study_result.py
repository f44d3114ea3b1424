"""What a study found, from its folder alone: statistics, what matters, maps and worst runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.errors import RpctlError
from rpctl.files.caps import read_text
from rpctl.files.strict_json import read_json
from rpctl.study.experiment import Design, RunTable
from rpctl.study.optimise import OPTIMUM_FILE
from rpctl.study.statistics import (
    Interval,
    MeritStatistics,
    ParameterMap,
    Sensitivity,
    describe,
    parameter_map,
    sensitivity,
    share,
    worst_rows,
)
from rpctl.study.store import RUNS_FILE, read_runs
from rpctl.study.study import succeeded, worst_file

FAILURE = "failure"  # a merit beside the others: 1 of a run that did not succeed, else 0


class WorstRun(NamedTuple):
    """One of the worst runs by the study's merit.

    Attributes:
        run: Its number.
        value: Of the merit; inf where it has none.
        outcome: In a word.
        reason: In a sentence.
        config: The file that replays it.
        command: What replays it; empty for a run that was refused for its settings.
    """

    run: int
    value: float
    outcome: str
    reason: str
    config: str
    command: str


@dataclass(frozen=True)
class StudyResult:
    """What a study found.

    Attributes:
        folder: Where it lies.
        robot: Name of the robot.
        runs: All runs; ``runs.series`` over ``runs.t`` are for envelopes, see
            :func:`rpctl.study.statistics.envelope`.
        succeeded: Which runs (N,) did.
        merit: That runs are compared by.
        units: By name of merit, parameter and series; empty where there is none, or not known.
        design: The points that were run.
        scatter: Distributions by parameter, as a study file says them.
        success: Share of runs that succeeded.
        statistics: Of each merit.
        sensitivities: Of each merit, and of ``failure`` where some runs failed and others did not.
        maps: The study's merit over the two parameters that matter most, if there are two.
        worst: The worst runs, the worst first.
        optimum: What ``--optimize`` found, as JSON says it; None: nothing yet.
        details: All that the file of the runs tells of itself.
    """

    folder: Path
    robot: str
    runs: RunTable = field(repr=False)
    succeeded: NDArray[np.bool_] = field(repr=False)
    merit: str
    units: Mapping[str, str] = field(repr=False)
    design: Design
    scatter: Mapping[str, Any] = field(repr=False)
    success: Interval
    statistics: tuple[MeritStatistics, ...] = field(repr=False)
    sensitivities: tuple[Sensitivity, ...] = field(repr=False)
    maps: tuple[ParameterMap, ...] = field(repr=False)
    worst: tuple[WorstRun, ...] = field(repr=False)
    optimum: Mapping[str, Any] | None = field(repr=False)
    details: Mapping[str, Any] = field(repr=False)

    def sensitivity_of(self, merit: str) -> Sensitivity | None:
        """Return what matters to a merit; None where that is not known."""
        return next((each for each in self.sensitivities if each.merit == merit), None)

    def to_dict(self) -> dict[str, Any]:
        """Return all but the runs themselves, as JSON says it."""
        return {
            "robot": self.robot,
            "runs": len(self.runs),
            "design": {
                "kind": self.design.kind, "count": self.design.count, "seed": self.design.seed},
            "scatter": dict(self.scatter),
            "merit": self.merit,
            "success": {**self.success._asdict(), "thresholds": self.details["success"]},
            "outcomes": dict(Counter(self.runs.outcomes)),
            "statistics": [
                {
                    "merit": each.name,
                    "unit": self.units.get(each.name, ""),
                    "runs": each.runs,
                    "missing": each.missing,
                    "mean": each.mean._asdict(),
                    "quantiles": [
                        {"level": level, **found._asdict()}
                        for level, found in each.quantiles.items()
                    ],
                    "largest": each.largest,
                }
                for each in self.statistics
            ],
            "sensitivities": [
                {
                    "merit": each.merit,
                    "method": each.method,
                    "ranking": list(each.ranking),
                    "replaced": each.replaced,
                    "parameters": {
                        name: {key: found[j]._asdict() for key, found in each.measures.items()}
                        for j, name in enumerate(each.parameters)
                    },
                }
                for each in self.sensitivities
            ],
            "maps": [
                {
                    name: found.tolist() if isinstance(found, np.ndarray) else found
                    for name, found in vars(each).items()
                }
                for each in self.maps
            ],
            "worst": [each._asdict() for each in self.worst],
            "optimum": self.optimum,
            "versions": self.details["identity"]["versions"],
        }  # fmt: skip


def read_result(folder: str | Path) -> StudyResult:
    """Return what a study found.

    Args:
        folder: Its folder.

    Raises:
        RpctlError: It holds no study that has come to its end.
    """
    folder = Path(folder)
    if not (folder / RUNS_FILE).is_file():
        raise RpctlError(f"{folder}: holds no finished study; `rpctl study` runs one")
    runs, details = read_runs(folder / RUNS_FILE)
    kept = details["identity"]["design"]
    design = Design(kept["kind"], int(details["count"]), int(kept["seed"]))
    merit: str = details["merit"]
    success = succeeded(runs.merits, runs.outcomes, details["success"])
    found = _sensitivities(runs, design, success)
    return StudyResult(
        folder,
        details["identity"]["robot"]["name"],
        runs,
        success,
        merit,
        details["units"],
        design,
        details["identity"]["experiment"]["scatter"],
        share(int(success.sum()), len(runs)),
        tuple(describe(name, values) for name, values in runs.merits.items()),
        found,
        _maps(runs, merit, found),
        _worst(runs, merit, int(details["worst"]), folder, details["command"]),
        _optimum(folder),
        details,
    )


def _sensitivities(
    runs: RunTable, design: Design, success: NDArray[np.bool_]
) -> tuple[Sensitivity, ...]:
    names = tuple(runs.parameters)
    if not names or len(runs) < 3:
        return ()
    inputs = np.column_stack(list(runs.parameters.values()))
    if design.kind == "morris":  # its effects are those of steps in the unit cube
        inputs = design.points(len(names))
    merits = dict(runs.merits)
    if 0 < success.sum() < len(success):
        merits[FAILURE] = 1.0 - success.astype(float)
    return tuple(sensitivity(name, names, design, inputs, each) for name, each in merits.items())


def _maps(runs: RunTable, merit: str, found: tuple[Sensitivity, ...]) -> tuple[ParameterMap, ...]:
    """Return the map of the merit over the two parameters that matter most to it."""
    ranking = next((each.ranking for each in found if each.merit == merit), ())
    if len(ranking) < 2:
        return ()
    x, y = (runs.parameters[name] for name in ranking[:2])
    return (parameter_map(merit, (ranking[0], ranking[1]), x, y, runs.merits[merit]),)


def _worst(
    runs: RunTable, merit: str, count: int, folder: Path, command: str
) -> tuple[WorstRun, ...]:
    rows = worst_rows(runs.merits[merit], count).tolist()
    configs = [folder / worst_file(k) for k in range(1, len(rows) + 1)]
    return tuple(
        WorstRun(
            int(runs.index[row]),
            float(runs.merits[merit][row]),
            runs.outcomes[row],
            runs.reasons[row],
            str(config),
            replay_command(command, config) if config.is_file() else "",
        )
        for row, config in zip(rows, configs, strict=True)
    )


def replay_command(command: str, config: Path) -> str:
    """Return the command line that tracks with a configuration.

    Args:
        command: What tracks the robot.
        config: The file.
    """
    return f"{command} --config {quote(str(config))} --out {quote(str(config.with_suffix('')))}"


def _optimum(folder: Path) -> Mapping[str, Any] | None:
    path = folder / OPTIMUM_FILE
    if not path.is_file():
        return None
    try:
        return read_json(read_text(path, "MAX_TOML_BYTES", "a study's optimum"))
    except ValueError as error:
        raise RpctlError(f"{path}: {error}; remove it, and optimise again") from None
