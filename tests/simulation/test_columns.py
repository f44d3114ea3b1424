"""Columns that may be larger than memory: what is written is read again, and memory stays small."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

from rpctl.errors import RpctlError
from rpctl.simulation import columns
from rpctl.simulation.columns import blocks, column_of, release, scratch, split

ROWS = columns.IN_MEMORY_BYTES // 8 // 3 + 1  # of three numbers: just too many for memory


def anonymous_and_all() -> tuple[int, int]:
    """Return the process's anonymous and whole memory, bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    found = {
        line.split(":")[0]: line.split()[1] for line in lines if line.startswith(("Rss", "VmR"))
    }
    return 1024 * int(found["RssAnon"]), 1024 * int(found["VmRSS"])


def test_small_columns_are_in_memory_and_large_ones_in_a_file_without_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    small, large = scratch((ROWS - 1, 3)), scratch((ROWS, 3))
    assert columns._mapping(small) is None
    assert columns._mapping(large) is not None
    assert list(tmp_path.iterdir()) == []
    for column in (small, large, scratch((7, 0)), scratch((4,))):
        assert not column.any()
        assert column.flags.writeable
        assert column.dtype == np.float64


def test_released_rows_keep_their_numbers() -> None:
    column = scratch((ROWS, 3))
    column[:] = np.arange(3.0 * ROWS).reshape(ROWS, 3)
    for first, last in ((0, None), (1000, 5000), (0, 1), (ROWS - 1, ROWS + 5), (ROWS, ROWS)):
        release(column, first, last)
    release(column[: ROWS // 2])
    np.testing.assert_array_equal(column.ravel(), np.arange(3.0 * ROWS))


def test_blocks_are_all_rows_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(columns, "BLOCK_BYTES", 24 * 1000)
    column, times = scratch((ROWS, 3)), np.arange(float(ROWS))
    column[:] = times[:, None]
    parts = list(blocks(column, times))
    assert {len(a) for a, _ in parts[:-1]} == {1000}
    np.testing.assert_array_equal(np.concatenate([a for a, _ in parts]), column)
    np.testing.assert_array_equal(np.concatenate([b for _, b in parts]), times)
    assert [len(each) for (each,) in blocks(np.empty((5, 0)))] == [5]
    assert list(blocks(np.empty(0))) == []


def test_columns_of_an_array_are_copies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(columns, "BLOCK_BYTES", 24 * 1000)
    for array in (scratch((ROWS, 3)), scratch((5, 3))):
        array[:] = np.arange(3.0 * len(array)).reshape(-1, 3)
        for k, column in enumerate(split(array[:, 1:])):
            np.testing.assert_array_equal(column, array[:, 1 + k])
            assert column.base is None
        assert k == 1
        np.testing.assert_array_equal(column_of(array, 2), array[:, 2])
    assert list(split(np.empty((4, 0)))) == []


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_filling_and_reading_a_large_column_takes_little_memory() -> None:
    column = scratch((4_000_000, 2))  # 64 MB
    anonymous, whole = anonymous_and_all()
    for first in range(0, len(column), 100_000):
        column[first : first + 100_000] = first
        release(column, first, first + 100_000)
    total, highest = 0.0, 0
    for (block,) in blocks(column):
        total += float(block.sum())
        highest = max(highest, anonymous_and_all()[1] - whole)
    assert total == 2.0 * 100_000 * sum(range(0, 4_000_000, 100_000))
    assert highest < 24 * 2**20
    assert anonymous_and_all()[0] - anonymous < 2**23
    assert anonymous_and_all()[1] - whole < 2**23


def test_a_full_disk_is_told_when_the_column_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page of a file that finds no room kills the process, in the middle of the run."""
    with pytest.raises(RpctlError, match=r"MB for a column of the log \(.*log_every.*TMPDIR"):
        scratch((2**56, 3))


def test_nothing_is_left_when_the_process_is_killed(tmp_path: Path) -> None:
    code = (
        "import os, signal; from rpctl.simulation.columns import scratch; c = scratch((10**6, 3));"
        "c[:] = 1.0; os.kill(os.getpid(), signal.SIGKILL)"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, check=False)
    assert done.returncode == -9
    assert list(tmp_path.iterdir()) == []
