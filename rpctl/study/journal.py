"""What long work has done so far, in a folder, and what it follows from.

A journal has one line of JSON for each piece of work, written when it has ended. The first line
says what the others follow from: robot, experiment, versions. A line that a crash or a full disk
cut off, or that has changed since, is not what its digest says: what it stood for is done again.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from rpctl.control.registry import own_digests
from rpctl.errors import RpctlError
from rpctl.files.opening import open_input, read_input
from rpctl.files.records import to_plain
from rpctl.files.strict_json import read_json
from rpctl.files.writing import make_folder, write_atomically
from rpctl.study.design import Design
from rpctl.study.experiment import Experiment
from rpctl.study.scatter import Scatter, distribution_table

DIGEST = "sha256"  # of the rest of a line
MOST_SHOWN = 5  # differences that a message names
PACKAGES = ("rpctl", "numpy", "pin", "casadi", "llvmlite")  # that results depend on
DRAWN_BY = {"sobol": "SALib", "morris": "SALib"}  # other designs are NumPy's and SciPy's
PYTHON, CODE = "python", "rpctl's code"
DIGITS = 12  # of a digest: enough to tell two checkouts apart

Record = dict[str, Any]


class Journal(NamedTuple):
    """The journal of some work.

    Attributes:
        path: The file.
        identity: What the records follow from; a journal of another identity is refused.
        work: What it is of, in words: ``"a study"``.
    """

    path: Path
    identity: Mapping[str, Any]
    work: str
    pronoun: str = "it"

    def begin(self, resume: bool) -> list[Record]:
        """Make the file, or go on with it; return the records that it holds.

        Raises:
            RpctlError: There are records and they are not to be resumed, or they are of something
                else: the difference is named.
        """
        make_folder(self.path.parent)
        if not self.path.exists():
            self.rewrite([])
            return []
        there, *records = [*self._records()] or [{}]
        self.require_same(there, resume)
        self.rewrite(records)  # without what was torn
        return records

    def require_same(self, there: Mapping[str, Any], resume: bool) -> None:
        """Refuse to go on with records of another identity, or if nobody has asked for it.

        Raises:
            RpctlError: The difference is named.
        """
        folder = self.path.parent
        if not resume:
            raise RpctlError(
                f"{folder}: holds {self.work}; add --resume to go on with {self.pronoun}, or give "
                "another --out"
            )
        differences = [*plain_differences(there, json.loads(json.dumps(self.identity)))]
        if differences:
            raise RpctlError(
                f"{folder}: holds runs of something else: {'; '.join(differences[:MOST_SHOWN])}; "
                "give another --out"
            )

    def add(self, record: Mapping[str, Any]) -> None:
        """Keep a record."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(_line(record))

    def rewrite(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Write other records in the place of those that are there."""
        lines = map(_line, (self.identity, *records))
        write_atomically(self.path, "".join(lines).encode(), follow_links=False)

    def _records(self) -> Iterator[Record]:
        """Yield what the lines say that are whole."""
        with open_input(self.path, "MAX_SHOWN_BYTES", "a journal of runs") as file:
            for line in file:
                try:
                    record = read_json(line.decode())
                    whole = record.pop(DIGEST) == _digest(json.dumps(record))
                except (ValueError, KeyError, AttributeError, TypeError):
                    continue
                if whole:
                    yield record


def _line(record: Mapping[str, Any]) -> str:
    return json.dumps({**record, DIGEST: _digest(json.dumps(record))}) + "\n"


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()[:16]


def plain_differences(there: Any, here: Any, label: str = "") -> Iterator[str]:
    """Yield where two records of JSON differ: ``seed: 1 there, 2 here``."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for key in sorted({*there, *here}):
            inner = f"{label}.{key}" if label else key
            yield from plain_differences(there.get(key), here.get(key), inner)
    elif there != here:
        yield f"{label}: {_short(there)} there, {_short(here)} here"


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


# ---- what work follows from ---------------------------------------------------------------


@cache
def installed() -> dict[str, str]:
    """Return what this process computes with, by name; as it was when it was first asked."""
    return {
        PYTHON: f"{sys.version_info.major}.{sys.version_info.minor}",
        **{package: version(package) for package in PACKAGES},
        CODE: _code_digest(),
    }


def _code_digest() -> str:
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
