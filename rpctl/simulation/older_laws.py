"""Laws of older files: what the settings that they lack stood for when they were written.

A setting that a table leaves out has its default of today. Up to schema 5, laws had no leash, no
stage for far starts and no gains of the joints' own, M and h were those of the sample, and the
integral's gain was 10 1/s: their defaults would make an old run one that never was.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, get_type_hints

from rpctl.control.bounded import BoundedDynamic
from rpctl.control.end_effector import EndEffector
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.horizon.law import Horizon
from rpctl.control.integral import IntegralDynamic
from rpctl.control.kanayama import Kanayama
from rpctl.control.settings import REGISTRIES, Registry
from rpctl.control.unified import UnifiedKinematic
from rpctl.files.toml import Table
from rpctl.simulation.config import LAW_REGISTRIES

NO_STAGES = {"leash": False, "approach": False}  # as TOML says None
UP_TO_5: dict[object, Table] = {  # by law
    UnifiedKinematic: NO_STAGES,
    Kanayama: NO_STAGES,
    FeedbackLinearization: NO_STAGES,
    BoundedDynamic: {"midpoint": False},
    IntegralDynamic: {"inner": {}, "gain": 10.0},
    Horizon: {"fallback": {"law": "unified"}, "approach": False},
    EndEffector: {"base": {"law": "horizon"}},
}
JOINTS_AS_BASE = (  # the joints' own setting, and the base's that held for them too
    ("joint_horizon", "horizon"),
    ("joint_horizon_dyn", "horizon_dyn"),
    ("joint_gain", "gain"),
)
LAWS_UP_TO_5 = {"kinematic": {"law": "unified"}, "dynamic": {"law": "paper"}}  # if none is named


def tables_up_to_5(tables: Mapping[str, Any]) -> Table:
    """Return the tables of a configuration of schema 5 or less with all that they stood for.

    What is no table of a known law stays as it is.

    Args:
        tables: Of the configuration, as the file holds them, laws by their names of today.
    """
    tables = {**LAWS_UP_TO_5, **tables}
    laws = {key: _named(tables[key], kind) for key, kind in LAW_REGISTRIES.items()}
    return {**tables, **laws}


def _named(table: Any, registry: Registry) -> Any:
    """Return the table of a law that it names."""
    name = table.get(registry.key) if isinstance(table, Mapping) else None
    known = registry.factories.get(name) if isinstance(name, str) else None
    return table if known is None or "settings" in table else _completed(table, known)


def _completed(table: Mapping[str, Any], law: Callable[..., Any]) -> Table:
    """Return the table of a law, and those of the laws within it, with what they stood for."""
    found = {**UP_TO_5.get(law, {}), **table}
    if law in UP_TO_5:
        defaults = {item.name: item.default for item in dataclasses.fields(law)}  # type: ignore[arg-type]
        for own, base in JOINTS_AS_BASE:
            if own in defaults and base in defaults:
                found.setdefault(own, found.get(base, defaults[base]))
    for name, hint in get_type_hints(law).items():
        if name in found and hint in REGISTRIES:
            found[name] = _named(found[name], REGISTRIES[hint])
        elif hint in UP_TO_5 and isinstance(found.get(name), Mapping):
            found[name] = _completed(found[name], hint)
    return found
