"""Work on foreign input done by a confined Python process, which is talked to by pipes.

The process holds nothing of the user's: an empty environment, no files but its pipes, and after
:func:`rpctl.files.confinement.confine` no way to more. What it answers is foreign, too.
"""

from __future__ import annotations

import importlib
import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import cached_property, lru_cache
from pathlib import Path
from threading import Timer
from types import TracebackType
from typing import IO, TYPE_CHECKING

from rpctl.errors import RpctlError
from rpctl.files.confinement import confine

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

Process = subprocess.Popen[bytes]

# rpctl itself would load Pinocchio; the worker needs but few files of its.
BOOT = """import sys, types
rpctl = sys.modules["rpctl"] = types.ModuleType("rpctl")
rpctl.__path__ = [sys.argv[1]]
from rpctl.files.worker import serve
serve(sys.argv[2])"""
NEEDED = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")  # without which Python may not run
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
LENGTH = 8  # bytes that tell how long a message is
SHORT = 2**16  # bytes of the first answer, and of the errors that are read
LONG = 2**24  # bytes of the settings: a path to search may have many entries
LAST_WORDS_S = 1.0  # s that a worker has to end after its pipes
GRACE_S = 5  # s that a worker outlives its time, should nobody be left to end it


class WorkerError(RpctlError):
    """A worker that ended, or was ended, without an answer.

    Attributes:
        late: Whether it took too long.
    """

    def __init__(self, reason: str, late: bool = False) -> None:
        self.late = late
        super().__init__(reason)


class Channel:
    """Messages of bytes between a worker and who started it."""

    def __init__(self, incoming: IO[bytes], outgoing: IO[bytes]) -> None:
        self._incoming, self._outgoing = incoming, outgoing

    def send(self, message: bytes) -> None:
        """Send a message; may block until the other side reads it."""
        self._outgoing.write(len(message).to_bytes(LENGTH, "big"))
        self._outgoing.write(message)
        self._outgoing.flush()

    def receive(self, most: int) -> bytes:
        """Return the next message.

        Raises:
            EOFError: The other side has gone.
            ValueError: The message has more than ``most`` bytes.
        """
        size = int.from_bytes(self._read(LENGTH), "big")
        if size > most:
            raise ValueError(f"a message of {size} bytes; at most {most} are allowed")
        return self._read(size)

    def _read(self, size: int) -> bytes:
        data = self._incoming.read(size)
        if len(data) < size:
            raise EOFError
        return data


@lru_cache(maxsize=1)
def _starter() -> ThreadPoolExecutor:
    from concurrent.futures import ThreadPoolExecutor  # few need it

    return ThreadPoolExecutor(1, "rpctl-starter")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_starter.cache_clear)  # threads do not come along


def _in_lasting_thread(start: Callable[[], Process]) -> Process:
    """Start a process in a thread that lasts as long as this process.

    Linux ends a worker when the thread that started it ends, and threads of servers are short.
    """
    if threading.current_thread() is threading.main_thread():
        return start()
    return _starter().submit(start).result()


class Worker(AbstractContextManager["Worker"]):
    """A confined process that runs ``main(channel)`` of a module; a context that ends it for sure.

    It starts while its owner goes on; whoever asks it first waits.
    """

    def __init__(self, module: str, memory: int, seconds: float) -> None:
        """Start a process; it imports its module, is confined, and waits for messages.

        Args:
            module: Name of a module of rpctl that needs no other part of it to be imported first;
                it imports all that its ``main`` needs, for nothing is found afterwards. If
                it has a function ``prepare``, that is called before.
            memory: Bytes of address space that it may take.
            seconds: After which it is ended, whatever it does, s.

        Raises:
            WorkerError: It could not be started.
        """
        self._late = False
        command = [sys.executable, "-I", "-X", "utf8", "-c", BOOT, str(Path(__file__).parents[1])]
        environment = {name: os.environ[name] for name in NEEDED if name in os.environ}
        try:
            self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed by close
        except OSError as error:
            raise WorkerError(f"no temporary file could be made ({error.strerror})") from None
        try:
            self._process = _in_lasting_thread(
                lambda: subprocess.Popen(
                    [*command, module], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                    stderr=self._errors, env=environment | ONE_THREAD, start_new_session=True,
                )
            )  # fmt: skip
        except OSError as error:
            self._errors.close()
            raise WorkerError(f"no process could be started ({error.strerror})") from None
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._channel = Channel(self._process.stdout, self._process.stdin)
        self._timer = self._started_timer(seconds)
        settings = [entry for entry in sys.path if entry], memory, int(seconds) + GRACE_S
        try:
            self.send(json.dumps(settings).encode())
        except BaseException:
            self.close()
            raise

    @cached_property
    def measures(self) -> tuple[str, ...]:
        """What confines it (:data:`rpctl.files.confinement.MEASURES`), before it does anything.

        Raises:
            WorkerError: It could not be started.
        """
        return tuple(json.loads(self._receive(SHORT)))

    def send(self, message: bytes) -> None:
        """Send it a message.

        Raises:
            WorkerError: It has ended.
        """
        try:
            self._channel.send(message)
        except OSError:
            raise self._ended() from None

    def receive(self, most: int) -> bytes:
        """Return its next message, of at most so many bytes.

        Raises:
            WorkerError: It has ended, or says more.
        """
        _ = self.measures  # its first message
        return self._receive(most)

    def _receive(self, most: int) -> bytes:
        try:
            return self._channel.receive(most)
        except (EOFError, OSError):
            raise self._ended() from None
        except ValueError as error:
            raise WorkerError(f"it answered with {error}") from None

    def grant(self, seconds: float) -> None:
        """Let it run so many seconds from now, s, instead of what was left of its time."""
        self._timer.cancel()
        self._timer = self._started_timer(seconds)

    def _started_timer(self, seconds: float) -> Timer:
        timer = Timer(seconds, self._end_late)
        timer.daemon = True
        timer.start()
        return timer

    def close(self) -> None:
        """End it, and whatever it may have started."""
        self._timer.cancel()
        self._kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            with suppress(OSError):  # what was not flushed into a pipe that broke
                stream.close()  # type: ignore[union-attr]

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _end_late(self) -> None:
        self._late = True
        self._kill()
        self._process.wait()  # or it would stay as a zombie until somebody asks

    def _kill(self) -> None:
        with suppress(OSError):  # it has ended
            if hasattr(os, "killpg") and self._process.returncode is None:
                os.killpg(self._process.pid, signal.SIGKILL)
            else:
                self._process.kill()

    def _ended(self) -> WorkerError:
        """Return why there is no answer."""
        try:
            code = self._process.wait(LAST_WORDS_S)
        except subprocess.TimeoutExpired:  # it closed its pipes and goes on
            self._kill()
            code = self._process.wait()
        if self._late:
            return WorkerError("it took too long", late=True)
        self._errors.seek(0)
        last = self._errors.read(SHORT).decode("utf-8", "replace").strip().rpartition("\n")[2]
        return WorkerError(last or f"exit code {code}")


def serve(module: str) -> None:
    """Be the worker: import a module, give up all else, and run its ``main(channel)``."""
    incoming, outgoing = io.FileIO(os.dup(0)), io.FileIO(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is printed is no message
    channel = Channel(io.BufferedReader(incoming), io.BufferedWriter(outgoing))
    path, memory, seconds = json.loads(channel.receive(LONG))
    sys.path[:] = path
    loaded = importlib.import_module(module)
    if hasattr(loaded, "prepare"):
        loaded.prepare()
    os.environ.clear()
    channel.send(json.dumps(confine(memory, seconds)).encode())
    loaded.main(channel)
