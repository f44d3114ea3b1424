"""The configuration in a run's file: a configuration file's tables, and laws without a name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, get_args, get_origin, get_type_hints

from rpctl.control.settings import (
    DYNAMIC_REGISTRY,
    KINEMATIC_REGISTRY,
    OBSTACLE_REGISTRY,
    REGISTRIES,
    Registry,
    named_from_table,
    named_to_table,
)
from rpctl.control.unregistered import Unregistered, from_json, name_of, unregistered
from rpctl.errors import RpctlError
from rpctl.files.toml import Table
from rpctl.simulation.config import LAW_REGISTRIES, Config, config_from_tables
from rpctl.simulation.periods import delay_periods
from rpctl.simulation.plant import Plant

BIAS_KEY = "bias of "  # and an actuator: what older files call a bias of the efforts


def recorded(config: Config, periods: int) -> Config:
    """Return a configuration as a run keeps it: as it was simulated, and what a file can hold.

    Args:
        config: What was asked for.
        periods: Number of control periods that were simulated.
    """
    run, plant = config.run, config.plant
    x1, x2, x3 = map(float, run.initial_error)
    delay = delay_periods(plant.delay, run.control_period) * run.control_period
    return dataclasses.replace(
        config,
        kinematic=recordable(config.kinematic, KINEMATIC_REGISTRY),
        dynamic=recordable(config.dynamic, DYNAMIC_REGISTRY),
        run=dataclasses.replace(
            run, duration=periods * run.control_period, initial_error=(x1, x2, x3)
        ),
        plant=_recorded_plant(plant, delay),
    )


def _recorded_plant(plant: Plant, delay: float) -> Plant:
    """Return a plant as a run keeps it, with the delay (s) that was simulated."""
    kind = plant.kind if plant.own is None else "own"
    return dataclasses.replace(plant, kind=kind, delay=delay, controller_model=None, own=None)


def recordable(law: Any, kind: Registry) -> Any:
    """Return a law as a run keeps it: what a file cannot name, in it or itself, is unregistered.

    Args:
        law: A law, or an obstacle of one.
        kind: Which of them it is.
    """
    if type(law) not in kind.factories.values():
        return unregistered(law)
    changes: dict[str, object] = {}
    for name, hint in get_type_hints(type(law)).items():
        value = getattr(law, name)
        if hint in REGISTRIES:
            changes[name] = recordable(value, REGISTRIES[hint])
        elif get_origin(hint) is tuple and get_args(hint)[0] in REGISTRIES:
            changes[name] = tuple(recordable(v, REGISTRIES[get_args(hint)[0]]) for v in value)
    try:
        found = dataclasses.replace(law, **changes)
        named_to_table(found, kind)
    except RpctlError:  # a setting that no file can say
        return unregistered(law)
    return found


def config_of(tables: Mapping[str, Any]) -> Config:
    """Return the configuration that a run's file holds.

    Raises:
        RpctlError: The tables are none of a configuration.
    """
    faults: list[str] = []
    rest = {key: table for key, table in tables.items() if key not in LAW_REGISTRIES}
    config = config_from_tables(rest, faults)
    if faults:
        raise RpctlError("; ".join(faults))
    laws: dict[str, Any] = {
        key: _law_of(tables[key], kind, key)
        for key, kind in LAW_REGISTRIES.items()
        if key in tables
    }
    return dataclasses.replace(config, **laws)


def _law_of(table: Table, kind: Registry, key: str) -> Any:
    """Return a law; unregistered where this version does not know it or a setting of it."""
    faults: list[str] = []
    law = named_from_table(_with_unregistered(table), kind, key, faults)
    if not faults:
        return law
    found: Unregistered = from_json(table)
    known = kind.factories.get(found.name)
    return found if known is None else dataclasses.replace(found, name=name_of(known))


def _with_unregistered(value: Any) -> Any:
    """Return a table in which the tables of laws and obstacles without a name are replaced."""
    if isinstance(value, list):
        return [_with_unregistered(each) for each in value]
    if not isinstance(value, Mapping):
        return value
    for kind in (OBSTACLE_REGISTRY, KINEMATIC_REGISTRY):
        name = value.get(kind.key)
        known = any(name in each.factories for each in REGISTRIES.values())
        if isinstance(name, str) and ("settings" in value or not known):
            return from_json(value)
    return {key: _with_unregistered(each) for key, each in value.items()}


def tables_of_settings(settings: Mapping[str, Any], friction: float) -> Table:
    """Return the tables of a configuration from the settings that older files hold.

    They hold laws and obstacles by the names of their classes, and None where there is nothing.

    Args:
        settings: Of a file of schema 2 or 3.
        friction: Coefficient between wheels and ground, which stands elsewhere in it.
    """
    names = ("reference", "duration", "initial_error", "control_period", "plant_step")
    run = {name: settings[name] for name in names if settings.get(name) is not None}
    plant = settings.get("plant", {})
    biases = {
        key.removeprefix(BIAS_KEY): bias for key, bias in plant.items() if key.startswith(BIAS_KEY)
    }
    laws = {key: _with_names(settings[key]) for key in LAW_REGISTRIES if key in settings}
    return {
        **laws,
        "run": {**run, "friction": friction},
        "plant": {"tau_bias": biases, "delay": plant.get("delay", 0.0)},
    }


def _with_names(value: Any, hint: object = None) -> Any:
    """Return an older table of a law with the names of today instead of those of classes.

    Args:
        value: Of a setting, or the table of a law or an obstacle.
        hint: Type of the setting, if its law is known; a class there needs no name.
    """
    if isinstance(value, list):
        hint = get_args(hint)[0] if get_origin(hint) is tuple else None
        return [_with_names(each, hint) for each in value]
    if not isinstance(value, Mapping) or not isinstance(value.get("law"), str):
        return value
    head, kind = _name_today(value["law"], hint)
    hints = {} if kind is None else get_type_hints(kind)
    settings = {
        key: _with_names(each, hints.get(key))
        for key, each in value.items()
        if key != "law" and each is not None
    }
    return {**head, "settings": settings} if kind is None else {**head, **settings}


def _name_today(class_name: str, hint: object) -> tuple[dict[str, str], type | None]:
    """Return how a table names a class today, and the class if it is known."""
    if isinstance(hint, type) and dataclasses.is_dataclass(hint) and hint.__name__ == class_name:
        return {}, hint
    for registry in (KINEMATIC_REGISTRY, DYNAMIC_REGISTRY, OBSTACLE_REGISTRY):
        for today, known in registry.factories.items():
            if isinstance(known, type) and known.__name__ == class_name:
                return {registry.key: today}, known
    return {"law": class_name}, None
