"""Confined processes for all meshes: started when one is read, ended when none is any more."""

from __future__ import annotations

import atexit
import hashlib
import os
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rpctl.description.meshes.paths import MeshError
from rpctl.description.urdf.findings import excerpt
from rpctl.files.array_messages import pack, unpack
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.worker import Worker, WorkerError
from rpctl.kernels.cache import cached, sources

WORKER = "rpctl.description.meshes.worker"
LIFE_S = 3600.0  # s of processor time of one process, however many meshes it reads
IDLE_S = 10.0  # s after which a process that nobody asks ends: it holds .1 GB
TRIANGLE_BYTES = 3 * 24 + 12  # of an answer: three vertices and their numbers
MORE_BYTES = 2**20  # of an answer, whatever the mesh
MAX_FAULT = 400  # characters of a fault

Answer = tuple[dict[str, Any], list[Any]]
INHERITED: list[MeshService] = []  # of a parent process: not ours to ask or to end


class StalledMeshError(MeshError):
    """A mesh that took too long, or ended the process that reads meshes."""


class MeshService:
    """Asks a process, and starts another one when a mesh has ended it.

    Args:
        module: What the process runs.
    """

    def __init__(self, module: str) -> None:
        self._module = module
        self._lock = threading.Lock()
        self._worker: Worker | None = None
        self._asked = 0.0  # when it was last asked, s

    def ask(self, request: bytes) -> bytes:
        """Return the answer to a message, which is one, too.

        Raises:
            StalledMeshError: It took too long, or ended the process.
            MeshError: The mesh is refused, or there is no process to read it.
        """
        most = cap("MAX_MESH_TRIANGLES") * TRIANGLE_BYTES + MORE_BYTES
        with self._lock:
            try:
                answer = self._ask(request, most)
                head, _ = unpack(answer)
            except ValueError:
                self.close()
                raise StalledMeshError("not readable: the reading process ended") from None
            except BaseException:
                self.close()  # half of an answer may be under way
                raise
        if "fault" in head:  # foreign text, too
            raise MeshError("".join(filter(str.isprintable, str(head["fault"])))[:MAX_FAULT])
        return answer

    def _ask(self, request: bytes, most: int) -> bytes:
        """Return the process's answer; one that was idle may have ended, and is replaced."""
        worker, self._worker = self._worker, None
        if worker is not None:
            try:
                return self._ask_worker(worker, request, most)
            except StalledMeshError:
                if time.monotonic() - self._asked >= cap("MAX_MESH_SECONDS"):
                    raise
        return self._ask_worker(self._start(), request, most)

    def _ask_worker(self, worker: Worker, request: bytes, most: int) -> bytes:
        """Return one process's answer; without one it is ended."""
        self._asked = time.monotonic()
        seconds = cap("MAX_MESH_SECONDS")
        try:
            worker.grant(seconds)
            worker.send(request)
            answer = worker.receive(most)
            worker.grant(IDLE_S)
        except WorkerError as error:
            worker.close()
            fault, bound = f"it takes over {seconds} s", "MAX_MESH_SECONDS"
            if not error.late:
                fault = f"the reading process ended ({excerpt(str(error))}), perhaps out of memory"
                bound = "MAX_MESH_MEMORY"
            raise StalledMeshError(f"refused: {fault}; {how_to_raise(bound)}") from None
        except BaseException:
            worker.close()
            raise
        self._worker = worker
        return answer

    def _start(self) -> Worker:
        try:
            return Worker(self._module, cap("MAX_MESH_MEMORY"), LIFE_S)
        except WorkerError as error:
            raise MeshError(f"not read: {excerpt(str(error))}; meshes need a process") from None

    def close(self) -> None:
        """End the process, if there is one."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close()


SERVICE = MeshService(WORKER)


def ask(job: str, head: Mapping[str, Any], arrays: Sequence[Any]) -> Answer:
    """Return the answer to a job: of the process that does it, or from disk where it ever was.

    Args:
        job: One of ``rpctl.description.meshes.worker.JOBS``.

    Raises:
        MeshError: There is none, as of :meth:`MeshService.ask`.
    """
    request = pack({"job": job, **head}, arrays)
    key = hashlib.sha256(sources().encode() + request)
    return unpack(cached(key.digest(), lambda: SERVICE.ask(request)))


def close() -> None:
    """End the process."""
    SERVICE.close()


def _forget() -> None:
    global SERVICE
    INHERITED.append(SERVICE)
    SERVICE = MeshService(WORKER)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
atexit.register(close)
