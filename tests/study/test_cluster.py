"""Chunks on Dask: separate processes on loopback that die, come late, or are of other versions."""

from __future__ import annotations

import pickle
import socket
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import numpy as np
import pytest

from rpctl import load
from rpctl.errors import RpctlError
from rpctl.study import cluster
from rpctl.study.cluster import DaskExecutor, check_workers, run_asked
from rpctl.study.executor import LostChunksError
from rpctl.study.store import CODE, installed
from rpctl.study.study import run_study
from rpctl.study.study_file import read_study
from tests.study import chunk_works
from tests.study.chunk_works import Runs, chunks_of, draw
from tests.study.dask_processes import DaskProcesses

ABSENT_ADDRESS = "tcp://127.0.0.1:9"  # discard: nobody listens there


@pytest.mark.parametrize("name", ["numpy", "python", CODE])
def test_a_worker_of_another_version_is_refused(name: str) -> None:
    """Named are its address, what differs, and both versions; not the workers that fit."""
    workers = {"tcp://a:1": installed(), "tcp://b:2": installed() | {name: "0.1"}}
    client = SimpleNamespace(run=lambda function, on_error: workers)
    with pytest.raises(RpctlError) as error:
        check_workers(client)
    assert str(error.value) == (
        f"worker tcp://b:2 has {name} 0.1, here {installed()[name]}; "
        "install the same versions on all machines"
    )


