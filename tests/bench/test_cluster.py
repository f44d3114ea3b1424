"""What a chunk of a study costs on a cluster, and what follows for many machines.

``python -m tests.bench.test_cluster`` prints what is sent, what a scheduler, a client and a worker
spend on a chunk and on its bytes (processor time, so that a busy machine changes little), how many
workers that feeds, and a study with 1 and 2 workers and with Dask. It takes two minutes.
"""

from __future__ import annotations

import pickle
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from pytest_benchmark.fixture import BenchmarkFixture

import rpctl
from rpctl.robot.model import Robot
from rpctl.study.cluster import DaskExecutor
from rpctl.study.dask_worker import SentWork
from rpctl.study.executor import Executor, ProcessExecutor, SerialExecutor
from rpctl.study.run_chunk import RunChunk, run_chunk, task_of
from rpctl.study.study import run_study
from rpctl.study.study_file import read_study
from rpctl.study.versions import installed
from tests.study.chunk_works import Empty, answer
from tests.study.dask_processes import DaskProcesses

STUDY = """
[study]
count = {count}
duration = 5.0

[run]
reference = "eight"

[scatter]
"run.initial_error.x" = {{ normal = [0.0, 0.05] }}
"run.initial_error.y" = {{ normal = [0.0, 0.05] }}
"run.initial_error.theta" = {{ normal = [0.0, 0.1] }}
"plant.delay" = {{ choice = [0.0, 0.002, 0.004] }}
"""
RUNS = 256  # of the chunk that is weighed
TASKS = 2000  # that only cost what a task costs
BIG, BIG_TASKS = 2**20, 150  # bytes of a result, and tasks with one
GIGABIT = 125e6  # bytes/s


class Cost(NamedTuple):
    """Processor time of each process, s."""

    scheduler: float
    client: float
    worker: float

    def __sub__(self, other: Any) -> Cost:
        return Cost(*(mine - its for mine, its in zip(self, other, strict=True)))

    def per(self, count: float) -> Cost:
        """Return the share of one of ``count``."""
        return Cost(*(each / count for each in self))


@contextmanager
def dask(workers: int) -> Iterator[tuple[DaskExecutor, Callable[[], Cost]]]:
    """Yield an executor on processes of their own, and what returns their costs so far."""
    with tempfile.TemporaryDirectory() as folder, DaskProcesses(Path(folder)) as processes:
        for _ in range(workers):
            processes.start_worker()
        pids = [process.pid for process in processes.processes]

        def spent() -> Cost:
            times = [sum(psutil.Process(pid).cpu_times()[:2]) for pid in pids]
            return Cost(times[0], time.process_time(), sum(times[1:]))

        with DaskExecutor(processes.address) as executor:
            while executor.workers < workers:
                time.sleep(0.05)
            yield executor, spent


def spent_on(work: Callable[[Empty], Any], count: int) -> tuple[Cost, float]:
    """Return what tasks cost, and how long they took, s."""
    with dask(2) as (executor, spent):
        chunks = [Empty(number) for number in range(count)]
        list(executor.map_chunks(work, chunks[:100]))  # imports, first connections
        before, began = spent(), time.perf_counter()
        for _ in executor.map_chunks(work, chunks):
            pass
        return spent() - before, time.perf_counter() - began


def chunk_of(robot: Robot, runs: int, folder: Path) -> tuple[Any, RunChunk]:
    """Return the work of a study of a robot, and a chunk of it."""
    path = folder / "study.toml"
    path.write_text(STUDY.format(count=runs))
    study = read_study(path, robot)
    rows = np.arange(runs)
    return partial(run_chunk, task_of(robot, study.experiment)), RunChunk(rows, rows, study.values)


def print_chunk(robot: Robot, folder: Path, measured: int) -> None:
    """Print the bytes and the time of a chunk of :data:`RUNS` runs; some of them are measured."""
    work, chunk = chunk_of(robot, RUNS, folder)
    sent = SentWork(work, installed())
    part = RunChunk(chunk.rows[:measured], chunk.indices[:measured], chunk.values[:measured])
    began = time.process_time()
    loaded = pickle.loads(pickle.dumps(work))
    loaded(RunChunk(chunk.rows[:1], chunk.indices[:1], chunk.values[:1]))
    first = time.process_time() - began
    began = time.process_time()
    result = loaded(part)
    run = (time.process_time() - began) / measured
    bytes_run = len(pickle.dumps(result, 5)) / measured
    print(
        f"{robot.name:20}{len(sent.packed) / 1e3:10.1f} kB{len(pickle.dumps(chunk, 5)) / 1e3:10.1f}"
        f" kB{RUNS * bytes_run / 1e3:10.1f} kB{first - run:11.2f} s{RUNS * run:11.2f} s"
    )


