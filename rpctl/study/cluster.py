"""Chunks of work on Dask distributed: more machines.

Start ``dask scheduler`` on one machine and ``dask worker ADDRESS --nthreads 1 --nworkers -1`` on
each, before a study or while it runs, and give the study the scheduler's address. A worker that
dies loses nothing: its chunk is given to another one. One that joins gets chunks within a second.
All have to have the Python, the libraries and the rpctl of the process that asks, to the last line;
others are refused before the first chunk, and those that join later are sent away.

**What is sent.** With each chunk, numbers of runs and their settings, and what all have in common:
the study's configuration, the robot and the file of its reference, which a worker loads once.
Meshes are not: dynamics need none. No disk has to be shared. Back come merits, outcomes and the
kept samples of the errors.

**Who may ask.** What is sent is Python's pickle: who reaches a scheduler or a worker runs any code
on all of them; own processes (:class:`rpctl.study.executor.ProcessExecutor`) talk by pipes, and are
reached by nobody. A scheduler on a network needs Dask's TLS: start all parts with
``--tls-ca-file``, ``--tls-cert`` and ``--tls-key``, give the address as ``tls://HOST:PORT``, and
the same files in the environment (``DASK_DISTRIBUTED__COMM__TLS__CA_FILE``,
``...__CLIENT__CERT``, ``...__CLIENT__KEY``).

**What a chunk costs.** Measured on a virtual machine of two
shared cores, Python 3.11, distributed 2026.8 (processor time):

====================================================  =========  ======  ======
of a chunk                                            scheduler  client  worker
====================================================  =========  ======  ======
ms, whatever it holds                                    2.2       1.8     2.7
ms for each MB of its result                             2.2       1.3     3.3
====================================================  =========  ======  ======

TIAGo is 16 kB, sent once, and takes .4 s to load; importing what simulates it takes 1.2 s. 256 runs
are 10 kB out and 750 kB back (200 samples of each error; ``samples`` in the study's file). Results
pass through the scheduler to the client. So the workers (cores) that are kept busy are the least of

    chunk / (2.2 ms + 2.2 ms/MB · result)   and   chunk · bandwidth / result

=========  ===========  =================  ==================
a chunk    its result   scheduler feeds    1 Gbit/s brings
=========  ===========  =================  ==================
1 s        10 kB              460               12500
1 s        600 kB             290                 210
10 s       600 kB            2900                2100
60 s       600 kB           17000               12500
=========  ===========  =================  ==================

**100 machines** of 8 cores need chunks of 4 s or more, **1000 machines** chunks of 40 s: larger
ones (``chunk`` in the study's file) or fewer samples. Where chunks are as large as a study allows,
it stops scaling: with less than some ten chunks a worker, the last ones leave the others idle, so
that n runs of s seconds each are worth about n · s / 400 s workers at chunks of 40 s. Beyond 8000
workers it is the scheduler that stops it, one Python process; then several schedulers take studies
of different seeds. A worker that starts spends 2 s before its first chunk, more where its loop has
to be compiled.
"""

from __future__ import annotations

import socket
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from rpctl.errors import RpctlError
from rpctl.libraries import library
from rpctl.study.executor import (
    Chunk,
    Executor,
    LostChunksError,
    Result,
    Work,
    pickled,
    run_pickled,
)
from rpctl.study.experiment import extra
from rpctl.study.store import CODE, installed

CONNECT_S = 10.0  # s in which a scheduler has to answer
JOIN_S = 60.0  # s in which a first worker has to join
MAX_SHOWN = 10  # workers that a message names
GOING = (OSError, RuntimeError, ValueError, CancelledError)  # of Dask, without a scheduler
GONE = "the scheduler is gone, or lost the study; finished runs are kept"


class Answer(NamedTuple):
    """What a worker answers.

    Attributes:
        result: Of the work, where it was done.
        error: What it raised; None: nothing.
        refused: In what the worker differs from who asks, which then does no work.
        address: Of such a worker.
    """

    result: Any = None
    error: Exception | None = None
    refused: Sequence[str] = ()
    address: str = ""


