"""Numbers at the edge: refused by name and range, or simulated; never carried on."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, get_type_hints

import numpy as np
import pytest

from rpctl import Robot
from rpctl.control.horizon import constraints
from rpctl.control.horizon.settings import Bounds, Weights
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.errors import RpctlError, SolverError
from rpctl.files.records import Range, fields_of
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.plants.plant import Plant

BEYOND = (math.inf, -math.inf, math.nan, 1e308, -1e308)
TINY = (5e-324, 1e-320, 1e-200)  # numbers that are not 0, and whose squares are
MAY_BE_TINY = {
    "delay",
    "beta",
    "dropped",
    "lag",
    "dead_time",
    "losses",
    "effort_lag",
    "jitter",
    "lateness",
}
SHORT = RunSettings(duration=0.006)
KINDS = [*KINEMATIC_LAWS.values(), *DYNAMIC_LAWS.values(), Weights, Bounds, RunSettings, Plant]


def numbers(kind: Any) -> Iterator[str]:
    """Yield the settings of a dataclass that are floating-point numbers."""
    hints = get_type_hints(kind)
    for item in dataclasses.fields(kind):
        if hints[item.name] in (float, float | None):
            yield item.name


SETTINGS = [(kind, name) for kind in KINDS for name in numbers(kind)]


def called(setting: tuple[type, str]) -> str:
    return f"{setting[0].__name__}-{setting[1]}"


@pytest.mark.parametrize("setting", SETTINGS, ids=called)
def test_setting_out_of_range_is_refused_by_name(setting: tuple[type, str]) -> None:
    kind, name = setting
    for value in BEYOND + (() if name in MAY_BE_TINY else TINY):
        with pytest.raises(RpctlError, match=name.replace("_", ".")):
            kind(**{name: value})


def configured(kind: type, made: Any) -> Config:
    if kind in KINEMATIC_LAWS.values():
        return Config(kinematic=made, run=SHORT)
    if kind in DYNAMIC_LAWS.values():
        return Config(dynamic=made, run=SHORT)
    if kind in (Weights, Bounds):
        part = {Weights: "weights", Bounds: "bounds"}[kind]
        return Config(kinematic=KINEMATIC_LAWS["horizon"](**{part: made}), run=SHORT)
    if kind is Plant:
        return Config(plant=made, run=SHORT)
    return Config(run=made)


TELLING = [  # a setting of each kind of law, weight, bound, run and plant
    (KINEMATIC_LAWS["unified"], "horizon"), (KINEMATIC_LAWS["kanayama"], "ky"),
    (DYNAMIC_LAWS["bounded"], "horizon_dyn"), (Weights, "accelerations"), (Weights, "position"),
    (Bounds, "grip"), (RunSettings, "friction"), (Plant, "effort_lag"),
]  # fmt: skip


def edges(setting: tuple[Any, str]) -> list[float]:
    """Return the least and the most that a setting may be."""
    limit = fields_of(setting[0])[setting[1]].limit
    return [limit.low, limit.high] if isinstance(limit, Range) else []


@pytest.mark.parametrize(
    "setting",
    [
        *(pytest.param(setting, marks=pytest.mark.slow) for setting in TELLING),
        *(pytest.param(setting, marks=pytest.mark.thorough) for setting in SETTINGS),
    ],
    ids=called,
)
def test_setting_at_the_edge_is_simulated_or_refused(
    paper: Robot, setting: tuple[type, str]
) -> None:
    kind, name = setting
    for value in edges(setting):
        with np.errstate(all="ignore"):
            try:
                given: dict[str, Any] = {name: value}
                made = dataclasses.replace(SHORT, **given) if kind is RunSettings else kind(**given)
                run = simulate(paper, configured(kind, made))
            except RpctlError as error:
                assert "Traceback" not in str(error)
            else:
                assert np.isfinite(run.tau).all()


def test_what_the_solver_of_the_cost_refuses_names_the_weights(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object) -> None:
        raise ValueError("bad value")

    monkeypatch.setattr(constraints, "solve_discrete_are", fails)
    with pytest.raises(SolverError, match=r"weights of 300 for positions, 2 for rates and 0\.05"):
        constraints._cost_to_go(300.0, Weights(), 0.1)
