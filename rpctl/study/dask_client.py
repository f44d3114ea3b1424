"""A client of a Dask scheduler, whose workers compute with the versions of this process."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import Any

from rpctl.errors import RpctlError
from rpctl.libraries import library
from rpctl.study.chunk_worker import for_children
from rpctl.study.versions import (
    ABSENT,
    CODE,
    PACKAGES,
    PYTHON,
    code_digest,
    differences,
    installed,
    minor,
)

INSTALL = "pip install 'rpctl[cluster]'"
CONNECT_S = 10.0  # s in which a scheduler has to answer
JOIN_S = 60.0  # s in which a first worker has to join
KILL_S = 1.0  # s that a worker of an own cluster may take to end
LOOPBACK = "127.0.0.1"
MAX_SHOWN = 10  # workers that a message names


def check_workers(client: Any) -> None:
    """Refuse workers that compute with other versions than this process.

    Args:
        client: ``distributed.Client``.

    Raises:
        RpctlError: Naming the workers, the packages and both versions.
    """
    here = installed()
    faults = []
    for address, found in client.get_versions(packages=list(PACKAGES))["workers"].items():
        packages = {name: found["packages"][name] or ABSENT for name in PACKAGES}
        there = {PYTHON: minor(found["host"]["python"]), **packages}
        wrong = differences(there, here)
        faults += [worker_fault(address, wrong)] if wrong else []
    if not faults:
        for address, code in client.run(code_digest, on_error="return").items():
            wrong = differences({CODE: str(code)}, here)
            faults += [worker_fault(address, wrong)] if wrong else []
    if faults:
        more = [f"and {len(faults) - MAX_SHOWN} more workers"] if len(faults) > MAX_SHOWN else []
        raise RpctlError("\n".join([*faults[:MAX_SHOWN], *more]))


def worker_fault(address: str, wrong: Sequence[str]) -> str:
    """Return the sentence on a worker of other versions."""
    return f"worker {address} has {'; '.join(wrong)}; install the same versions on all machines"


def local_cluster(workers: int) -> Any:
    """Return a cluster of processes of one thread each that listens on loopback only."""
    distributed = _distributed()
    with for_children():  # a thread that it starts now starts them
        return distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:0",
            silence_logs=logging.ERROR,  # what it says of a worker is said by LostChunksError
        )


async def kill_workers(cluster: Any) -> None:
    """End the processes of a cluster, at work or not."""
    logging.getLogger("distributed.nanny").setLevel(logging.CRITICAL)  # it is meant to be so
    await asyncio.gather(*(nanny.kill(timeout=KILL_S) for nanny in cluster.workers.values()))


def connect(address: str, security: Any) -> Any:
    """Return a client of a scheduler that has at least one worker.

    Args:
        address: Of the scheduler.
        security: What authenticates this process, or None.

    Raises:
        RpctlError: No scheduler answers, or no worker joins.
    """
    distributed = _distributed()
    try:
        client = distributed.Client(
            address, timeout=CONNECT_S, security=security, set_as_default=False
        )
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).partition("\n")[0]
        raise RpctlError(
            f"{address}: no scheduler answers ({reason}); start one with `dask scheduler`, and "
            "give its address as tcp://HOST:PORT"
        ) from None
    try:
        client.wait_for_workers(1, timeout=JOIN_S)
    except TimeoutError:
        client.close()
        raise RpctlError(
            f"{address}: no worker has joined in {JOIN_S:g} s; start some with "
            f"`dask worker {address} --nthreads 1`"
        ) from None
    return client


def _distributed() -> Any:
    """Return Dask's library.

    Raises:
        RpctlError: It is not installed.
    """
    try:
        return library("distributed")
    except ModuleNotFoundError as error:
        if error.name not in ("dask", "distributed"):
            raise
        raise RpctlError(f"more machines need distributed; {INSTALL}") from None
