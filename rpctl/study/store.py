"""The runs of a study on disk: parts while it runs, one Parquet file in the end."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.files.opening import read_input, read_text
from rpctl.files.writing import make_folder, write_atomically, writing
from rpctl.study.extras import arrow, parquet
from rpctl.study.identity import plain_differences

RUNS_FILE, IDENTITY_FILE, PART_FOLDER = "runs.parquet", "identity.json", "parts"
KEY = b"rpctl"  # of the metadata
FORMAT = 1
GROUP_ROWS = 1024  # rows of a row group: the file does not show how the runs were cut into chunks
RUN, OUTCOME, REASON, SUCCESS = "run", "outcome", "reason", "success"  # columns
Judge = Callable[[Mapping[str, Array], tuple[str, ...]], NDArray[np.bool_]]
WRITE = {"compression": "zstd", "write_page_checksum": True, "use_dictionary": [OUTCOME, REASON]}


@dataclass(frozen=True)
class RunTable:
    """Rows of a study, one a run.

    Attributes:
        index: Numbers of the runs (K,).
        parameters: Scattered values by name, (K,) each.
        merits: By name, (K,) each; inf where a run has none.
        series: Over time, by name, (K, T) float32 each; NaN where a run had ended.
        t: Times of the series (T,), s.
        outcomes: In a word, K of them.
        reasons: In a sentence, K of them.
    """

    index: NDArray[np.int64]
    parameters: Mapping[str, Array]
    merits: Mapping[str, Array]
    series: Mapping[str, NDArray[np.float32]]
    t: Array
    outcomes: tuple[str, ...]
    reasons: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True)
class Store:
    """A folder that holds the runs of one study.

    Attributes:
        folder: The folder.
        identity: What the runs follow from; a folder of another identity is refused.
        details: What else the file tells of itself: the study's text, instants of the series.
        units: By name of the column.
    """

    folder: Path
    identity: Mapping[str, Any]
    details: Mapping[str, Any] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def runs_file(self) -> Path:
        """The file of all runs."""
        return self.folder / RUNS_FILE

    def prepare(self, resume: bool) -> None:
        """Make the folder, or go on with it.

        Args:
            resume: Whether to go on with runs that are there; False refuses them.

        Raises:
            RpctlError: The folder holds a study and is not to be resumed, or it holds runs of
                another study, robot or version: the difference is named.
        """
        path = self.folder / IDENTITY_FILE
        known = _plain(self.identity)
        if path.exists():
            there = _read_identity(path)
            if not resume:
                raise RpctlError(
                    f"{self.folder}: holds a study; add --resume to go on with it, or give another "
                    "--out"
                )
            if found := plain_differences(there, known):
                raise RpctlError(
                    f"{self.folder}: holds runs of something else: {'; '.join(found[:5])}; give "
                    "another --out"
                )
            return
        make_folder(self.folder)
        text = json.dumps(known, indent=2)  # infinite ends of distributions stay
        write_atomically(path, (text + "\n").encode(), follow_links=False)

    def write(self, rows: RunTable) -> None:
        """Keep rows; the same rows again change nothing."""
        make_folder(self.folder / PART_FOLDER)
        sink = arrow().BufferOutputStream()
        parquet().write_table(self._table(rows), sink, **WRITE)
        data = sink.getvalue().to_pybytes()
        name = f"part-{rows.index[0]:09d}-{rows.index[-1]:09d}-{_digest(data)}.parquet"
        write_atomically(self.folder / PART_FOLDER / name, data, follow_links=False)

    def done(self) -> NDArray[np.int64]:
        """Return the numbers of the runs that are kept, in order; torn parts are removed."""
        found = [np.zeros(0, np.int64)]
        for path in self._parts():
            if path != self.runs_file and _digest(_bytes(path)) not in path.name:
                path.unlink(missing_ok=True)  # torn: its runs are done again
                continue
            try:
                found.append(np.asarray(_read(path)[RUN]))
            except (OSError, ValueError, KeyError):
                raise RpctlError(
                    f"{path}: is damaged; remove it, and its runs are done again"
                ) from None
        return np.unique(np.concatenate(found))

    def merge(self, count: int, judge: Judge) -> Path:
        """Write all runs to one file, in order, and remove the parts.

        Args:
            count: How many runs there are: 0 to count − 1.
            judge: Returns which runs succeeded, from their merits and outcomes.

        Raises:
            RpctlError: Runs lack.
        """
        path = self.runs_file
        tables = (_judged(table, judge) for table in self._rows_in_order(count))
        with writing(path, follow_links=False) as file:
            rows = _write_groups(_groups(tables), file)
            if rows != count:
                raise RpctlError(f"{self.folder}: {rows} of {count} runs are there; add --resume")
        for part in self._parts():
            if part != path:
                part.unlink(missing_ok=True)
        with suppress(OSError):
            (self.folder / PART_FOLDER).rmdir()
        return path

    def _parts(self) -> list[Path]:
        """Return the files that hold runs, those of the first runs first."""
        parts = sorted((self.folder / PART_FOLDER).glob("part-*.parquet"))
        return [self.runs_file, *parts] if self.runs_file.exists() else parts

    def _rows_in_order(self, count: int) -> Iterator[Any]:
        """Yield tables of runs that follow each other, each run once, with this store's schema."""
        following = 0
        for path in self._parts():
            table = _read(path)
            index = np.asarray(table[RUN])
            wanted = np.flatnonzero((index >= following) & (index < count))
            if len(wanted):
                following = int(index[wanted[-1]]) + 1
                t = json.loads(table.schema.metadata[KEY])["t"]
                yield table.take(wanted).replace_schema_metadata(self._metadata(t))

    def _table(self, rows: RunTable) -> Any:
        """Return rows as a table of Arrow."""
        pa = arrow()
        columns: list[tuple[str, str, Any]] = [(RUN, "run", pa.array(rows.index, pa.int64()))]
        for role, named in (("parameter", rows.parameters), ("merit", rows.merits)):
            columns += [(name, role, pa.array(each, pa.float64())) for name, each in named.items()]
        columns.append((OUTCOME, "outcome", pa.array(rows.outcomes, pa.string())))
        columns.append((REASON, "outcome", pa.array(rows.reasons, pa.string())))
        columns += [(name, "series", _lists(each)) for name, each in rows.series.items()]
        fields = [
            pa.field(name, each.type, metadata={"role": role, "unit": self.units.get(name, "")})
            for name, role, each in columns
        ]
        schema = pa.schema(fields, metadata=self._metadata(rows.t.tolist()))
        return pa.Table.from_arrays([each for _, _, each in columns], schema=schema)

    def _metadata(self, t: list[float]) -> dict[bytes, bytes]:
        content = {"format": FORMAT, "identity": self.identity, **self.details, "t": t}
        return {KEY: json.dumps(_plain(content)).encode()}


