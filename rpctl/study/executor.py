"""Chunks of work, one after another or in own processes: the results are the same.

An executor is a context: its processes live from the first chunk to its end, so that a study that
asks several times starts them once. Work is a function of a chunk that other processes can import,
the robot and all else that it needs bound to it (``functools.partial``): it is sent to a process
once, not once a chunk. It has to be pure, for a chunk whose process dies is given out again.
"""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from types import TracebackType
from typing import Any, Generic, Protocol, TypeVar

from rpctl.errors import RpctlError
from rpctl.study.chunk_worker import ChunkWorker

MAX_KILLS = 3  # workers that a chunk may cost

Chunk = TypeVar("Chunk")
Result = TypeVar("Result")


class Executor(Protocol):
    """What runs chunks of work."""

    @property
    def workers(self) -> int:
        """How many chunks run at a time; of a cluster, now."""
        ...

    def map_chunks(
        self, work: Callable[[Chunk], Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end.

        Chunks are taken from ``chunks`` as workers become free. Who stops asking (an exception, a
        Ctrl-C, ``close`` of the iterator) ends what runs.

        Args:
            work: A pure function that other processes can import.
            chunks: What it is called with; ``str`` of one names its runs.

        Raises:
            RpctlError: As ``work`` raised it.
            LostChunksError: Some chunks ended their workers each time; after all others are done.
        """
        ...

    def __enter__(self) -> Executor: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


class LostChunksError(RpctlError):
    """Chunks of work that ended every worker they were given to.

    Attributes:
        chunks: They.
    """

    exit_code = 3

    def __init__(self, chunks: Sequence[Any], reason: str) -> None:
        self.chunks = tuple(chunks)
        super().__init__(
            f"{', '.join(map(str, chunks))}: each worker that ran them ended ({reason}); if memory "
            "ran out, take fewer workers or smaller chunks"
        )


class SerialExecutor:
    """Runs chunks in this process, one after another."""

    workers = 1

    def map_chunks(
        self, work: Callable[[Chunk], Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result; see :class:`Executor`."""
        for chunk in chunks:
            yield chunk, work(chunk)

    def __enter__(self) -> SerialExecutor:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        pass


class ProcessExecutor:
    """Runs chunks in own processes of one thread each, none of which outlives it.

    They ignore SIGINT: on a Ctrl-C this process, their parent, ends them. They end by themselves
    when their parent does.

    Args:
        workers: How many.

    Raises:
        RpctlError: There are none.
    """

    def __init__(self, workers: int) -> None:
        if workers < 1:
            raise RpctlError(f"{workers} workers; give 1 or more")
        self.workers = workers
        self._workers: list[ChunkWorker] = []  # that have not been ended
        self._idle: list[ChunkWorker] = []

    def __enter__(self) -> ProcessExecutor:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for worker in self._workers:  # also those of a loop that was left and not yet closed
            worker.end()
        self._workers, self._idle = [], []

    def map_chunks(
        self, work: Callable[[Chunk], Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end; see :class:`Executor`."""
        data = pickle.dumps(work, pickle.HIGHEST_PROTOCOL)
        tasks = _ChunkQueue(chunks, self.workers)
        busy: _Busy[Chunk] = {}
        try:
            self._give_out(busy, tasks, data)
            while busy:
                for connection in wait(list(busy)):
                    ended = self._ended(busy, tasks, connection)
                    self._give_out(busy, tasks, data)  # before the caller works on what ended
                    if ended is not None:
                        yield ended
        finally:
            for worker, _ in busy.values():
                self._end(worker)
        tasks.require_all()

    def _give_out(self, busy: _Busy[Chunk], tasks: _ChunkQueue[Chunk], data: bytes) -> None:
        """Give tasks to workers that are idle or new, as long as there are both."""
        while len(busy) < self.workers and (task := tasks.take()):
            worker = self._idle.pop() if self._idle else self._start()
            if not worker.is_alive:  # killed while it was idle: no chunk's fault
                self._end(worker)
                worker = self._start()
            busy[worker.connection] = worker, task
            worker.give(data, task.chunk)

    def _start(self) -> ChunkWorker:
        worker = ChunkWorker()
        self._workers.append(worker)
        return worker

    def _end(self, worker: ChunkWorker) -> None:
        worker.end()
        if worker in self._workers:
            self._workers.remove(worker)

    def _ended(
        self, busy: _Busy[Chunk], tasks: _ChunkQueue[Chunk], connection: Any
    ) -> tuple[Chunk, Any] | None:
        """Return a task's chunk and what a worker answers; None if it has only started, or died.

        Raises:
            Exception: As the work raised it.
        """
        worker, task = busy[connection]
        try:
            answer = worker.answer()
        except (EOFError, OSError):
            reason = worker.last_words()
            del busy[connection]
            self._end(worker)
            tasks.give_back(task, reason, to_blame=worker.has_started)
            return None
        if answer is None:
            return None
        del busy[connection]
        self._idle.append(worker)
        tasks.deaths = 0
        result, error = answer
        if error is not None:
            raise error
        return task.chunk, result


@dataclass
class _GivenChunk(Generic[Chunk]):
    """A chunk, and how many workers it has ended."""

    chunk: Chunk
    kills: int = 0


class _ChunkQueue(Generic[Chunk]):
    """What is still to be done: the chunks in their order, those that came back last."""

    def __init__(self, chunks: Iterable[Chunk], workers: int) -> None:
        self._chunks = iter(chunks)
        self._returned: deque[_GivenChunk[Chunk]] = deque()
        self._lost: list[Chunk] = []
        self._reason = ""
        self._too_many = MAX_KILLS * workers
        self.deaths = 0  # of workers since one answered

    def take(self) -> _GivenChunk[Chunk] | None:
        """Return the next task, None if there is none."""
        for chunk in self._chunks:
            return _GivenChunk(chunk)
        return self._returned.popleft() if self._returned else None

    def give_back(self, task: _GivenChunk[Chunk], reason: str, to_blame: bool) -> None:
        """Have a task done again whose worker died, unless it has cost too many.

        Args:
            task: The task.
            reason: Why the worker died.
            to_blame: Whether the worker had begun it.

        Raises:
            RpctlError: No worker lives long enough to answer.
        """
        self._reason = reason
        self.deaths += 1
        task.kills += to_blame
        if task.kills < MAX_KILLS:
            self._returned.append(task)
        else:
            self._lost.append(task.chunk)
        if self.deaths < self._too_many:
            return
        if not to_blame:
            raise RpctlError(f"processes end as soon as they are started ({reason})")
        for chunk in self._chunks:  # whatever is still to come would end them, too
            tried = [*self._lost, *(each.chunk for each in self._returned)]
            raise LostChunksError(tried, f"{reason}; {chunk} and what follows was not tried")

    def require_all(self) -> None:
        """Check that no task was lost.

        Raises:
            LostChunksError: Naming those that were.
        """
        if self._lost:
            raise LostChunksError(self._lost, self._reason)


_Busy = dict[Any, tuple[ChunkWorker, _GivenChunk[Chunk]]]  # by the connection that tells of them