def print_scaling(task: Cost, byte: Cost) -> None:
    """Print how many workers are fed, by the time of a chunk and the bytes of its result."""
    print(f"\n{'chunk':>8}{'result':>10}{'scheduler':>12}{'client':>10}{'1 Gbit/s':>10}  workers")
    for seconds in (0.1, 1.0, 10.0, 60.0):
        for size in (1e4, 6e5):
            costs = [task[k] + byte[k] * size for k in (0, 1)]
            fed = [seconds / cost for cost in costs] + [seconds * GIGABIT / size]
            print(
                f"{seconds:6.1f} s{size / 1e3:7.0f} kB{fed[0]:12.0f}{fed[1]:10.0f}{fed[2]:10.0f}"
                f"  {min(fed):.0f}"
            )


def study_seconds(robot: Robot, count: int, folder: Path) -> dict[str, float]:
    """Return how long a study takes with each executor, starting them included, s of wall time.

    Args:
        robot: The robot.
        count: Number of runs, 5 s each.
        folder: Where the results go, one folder for each executor.
    """
    path = folder / "study.toml"
    path.write_text(STUDY.format(count=8))  # builds the loop, which all find on disk
    with SerialExecutor() as first:
        run_study(robot, read_study(path, robot), folder / "first", first)
    path.write_text(STUDY.format(count=count))
    study = read_study(path, robot)
    executors: dict[str, Callable[[], Executor]] = {
        "this process": SerialExecutor,
        "1 process": lambda: ProcessExecutor(1),
        "2 processes": lambda: ProcessExecutor(2),
        "Dask, 2 processes": lambda: DaskExecutor(workers=2),
    }
    files, found = set(), {}
    for name, make in executors.items():
        began = time.perf_counter()
        with make() as executor:
            out = folder / name / robot.name
            files.add(run_study(robot, study, out, executor).read_bytes())
        found[name] = time.perf_counter() - began
    assert len(files) == 1, "results depend on the executor"
    return found


def print_study(robot: Robot, count: int, folder: Path) -> None:
    """Print how long a study takes with each executor, starting them included."""
    print(f"\n{count} runs of {robot.name}, 5 s each")
    for name, took in study_seconds(robot, count, folder).items():
        print(f"{name:20}{took:8.1f} s{count / took:10.1f} runs/s")


def test_a_chunk_through_a_process(benchmark: BenchmarkFixture) -> None:
    """What a chunk costs that holds no work."""
    with ProcessExecutor(1) as executor:
        list(executor.map_chunks(partial(answer, 8), [Empty(0)]))
        chunks = [Empty(number) for number in range(100)]
        benchmark(lambda: list(executor.map_chunks(partial(answer, 8), chunks)))


def main() -> None:
    robots = [rpctl.load("paper"), rpctl.load("tiago")]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(f"a chunk of {RUNS} runs of 5 s, 200 samples of each kept; load: once a worker")
        print(
            f"{'robot':20}{'sent once':>13}{'a chunk':>13}{'its result':>13}{'load':>12}{'run':>12}"
        )
        for robot in robots:
            print_chunk(robot, folder, 8)
        task, took = spent_on(partial(answer, 8), TASKS)
        task = task.per(TASKS)
        print(f"\na task without work, 2 workers: {1e3 * took / TASKS:.2f} ms of wall time")
        big, took = spent_on(partial(answer, BIG), BIG_TASKS)
        byte = (big - task.per(1 / BIG_TASKS)).per(BIG * BIG_TASKS)
        print(f"{BIG_TASKS * BIG / took / 1e6:.0f} MB/s of results, all on this machine")
        print(f"{'':20}{'scheduler':>12}{'client':>12}{'worker':>12}")
        print(f"{'ms a task':20}" + "".join(f"{1e3 * each:12.3f}" for each in task))
        print(f"{'ms a MB':20}" + "".join(f"{1e9 * each:12.3f}" for each in byte))
        print_scaling(task, byte)
        for robot, count in zip(robots, (192, 48), strict=True):
            print_study(robot, count, folder)


if __name__ == "__main__":
    main()
