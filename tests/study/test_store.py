"""The store: rows come back as they were, in order, whatever the chunks; damage is found."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from rpctl import RpctlError
from rpctl.arrays import Array
from rpctl.libraries import library
from rpctl.study.store import RunTable, Store, chunks_of, read_runs

T = 3
IDENTITY: dict[str, Any] = {"robot": {"name": "r2"}, "seed": 1}


def rows(*numbers: int) -> RunTable:
    index = np.array(numbers, np.int64)
    return RunTable(
        index,
        {"plant.delay": index / 7.0},
        {"rms": np.where(index % 5 == 3, np.inf, index**0.5)},
        {"error": (index[:, None] + np.arange(T) / 10.0).astype(np.float32)},
        np.array([0.0, 0.1, 0.2]),
        tuple("tracked" if n % 2 else "away" for n in numbers),
        tuple(f"run {n}" for n in numbers),
    )


def judge(merits: Any, outcomes: tuple[str, ...]) -> Any:
    return (merits["rms"] < 2.0) & np.array([each == "tracked" for each in outcomes])


def store(folder: Path, **changes: Any) -> Store:
    made = Store(folder / "out", {**IDENTITY, **changes}, {"study": "text"}, {"rms": "m"})
    made.prepare(resume=folder.joinpath("out").exists())
    return made


def written(folder: Path, *groups: range) -> bytes:
    made = store(folder)
    for group in groups:
        made.write(rows(*group))
    return made.merge(9, judge).read_bytes()


def test_rows_come_back_as_they_were(tmp_path: Path) -> None:
    written(tmp_path, range(5, 9), range(5))
    found, details = read_runs(tmp_path / "out" / "runs.parquet")
    expected = rows(*range(9))
    np.testing.assert_array_equal(found.index, expected.index)
    for role in ("parameters", "merits", "series"):
        for name, column in getattr(expected, role).items():
            np.testing.assert_array_equal(getattr(found, role)[name], column)
    assert found.series["error"].dtype == np.float32
    assert (found.outcomes, found.reasons) == (expected.outcomes, expected.reasons)
    np.testing.assert_array_equal(found.t, expected.t)
    assert (details["study"], details["units"]["rms"]) == ("text", "m")
    assert details["identity"] == IDENTITY
    assert not (tmp_path / "out" / "parts").exists()


def test_other_programs_read_the_file(tmp_path: Path) -> None:
    written(tmp_path, range(9))
    table = library("pandas").read_parquet(tmp_path / "out" / "runs.parquet")
    assert table["success"].tolist() == [n % 2 == 1 and n < 4 and n != 3 for n in range(9)]
    assert table["error"][4].tolist() == pytest.approx([4.0, 4.1, 4.2])
    schema = pq.read_schema(tmp_path / "out" / "runs.parquet")
    assert schema.field("rms").metadata[b"unit"] == b"m"


def test_the_file_does_not_show_the_chunks(tmp_path: Path) -> None:
    groups = (range(3), range(3, 4), range(4, 9))
    files = [
        written(tmp_path / str(k), *order)
        for k, order in enumerate([*itertools.permutations(groups), (range(9),)])
        if not (tmp_path / str(k)).mkdir()  # type: ignore[func-returns-value]
    ]
    assert len(files) == 7
    assert len(set(files)) == 1


def test_large_files_have_groups_of_one_size(tmp_path: Path) -> None:
    made = store(tmp_path)
    for first in range(0, 2500, 700):
        made.write(rows(*range(first, min(first + 700, 2500))))
    path = made.merge(2500, judge)
    assert np.array_equal(read_runs(path)[0].index, np.arange(2500))
    found = pq.ParquetFile(path).metadata
    sizes = [found.row_group(k).num_rows for k in range(found.num_row_groups)]
    assert sizes == [1024, 1024, 452]


def test_rows_twice_count_once(tmp_path: Path) -> None:
    assert written(tmp_path, range(6), range(4, 9), range(6)) == written(
        tmp_path, range(9)
    )  # the second on top of the first's file


@pytest.mark.parametrize("fault", ["cut", "flipped", "empty"])
def test_a_torn_part_is_done_again(tmp_path: Path, fault: str) -> None:
    made = store(tmp_path)
    made.write(rows(*range(4)))
    made.write(rows(*range(4, 9)))
    part = sorted((tmp_path / "out" / "parts").iterdir())[0]
    data = bytearray(part.read_bytes())
    if fault == "flipped":
        data[60] ^= 1  # in a page: the footer is whole
    part.write_bytes(bytes({"cut": data[:-20], "flipped": data, "empty": b""}[fault]))
    assert made.done().tolist() == list(range(4, 9))
    assert not part.exists()
    with pytest.raises(RpctlError, match="5 of 9 runs are there; add --resume"):
        made.merge(9, judge)
    assert not made.runs_file.exists()
    assert written(tmp_path, range(4)) == written_elsewhere(tmp_path)


def written_elsewhere(folder: Path) -> bytes:
    (folder / "elsewhere").mkdir()
    return written(folder / "elsewhere", range(9))


def test_a_folder_is_not_taken_over(tmp_path: Path) -> None:
    written(tmp_path, range(9))
    with pytest.raises(RpctlError, match="holds a study; add --resume"):
        Store(tmp_path / "out", IDENTITY).prepare(resume=False)
    with pytest.raises(RpctlError, match=r"else: seed: 1 there, 2 here; give another --out"):
        store(tmp_path, seed=2)
    with pytest.raises(RpctlError, match=r"robot\.name: r2 there, d2 here"):
        store(tmp_path, robot={"name": "d2"})
    with pytest.raises(RpctlError, match="more: nothing there, 3 here"):
        store(tmp_path, more=3)


def test_a_whole_file_counts_as_done(tmp_path: Path) -> None:
    written(tmp_path, range(9))
    made = store(tmp_path)
    assert made.done().tolist() == list(range(9))
    made.write(rows(9, 10))
    assert read_runs(made.merge(11, judge))[0].index.tolist() == list(range(11))
    data = made.runs_file.read_bytes()
    column = pq.ParquetFile(made.runs_file).metadata.row_group(0).column(0)
    inside = column.data_page_offset + column.total_compressed_size - 1
    flipped = data[:inside] + bytes([data[inside] ^ 1]) + data[inside + 1 :]
    for damaged in (data[:-9], flipped):
        made.runs_file.write_bytes(damaged)
        with pytest.raises(RpctlError, match="is damaged; remove it"):
            made.done()


def test_what_is_no_file_of_runs_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "runs.parquet"
    path.write_bytes(b"PAR1 no")
    with pytest.raises(RpctlError, match="is no file of a study's runs"):
        read_runs(path)
    library("pandas").DataFrame({"a": [1]}).to_parquet(path)
    with pytest.raises(RpctlError, match="is no file of a study's runs"):
        read_runs(path)


def test_chunks_hold_rows_that_follow_each_other() -> None:
    found = [each.tolist() for each in chunks_of([0, 1, 2, 3, 4, 7, 8, 12], 3)]
    assert found == [[0, 1, 2], [3, 4], [7, 8], [12]]
    assert list(chunks_of(np.zeros(0, np.int64), 3)) == []
    assert sum(map(len, chunks_of(np.arange(1000), 7))) == 1000


def test_values_that_are_not_finite_stay(tmp_path: Path) -> None:
    made = store(tmp_path)
    nan: Array = np.full((1, T), np.nan)
    first = rows(3)
    made.write(RunTable(first.index - 3, first.parameters, first.merits, {"error": nan.astype(
        np.float32)}, first.t, ("diverging",), ("",)))  # fmt: skip
    found = read_runs(made.merge(1, judge))[0]
    assert found.merits["rms"].tolist() == [np.inf]
    assert np.isnan(found.series["error"]).all()
