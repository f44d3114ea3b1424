"""Robots that many tests share; loading is fast, but once is enough."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rpctl import Robot, Run
from tests.catalogue import robot_of
from tests.drive.drive_cases import Files
from tests.golden import golden_run, load_tricycle

# A shell lets what it runs in the background ignore Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Leave what is imported and collected out of garbage collection: it costs a fifth."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000)


@pytest.fixture(scope="session", autouse=True)
def cache_of_the_session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep machine code in a folder of this session's, which its workers share."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RPCTL_CACHE_DIR", str(folder / "cache"))
        yield


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


@pytest.fixture(scope="session")
def tiago() -> Robot:
    return robot_of("tiago")


@pytest.fixture(scope="session")
def paper() -> Robot:
    return robot_of("paper")


@pytest.fixture(scope="session")
def mixed_chain() -> Robot:
    return robot_of("mixed_chain")


@pytest.fixture(scope="session")
def tricycle(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """The robot of the log that is written by hand."""
    return load_tricycle(tmp_path_factory.mktemp("golden"))


@pytest.fixture(scope="session")
def golden(tricycle: Robot) -> Run:
    """The log that is written by hand: each figure of it is known."""
    return golden_run(tricycle)


@pytest.fixture(scope="session", params=["paper", "mixed_chain", "tiago"])
def robot(request: pytest.FixtureRequest) -> Robot:
    """Each robot that the properties of the dynamics must hold for."""
    return robot_of(request.param)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20210601)
