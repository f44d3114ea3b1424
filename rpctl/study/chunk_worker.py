"""``ChunkWorker``: a process of one thread that runs chunks of work, and its side of the pipe."""

from __future__ import annotations

import multiprocessing as mp
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.pool import ExceptionWithTraceback  # type: ignore[attr-defined]
from typing import Any, NamedTuple

from rpctl.errors import RpctlError
from rpctl.files.worker import ONE_THREAD

LAST_WORDS_S = 5.0  # s that a process may live on behind its end of the pipe

Outcome = tuple[Any, Exception | None]  # a result, or the error in its place


class FinishedChunk(NamedTuple):
    """What a worker of a cluster answers to a chunk."""

    result: Any


class RefusedWorker(NamedTuple):
    """What a worker of a cluster answers that has other versions than who asks."""

    address: str
    differences: list[str]


class ChunkWorker:
    """A process that runs chunks, one at a time; it ends when its parent does.

    Attributes:
        connection: Is ready to be read when there is an answer, or will be none.
        has_started: Whether it has said that it reads.
    """

    def __init__(self) -> None:
        context = mp.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.has_started = False
        self._message = b""  # that it gets once it reads
        self._known: bytes | None = None  # the work that it holds
        self._process = context.Process(target=serve, args=(theirs,), daemon=True)
        with for_children():
            self._process.start()
        theirs.close()

    @property
    def is_alive(self) -> bool:
        """Whether it still runs."""
        return self._process.is_alive()

    def give(self, work: bytes, chunk: object) -> None:
        """Have it run a chunk, as soon as it has started.

        Args:
            work: What runs it, pickled; sent where it is another than the last.
            chunk: The chunk.
        """
        news = None if work == self._known else work
        self._known = work
        self._message = pickle.dumps((news, chunk), pickle.HIGHEST_PROTOCOL)
        if self.has_started:
            self._send()

    def _send(self) -> None:
        with suppress(OSError):  # it has died: so its answer will say
            self.connection.send_bytes(self._message)
        self._message = b""

    def answer(self) -> Outcome | None:
        """Return what the work returned or raised; None where it has only started.

        Raises:
            OSError, EOFError: It has died.
        """
        answer: Outcome | None = self.connection.recv()
        if not self.has_started:
            self.has_started = True
            self._send()
        return answer

    def last_words(self) -> str:
        """Return why it has died."""
        self._process.join(LAST_WORDS_S)
        code = self._process.exitcode
        if code is None:
            return "it closed its pipe"
        return f"exit code {code}" if code >= 0 else f"killed by {signal.Signals(-code).name}"

    def end(self) -> None:
        """End it at once, whatever it does."""
        self._process.kill()
        self._process.join()
        self.connection.close()


@contextmanager
def for_children() -> Iterator[None]:
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


def serve(connection: Connection) -> None:
    """Be the worker: say so, then answer chunk after chunk until the parent goes."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    connection.send(None)
    data = b""
    work: Callable[[Any], Any] | None = None
    while True:
        try:
            news, chunk = connection.recv()
        except EOFError:
            return
        if news is not None:
            work, data = None, news
        try:
            work = work or pickle.loads(data)
            outcome: Outcome = work(chunk), None
        except Exception as error:
            outcome = None, portable(error)
        try:
            message = pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL)
        except Exception as error:
            message = pickle.dumps((None, portable(error)), pickle.HIGHEST_PROTOCOL)
        connection.send_bytes(message)


def _end_with_parent() -> None:
    """End this process when the one that started it was killed."""
    parent = mp.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


def portable(error: Exception) -> Any:
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