def test_a_worker_of_other_versions_unpickles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may have joined after the others were checked."""
    dask = SimpleNamespace(get_worker=lambda: SimpleNamespace(address="tcp://c:3"))
    monkeypatch.setattr(cluster, "library", lambda name: dask)
    refused = run_asked(b"no pickle", installed() | {"numpy": "9"}, b"no pickle")
    assert refused == (None, None, [f"numpy {np.__version__}, here 9"], "tcp://c:3")
    answer = run_asked(b"no pickle", installed(), b"no pickle")
    assert isinstance(answer.error, pickle.UnpicklingError)


def test_without_dask_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rpctl.study.experiment.find_spec", lambda name: None)
    with pytest.raises(RpctlError, match="run pip install 'distributed<"):
        DaskExecutor(ABSENT_ADDRESS)


@pytest.mark.slow
def test_an_address_without_a_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with pytest.raises(RpctlError, match="no scheduler answers") as error:
        DaskExecutor(ABSENT_ADDRESS)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("hangs_up", [True, False])
def test_a_port_that_is_no_schedulers_is_told_in_bounded_time(
    hangs_up: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes the connection and says nothing, for which Dask waits until it hangs up."""
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server:
        if hangs_up:
            Thread(target=lambda: server.accept()[0].close(), daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        why = "it closes the connection" if hangs_up else "timed out"
        with pytest.raises(RpctlError, match=rf"{address}: no scheduler answers \({why}\)"):
            DaskExecutor(address)


def test_an_address_without_a_port_is_none() -> None:
    with pytest.raises(RpctlError, match=r"nowhere: no scheduler answers \(no host and port\)"):
        DaskExecutor("nowhere")


@pytest.mark.slow
def test_a_scheduler_without_workers_is_told_while_it_is_waited_for(
    dask: DaskProcesses, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "JOIN_S", 1.0)
    told: list[str] = []
    with pytest.raises(RpctlError, match="no worker has joined in 1 s; start some with"):
        DaskExecutor(dask.address, told.append)
    assert told == [f"{dask.address}: there is no worker yet; waiting 1 s for one to join"]


@pytest.fixture
def dask(tmp_path: Path) -> Iterator[DaskProcesses]:
    with DaskProcesses(tmp_path) as processes:
        yield processes


def assert_same(found: Mapping[Runs, object], chunks: list[Runs]) -> None:
    """Assert bit for bit what one process finds."""
    assert sorted(found) == chunks
    for chunk, result in found.items():
        np.testing.assert_array_equal(result, draw(0.0, chunk))


def began(folder: Path) -> Counter[int]:
    """Return how many chunks each process has begun."""
    return Counter(int(path.name.partition("-")[2]) for path in folder.iterdir())


@pytest.mark.slow
def test_one_worker_is_killed_and_one_joins_late(dask: DaskProcesses, tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.mkdir()
    chunks, found = chunks_of(20), {}
    first, second = dask.start_worker(), None
    with DaskExecutor(dask.address) as executor:
        work = partial(chunk_works.draw_and_log, log, 0.3)
        for chunk, result in executor.map_chunks(work, iter(chunks)):
            assert chunk not in found
            found[chunk] = result
            if len(found) == 3:
                second = dask.start_worker()
                while executor.workers < 2:  # it takes long to start on a busy machine
                    time.sleep(0.05)
                first.kill()
                first.wait()
    assert_same(found, chunks)
    assert second is not None
    counts = began(log)
    assert min(counts[each.pid] for each in (first, second)) >= 1
    assert len(list(log.iterdir())) > len(chunks)  # what was killed was begun again


@pytest.mark.slow
def test_a_chunk_that_ends_each_worker_is_named(dask: DaskProcesses, tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.mkdir()
    chunks, found = chunks_of(6), {}
    dask.start_worker("--nanny")
    work = partial(chunk_works.dies_of, [10], log, 99)
    with DaskExecutor(dask.address) as executor, pytest.raises(LostChunksError) as lost:
        for chunk, result in executor.map_chunks(work, chunks):
            found[chunk] = result  # noqa: PERF403 - the last of them raises
    assert lost.value.chunks == (chunks[1],)
    assert_same(found, [chunks[0], *chunks[2:]])


STUDY = """
[study]
count = 12
duration = 0.1
chunk = 2

[run]
reference = "way.csv"

[scatter]
"run.initial_error.y" = { normal = [0.0, 0.05] }
"""


@pytest.mark.slow
def test_a_study_needs_no_file_of_the_other_machines(
    dask: DaskProcesses, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot's file is gone, and the reference's lies where workers do not look."""
    monkeypatch.chdir(tmp_path.parent)
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(load("paper").description.path.read_text())
    rows = (f"{t},{0.3 * t},0,0\n" for t in np.arange(0.0, 1.0, 0.01))
    Path("way.csv").write_text("t,x,y,theta\n" + "".join(rows))
    Path("study.toml").write_text(STUDY)
    robot = load(urdf)
    study = read_study("study.toml", robot)
    alone = run_study(robot, study, tmp_path / "alone").read_bytes()
    urdf.unlink()
    dask.start_worker()
    with DaskExecutor(dask.address) as executor:
        shared = run_study(robot, study, tmp_path / "shared", executor)
    assert shared.read_bytes() == alone


def planted(folder: Path, package: str, version: str) -> Path:
    """Return a folder that makes another version of a package appear installed."""
    place = folder / "planted" / f"{package}-{version}.dist-info"
    place.mkdir(parents=True)
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
    return place.parent


@pytest.mark.thorough
def test_a_late_worker_of_other_versions_is_sent_away(dask: DaskProcesses, tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.mkdir()
    chunks, found, bad = chunks_of(40), {}, None
    told: list[str] = []
    good = dask.start_worker()
    with DaskExecutor(dask.address, tell=told.append) as executor:
        work = partial(chunk_works.draw_and_log, log, 0.3)
        for chunk, result in executor.map_chunks(work, chunks):
            found[chunk] = result
            if bad is None:
                bad = dask.start_worker(path=planted(tmp_path, "numpy", "1.0"))
                while executor.workers < 2:  # it takes long to start on a busy machine
                    time.sleep(0.05)
    assert_same(found, chunks)
    (text,) = [each for each in told if "no worker yet" not in each]
    assert f"has numpy 1.0, here {np.__version__}; install the same" in text
    assert text.endswith("the scheduler removed it")
    assert set(began(log)) == {good.pid}
    assert bad is not None
    assert bad.wait(20.0) == 0


@pytest.mark.slow
def test_a_scheduler_that_goes_is_an_error_of_one_line(dask: DaskProcesses) -> None:
    dask.start_worker()
    with DaskExecutor(dask.address) as executor:
        with pytest.raises(RpctlError, match="the scheduler is gone") as error:
            for _ in executor.map_chunks(partial(draw, 0.1), chunks_of(100)):
                dask.processes[0].kill()
        assert error.value.__cause__ is None
