"""What the runs of a study follow from, as records of JSON: robot, experiment, versions."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from rpctl.errors import RpctlError
from rpctl.files.opening import read_input
from rpctl.simulation.config import config_tables
from rpctl.study.design import Design
from rpctl.study.distributions import distribution_table
from rpctl.study.experiment import Experiment
from rpctl.study.scatter import Scatter
from rpctl.study.versions import installed

DRAWN_BY = {"sobol": "SALib", "morris": "SALib"}  # other designs are NumPy's and SciPy's


def code_identity(design: Design) -> dict[str, str]:
    """Return the versions of what computes the runs of a design, and draws its points."""
    packages = ("scipy", *((DRAWN_BY[design.kind],) if design.kind in DRAWN_BY else ()))
    return {**installed(), **{name: version(name) for name in packages}}


def experiment_identity(experiment: Experiment, scatter: Scatter) -> dict[str, Any]:
    """Return what all runs have in common, and what differs between them.

    Args:
        experiment: What they have in common.
        scatter: What differs.
    """
    own = {
        item.name: getattr(experiment, item.name)
        for item in dataclasses.fields(experiment)
        if item.name not in ("config", "names", "reference")
    }
    pairs = zip(scatter.names, scatter.distributions, strict=True)
    return {
        **own,
        "config": config_tables(experiment.config),
        "reference": reference_digest(experiment.config.run.reference),
        "scatter": {name: distribution_table(each) for name, each in pairs},
    }


def reference_digest(reference: str) -> str | None:
    """Return the digest of a reference's file; None of a name."""
    try:
        return _digest(read_input(reference, "MAX_SHOWN_BYTES", "a reference"))
    except RpctlError:
        return None


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def plain_differences(there: Any, here: Any, label: str = "") -> list[str]:
    """Return where two records of JSON differ: ``seed: 1 there, 2 here``.

    Args:
        there: One record.
        here: The other.
        label: What they are part of.
    """
    if not (isinstance(there, Mapping) and isinstance(here, Mapping)):
        return [] if there == here else [f"{label}: {_short(there)} there, {_short(here)} here"]
    found = []
    for key in sorted({*there, *here}):
        inner = f"{label}.{key}" if label else key
        found += plain_differences(there.get(key), here.get(key), inner)
    return found


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
