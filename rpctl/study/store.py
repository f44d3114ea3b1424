"""The runs of a study on disk: lines of a journal while it runs, one Parquet file in the end."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.writing import writing
from rpctl.study.design import extra
from rpctl.study.experiment import RunTable

RUNS_FILE = "runs.parquet"
KEY = b"rpctl"  # of the metadata
FORMAT = 1
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
    content = {"format": FORMAT, **details, "t": table.t.tolist()}
    schema = pa.schema(fields, metadata={KEY: json.dumps(content).encode()})
    arrow = pa.Table.from_arrays([each for _, _, each in columns], schema=schema)
    with writing(path, follow_links=False) as file:
        extra("pyarrow.parquet").write_table(arrow, file, row_group_size=GROUP_ROWS, **WRITE)


def read_runs(path: Path) -> tuple[RunTable, dict[str, Any]]:
    """Return the runs of a study's file, and what it tells of itself; checksums are verified.

    Raises:
        RpctlError: It is no such file, or it is damaged.
    """
    try:
        table = extra("pyarrow.parquet").read_table(
            path, page_checksum_verification=True, partitioning=None, use_threads=False
        )
        details = json.loads(table.schema.metadata[KEY])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RpctlError(
            f"{path}: is no file of a study's runs: {error}; remove it, and they are done again"
        ) from None
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
            columns[role][item.name] = np.asarray(table[item.name])
    runs = RunTable(
        np.asarray(table[RUN]),
        columns["parameter"],
        columns["merit"],
        columns["series"],
        np.array(details["t"], float),
        *(tuple(table[name].to_pylist()) for name in (OUTCOME, REASON)),
    )
    return runs, details
