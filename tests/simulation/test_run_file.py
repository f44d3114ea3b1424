"""The file of a run: packed without a loss, read by NumPy alone, in half the room if asked for."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot, RpctlError, Run, track, verify
from rpctl.arrays import Array
from rpctl.errors import RunFileError, UnknownNameError
from rpctl.simulation import packed, run_file
from rpctl.simulation.log import Log
from rpctl.simulation.run import ENTRIES, entries_of
from rpctl.simulation.run_file import ARRAY_ENTRIES
from rpctl.simulation.run_schema import ARRAYS, META
from tests.runs import vary


@pytest.fixture(scope="module")
def run(paper: Robot) -> Run:
    return track(paper, "eight", 0.2, (0.1, 0.0, 0.0), certificate=verify(paper, samples=1))


def assert_equal(first: Run, second: Run) -> None:
    """Assert that two runs hold the same, bit by bit."""
    (meta, arrays), (other_meta, other_arrays) = entries_of(first), entries_of(second)
    assert json.dumps(meta, default=list) == json.dumps(other_meta, default=list)
    for name, array in arrays.items():
        assert array.shape == other_arrays[name].shape, name
        assert np.ascontiguousarray(array).tobytes() == other_arrays[name].tobytes(), name


def numpy_alone(path: Path, name: str) -> Array:
    """Return an array of a run's file by the lines of run_file's docstring, and nothing else."""
    lines = dedent(str(run_file.__doc__).partition("NumPy alone reads it::\n")[2])
    lines = lines.replace('"run.npz"', repr(str(path))).replace('["q"]', f'["{name}"]')
    found: dict[str, Any] = {"np": np, "json": json}
    exec(lines, found)
    return np.asarray(found["q"])


def test_every_entry_has_a_kind() -> None:
    assert {item.name for item in fields(Log)} - {"bound_limits"} == set(ARRAYS) == ARRAY_ENTRIES
    assert META.keys() | ARRAYS.keys() == ENTRIES.keys()
    assert not META.keys() & ARRAYS.keys()


def test_numpy_alone_reads_every_array(run: Run, tmp_path: Path) -> None:
    for precision in ("double", "single"):
        path = run.save(tmp_path / "run.npz", precision)
        with np.load(path, allow_pickle=False) as stored:
            assert set(stored) == {"meta", "columns"}
        back = Run.load(path)
        for name in ("t", "q", "e", "ee", "steering", "work", "contact_load"):
            there = numpy_alone(path, name)
            here = getattr(back.log, name)
            assert there.shape == here.shape
            np.testing.assert_array_equal(there.view(np.int64), here.view(np.int64))


def test_equal_columns_are_kept_once_and_errors_not_at_all(run: Run, tmp_path: Path) -> None:
    path = run.save(tmp_path / "run.npz")
    with np.load(path) as stored:
        meta, planes = json.loads(str(stored["meta"])), stored["columns"]
    columns = {name: each["columns"] for name, each in meta["columns"].items()}
    assert columns["t"] == [[0]]
    assert columns["joints"] == [columns["q"][k] for k in (4, 5)]
    assert columns["rates"][2:] == columns["nu"][2:]
    joints = zip(columns["joints_ref"], columns["joints"], strict=True)
    assert columns["e"][3:] == [[*wanted, *actual] for wanted, actual in joints]
    numbers = {number for each in columns.values() for of in each for number in of}
    assert sorted(numbers) == list(range(len(planes)))
    assert len(planes) < sum(map(len, columns.values())) - 10
    assert_equal(Run.load(path), run)


def test_a_difference_that_is_none_is_kept(run: Run, tmp_path: Path) -> None:
    """One bit of one sample, and zero of the other sign, are enough."""
    for value in (np.nextafter(run.log.e[3, 4], 1.0), -0.0):
        wrong = run.log.e.copy()
        wrong[3, 4] = value
        varied = vary(run, e=wrong)
        assert_equal(Run.load(varied.save(tmp_path / "run.npz")), varied)


def test_few_columns_at_a_time_give_the_same_file(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run.save(tmp_path / "run.npz").read_bytes()
    monkeypatch.setattr(packed, "GROUP_BYTES", 1)
    assert run.save(tmp_path / "run.npz").read_bytes() == whole
    assert_equal(Run.load(tmp_path / "run.npz"), run)


def test_single_precision_rounds_all_but_the_time(run: Run, tmp_path: Path) -> None:
    double = run.save(tmp_path / "double.npz")
    single = run.save(tmp_path / "single.npz", "single")
    back = Run.load(single)
    for name, here in entries_of(run)[1].items():
        wanted = here if name == "t" else here.astype(np.float32).astype(np.float64)
        np.testing.assert_array_equal(getattr(back.log, name), wanted)
    sizes = [path.stat().st_size for path in (single, double)]
    assert sizes[0] < 0.8 * sizes[1]
    with np.load(single) as stored:
        assert json.loads(str(stored["meta"]))["precision"] == "single"


def test_single_precision_is_refused_where_it_does_not_do(run: Run, tmp_path: Path) -> None:
    large = vary(run, energy=np.full(len(run.t), 1e39))
    with pytest.raises(RpctlError, match='"energy" is too large for single precision'):
        large.save(tmp_path / "run.npz", "single")
    assert not list(tmp_path.iterdir())
    assert_equal(Run.load(large.save(tmp_path / "run.npz")), large)
    with pytest.raises(UnknownNameError, match="precision 'half' is not known"):
        run.save(tmp_path / "half.npz", "half")


def test_a_run_of_schema_4_comes_back() -> None:
    """The file was written by the version before."""
    back = Run.load(Path(__file__).with_name("run_schema_4.npz"))
    assert back.config.run.duration == pytest.approx(0.02)
    assert back.robot.name == "paper"
    assert rpctl.summarize(back).limits_violated == ()
    assert back.log.e.shape == (len(back.t), 5)
    wheels = ("wheel_left_joint", "wheel_right_joint")
    assert back.log.bound_limits == tuple((wheel, "effort") for wheel in wheels)


def test_a_run_of_schema_5_comes_back(tmp_path: Path) -> None:
    """Written by the version before: no collisions, an ideal robot. One of today says all that."""
    path = Path(__file__).with_name("run_schema_5.npz")
    back = Run.load(path)
    assert back.config.run.duration == pytest.approx(0.02)
    assert back.config.run.initial_error == (0.1, 0.3, 0.3)
    assert back.collisions is None
    summary = rpctl.summarize(back)
    assert (summary.collisions, summary.clearances) == ((), ())
    assert_equal(Run.load(back.save(tmp_path / "run.npz")), back)
    assert (back.robot.losses, back.robot.armature) == (False, None)
    np.testing.assert_array_equal(back.log.lost, np.zeros(len(back.t)))
    with np.load(path) as file:
        text, columns = str(file["meta"]), file["columns"]
    damaged = tmp_path / "damaged.npz"
    np.savez(damaged, meta=np.array(text.replace('"schema": 5', '"schema": 6')), columns=columns)
    with pytest.raises(
        RunFileError, match="not known: armature, collisions, law_sentences, losses, rec"
    ):
        Run.load(damaged)
