"""A study's file in TOML: what is run, what differs, and how it is judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from rpctl.errors import DescriptionError, Finding, RpctlError
from rpctl.files import toml
from rpctl.files.opening import read_text
from rpctl.files.records import read_record
from rpctl.files.toml import Table
from rpctl.robot.model import Robot
from rpctl.simulation.config import CONFIG_TABLES, Config, config_from_tables
from rpctl.study.distributions import DISTRIBUTIONS, Fixed
from rpctl.study.experiment import Experiment
from rpctl.study.merits import merits_for
from rpctl.study.scatter import Scatter, scatter_of, with_values
from rpctl.study.study import Optimisation, Study, StudySettings

OWN_TABLES = ("study", "scatter", "success", "optimize")
KIND = "a study file"
TRIED = 0.25  # the quantile that is tried on the robot: the middle of a scale varies nothing
Made = TypeVar("Made")


def read_study(path: str | Path, robot: Robot, backend: str = "auto") -> Study:
    """Read a study of a robot.

    Args:
        path: The file.
        robot: The robot: its merits, joints and laws are those that the file may name.
        backend: ``"compiled"``, ``"pinocchio"``, or ``"auto"``.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """

    def schema(data: Table, faults: list[str]) -> Study:
        return cast(Study, _study(data, robot, backend, faults))  # None: there are faults

    text = read_text(path, "MAX_TOML_BYTES", KIND)
    study = replace(toml.read(path, schema, KIND), text=text)
    try:
        study.design.size(len(study.scatter.names))
    except RpctlError as error:
        raise DescriptionError(path, [Finding("error", None, f"study: {error}")]) from None
    return study


def _study(data: Table, robot: Robot, backend: str, faults: list[str]) -> Study | None:
    """Return the study of a file's tables; what is wrong is added to the faults."""
    faults += [
        f"{key}: is no table of a study; it has {', '.join(OWN_TABLES)}, and those of a "
        f"configuration: {', '.join(CONFIG_TABLES)}"
        for key in data
        if key not in (*CONFIG_TABLES, *OWN_TABLES)
    ]
    own = {name: _table(data, name, faults) for name in OWN_TABLES}
    config = config_from_tables({k: v for k, v in data.items() if k in CONFIG_TABLES}, faults)
    settings = read_record(StudySettings, own["study"], "study", faults)
    if settings is None or faults:
        return None
    if settings.duration is not None:
        if config.run.duration is not None:
            faults.append("study.duration: run.duration says another one; leave one of them out")
        config = config.with_run(duration=settings.duration)
    scatter = _scatter(own["scatter"], "scatter", config, faults)
    success = _success(own["success"], robot, faults)
    _try(faults, "study.merit", lambda: merits_for(robot, (settings.merit,)))
    ranges, optimisation = _optimisation(own["optimize"], robot, config, faults)
    faults += [
        f'optimize.parameters."{name}": is scattered, too; leave one of them out'
        for name in ranges.names
        if name in scatter.names
    ]
    if faults:
        return None
    config, scatter = _with_fixed(config, scatter)
    _try(faults, "scatter", lambda: _require_fit(robot, config, scatter))
    experiment = Experiment(
        config,
        scatter.names,
        settings.seed,
        samples=settings.samples,
        tolerance=settings.tolerance,
        backend=backend,
    )
    return Study(experiment, scatter, settings, success, ranges, optimisation)


def _table(data: Table, name: str, faults: list[str]) -> Table:
    """Return one of a file's tables, empty if it has none."""
    table = data.get(name, {})
    if isinstance(table, Mapping):
        return dict(table)
    faults.append(f"{name}: is {table!r}; write [{name}]")
    return {}


def _scatter(table: Table, where: str, config: Config, faults: list[str]) -> Scatter:
    """Return the distributions of a table, whose names may be in quotes or tables in one another.

    Args:
        table: The table.
        where: Its name.
        config: What it is of.
        faults: All that is wrong with the file so far.
    """
    names: list[str] = []
    distributions: list[Any] = []
    for name, value in _flat(table):
        found = _try(faults, f'{where}."{name}"', lambda: scatter_of({name: value}, config))  # noqa: B023
        if found is not None:
            names += found.names
            distributions += found.distributions
    return Scatter(tuple(names), tuple(distributions))


