"""The runs of a study on disk, and what they follow from.

A journal has one line of JSON for each piece of work, written when it has ended. The first line
says what the others follow from: robot, experiment, versions. A line that a crash or a full disk
cut off, or that has changed since, is not what its digest says: what it stood for is done again.
In the end all runs are one Parquet file.
"""

from __future__ import annotations

import base64
import dataclasses
import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.registry import own_digests
from rpctl.errors import RpctlError, one_line
from rpctl.files.caps import cap, how_to_raise, open_input, read_input
from rpctl.files.records import to_plain
from rpctl.files.strict_json import read_json
from rpctl.files.writing import make_folder, write_atomically, writing
from rpctl.robot.inspection import robot_identity
from rpctl.robot.model import Robot
from rpctl.simulation.loop.budget import in_bytes
from rpctl.study.experiment import Design, Experiment, RunTable, extra
from rpctl.study.scatter import Scatter, distribution_table

DIGEST = "sha256"  # of the rest of a line, or of all rows
MOST_SHOWN = 5  # differences that a message names
PACKAGES = ("rpctl", "numpy", "pin", "casadi", "llvmlite")  # that results depend on
DRAWN_BY = {"sobol": ("SALib",), "morris": ("SALib",)}  # other designs are NumPy's and SciPy's
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
                f"{folder}: holds {self.work}; add --resume to continue {self.pronoun}, or give "
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


def identity(
    robot: Robot, experiment: Experiment, scatter: Scatter, design: Design
) -> dict[str, Any]:
    """Return what the runs of an experiment follow from, at the points of a design."""
    drawn_by = ("scipy", *DRAWN_BY.get(design.kind, ()))
    return {
        "robot": robot_identity(robot),
        "experiment": experiment_identity(experiment, scatter),
        "versions": {**installed(), **{name: version(name) for name in drawn_by}},
    }


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


# ---- all runs in one Parquet file ---------------------------------------------------------

RUNS_FILE = "runs.parquet"
TYPES = (  # of columns; the last two are the same of two releases of pyarrow
    "int64", "double", "bool", "string", "fixed_size_list<item: float>",
    "fixed_size_list<element: float>",
)  # fmt: skip
KEY = b"rpctl"  # of the metadata
FORMAT = 1
DAMAGED = (
    OSError, ValueError, LookupError, TypeError, AttributeError, NotImplementedError, MemoryError
)  # fmt: skip
GROUP_ROWS = 1024  # rows of a row group
RUN, OUTCOME, REASON, SUCCESS = "run", "outcome", "reason", "success"  # columns
WRITE = {"compression": "zstd", "write_page_checksum": True, "use_dictionary": [OUTCOME, REASON]}


def record_of(table: RunTable) -> dict[str, Any]:
    """Return rows as JSON holds them; see :func:`table_of`."""
    return {
        "runs": table.index.tolist(),
        "parameters": {name: each.tolist() for name, each in table.parameters.items()},
        "merits": {name: each.tolist() for name, each in table.merits.items()},
        "series": {
            name: base64.b64encode(each.astype(np.float32).tobytes()).decode()
            for name, each in table.series.items()
        },
        "t": table.t.tolist(),
        "outcomes": table.outcomes,
        "reasons": table.reasons,
    }


def table_of(record: Mapping[str, Any]) -> RunTable:
    """Return the rows of a journal's record."""
    index = np.array(record["runs"], np.int64)
    series = {
        name: np.frombuffer(base64.b64decode(each), np.float32).reshape(len(index), -1)
        for name, each in record["series"].items()
    }
    return RunTable(
        index,
        {name: np.array(each, float) for name, each in record["parameters"].items()},
        {name: np.array(each, float) for name, each in record["merits"].items()},
        series,
        np.array(record["t"], float),
        tuple(record["outcomes"]),
        tuple(record["reasons"]),
    )