class DaskExecutor(Executor):
    """Runs chunks on the workers of a Dask scheduler, which may come and go.

    Args:
        address: Of the scheduler, as ``tcp://10.0.0.1:8786``.
        tell: Called with what a user should know: a worker that was refused.

    Raises:
        RpctlError: Dask is not installed, no scheduler answers, no worker joins, or workers have
            other versions than this process.
    """

    def __init__(self, address: str, tell: Callable[[str], object] | None = None) -> None:
        self._tell = tell or (lambda text: print(text, file=sys.stderr))
        self._refused: set[str] = set()  # addresses of workers that were sent away
        self._client = _connect(address, self._tell)
        try:
            check_workers(self._client)
        except BaseException:
            self._client.close()
            raise

    @property
    def workers(self) -> int:  # type: ignore[override]
        """How many chunks run at a time, now."""
        with _scheduler_there():
            return max(sum(self._client.nthreads().values()), 1)

    def __exit__(self, *error: object) -> None:
        self._client.close()

    def map_chunks(
        self, work: Work[Chunk, Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end; see :class:`Executor`."""
        distributed, left = library("distributed"), deque(chunks)
        data, given_out = pickled(work), dict[Any, Chunk]()
        queue, lost = distributed.as_completed(loop=self._client.loop), list[Chunk]()

        def give_out() -> None:  # one a worker: what waits beside a chunk would die with it
            while left and len(given_out) < self.workers:
                packed = pickled(left[0])
                future = self._client.submit(run_asked, packed, installed(), data, pure=False)
                given_out[future] = left.popleft()
                queue.add(future)

        try:
            with _scheduler_there():
                give_out()
            for future in queue:
                chunk = given_out.pop(future)
                answer: Answer | None = None
                try:
                    with _scheduler_there():
                        answer = future.result()
                except distributed.KilledWorker:
                    lost.append(chunk)
                if answer and answer.refused:
                    self._send_away(answer)
                    left.appendleft(chunk)
                with _scheduler_there():
                    give_out()
                if answer and answer.error:
                    raise answer.error
                if answer and not answer.refused:
                    yield chunk, answer.result
        finally:
            with suppress(*GOING):
                self._client.cancel([*given_out])
        if lost:
            raise LostChunksError(lost)

    def _send_away(self, worker: Answer) -> None:
        """Have a worker leave that joined with other versions, and say so once."""
        if worker.address not in self._refused:  # it had another chunk before it left
            self._refused.add(worker.address)
            self._client.retire_workers([worker.address])
            self._tell(f"{_worker_fault(worker.address, worker.refused)}; the scheduler removed it")


def run_asked(chunk: bytes, asked: Mapping[str, str], work: bytes) -> Answer:
    """Return what work makes of a chunk on a worker, or a record of why there is nothing.

    Nothing is unpickled unless all versions are the same.

    Args:
        chunk: It, pickled.
        asked: The versions of who asks.
        work: What runs the chunk, pickled.
    """
    wrong = differences(installed(), asked)
    if wrong:
        return Answer(refused=wrong, address=library("distributed").get_worker().address)
    try:
        return Answer(run_pickled(work, chunk))
    except Exception as error:  # whatever it is, the process that asked is to raise it
        return Answer(error=error)


def differences(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Return what another process has otherwise, each as ``numpy 2.3.1, here 2.4.6``."""
    return [f"{name} {there[name]}, here {mine}" for name, mine in here.items()
            if name in there and there[name] != mine]  # fmt: skip


def check_workers(client: Any) -> None:
    """Refuse workers that compute with other versions than this process.

    Raises:
        RpctlError: Naming the workers, the packages and both versions.
    """
    faults = []
    for address, known in client.run(installed, on_error="return").items():
        there = {CODE: repr(known)} if isinstance(known, Exception) else known
        wrong = differences(there, installed())
        faults += [_worker_fault(address, wrong)] if wrong else []
    if faults:
        more = [f"and {len(faults) - MAX_SHOWN} more workers"] if len(faults) > MAX_SHOWN else []
        raise RpctlError("\n".join([*faults[:MAX_SHOWN], *more]))


def _worker_fault(address: str, wrong: Sequence[str]) -> str:
    return f"worker {address} has {'; '.join(wrong)}; install the same versions on all machines"


@contextmanager
def _scheduler_there() -> Iterator[None]:
    """Say of a connection that breaks what that means."""
    try:
        yield
    except GOING:
        raise RpctlError(GONE) from None


def _require_greeting(address: str) -> None:
    """Refuse what says nothing to who connects, as a scheduler does at once: Dask would wait on.

    With another protocol than TCP the client speaks first.

    Raises:
        OSError: Nothing is there, or it is silent.
        ValueError: It is no address.
    """
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    if parts.scheme != "tcp":
        return
    if not parts.hostname or parts.port is None:
        raise ValueError("no host and port")
    with socket.create_connection((parts.hostname, parts.port), CONNECT_S) as connection:
        if not connection.recv(1):
            raise ConnectionError("it closes the connection")


def _connect(address: str, tell: Callable[[str], object]) -> Any:
    """Return a client of a scheduler that has at least one worker; ``tell`` says what it waits for.

    Raises:
        RpctlError: Dask is missing, no scheduler answers, or no worker joins.
    """
    distributed = extra("distributed", "more machines need", "cluster")
    try:
        _require_greeting(address)
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).partition("\n")[0]
        raise RpctlError(
            f"{address}: no scheduler answers ({reason}); start one with `dask scheduler`, and "
            "give its address as tcp://HOST:PORT"
        ) from None
    try:
        if not client.nthreads():
            tell(f"{address}: there is no worker yet; waiting {JOIN_S:g} s for one to join")
        client.wait_for_workers(1, timeout=JOIN_S)
    except TimeoutError:
        client.close()
        raise RpctlError(
            f"{address}: no worker has joined in {JOIN_S:g} s; start some with "
            f"`dask worker {address} --nthreads 1`"
        ) from None
    return client
