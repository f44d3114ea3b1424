"""A Dask scheduler and workers as a user starts them: processes of their own, on loopback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import rpctl

LOOPBACK = "127.0.0.1"
STARTED_S = 30.0


class DaskProcesses:
    """A scheduler, and the workers that tests start; a context that ends these and no others.

    Args:
        folder: Where they run; nothing of the project lies there.

    Attributes:
        address: The scheduler's.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        self.start("scheduler", "--host", LOOPBACK, "--port", "0", "--dashboard-address",
                   f"{LOOPBACK}:0", "--scheduler-file", str(file))  # fmt: skip
        self.address = read_address(file)

    def start_worker(self, *words: str, path: Path | None = None) -> subprocess.Popen[bytes]:
        """Start a worker; ``path`` comes before all others where it looks for modules."""
        return self.start(
            "worker", self.address, "--host", LOOPBACK, "--nthreads", "1", "--no-dashboard",
            *(words or ("--no-nanny",)), path=path,
        )  # fmt: skip

    def start(self, *words: str, path: Path | None = None) -> subprocess.Popen[bytes]:
        root = Path(rpctl.__file__).parents[1]
        paths = [str(each) for each in (path, root) if each is not None]
        environment: Mapping[str, str] = {
            **os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1",
        }  # fmt: skip
        with (self.folder / f"{words[0]}-{len(self.processes)}.log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *words], cwd=self.folder, env=environment,
                stdout=log, stderr=log,
            )  # fmt: skip
        self.processes.append(process)
        return process

    def __enter__(self) -> DaskProcesses:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


def read_address(file: Path) -> str:
    """Return the scheduler's address, once it has written it."""
    deadline = time.monotonic() + STARTED_S
    while not (file.exists() and file.read_text().endswith("}")):
        assert time.monotonic() < deadline, "no scheduler"
        time.sleep(0.05)
    return str(json.loads(file.read_text())["address"])
