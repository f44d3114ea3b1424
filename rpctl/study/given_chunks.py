"""The chunks of a study that a Dask scheduler has, and what comes back of them."""

from __future__ import annotations

import math
import pickle
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from hashlib import sha256
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any, Generic, NamedTuple, TypeVar

from rpctl.errors import RpctlError

LOOK_S = 1.0  # s after which workers that have joined are looked for
GOING = (OSError, RuntimeError, ValueError, CancelledError)  # of Dask, without a scheduler
GONE = "the scheduler has gone, or has forgotten the study; what has ended is not lost"

Chunk = TypeVar("Chunk")


class LostChunk(NamedTuple):
    """What becomes of a chunk whose workers all died."""

    reason: str


Answer = Any  # a FinishedChunk, a RefusedWorker, a _Lost or an exception


class GivenChunks(Generic[Chunk]):
    """The chunks that a scheduler has: one for each thread of its workers.

    None waits at a worker: it would be blamed, too, for the death of that worker.

    Attributes:
        chunks: By the future of their answer.
    """

    def __init__(self, client: Any, work: str, chunks: Iterable[Chunk]) -> None:
        self.chunks: dict[Any, Chunk] = {}
        self._client, self._left = client, iter(chunks)
        self._ended: SimpleQueue[Any] = SimpleQueue()
        from rpctl.study.dask_worker import run_sent  # imports Dask

        self._run, self._work = run_sent, work
        self._number = 0  # of the next task
        self._looked, self._room = -math.inf, 0

    def fill(self) -> None:
        """Give out chunks until each worker has enough."""
        now = time.monotonic()
        if now > self._looked + LOOK_S:
            self._looked = now
            with scheduler_there():
                self._room = max(sum(self._client.nthreads().values()), 1)
        for chunk in islice(self._left, max(self._room - len(self.chunks), 0)):
            self.give(chunk)

    def give(self, chunk: Chunk) -> None:
        """Give out a chunk, under a key that is its content's."""
        data = pickle.dumps(chunk, pickle.HIGHEST_PROTOCOL)
        key = f"{self._work}-{self._number}-{digest(data)}"
        self._number += 1
        future = self._client.submit(self._run, self._work, data, key=key, pure=False)
        self.chunks[future] = chunk
        future.add_done_callback(self._ended.put)

    def ended(self) -> list[tuple[Chunk, Answer]]:
        """Return chunks that have ended and their answers; none after a while without any."""
        futures = []
        with suppress(Empty):
            futures.append(self._ended.get(timeout=LOOK_S))
            while True:
                futures.append(self._ended.get_nowait())
        good = [future for future in futures if future.status == "finished"]
        with scheduler_there():
            answers = dict(zip(good, self._client.gather(good), strict=True))
        return [
            (self.chunks.pop(future), answers.pop(future, None) or _failure(future))
            for future in futures
        ]

    def cancel(self) -> None:
        """Forget what was given out."""
        with suppress(*GOING):
            self._client.cancel(list(self.chunks))


@contextmanager
def scheduler_there() -> Iterator[None]:
    """Say of a connection that breaks what that means."""
    try:
        yield
    except GOING:
        raise RpctlError(GONE) from None


def _failure(future: Any) -> Answer:
    """Return why a task has no result."""
    if future.status in ("cancelled", "lost"):
        return RpctlError(GONE)
    error: Exception = future.exception()
    if type(error).__name__ == "KilledWorker":
        return LostChunk(f"{error.allowed_failures + 1} in turn")  # type: ignore[attr-defined]
    return error.with_traceback(future.traceback())


def digest(data: bytes) -> str:
    """Return a short hash of data."""
    return sha256(data).hexdigest()[:16]