def read_runs(path: Path) -> tuple[RunTable, dict[str, Any]]:
    """Return the runs of a study's file, and what it tells of itself.

    Args:
        path: The file.

    Raises:
        RpctlError: It is no such file.
    """
    try:
        table = _read(path)
        details = json.loads(table.schema.metadata[KEY])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RpctlError(f"{path}: is no file of a study's runs: {error}") from None
    if details.get("format") != FORMAT:
        raise RpctlError(f"{path}: has format {details.get('format')}; this rpctl reads {FORMAT}")
    found: dict[str, dict[str, Any]] = {"parameter": {}, "merit": {}, "series": {}}
    details["units"] = {}
    for item in table.schema:
        role = item.metadata[b"role"].decode()
        details["units"][item.name] = item.metadata[b"unit"].decode()
        if role == "series":
            column = table[item.name].combine_chunks()
            found[role][item.name] = np.asarray(column.flatten()).reshape(len(table), -1)
        elif role in found:
            found[role][item.name] = np.asarray(table[item.name])
    index = np.asarray(table[RUN])
    outcomes, reasons = (tuple(table[name].to_pylist()) for name in (OUTCOME, REASON))
    t = np.array(details["t"], float)
    runs = RunTable(
        index, found["parameter"], found["merit"], found["series"], t, outcomes, reasons
    )
    return runs, details


def _write_groups(groups: Iterator[Any], file: BinaryIO) -> int:
    """Write groups of rows to a file; return how many rows they have."""
    rows = 0
    for first in groups:  # its schema is that of all
        with parquet().ParquetWriter(file, first.schema, **WRITE) as writer:
            for group in chain([first], groups):
                writer.write_table(group)
                rows += len(group)
    return rows


def _groups(tables: Iterable[Any]) -> Iterator[Any]:
    """Yield the rows of tables in groups of the same size, but for the last."""
    waiting: list[Any] = []
    for table in tables:
        waiting.append(table)
        while sum(map(len, waiting)) >= GROUP_ROWS:
            joined = arrow().concat_tables(waiting)
            yield joined.slice(0, GROUP_ROWS).combine_chunks()
            waiting = [joined.slice(GROUP_ROWS)]
    if sum(map(len, waiting)):
        yield arrow().concat_tables(waiting).combine_chunks()


def _judged(table: Any, judge: Judge) -> Any:
    """Return a table with a column that tells which runs succeeded, in the place of any before."""
    pa = arrow()
    if SUCCESS in table.column_names:
        table = table.drop_columns([SUCCESS])
    names = [item.name for item in table.schema if item.metadata[b"role"] == b"merit"]
    merits = {name: np.asarray(table[name]) for name in names}
    found = judge(merits, tuple(table[OUTCOME].to_pylist()))
    item = pa.field(SUCCESS, pa.bool_(), metadata={"role": "outcome", "unit": ""})
    return table.add_column(table.column_names.index(OUTCOME), item, pa.array(found))


def _read_identity(path: Path) -> Any:
    try:
        return json.loads(read_text(path, "MAX_TOML_BYTES", "a study's identity"))
    except (RpctlError, ValueError):
        raise RpctlError(f"{path}: cannot be read; give another --out") from None


def _read(path: Path) -> Any:
    """Return a table of a file; its checksums are verified.

    Raises:
        OSError, ValueError: It is torn, or not Parquet.
    """
    return parquet().read_table(
        path, page_checksum_verification=True, partitioning=None, use_threads=False
    )


def _bytes(path: Path) -> bytes:
    return read_input(path, "MAX_SHOWN_BYTES", "a part of a study")


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def _lists(values: NDArray[np.float32]) -> Any:
    """Return an array (K, T) as a column of lists."""
    pa = arrow()
    flat = pa.array(np.ascontiguousarray(values, np.float32).ravel(), pa.float32())
    return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def _plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record as JSON reads it again."""
    return dict(json.loads(json.dumps(value)))


def chunks_of(missing: Sequence[int] | NDArray[np.int64], size: int) -> Iterator[NDArray[np.int64]]:
    """Yield rows that lack in chunks of rows that follow each other, at most ``size`` each.

    Args:
        missing: Numbers of rows, in order.
        size: The most in a chunk.
    """
    rows = np.asarray(missing, np.int64)
    for stretch in np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1):
        for first in range(0, len(stretch), size):
            yield stretch[first : first + size]
