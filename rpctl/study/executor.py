"""Chunks of work, one after another, in own processes or on a cluster: the results are the same.

An executor is a context: its processes live from the first chunk to its end, so that a study that
asks several times starts them once. Work is a function of a chunk that other processes can import,
the robot and all else that it needs bound to it (``functools.partial``). It has to be pure, for a
chunk whose process dies is done again.
"""

from __future__ import annotations

import io
import multiprocessing as mp
import os
import pickle
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import lru_cache
from multiprocessing import resource_tracker
from typing import Any, TypeVar, cast

from rpctl.errors import RpctlError
from rpctl.files.own_code import sent
from rpctl.files.signals import held_signals
from rpctl.files.worker import ONE_THREAD

MAX_TRIES = 2  # of a chunk by itself, after a worker has died while it ran or waited
FEW_LOST = 2  # chunks in a row that may be lost: each by its own fault
START_S = 4.0  # s of work that are saved before starting processes pays
ALONE_S = 10.0  # s after which they are started whatever is left: more may be asked for

Chunk = TypeVar("Chunk")
Result = TypeVar("Result")
Own = TypeVar("Own", bound="Executor")
Work = Callable[[Chunk], Result]


class LostChunksError(RpctlError):
    """Chunks of work that ended every worker they were given to."""

    exit_code = 3

    def __init__(self, chunks: Sequence[Any], more: str = "") -> None:
        self.chunks = tuple(chunks)
        super().__init__(
            f"{', '.join(map(str, chunks))}: each worker that ran them ended{more}; if memory "
            "ran out, take fewer workers or smaller chunks"
        )


class Executor:
    """Runs chunks in this process, one after another.

    Attributes:
        workers: How many chunks run at a time; of a cluster, now.
    """

    workers: int = 1

    def map_chunks(
        self, work: Work[Chunk, Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end; ``str`` of a chunk names its runs.

        Who stops asking (an exception, a Ctrl-C, ``close`` of the iterator) ends what runs.

        Raises:
            RpctlError: As ``work`` raised it.
            LostChunksError: Some chunks ended their workers each time; after all others are done.
        """
        for chunk in chunks:
            yield chunk, work(chunk)

    def __enter__(self: Own) -> Own:
        return self

    def __exit__(self, *error: object) -> None:
        pass


class ProcessExecutor(Executor):
    """Runs chunks in own processes of one thread each, none of which outlives it.

    They ignore SIGINT: on a Ctrl-C this process, their parent, ends them. They end by themselves
    when their parent does. When one dies, what ran then is tried again, a chunk at a time.

    Args:
        workers: How many.
        sparing: Whether this process works alone until it pays to start them.
    """

    def __init__(self, workers: int, sparing: bool = False) -> None:
        if workers < 1:
            raise RpctlError(f"{workers} workers; give 1 or more")
        self.workers, self._sparing, self._alone_s = workers, sparing, 0.0
        self._pool: ProcessPoolExecutor | None = None

    def __exit__(self, *error: object) -> None:
        self._end()

    def map_chunks(
        self, work: Work[Chunk, Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end; see :class:`Executor`."""
        left = deque(chunks)
        yield from self._alone(work, left)
        data = pickled(work)
        running: dict[Future[Any], Chunk] = {}
        lost: list[Chunk] = []
        lost_in_a_row = 0
        try:
            while (left or running) and lost_in_a_row < max(self.workers, FEW_LOST):
                while left and len(running) <= self.workers:  # one waits for the next worker
                    chunk = left.popleft()
                    running[self._submit(data, chunk)] = chunk
                done = wait(running, return_when=FIRST_COMPLETED).done
                if any(isinstance(each.exception(), BrokenProcessPool) for each in done):
                    suspects = [*running.values()]
                    running.clear()
                    self._end()
                    for chunk in suspects:
                        results = self._tried(data, chunk)
                        yield from results
                        lost_in_a_row = 0 if results else lost_in_a_row + 1
                        lost += [] if results else [chunk]
                    continue
                for future in done:
                    yield running.pop(future), future.result()
        finally:
            if running:
                self._end()
        if lost:
            more = f"; {left[0]} and the following were not tried" if left else ""
            raise LostChunksError(lost, more)

    def _alone(self, work: Work[Chunk, Result], left: deque[Chunk]) -> Iterator[Any]:
        """Yield what this process does itself until it pays to start others."""
        while left and self._sparing and self._alone_s < ALONE_S:
            chunk, began, before = left.popleft(), time.monotonic(), self._alone_s
            result = work(chunk)
            took = time.monotonic() - began
            self._alone_s += took
            # The first chunk also loads and compiles: it tells nothing of the others.
            saved = took * len(left) * (1.0 - 1.0 / self.workers) if before else 0.0
            self._sparing = saved < START_S
            yield chunk, result

    def _tried(self, data: bytes, chunk: Chunk) -> list[tuple[Chunk, Any]]:
        """Return a chunk with its result after some tries by itself; nothing if each ended."""
        for _ in range(MAX_TRIES):
            with suppress(BrokenProcessPool):
                return [(chunk, self._submit(data, chunk).result())]
            self._end()
        return []

    def _submit(self, data: bytes, chunk: Any) -> Future[Any]:
        """Have a process run a chunk; one that died while it was idle is no chunk's fault."""
        packed = pickled(chunk)
        with held_signals(), _for_children():
            try:
                return self._started().submit(run_pickled, data, packed)
            except BrokenProcessPool:
                self._end()
                return self._started().submit(run_pickled, data, packed)

    def _started(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(self.workers, mp.get_context("spawn"), _watch_parent)
            # All start with the first chunk: one that started while another dies would change the
            # dictionary of processes that the pool's thread is walking, and that thread would fail.
            vars(self._pool)["_safe_to_dynamically_spawn_children"] = False
        return self._pool

    def _end(self) -> None:
        """End all processes at once, whatever they do."""
        if self._pool is None:
            return
        with held_signals():  # one process left would wait for the next chunk, and Python for it
            for process in [*self._pool._processes.values()]:  # kill_workers() of Python 3.14
                process.kill()
            self._pool.shutdown(cancel_futures=True)
            self._pool = None


@contextmanager
def _for_children() -> Iterator[None]:
    """Let processes that are started inherit one thread for libraries, and no SIGINT."""
    resource_tracker.ensure_running()  # it would unblock the signal when it starts
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _watch_parent() -> None:
    """Have this process end when the one that started it was killed."""

    def end_with_parent() -> None:
        mp.parent_process().join()  # type: ignore[union-attr]  # each child has one
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


class _Pickler(pickle.Pickler):
    def reducer_override(self, thing: object) -> Any:
        return sent(thing)


def pickled(thing: object) -> bytes:
    """Return what :func:`run_pickled` takes; laws of a user's own file go with its text."""
    data = io.BytesIO()
    _Pickler(data, pickle.HIGHEST_PROTOCOL).dump(thing)
    return data.getvalue()


def run_pickled(work: bytes, chunk: bytes) -> Any:
    """Return what the work makes of a chunk; it is loaded once, however many chunks there are."""
    return _loaded(work)(pickle.loads(chunk))


@lru_cache(maxsize=1)
def _loaded(work: bytes) -> Callable[[Any], Any]:
    return cast("Callable[[Any], Any]", pickle.loads(work))


def executor_for(workers: int) -> Executor:
    """Return what runs chunks on this machine: processes only where they pay."""
    return Executor() if workers == 1 else ProcessExecutor(workers, sparing=True)
