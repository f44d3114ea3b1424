"""The runs of a study on disk: lines of a journal while it runs, one Parquet file in the end."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError, one_line
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.writing import writing
from rpctl.simulation.loop.budget import in_bytes
from rpctl.study.design import extra
from rpctl.study.experiment import RunTable

RUNS_FILE = "runs.parquet"
SERIES_TYPES = ("fixed_size_list<item: float>", "fixed_size_list<element: float>")
TYPES = ("int64", "double", "bool", "string", *SERIES_TYPES)
KEY = b"rpctl"  # of the metadata
FORMAT = 1
DIGEST = "sha256"  # of the rows, among what the file tells of itself
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
            f"{path}: is no file of a study's runs: {one_line(str(error))}; remove it, and they "
            "are done again"
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
            f"{path}: its {told.num_rows} runs take {in_bytes(size)} of memory; remove it if it is "
            f"no study of yours, or {how_to_raise('MAX_RUN_BYTES')}"
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
        raise ValueError("it was changed after it was written")
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
