"""Chunks of work on Dask distributed: other machines, or processes of this one.

Start ``dask scheduler`` on one machine and ``dask worker ADDRESS --nthreads 1 --nworkers -1`` on
each, before a study or while it runs, and give the study the scheduler's address. A worker that
dies loses nothing: its chunk is given to another one. One that joins gets chunks within a second.
All have to have the Python, the libraries and the rpctl of the process that asks, to the last line;
others are refused before the first chunk, and those that join later are sent away.

**What is sent.** Once to each worker: the study's configuration, the robot's URDF after xacro with
its drive and how it was loaded, and the file of its reference. Meshes are not: dynamics need none.
No disk has to be shared. For each chunk: numbers of runs and their settings; back come merits,
outcomes and the kept samples of the errors.

**Who may ask.** What is sent is Python's pickle: who reaches a scheduler or a worker runs any code
on all of them. An own cluster listens on loopback only, which other users of this machine reach,
too; processes that talk by pipes (:class:`rpctl.study.executor.ProcessExecutor`) are reached by
nobody. A scheduler on a network needs Dask's TLS: start all parts with ``--tls-ca-file``,
``--tls-cert`` and ``--tls-key``, give the address as ``tls://HOST:PORT``, and the same files as
``security`` or in the environment (``DASK_DISTRIBUTED__COMM__TLS__CA_FILE``,
``...__CLIENT__CERT``, ``...__CLIENT__KEY``).

**What a chunk costs.** As ``python -m tests.bench.test_cluster`` found on a virtual machine of two
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

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from types import TracebackType
from typing import Any, TypeVar

from rpctl.errors import RpctlError
from rpctl.study.chunk_worker import FinishedChunk, RefusedWorker
from rpctl.study.dask_client import (
    check_workers,
    connect,
    kill_workers,
    local_cluster,
    worker_fault,
)
from rpctl.study.executor import LostChunksError
from rpctl.study.given_chunks import GOING, GivenChunks, LostChunk, digest, scheduler_there
from rpctl.study.versions import installed

CLOSE_S = 10.0  # s that a local cluster may take to end

Chunk = TypeVar("Chunk")
Result = TypeVar("Result")


class DaskExecutor:
    """Runs chunks on the workers of a Dask scheduler, which may come and go.

    Args:
        address: Of the scheduler, as ``tcp://10.0.0.1:8786``; None starts a cluster of own
            processes, which listens on loopback only.
        workers: How many processes of one thread an own cluster has.
        security: ``distributed.Security`` with the certificates of a ``tls://`` scheduler; None
            takes what Dask is configured with (``DASK_DISTRIBUTED__COMM__TLS__CA_FILE``, ...).
        tell: Called with what a user should know: a worker that was refused.

    Raises:
        RpctlError: Dask is not installed, no scheduler answers, no worker joins, or workers have
            other versions than this process.
    """

    def __init__(
        self,
        address: str | None = None,
        workers: int = 1,
        security: Any = None,
        tell: Callable[[str], object] | None = None,
    ) -> None:
        if workers < 1:
            raise RpctlError(f"{workers} workers; give 1 or more")
        self._tell = tell or (lambda text: print(text, file=sys.stderr))
        self._cluster: Any = None
        self._client: Any = None
        self._at_work = False
        self._refused: set[str] = set()  # addresses of workers that were sent away
        self._sent = ""  # name of the work that the workers hold
        try:
            if address is None:
                self._cluster = local_cluster(workers)
                address = self._cluster.scheduler_address
            self._client = connect(address, security)
            check_workers(self._client)
        except BaseException:
            self.close()
            raise

    @property
    def workers(self) -> int:
        """How many chunks run at a time, now."""
        return sum(self._client.nthreads().values())

    def __enter__(self) -> DaskExecutor:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the scheduler; an own cluster ends, whatever it does."""
        if self._client is not None:
            self._forget()
            self._client.close()
        if self._cluster is not None:
            with suppress(TimeoutError):  # of a busy machine; they end with this process, too
                if self._at_work:
                    self._cluster.sync(kill_workers, self._cluster)
            with suppress(TimeoutError):
                self._cluster.close(CLOSE_S)

    def map_chunks(
        self, work: Callable[[Chunk], Result], chunks: Iterable[Chunk]
    ) -> Iterator[tuple[Chunk, Result]]:
        """Yield each chunk and its result, as they end; see :class:`rpctl.study.executor.Executor`.

        If all workers leave, it waits for others.
        """
        given = GivenChunks(self._client, self._send(work), chunks)
        self._at_work = True
        lost: list[Chunk] = []
        reason = ""
        try:
            given.fill()
            while given.chunks:
                ended = given.ended()
                given.fill()  # before the caller works on what ended
                for chunk, answer in ended:
                    if isinstance(answer, FinishedChunk):
                        yield chunk, answer.result
                    elif isinstance(answer, RefusedWorker):
                        self._refuse(answer)
                        given.give(chunk)
                    elif isinstance(answer, LostChunk):
                        lost, reason = [*lost, chunk], answer.reason
                    else:
                        raise answer
        finally:
            self._at_work = bool(given.chunks)
            given.cancel()
        if lost:
            raise LostChunksError(lost, reason)

    def _send(self, work: Callable[..., Any]) -> str:
        """Send work to all workers, also those that join later; return its name there.

        No task depends on it: the scheduler would rather wait for a worker that holds it than give
        a chunk to one that does not.
        """
        from rpctl.study.dask_worker import SentWork  # imports Dask

        sent = SentWork(work, installed())
        name = f"rpctl-{digest(sent.packed)}"
        if name != self._sent:
            self._forget()
            with scheduler_there():
                self._client.register_plugin(sent, name=name)
            self._sent = name
        return name

    def _forget(self) -> None:
        """Have workers forget the work that they hold."""
        if self._sent:
            with suppress(*GOING):
                self._client.unregister_worker_plugin(self._sent)
        self._sent = ""

    def _refuse(self, refused: RefusedWorker) -> None:
        """Have a worker leave that joined with other versions, and say so once."""
        if refused.address in self._refused:  # it had another chunk before it left
            return
        self._refused.add(refused.address)
        self._client.retire_workers([refused.address])
        self._tell(f"{worker_fault(refused.address, refused.differences)}; it was sent away")
