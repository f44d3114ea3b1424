"""The runs of a study: they come back from a line and from a file as they were; damage is found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from rpctl import RpctlError
from rpctl.libraries import library
from rpctl.study import store
from rpctl.study.experiment import RunTable, join_tables
from rpctl.study.store import read_runs, record_of, table_of, write_runs

T = 3
DETAILS = {"study": "text", "identity": {"seed": 1}}


def rows(*numbers: int) -> RunTable:
    index = np.array(numbers, np.int64)
    series = (index[:, None] + np.arange(T) / 10.0).astype(np.float32)
    return RunTable(
        index,
        {"plant.delay": index / 7.0},
        {"rms": np.where(index % 5 == 3, np.inf, index**0.5)},
        {"error": np.where(index[:, None] == 3, np.float32(np.nan), series)},
        np.array([0.0, 0.1, 0.2]),
        tuple("tracked" if n % 2 else "away" for n in numbers),
        tuple(f"run {n}" for n in numbers),
    )


def written(folder: Path, table: RunTable) -> Path:
    path = folder / "runs.parquet"
    good = np.array([each == "tracked" for each in table.outcomes])
    write_runs(path, table, good, DETAILS, {"rms": "m"})
    return path


def assert_same(found: RunTable, expected: RunTable) -> None:
    np.testing.assert_array_equal(found.index, expected.index)
    np.testing.assert_array_equal(found.t, expected.t)
    for role in ("parameters", "merits", "series"):
        for name, column in getattr(expected, role).items():
            np.testing.assert_array_equal(getattr(found, role)[name], column)
    assert (found.outcomes, found.reasons) == (expected.outcomes, expected.reasons)


def test_rows_come_back_as_they_were(tmp_path: Path) -> None:
    table = rows(*range(9))
    assert_same(table_of(json.loads(json.dumps(record_of(table)))), table)
    found, details = read_runs(written(tmp_path, table))
    assert_same(found, table)
    assert found.series["error"].dtype == np.float32
    assert (details["study"], details["units"]["rms"]) == ("text", "m")
    assert details["identity"] == {"seed": 1}


def test_tables_are_joined_in_order_each_run_once() -> None:
    joined = join_tables([rows(5, 6, 7, 8), rows(0, 1, 2), rows(2, 3, 4, 5)], 8)
    assert_same(joined, rows(*range(8)))


def test_other_programs_read_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, rows(*range(2500)))
    table = library("pandas").read_parquet(path)
    assert table["success"].tolist() == [n % 2 == 1 for n in range(2500)]
    assert table["error"][4].tolist() == pytest.approx([4.0, 4.1, 4.2])
    found = pq.ParquetFile(path)
    assert found.schema_arrow.field("rms").metadata[b"unit"] == b"m"
    sizes = [found.metadata.row_group(k).num_rows for k in range(found.metadata.num_row_groups)]
    assert sizes == [1024, 1024, 452]


def test_what_is_no_file_of_runs_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, rows(*range(9)))
    data = path.read_bytes()
    column = pq.ParquetFile(path).metadata.row_group(0).column(0)
    inside = column.data_page_offset + column.total_compressed_size - 1
    flipped = data[:inside] + bytes([data[inside] ^ 1]) + data[inside + 1 :]
    for damaged in (data[:-9], flipped, b"PAR1 no"):
        path.write_bytes(damaged)
        with pytest.raises(RpctlError, match=r"is not a file of a study's runs: .*; remove it"):
            read_runs(path)
    library("pandas").DataFrame({"a": [1]}).to_parquet(path)
    with pytest.raises(RpctlError, match="is not a file of a study's runs"):
        read_runs(path)


def test_a_merit_that_was_changed_is_found_out(tmp_path: Path) -> None:
    """The file is whole by Parquet's own sums; the digest of its rows is another's."""
    path = written(tmp_path, rows(*range(9)))
    table = pq.read_table(path)
    for name in ("rms", "success", "outcome", "plant.delay", "error", "run"):
        values = table[name].to_pylist()
        values[2], values[3] = values[3], values[2]
        column = table.schema.get_field_index(name)
        changed = table.set_column(column, table.field(name), library("pyarrow").array(
            values, table.field(name).type))  # fmt: skip
        pq.write_table(changed, path)
        with pytest.raises(RpctlError, match="it was edited after it was written; remove it"):
            read_runs(path)
    pq.write_table(table, path)
    assert_same(read_runs(path)[0], rows(*range(9)))


def test_a_small_file_of_many_rows_is_refused_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows that are all alike take some bytes on disk, and eight a number in memory."""
    path, many = written(tmp_path, rows(0)), 2_000_000
    table = pq.read_table(path).take(np.zeros(many, np.int64))
    pq.write_table(table, path, compression="zstd")
    assert path.stat().st_size < 200_000
    monkeypatch.setenv("RPCTL_MAX_RUN_BYTES", str(50 * 2**20))
    monkeypatch.setattr(store, "_read", lambda path: pytest.fail("it was read"))
    with pytest.raises(RpctlError, match=r"its 2000000 runs take .* of memory; remove it if"):
        read_runs(path)


def test_columns_of_other_types_are_refused_before_they_are_read(tmp_path: Path) -> None:
    path = written(tmp_path, rows(0, 1))
    table = pq.read_table(path)
    nested = library("pyarrow").array([[[1.0]], [[2.0]]])
    pq.write_table(table.append_column("more", nested), path)
    with pytest.raises(RpctlError, match='its column "more" is of type list<'):
        read_runs(path)


@pytest.mark.parametrize("seed", range(40))
def test_a_damaged_file_is_named_or_unharmed(seed: int, tmp_path: Path) -> None:
    table, rng = rows(*range(9)), np.random.default_rng(seed)
    path = written(tmp_path, table)
    data = bytearray(path.read_bytes())
    if seed % 4 == 0:
        data = data[: int(rng.integers(len(data)))]
    for place in rng.integers(len(data), size=1 + seed % 3) if data else ():
        data[place] ^= int(rng.integers(1, 256))
    path.write_bytes(data)
    try:
        found, _ = read_runs(path)
    except RpctlError as error:
        assert str(error).startswith(f"{path}: ")
    else:
        assert_same(found, table)