def write_runs(
    path: Path,
    table: RunTable,
    succeeded: NDArray[np.bool_],
    details: Mapping[str, Any],
    units: Mapping[str, str],
) -> None:
    """Write all runs to one file.

    Args:
        path: The file.
        table: The runs, in order.
        succeeded: Which of them (K,) did.
        details: What else the file tells of itself, as JSON.
        units: By name of the column.
    """
    pa = extra("pyarrow")
    columns: list[tuple[str, str, Any]] = [(RUN, "run", pa.array(table.index, pa.int64()))]
    for role, named in (("parameter", table.parameters), ("merit", table.merits)):
        columns += [(name, role, pa.array(each, pa.float64())) for name, each in named.items()]
    columns.append((SUCCESS, "outcome", pa.array(succeeded)))
    columns.append((OUTCOME, "outcome", pa.array(table.outcomes, pa.string())))
    columns.append((REASON, "outcome", pa.array(table.reasons, pa.string())))
    for name, each in table.series.items():
        flat = pa.array(np.ascontiguousarray(each, np.float32).ravel(), pa.float32())
        columns.append((name, "series", pa.FixedSizeListArray.from_arrays(flat, each.shape[1])))
    fields = [
        pa.field(name, each.type, metadata={"role": role, "unit": units.get(name, "")})
        for name, role, each in columns
    ]
    content = {"format": FORMAT, **details, "t": table.t.tolist(), DIGEST: digest(table, succeeded)}
    schema = pa.schema(fields, metadata={KEY: json.dumps(content).encode()})
    arrow = pa.Table.from_arrays([each for _, _, each in columns], schema=schema)
    with writing(path, follow_links=False) as file:
        extra("pyarrow.parquet").write_table(arrow, file, row_group_size=GROUP_ROWS, **WRITE)


def read_runs(path: Path) -> tuple[RunTable, dict[str, Any]]:
    """Return the runs of a study's file, and what it tells of itself.

    What it would take is known before it is read; checksums and its digest are verified.

    Raises:
        RpctlError: It is no such file, it is damaged, was changed, or takes too much memory.
    """
    try:
        _require_small(path)
        return _read(path)
    except DAMAGED as error:
        raise RpctlError(
            f"{path}: is not a file of a study's runs: {one_line(str(error))}; remove it, and "
            "rpctl repeats the runs"
        ) from None


def _require_small(path: Path) -> None:
    """Refuse a file whose rows would take too much memory; nothing of them is read.

    Raises:
        RpctlError: They would.
    """
    file = extra("pyarrow.parquet").ParquetFile(path)
    told, width = file.metadata, 0
    for each in file.schema_arrow:
        if str(each.type).partition("[")[0] not in TYPES:
            raise ValueError(f'its column "{each.name}" is of type {each.type}')
        width += 8 * getattr(each.type, "list_size", 1)
    pages = sum(told.row_group(k).total_byte_size for k in range(told.num_row_groups))
    size = max(told.num_rows * width, pages)
    if size > cap("MAX_RUN_BYTES"):
        raise RpctlError(
            f"{path}: its {told.num_rows} runs take {in_bytes(size)} of memory; remove it if it "
            f"is not a study of yours, or {how_to_raise('MAX_RUN_BYTES')}"
        )


def _read(path: Path) -> tuple[RunTable, dict[str, Any]]:
    # A text that many rows share is read once.
    table = extra("pyarrow.parquet").read_table(
        path,
        page_checksum_verification=True,
        partitioning=None,
        use_threads=False,
        read_dictionary=[OUTCOME, REASON],
    )
    details = json.loads(table.schema.metadata[KEY])
    if details.get("format") != FORMAT:
        raise RpctlError(f"{path}: has format {details.get('format')}; this rpctl reads {FORMAT}")
    columns: dict[str, dict[str, Array]] = {"parameter": {}, "merit": {}, "series": {}}
    details["units"] = {}
    for item in table.schema:
        role = item.metadata[b"role"].decode()
        details["units"][item.name] = item.metadata[b"unit"].decode()
        if role == "series":
            column = table[item.name].combine_chunks()
            columns[role][item.name] = np.asarray(column.flatten()).reshape(len(table), -1)
        elif role in columns:
            columns[role][item.name] = np.asarray(table[item.name], float)
    runs = RunTable(
        np.asarray(table[RUN], np.int64),
        columns["parameter"],
        columns["merit"],
        columns["series"],
        np.array(details["t"], float),
        *(_texts(table[name]) for name in (OUTCOME, REASON)),
    )
    if details.pop(DIGEST) != digest(runs, np.asarray(table[SUCCESS])):
        raise ValueError("it was edited after it was written")
    return runs, details


def _texts(column: Any) -> tuple[str, ...]:
    """Return the texts of a column that is read as a dictionary."""
    whole = column.combine_chunks()
    known = [str(each) for each in whole.dictionary.to_pylist()]
    return tuple(known[k] for k in whole.indices.to_pylist())


def digest(table: RunTable, succeeded: NDArray[np.bool_]) -> str:
    """Return a digest of all rows: who changes one and not the digest is found out."""
    found = sha256()
    columns = {**table.parameters, **table.merits, **table.series}
    for name, each in {**columns, RUN: table.index, SUCCESS: succeeded, "t": table.t}.items():
        stored = np.asarray(each, np.float32 if name in table.series else float)
        found.update(f"{name} {stored.shape} ".encode() + stored.tobytes())
    found.update(json.dumps([table.outcomes, table.reasons]).encode())
    return found.hexdigest()
