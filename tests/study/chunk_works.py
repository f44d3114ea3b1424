"""Work for the tests of executors: other processes import it."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import UnknownNameError


class Runs(NamedTuple):
    """A chunk of runs, by their numbers."""

    first: int
    stop: int

    def __str__(self) -> str:
        return f"runs {self.first} to {self.stop - 1}"


def chunks_of(count: int, size: int = 10) -> list[Runs]:
    """Return chunks of ``size`` runs each."""
    return [Runs(first, first + size) for first in range(0, count * size, size)]


def draw(seconds: float, chunk: Runs) -> Array:
    """Return numbers (runs, 3) that depend on each run's number only, after a while."""
    time.sleep(seconds)
    runs = range(chunk.first, chunk.stop)
    return np.array([np.random.default_rng([7, run]).normal(size=3) for run in runs])


def draw_and_log(folder: Path, seconds: float, chunk: Runs) -> Array:
    """As :func:`draw`; leaves the process's id in a file when it begins."""
    (folder / f"{chunk.first}-{os.getpid()}").touch()
    return draw(seconds, chunk)


def dies_of(first: Sequence[int], folder: Path, times: int, chunk: Runs) -> Array:
    """As :func:`draw`; chunks that begin with ``first`` kill their process so many times."""
    found = len(list(folder.glob(f"{chunk.first}-*")))
    (folder / f"{chunk.first}-{found}").touch()
    if chunk.first in first and found < times:
        os.kill(os.getpid(), 9)
    return draw(0.0, chunk)


def refuses(first: int, chunk: Runs) -> Array:
    """As :func:`draw`; one chunk raises an error that is made of more than its message."""
    if chunk.first == first:
        raise UnknownNameError("law", "papr", ["paper", "unified"])
    return draw(0.0, chunk)


def divides(chunk: Runs) -> float:
    """Raise what nobody expects."""
    return 1 / (chunk.first - chunk.first)


def threads(chunk: Runs) -> tuple[str | None, int]:
    """Return what libraries are told of threads, and the process's id."""
    return os.environ.get("OMP_NUM_THREADS"), os.getpid()


class Loaded:
    """Counts how often it comes out of a pickle in this process."""

    count = 0

    def __init__(self, size: int = 2**20) -> None:
        self.ballast = b"x" * size  # more than a pipe holds

    def __setstate__(self, state: dict[str, bytes]) -> None:
        type(self).count += 1
        self.ballast = state["ballast"]

    def __call__(self, chunk: Runs) -> tuple[int, int]:
        """Return the process's id and how often it has loaded this."""
        return os.getpid(), type(self).count