def _flat(table: Mapping[str, Any], above: str = "") -> list[tuple[str, Any]]:
    """Return distributions by their paths: a table of tables is a path that has no quotes."""
    found: list[tuple[str, Any]] = []
    for key, value in table.items():
        if isinstance(value, Mapping) and not _is_distribution(value):
            found += _flat(value, f"{above}{key}.")
        else:
            found.append((f"{above}{key}", value))
    return found


def _is_distribution(value: Mapping[str, Any]) -> bool:
    """Return whether a table has the numbers of a distribution, its name right or wrong."""
    named = any(key in DISTRIBUTIONS for key in value)
    return named or not value or any(isinstance(each, list) for each in value.values())


def _success(table: Table, robot: Robot, faults: list[str]) -> dict[str, float]:
    """Return the largest merits of a run that succeeds."""
    found: dict[str, float] = {}
    for name, value in table.items():
        if _try(faults, "success", lambda: merits_for(robot, (name,))) is None:  # noqa: B023
            continue
        if isinstance(value, bool) or not isinstance(value, int | float):
            faults.append(f"success.{name}: is {value!r}; give a number")
        else:
            found[name] = float(value)
    return found


def _optimisation(
    table: Table, robot: Robot, config: Config, faults: list[str]
) -> tuple[Scatter, Optimisation | None]:
    """Return the settings to be found and what they are judged by; None: nothing is."""
    if not table:
        return Scatter(), None
    ranges = table.pop("parameters", {})
    if not isinstance(ranges, Mapping):
        faults.append(f"optimize.parameters: is {ranges!r}; write [optimize.parameters]")
        return Scatter(), None
    given = {
        name: {"uniform": value} if isinstance(value, list) else value
        for name, value in _flat(ranges)
    }
    scatter = _scatter(given, "optimize.parameters", config, faults)
    asked = read_record(Optimisation, table, "optimize", faults)
    if asked is not None:
        _try(faults, "optimize.merit", lambda: merits_for(robot, (asked.merit,)))
        _try(faults, "optimize", lambda: asked.population(len(scatter.names)))
    ends = [scatter.values(np.full((1, len(scatter.names)), p)) for p in (0.0, 1.0)]
    for name, low, high in zip(scatter.names, *(end[0] for end in ends), strict=True):
        if not (np.isfinite([low, high]).all() and low < high):
            faults.append(f'optimize.parameters."{name}": has no range; give [low, high]')
    return scatter, asked


def _with_fixed(config: Config, scatter: Scatter) -> tuple[Config, Scatter]:
    """Return a configuration with what is the same in all runs, and what differs."""
    pairs = list(zip(scatter.names, scatter.distributions, strict=True))
    fixed = [(name, each.value) for name, each in pairs if isinstance(each, Fixed)]
    if fixed:
        names, values = zip(*fixed, strict=True)
        config = with_values(config, names, np.array(values))
    left = [(name, each) for name, each in pairs if not isinstance(each, Fixed)]
    return config, Scatter(tuple(name for name, _ in left), tuple(each for _, each in left))


def _require_fit(robot: Robot, config: Config, scatter: Scatter) -> None:
    """Refuse what no run could be made with: try a value of each distribution on the robot.

    Raises:
        RpctlError: A pattern matches no name, or a value is out of range.
    """
    shares = np.full((1, len(scatter.names)), TRIED)
    tried = with_values(config, scatter.names, scatter.values(shares)[0])
    known = tried.limits.apply(robot)
    tried.plant.simulated_robot(known)
    tried.plant.bias(known)


def _try(faults: list[str], where: str, make: Callable[[], Made]) -> Made | None:
    """Return what is made, or None; why it is not is added to the faults.

    Args:
        faults: All that is wrong so far.
        where: In the file.
        make: Makes it.
    """
    try:
        return make()
    except RpctlError as error:
        faults.append(f"{where}: {error}")
        return None
