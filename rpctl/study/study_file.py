"""A study's file in TOML: what is run, what differs, how it is judged; and one to begin with."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from rpctl.errors import RpctlError, fault_at
from rpctl.files import toml
from rpctl.files.caps import read_text
from rpctl.files.records import fields_of, read_record
from rpctl.files.toml import Table
from rpctl.robot.model import Robot
from rpctl.simulation.config import CONFIG_TABLES, Config, config_from_tables
from rpctl.study.experiment import Experiment
from rpctl.study.merits import MERITS, merits_for
from rpctl.study.scatter import (
    DISTRIBUTIONS,
    Distribution,
    Fixed,
    Scatter,
    scatter_of,
    scattered_paths,
    with_values,
)
from rpctl.study.study import Optimisation, Study, StudySettings

OWN_TABLES = ("study", "scatter", "success", "optimize")
KIND = "a study file"
TRIED = 0.25  # the quantile that is tried on the robot: the middle of a scale varies nothing


def read_study(path: str | Path, robot: Robot, backend: str = "auto") -> Study:
    """Read a study of a robot.

    Args:
        path: The file.
        robot: The robot: its merits, joints and laws are those that the file may name.
        backend: ``"compiled"``, ``"pinocchio"``, or ``"auto"``.

    Raises:
        DescriptionError: The file is missing, is not TOML, or has faults; all are named.
    """
    text = read_text(path, "MAX_TOML_BYTES", KIND)
    found = toml.read(path, lambda data, faults: _study(data, robot, backend, faults), KIND)
    study = replace(cast(Study, found), text=text)  # else there were faults
    try:
        study.design.size(len(study.scatter.names))
    except RpctlError as error:
        raise fault_at(path, None, f"study: {error}") from None
    return study


def _study(data: Table, robot: Robot, backend: str, faults: list[str]) -> Study | None:
    """Return the study of a file's tables; what is wrong is added to the faults."""
    faults += [
        f"{key}: a study has no such table; it can have {', '.join(OWN_TABLES)}, and those of a "
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
            faults.append("study.duration: run.duration has another value; leave out one of them")
        config = config.with_run(duration=settings.duration)
    scatter = _scatter(own["scatter"], "scatter", config, faults)
    success = _success(own["success"], robot, faults)
    with _told(faults, "study.merit"):
        merits_for(robot, (settings.merit,))
    ranges, optimisation = _optimisation(own["optimize"], robot, config, faults)
    faults += [
        f'optimize.parameters."{name}": is also under [scatter]; leave out one of them'
        for name in ranges.names
        if name in scatter.names
    ]
    if faults:
        return None
    given = scatter.distributions
    fixed = {name: each.value for name, each in given.items() if isinstance(each, Fixed)}
    config = with_values(config, tuple(fixed), np.array([*fixed.values()]))
    scatter = Scatter({name: each for name, each in given.items() if name not in fixed})
    with _told(faults, "scatter"):
        _require_fit(robot, config, scatter)
    experiment = Experiment(
        config, scatter.names, settings.seed, samples=settings.samples,
        tolerance=settings.tolerance, backend=backend,
    )  # fmt: skip
    return Study(experiment, scatter, settings, success, ranges, optimisation)


@contextmanager
def _told(faults: list[str], where: str) -> Iterator[None]:
    """Add what is refused inside to the faults."""
    try:
        yield
    except RpctlError as error:
        faults.append(f"{where}: {error}")


def _table(data: Table, name: str, faults: list[str]) -> Table:
    """Return a table of a table, empty if it has none."""
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
    found: dict[str, Distribution] = {}
    for name, value in _flat(table):
        with _told(faults, f'{where}."{name}"'):
            found |= scatter_of({name: value}, config).distributions
    return Scatter(found)


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
    for name, value in table.items():
        with _told(faults, "success"):
            merits_for(robot, (name,))
            if isinstance(value, bool) or not isinstance(value, int | float):
                faults.append(f"success.{name}: is {value!r}; give a number")
    return table


def _optimisation(
    table: Table, robot: Robot, config: Config, faults: list[str]
) -> tuple[Scatter, Optimisation | None]:
    """Return the settings to be found and what they are judged by; None: nothing is."""
    if not table:
        return Scatter(), None
    own = {key: value for key, value in table.items() if key != "parameters"}
    given = {
        name: {"uniform": value} if isinstance(value, list) else value
        for name, value in _flat(_table(table, "parameters", faults))
    }
    scatter = _scatter(given, "optimize.parameters", config, faults)
    asked = read_record(Optimisation, own, "optimize", faults)
    if asked is not None:
        with _told(faults, "optimize"):
            merits_for(robot, (asked.merit,))
            asked.population(len(scatter.names))
    ends = [scatter.values(np.full((1, len(scatter.names)), p))[0] for p in (0.0, 1.0)]
    for name, low, high in zip(scatter.names, *ends, strict=True):
        if not (np.isfinite([low, high]).all() and low < high):
            faults.append(f'optimize.parameters."{name}": has no range; give [low, high]')
    return scatter, asked


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


# ---- a file to begin with -----------------------------------------------------------------

TEMPLATE = """\
# A study of {robot}: rpctl study ROBOT THIS_FILE --out DIR
# Tables of a configuration ([run], [kinematic], [dynamic], [plant], [limits]) hold for all runs.

[study]
# monte-carlo draws at random (a larger count adds runs), latin-hypercube spreads more evenly, grid
# takes all combinations; sobol and morris tell what matters: shares of variance, mean effects.
{study}
[run]
reference = "{reference}"
control_period = 0.002   # s
plant_step = 0.002       # s

[kinematic]
law = "unified"

[dynamic]
law = "{dynamic}"

# What differs from run to run: a number, or uniform = [low, high], log-uniform = [low, high],
# normal = [mean, standard deviation], normal = [mean, standard deviation, low, high],
# choice = [value, ...].
[scatter]
{scatter}
# A run succeeds if it exceeds none of these; without this table it succeeds if it is within the
# tolerance, on average over its last quarter, and breaks no limit.
# [success]
# rms_base_error = 0.1

# Settings to be found by --optimize, within their ranges, for all the scatter at once.
[optimize]
{optimize}
[optimize.parameters]
"kinematic.horizon" = [0.2, 1.5]
{gain}

# Merits of this robot, all smaller if better:
{merits}#
# What can be scattered (PATTERN: names of joints or links, as "arm_*"):
{paths}"""
GAIN = '"dynamic.gain" = { log-uniform = [1.0, 50.0] }'
SHOWN = StudySettings(duration=5.0, samples=100)
SEARCHED = Optimisation(statistic="quantile", evaluations=64, runs=16, validation=100)
EXAMPLES: dict[str, tuple[str, list[float], str]] = {  # of what differs, by path
    "plant.masses.*": ("uniform", [0.9, 1.1], "times those of the file"),
    "plant.track": ("uniform", [0.98, 1.02], "likewise"),
    "plant.joint_friction.WHEEL": ("uniform", [0.0, 0.2], "dry, besides the file's, N m"),
    "plant.delay": ("uniform", [0.0, 0.01], "from a sample to its efforts, s"),
    "plant.noise.position": ("fixed", [0.001], "of what is measured, m; in all runs"),
    "run.initial_error.y": ("normal", [0.0, 0.05], "at the start, m"),
    "run.initial_error.theta": ("normal", [0.0, 0.1], "rad"),
}


def study_template(robot: Robot) -> str:
    """Return a study file for a robot, with comments: it works as it is."""
    moves, config = bool(robot.drive.base_speeds), Config()
    driven = [wheel.joint for wheel in robot.drive.wheels if wheel.driven]
    lines = []
    for path, (kind, numbers, words) in EXAMPLES.items():
        name = path.replace("WHEEL", driven[0]) if driven else path
        if (moves or not path.startswith("run.")) and _fits(robot, {name: {kind: numbers}}):
            lines.append((f'"{name}" = {{ {kind} = {numbers} }}', words))
    return TEMPLATE.format(
        robot=robot.name,
        study=_commented(_said(SHOWN)),
        reference="eight" if moves else "ee-square",
        dynamic="balance" if robot.drive.leans else "integral",
        gain='"dynamic.place" = [0.05, 0.5]' if robot.drive.leans else GAIN,
        scatter=_commented(lines),
        optimize=_commented(_said(SEARCHED)),
        merits="".join(
            f"#   {name:26}{MERITS[name].unit:9}{MERITS[name].what}\n" for name in merits_for(robot)
        ),
        paths="".join(f"#   {path}\n" for path in scattered_paths(config)),
    )


def _fits(robot: Robot, scatter: Table) -> bool:
    """Return whether a robot has what differs."""
    faults: list[str] = []
    with _told(faults, "scatter"):
        _require_fit(robot, Config(), scatter_of(scatter, Config()))
    return not faults


def _said(record: StudySettings | Optimisation) -> list[tuple[str, str]]:
    """Return the settings of a record as lines of TOML, with what is said of them."""
    lines: list[tuple[str, str]] = []
    kind: Any = type(record)
    for name, each in fields_of(kind).items():
        value, words = getattr(record, name), filter(None, (each.setting.help, each.setting.unit))
        if value is not None:
            lines.append((f"{name} = {json.dumps(value)}", ", ".join(words)))
    return lines


def _commented(lines: list[tuple[str, str]]) -> str:
    """Return lines with comments behind them, one below the other."""
    width = max(len(line) for line, _ in lines)
    return "".join(f"{line:{width}}  # {words}".rstrip(" #") + "\n" for line, words in lines)
