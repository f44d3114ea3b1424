"""A Dask worker's side of a study: the work that it holds, and what it answers."""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

from distributed import WorkerPlugin, get_worker

from rpctl.errors import RpctlError
from rpctl.study.chunk_worker import FinishedChunk, RefusedWorker, portable
from rpctl.study.versions import differences, installed

COMPRESSION = 1  # of zlib: a robot is text, for the most part


class SentWork(WorkerPlugin):
    """The work of a study, on each worker from when it joins until the study ends.

    Args:
        work: What runs a chunk.
        asked: The versions of who asks.
    """

    def __init__(self, work: Callable[[Any], Any], asked: Mapping[str, str]) -> None:
        self.packed = zlib.compress(pickle.dumps(work, pickle.HIGHEST_PROTOCOL), COMPRESSION)
        self._asked = dict(asked)

    @cached_property
    def _work(self) -> Callable[[Any], Any]:
        """The work; it is loaded once, however many chunks it gets."""
        work: Callable[[Any], Any] = pickle.loads(zlib.decompress(self.packed))
        return work

    def run(self, address: str, chunk: bytes) -> Any:
        """Return the answer to a chunk; nothing is unpickled unless all versions are the same.

        Args:
            address: Of this worker.
            chunk: The chunk, pickled.
        """
        if wrong := differences(installed(), self._asked):
            return RefusedWorker(address, wrong)
        try:
            return FinishedChunk(self._work(pickle.loads(chunk)))
        except RpctlError as error:
            return portable(error)  # without Dask's traceback


def run_sent(name: str, chunk: bytes) -> Any:
    """Run a chunk of the work that this worker holds under a name; see :meth:`SentWork.run`."""
    worker = get_worker()
    sent: Any = worker.plugins[name]
    return sent.run(worker.address, chunk)
