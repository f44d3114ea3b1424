"""Executors: the same results, whoever runs them, dies or is interrupted."""

from __future__ import annotations

import multiprocessing as mp
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rpctl.errors import RpctlError, UnknownNameError
from rpctl.study.executor import (
    MAX_TRIES,
    Executor,
    LostChunksError,
    ProcessExecutor,
)
from tests.study import chunk_works
from tests.study.chunk_works import Runs, chunks_of, draw


def results(
    executor: Executor, work: Callable[[Runs], object], chunks: list[Runs]
) -> dict[Runs, object]:
    with executor:
        return dict(executor.map_chunks(work, chunks))


def assert_same(found: Mapping[Runs, object], chunks: list[Runs]) -> None:
    """Assert bit for bit what one process finds, each chunk once."""
    assert sorted(found) == chunks
    for chunk, result in found.items():
        np.testing.assert_array_equal(result, draw(0.0, chunk))


@pytest.fixture(scope="module")
def two() -> Iterator[ProcessExecutor]:
    """Workers that several tests ask, as a study that optimises does."""
    with ProcessExecutor(2) as executor:
        yield executor


def test_processes_find_what_one_does(two: ProcessExecutor) -> None:
    chunks = chunks_of(7)
    pairs = list(two.map_chunks(partial(draw, 0.0), iter(chunks)))
    assert len(pairs) == len(chunks)
    assert_same(dict(pairs), chunks)
    assert_same(results(Executor(), partial(draw, 0.0), chunks), chunks)


def test_all_workers_start_before_one_can_die() -> None:
    """One that started while another died would end the thread that tends them."""
    before = set(mp.active_children())
    with ProcessExecutor(3) as three:
        list(three.map_chunks(partial(draw, 0.0), chunks_of(1)))
        assert len(set(mp.active_children()) - before) == 3


def test_work_is_loaded_once_a_process_by_processes_that_stay(two: ProcessExecutor) -> None:
    first = dict(two.map_chunks(chunk_works.Loaded(), chunks_of(8)))
    again = dict(two.map_chunks(chunk_works.Loaded(), chunks_of(8)))
    assert {count for _, count in (first | again).values()} == {1}
    other = dict(two.map_chunks(chunk_works.Loaded(2**18), chunks_of(8)))
    assert {count for _, count in other.values()} == {2}
    assert {pid for pid, _ in again.values()} <= {child.pid for child in mp.active_children()}


def test_libraries_of_a_worker_have_one_thread(
    two: ProcessExecutor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    with ProcessExecutor(1) as fresh:
        ((_, (threads, pid)),) = fresh.map_chunks(chunk_works.threads, chunks_of(1))
    assert threads == "1"
    assert pid != os.getpid()
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_a_worker_that_dies_loses_nothing(two: ProcessExecutor, tmp_path: Path) -> None:
    chunks = chunks_of(6)
    work = partial(chunk_works.dies_of, [30], tmp_path, MAX_TRIES - 1)
    assert_same(dict(two.map_chunks(work, chunks)), chunks)
    assert len(list(tmp_path.glob("30-*"))) == MAX_TRIES


def test_a_chunk_that_ends_each_worker_is_named_behind_the_others(
    two: ProcessExecutor, tmp_path: Path
) -> None:
    chunks, found = chunks_of(5), {}
    work = partial(chunk_works.dies_of, [10], tmp_path, 99)
    with pytest.raises(LostChunksError, match="runs 10 to 19: each") as lost:
        for chunk, result in two.map_chunks(work, chunks):
            found[chunk] = result  # noqa: PERF403 - the last of them raises
    assert (lost.value.chunks, lost.value.exit_code) == ((chunks[1],), 3)
    assert_same(found, [chunks[0], *chunks[2:]])
    assert len(list(tmp_path.glob("10-*"))) <= MAX_TRIES + 1


def test_work_that_ends_all_workers_is_given_up(tmp_path: Path) -> None:
    """Not after three processes for each of its chunks."""
    work = partial(chunk_works.dies_of, range(0, 1000, 10), tmp_path, 99)
    with pytest.raises(LostChunksError, match="and the following were not tried"):
        results(ProcessExecutor(1), work, chunks_of(100))
    assert len(list(tmp_path.iterdir())) <= 3 * (MAX_TRIES + 1)


def test_an_error_of_rpctl_comes_as_it_is_raised(two: ProcessExecutor) -> None:
    with pytest.raises(UnknownNameError, match="'papr' is not known; did you mean paper") as error:
        list(two.map_chunks(partial(chunk_works.refuses, 0), chunks_of(1)))
    assert error.value.choices == ("paper", "unified")
    assert len(list(two.map_chunks(partial(chunk_works.refuses, 99), chunks_of(1)))) == 1


def test_an_error_that_nobody_expects_tells_where(two: ProcessExecutor) -> None:
    with pytest.raises(ZeroDivisionError) as error:
        list(two.map_chunks(chunk_works.divides, chunks_of(1)))
    assert "chunk.first - chunk.first" in str(error.value.__cause__)


def test_who_leaves_the_loop_ends_what_runs(tmp_path: Path) -> None:
    before = set(mp.active_children())
    work = partial(chunk_works.draw_and_log, tmp_path, 0.0)
    with ProcessExecutor(2) as executor:
        for _ in executor.map_chunks(work, chunks_of(100)):
            break
        began = time.monotonic()
        executor.__exit__(None, None, None)
    assert time.monotonic() - began < 1.0
    assert set(mp.active_children()) == before
    assert len(list(tmp_path.iterdir())) <= 4  # chunks wait for workers, not workers for callers


def test_a_signal_that_comes_while_workers_are_ended_leaves_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kill = mp.process.BaseProcess.kill

    def interrupted(process: mp.process.BaseProcess) -> None:
        kill(process)
        signal.raise_signal(signal.SIGINT)

    before = set(mp.active_children())
    executor = ProcessExecutor(2)
    assert len(list(executor.map_chunks(partial(draw, 0.0), chunks_of(4)))) == 4
    monkeypatch.setattr(mp.process.BaseProcess, "kill", interrupted)
    with pytest.raises(KeyboardInterrupt):
        executor.__exit__()
    assert set(mp.active_children()) <= before


def test_no_workers_are_refused() -> None:
    with pytest.raises(RpctlError, match="0 workers; give 1 or more"):
        ProcessExecutor(0)


@pytest.mark.slow
def test_workers_killed_at_random_lose_nothing() -> None:
    """Whichever they are, at whatever moment: starting, idle or at work."""
    rng, chunks, found = np.random.default_rng(16), chunks_of(60), {}
    with ProcessExecutor(3) as executor:
        before = set(mp.active_children())
        for number, (chunk, result) in enumerate(executor.map_chunks(partial(draw, 0.02), chunks)):
            assert chunk not in found
            found[chunk] = result
            children = sorted(set(mp.active_children()) - before, key=lambda child: child.name)
            if number in (10, 35) and children:  # a third one might be the third of one chunk
                os.kill(children[rng.integers(len(children))].pid or 0, signal.SIGKILL)
    assert_same(found, chunks)


@pytest.mark.slow
def test_small_work_starts_no_process() -> None:
    """The estimate leaves the first chunk out, which loads and compiles."""
    chunks = chunks_of(8)
    before = set(mp.active_children())
    with ProcessExecutor(2, sparing=True) as executor:
        assert_same(dict(executor.map_chunks(partial(draw, 0.01), chunks)), chunks)
        assert set(mp.active_children()) == before
        assert_same(dict(executor.map_chunks(partial(draw, 1.2), chunks)), chunks)
        assert len(set(mp.active_children()) - before) == 2
