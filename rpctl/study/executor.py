"""Chunks of work, one after another, in own processes or on a cluster: the results are the same.

An executor is a context: its processes live from the first chunk to its end, so that a study that
asks several times starts them once. Work is a function of a chunk that other processes can import,
the robot and all else that it needs bound to it (``functools.partial``). It has to be pure, for a
chunk whose process dies is given out again.
"""

from __future__ import annotations

import multiprocessing as mp
import os
import pickle
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.pool import ExceptionWithTraceback  # type: ignore[attr-defined]
from typing import Any, Protocol, TypeVar

from rpctl.errors import RpctlError
from rpctl.files.worker import ONE_THREAD

MAX_KILLS = 3  # workers that a chunk may cost
MAX_STARTS = 10  # processes that may die for it before they have begun it
FEW_LOST = 2  # chunks in a row that may be lost: each by its own fault
LOOK_S = 1.0  # s after which workers that have joined are looked for
LAST_WORDS_S = 5.0  # s that a process may live on behind its end of the pipe
START_S = 4.0  # s of work that are saved before starting processes pays
ALONE_S = 10.0  # s after which they are started whatever is left: more may be asked for

Chunk = TypeVar("Chunk")
Result = TypeVar("Result")
Work = Callable[[Chunk], Result]


class Executor(Protocol):
    """What runs chunks of work."""

    @property
    def workers(self) -> int:
        """How many chunks run at a time; of a cluster, now."""
        ...

    def map_chunks(
        self, work: Work[Chunk, Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end; ``str`` of a chunk names its runs.

        Who stops asking (an exception, a Ctrl-C, ``close`` of the iterator) ends what runs.

        Raises:
            RpctlError: As ``work`` raised it.
            LostChunksError: Some chunks ended their workers each time; after all others are done.
        """
        ...

    def __enter__(self) -> Executor: ...

    def __exit__(self, *error: object) -> None: ...


class LostChunksError(RpctlError):
    """Chunks of work that ended every worker they were given to."""

    exit_code = 3

    def __init__(self, chunks: Sequence[Any], reason: str) -> None:
        self.chunks = tuple(chunks)
        super().__init__(
            f"{', '.join(map(str, chunks))}: each worker that ran them ended ({reason}); if memory "
            "ran out, take fewer workers or smaller chunks"
        )


class WorkerDiedError(Exception):
    """Each worker that ran a chunk has died; the text says how."""


class WorkerRefusedError(Exception):
    """A worker has sent a chunk back that another one can run."""


class SerialExecutor:
    """Runs chunks in this process, one after another."""

    workers = 1

    def map_chunks(
        self, work: Work[Chunk, Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result; see :class:`Executor`."""
        for chunk in chunks:
            yield chunk, work(chunk)

    def __enter__(self) -> SerialExecutor:
        return self

    def __exit__(self, *error: object) -> None:
        pass


class PoolExecutor:
    """Runs chunks on workers that answer by futures: what processes and clusters have in common."""

    @property
    def workers(self) -> int:
        """How many chunks run at a time."""
        raise NotImplementedError

    def submit(self, work: bytes, chunk: bytes) -> Future[Any]:
        """Have a worker run a chunk, both pickled."""
        raise NotImplementedError

    def answer(self, future: Future[Any]) -> bytes:
        """Return what a worker has answered; see :func:`run_pickled`.

        Raises:
            WorkerDiedError: No worker has come to the end of the chunk.
            WorkerRefusedError: Another worker is to do it.
        """
        answer: bytes = future.result()
        return answer

    def map_chunks(
        self, work: Work[Chunk, Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end; see :class:`Executor`."""
        data = pickle.dumps(work, pickle.HIGHEST_PROTOCOL)
        left = deque(chunks)
        running: dict[Future[Any], Chunk] = {}
        ended: list[tuple[Future[Any], Chunk]] = []
        lost: list[Chunk] = []
        reason, lost_in_a_row = "", 0
        try:
            while left or running or ended:
                # Workers get the next chunks before the caller works on what has ended.
                while left and len(running) < self.workers:
                    chunk = left.popleft()
                    running[self.submit(data, _dumped(chunk))] = chunk
                for future, chunk in ended:
                    try:
                        result, failure = pickle.loads(self.answer(future))
                    except WorkerRefusedError:
                        left.appendleft(chunk)
                        continue
                    except WorkerDiedError as error:
                        lost.append(chunk)
                        reason, lost_in_a_row = str(error), lost_in_a_row + 1
                        continue
                    if failure is not None:
                        raise failure
                    lost_in_a_row = 0
                    yield chunk, result
                following = [*running.values(), *left]
                if lost_in_a_row >= max(self.workers, FEW_LOST) and following:
                    reason += f"; {following[0]} and what follows was not tried"
                    break
                done = wait(running, LOOK_S, FIRST_COMPLETED).done
                ended = [(future, running.pop(future)) for future in done]
        finally:
            self.cancel(list(running))
        if lost:
            raise LostChunksError(lost, reason)

    def cancel(self, futures: Sequence[Future[Any]]) -> None:
        """End what runs, and forget it."""
        raise NotImplementedError


class ProcessExecutor(PoolExecutor):
    """Runs chunks in own processes of one thread each, none of which outlives it.

    They ignore SIGINT: on a Ctrl-C this process, their parent, ends them. They end by themselves
    when their parent does. A thread of this process waits for each of them.

    Args:
        workers: How many.
        sparing: Whether this process works alone until it pays to start them.
    """

    def __init__(self, workers: int, sparing: bool = False) -> None:
        if workers < 1:
            raise RpctlError(f"{workers} workers; give 1 or more")
        self._workers, self._sparing, self._alone_s = workers, sparing, 0.0
        self._threads = ThreadPoolExecutor(workers)
        self._lock = threading.Lock()
        self._children: set[_Child] = set()  # that have not been ended
        self._idle: list[_Child] = []
        self._is_closed = False

    @property
    def workers(self) -> int:
        """How many chunks run at a time."""
        return self._workers

    def __enter__(self) -> ProcessExecutor:
        return self

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._is_closed = True
        self._end_children()
        self._threads.shutdown(cancel_futures=True)

    def map_chunks(
        self, work: Work[Chunk, Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end; see :class:`Executor`."""
        left = deque(chunks)
        while left and self._works_alone:
            chunk, began, before = left.popleft(), time.monotonic(), self._alone_s
            result = work(chunk)
            took = time.monotonic() - began
            self._alone_s += took
            # The first chunk also loads and compiles: it tells nothing of the others.
            saved = took * len(left) * (1.0 - 1.0 / self._workers) if before else 0.0
            self._sparing = saved < START_S
            yield chunk, result
        yield from super().map_chunks(work, left)

    @property
    def _works_alone(self) -> bool:
        return self._sparing and self._alone_s < ALONE_S

    def submit(self, work: bytes, chunk: bytes) -> Future[Any]:
        """Have a process run a chunk, both pickled."""
        return self._threads.submit(self._ask, work, chunk)

    def _ask(self, work: bytes, chunk: bytes) -> bytes:
        """Return what a process answers to a chunk; one that dies is replaced some times."""
        last_words, at_work, at_start = "", 0, 0
        while at_work < MAX_KILLS and at_start < MAX_STARTS:
            child = self._take_child()
            try:
                answer = child.answer(work, chunk)
            except (EOFError, OSError):
                last_words = child.last_words()
                at_work += child.has_started
                at_start += not child.has_started  # which is no fault of the chunk
                self._children.discard(child)
                child.end()
                continue
            self._idle.append(child)
            return answer
        raise WorkerDiedError(last_words)

    def _take_child(self) -> _Child:
        with self._lock:  # of what all processes share: the environment that they inherit
            while self._idle:
                child = self._idle.pop()
                if child.is_alive:  # or it was killed while it was idle: no chunk's fault
                    return child
                self._children.discard(child)
            if self._is_closed:
                raise WorkerDiedError("it is too late")
            child = _Child()
            self._children.add(child)
            return child

    def cancel(self, futures: Sequence[Future[Any]]) -> None:
        """End the processes that run something."""
        if futures:
            with self._lock:
                self._is_closed = True  # a thread whose process ends shall not start another one
            self._end_children()
            wait(futures)
            self._is_closed = False

    def _end_children(self) -> None:
        for child in tuple(self._children):
            child.kill()
        self._children.clear()
        self._idle.clear()


class _Child:
    """A process that runs chunks, one at a time; it ends when its parent does."""

    def __init__(self) -> None:
        context = mp.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with _for_children():
            self._process.start()
        theirs.close()
        self.has_started = False

    @property
    def is_alive(self) -> bool:
        return self._process.is_alive()

    def answer(self, work: bytes, chunk: bytes) -> bytes:
        """Return what :func:`run_pickled` does there.

        Raises:
            OSError, EOFError: The process has died.
        """
        if not self.has_started:
            self._connection.recv_bytes()
            self.has_started = True
        self._connection.send((work, chunk))
        return self._connection.recv_bytes()

    def last_words(self) -> str:
        """Return why it has died."""
        self._process.join(LAST_WORDS_S)
        code = self._process.exitcode
        if code is None:
            return "it closed its pipe"
        return f"exit code {code}" if code >= 0 else f"killed by {signal.Signals(-code).name}"

    def kill(self) -> None:
        """End it at once; the thread that waits for its answer is told by the pipe."""
        self._process.kill()
        self._process.join()

    def end(self) -> None:
        """End it, and close the pipe."""
        self.kill()
        self._connection.close()


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


def _serve(connection: Connection) -> None:
    """Answer chunk after chunk until the parent goes."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    connection.send_bytes(b"ready")
    while True:
        try:
            work, chunk = connection.recv()
        except EOFError:
            return
        connection.send_bytes(run_pickled(work, chunk))


def run_pickled(work: bytes, chunk: bytes) -> bytes:
    """Return a pickle of what the work makes of a chunk and None, or of None and its error.

    The work is loaded once, however many chunks there are.
    """
    try:
        return _dumped((_loaded(work)(pickle.loads(chunk)), None))
    except Exception as error:  # whatever it is, the process that asked is to raise it
        return _dumped((None, _portable(error)))


@lru_cache(maxsize=1)
def _loaded(work: bytes) -> Callable[[Any], Any]:
    loaded: Callable[[Any], Any] = pickle.loads(work)
    return loaded


def _dumped(value: object) -> bytes:
    return pickle.dumps(value, pickle.HIGHEST_PROTOCOL)


def _end_with_parent() -> None:
    """End this process when the one that started it was killed."""
    parent = mp.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


def _portable(error: Exception) -> Any:
    """Return what is an error again once it has been sent to another process.

    One of rpctl's goes as it is; what nobody expected takes its traceback along as its cause.
    """
    if isinstance(error, RpctlError):
        return error.with_traceback(None)
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError("".join(traceback.format_exception_only(error)).strip())
    return ExceptionWithTraceback(error, error.__traceback__)


def executor_for(workers: int) -> Executor:
    """Return what runs chunks on this machine: processes only where they pay."""
    return SerialExecutor() if workers == 1 else ProcessExecutor(workers, sparing=True)
