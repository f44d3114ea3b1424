"""What the runs of a study follow from, as records of JSON: robot, experiment, versions."""

from __future__ import annotations

import dataclasses
import sys
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rpctl.control.registry import own_digests
from rpctl.errors import RpctlError
from rpctl.files.opening import read_input
from rpctl.files.records import to_plain
from rpctl.study.design import Design
from rpctl.study.distributions import distribution_table
from rpctl.study.experiment import Experiment
from rpctl.study.scatter import Scatter

PACKAGES = ("rpctl", "numpy", "pin", "casadi", "llvmlite")  # that results depend on
DRAWN_BY = {"sobol": "SALib", "morris": "SALib"}  # other designs are NumPy's and SciPy's
PYTHON, CODE = "python", "rpctl's code"
ABSENT = "none"
DIGITS = 12  # of a digest: enough to tell two checkouts apart


@lru_cache(maxsize=1)
def installed() -> dict[str, str]:
    """Return what this process computes with, by name; as it was when it was first asked."""
    return {
        PYTHON: f"{sys.version_info.major}.{sys.version_info.minor}",
        **{package: _version(package) for package in PACKAGES},
        CODE: code_digest(),
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ABSENT


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Return a digest of rpctl's modules: two checkouts of one version may differ."""
    package, digest = Path(__file__).parents[1], sha256()
    for path in sorted(package.rglob("*.py")):
        data = path.read_bytes()
        digest.update(f"{path.relative_to(package).as_posix()} {len(data)} ".encode())
        digest.update(data)
    return digest.hexdigest()[:DIGITS]


def code_identity(design: Design) -> dict[str, str]:
    """Return the versions of what computes the runs of a design, and draws its points."""
    packages = ("scipy", *((DRAWN_BY[design.kind],) if design.kind in DRAWN_BY else ()))
    return {**installed(), **{name: version(name) for name in packages}}


def experiment_identity(experiment: Experiment, scatter: Scatter) -> dict[str, Any]:
    """Return what all runs have in common, and what differs between them."""
    own = {
        item.name: getattr(experiment, item.name)
        for item in dataclasses.fields(experiment)
        if item.name not in ("config", "names", "reference")
    }
    return {
        **own,
        "config": to_plain(experiment.config),
        "reference": reference_digest(experiment.config.run.reference),
        "own laws": own_digests(experiment.config.kinematic),
        "scatter": {n: distribution_table(each) for n, each in scatter.distributions.items()},
    }


def reference_digest(reference: str) -> str | None:
    """Return the digest of a reference's file; None of a name."""
    try:
        return sha256(read_input(reference, "MAX_SHOWN_BYTES", "a reference")).hexdigest()[:16]
    except RpctlError:
        return None
