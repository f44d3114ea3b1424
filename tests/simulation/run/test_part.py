"""What is on disk while a run is simulated is a valid run, whenever the process ends."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot, RpctlError, Run
from rpctl.arrays import Array
from rpctl.control.law import Command, Efforts, Limit
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RunFileError
from rpctl.files.writing import write_atomically
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop import recorder
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.run import part as part_module
from rpctl.simulation.run.log import KEPT
from rpctl.simulation.run.part import PartWriter, chunk_files

PERIOD, COUNT = 0.002, 30
SETTINGS = RunSettings("eight", COUNT * PERIOD, (0.1, -0.2, 0.3))


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make chunks small, so that a short run has several."""
    monkeypatch.setattr(recorder, "BATCH", 4)
    monkeypatch.setattr(part_module, "CHUNK_ROWS", 8)


def law_with_limits(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
    """Return efforts that more and more limits bind."""
    speed = abs(float(nu[0]))
    kinds = [kind for n, kind in enumerate(("effort", "velocity", "lower")) if speed > 4e-3 * n]
    return Efforts(np.array([1.0, 1.0, 0.0, 0.0]), tuple(Limit("joint", kind) for kind in kinds))


def spooled(
    robot: Robot,
    folder: Path,
    watch: Callable[[LoopSample], None] | None = None,
    settings: RunSettings = SETTINGS,
) -> Run:
    with PartWriter(folder) as part:
        return simulate(
            robot, Config(run=settings, dynamic=law_with_limits), watch=watch, part=part
        )


def check_same(run: Run, whole: Run, count: int) -> None:
    """Assert that a run is the first samples of another one, bit by bit."""
    assert len(run.t) == count
    bound = run.log.bound_limits
    assert bound == whole.log.bound_limits[: len(bound)]
    for name in KEPT:
        expected = getattr(whole.log, name)[:count]
        if name == "active_limits":
            assert not expected[:, len(bound) :].any()
            expected = expected[:, : len(bound)]
        np.testing.assert_array_equal(getattr(run.log, name), expected, err_msg=name)
        assert not getattr(run.log, name).flags.writeable


def test_finished_part_is_the_run(paper: Robot, tmp_path: Path) -> None:
    run = spooled(paper, tmp_path / "run.part")
    assert len(chunk_files(tmp_path / "run.part")) == 4  # 31 samples in batches of 4
    again = Run.load(tmp_path / "run.part")
    check_same(again, run, COUNT + 1)
    assert len(run.log.bound_limits) == 3
    for name in ("robot", "ground", "config", "notes", "kinematic_report", "wall_time", "sizing"):
        assert getattr(again, name) == getattr(run, name), name
    looked_at = dataclasses.replace(again, collisions=run.collisions)  # afterwards only
    assert rpctl.summarize(looked_at) == rpctl.summarize(run)


def test_whenever_it_is_killed_what_was_written_is_a_run(paper: Robot, tmp_path: Path) -> None:
    """A copy of the folder at each sample is what a kill there leaves."""
    part, copies = tmp_path / "run.part", tmp_path / "copies"

    def watch(sample: LoopSample) -> None:
        shutil.copytree(part, copies / f"{round(sample.t / PERIOD)}")

    whole = spooled(paper, part, watch)
    for k in range(COUNT + 1):
        written = (k + 1) // 8 * 8
        if not written:
            with pytest.raises(RunFileError, match="no samples were written before"):
                Run.load(copies / f"{k}")
            continue
        run = Run.load(copies / f"{k}")
        check_same(run, whole, written)
        end = (written - 1) * PERIOD
        assert run.notes[-1] == (
            f"ended early at t = {end:.4g} of 0.06 s; the samples until then are kept"
        )
        assert run.config.run.duration == run.t[-1] == pytest.approx(end)
    assert rpctl.summarize(run).duration == pytest.approx(end)
    assert len(Run.load(run.save(tmp_path / "run.npz")).t) == written


def test_slow_laws_are_written_by_time(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(part_module, "CHUNK_SECONDS", 0.0)
    part, counts = tmp_path / "run.part", []

    def watch(sample: LoopSample) -> None:
        counts.append(len(chunk_files(part)))

    whole = spooled(paper, part, watch)
    assert counts == list(range(COUNT + 1))  # from the second, each is there before the next begins
    check_same(Run.load(part), whole, COUNT + 1)


def test_thinned_log_and_early_end_go_to_the_part(paper: Robot, tmp_path: Path) -> None:
    def watch(sample: LoopSample) -> None:
        if sample.t > 0.0389:
            raise KeyboardInterrupt

    kept: list[Run] = []
    settings = RunSettings("eight", 0.06, log_every=3)
    with pytest.raises(KeyboardInterrupt), PartWriter(tmp_path / "run.part") as part:
        simulate(paper, Config(run=settings), watch=watch, ended=kept.append, part=part)
    check_same(Run.load(tmp_path / "run.part"), kept[0], 8)  # 0, 3, ..., 18 and the last, 20
    assert kept[0].t[-1] == pytest.approx(0.04)


def test_a_full_disk_does_not_end_the_run(
    paper: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []

    def full(path: Path, data: bytes, **how: bool) -> Path:
        calls.append(path.name)
        if path.name == "000001.npz":
            raise RpctlError(f"{path.name}: cannot be written: No space left on device")
        return write_atomically(path, data, **how)

    monkeypatch.setattr(part_module, "write_atomically", full)
    run = spooled(paper, tmp_path / "run.part")
    assert calls == ["header.json", "header.json", "000000.npz", "header.json", "000001.npz"]
    assert run.notes == (
        "samples could not be saved while simulating: 000001.npz: cannot be written: No space left "
        "on device",
    )
    check_same(Run.load(tmp_path / "run.part"), run, 8)


def test_two_simulations_do_not_share_a_folder(paper: Robot, tmp_path: Path) -> None:
    part = tmp_path / "run.part"

    def watch(sample: LoopSample) -> None:
        if sample.t > 0.05:
            with pytest.raises(RpctlError, match="another simulation writes to this folder; wait"):
                PartWriter(part)
            refused.append(sample.t)

    refused: list[float] = []
    whole = spooled(paper, part, watch)
    assert refused
    check_same(Run.load(part), whole, COUNT + 1)


def test_an_older_part_is_set_aside_and_never_mixed(paper: Robot, tmp_path: Path) -> None:
    part = tmp_path / "run.part"
    older = spooled(paper, part)
    newer = spooled(paper, part, settings=RunSettings("circle", 10 * PERIOD))
    newest = spooled(paper, part, settings=RunSettings("line", 12 * PERIOD))
    for folder, run in (("run.part-1", older), ("run.part-2", newer), ("run.part", newest)):
        assert Run.load(tmp_path / folder).config == run.config
    assert newest.notes == (
        f"{tmp_path}/run.part-2 holds the samples of an earlier simulation that was "
        "stopped: view it, then remove it",
    )


def test_files_of_others_are_neither_removed_nor_taken_for_a_part(
    paper: Robot, tmp_path: Path
) -> None:
    part = tmp_path / "run.part"
    part.mkdir()
    (part / "mine.txt").write_text("mine")
    with PartWriter(part) as mine:
        simulate(paper, Config(run=SETTINGS), part=mine)
        (part / "note.txt").write_text("too")
        mine.remove()
    assert [each.name for each in part.iterdir()] == ["note.txt"]
    assert (tmp_path / "run.part-1" / "mine.txt").read_text() == "mine"


def test_nothing_is_left_of_a_run_that_ends_at_its_first_sample(
    paper: Robot, tmp_path: Path
) -> None:
    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), PartWriter(tmp_path / "out" / "run.part") as part:
        simulate(paper, Config(run=SETTINGS), watch=interrupt, part=part)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_left_where_nothing_was_simulated(paper: Robot, tmp_path: Path) -> None:
    with (
        pytest.raises(RpctlError, match="duration"),
        PartWriter(tmp_path / "out" / "run.part") as part,
    ):
        simulate(paper, Config(run=RunSettings("eight", -1.0)), part=part)
    with PartWriter(tmp_path / "run.part") as part:
        simulate(paper, Config(run=SETTINGS), part=part)
        part.remove()
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    with pytest.raises(RpctlError, match="cannot be made"):
        PartWriter(tmp_path / "file" / "run.part")


@pytest.fixture(scope="module")
def stopped(paper: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A part; a test works on a copy."""
    folder = tmp_path_factory.mktemp("stopped")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorder, "BATCH", 4)
        patch.setattr(part_module, "CHUNK_ROWS", 8)
        spooled(paper, folder / "one")
    return folder


def rewrite(chunk: Path, /, **changes: Any) -> None:
    """Write a chunk again with some of its arrays changed; None leaves one out."""
    with np.load(chunk) as stored:
        arrays = {name: stored[name] for name in stored} | changes
    buffer = io.BytesIO()
    np.savez(buffer, **{name: array for name, array in arrays.items() if array is not None})
    chunk.write_bytes(buffer.getvalue())


def remeta(part: Path, /, **changes: Any) -> None:
    meta = json.loads((part / "header.json").read_text()) | changes
    kept = {name: value for name, value in meta.items() if value != "drop"}
    (part / "header.json").write_text(json.dumps(kept))


def numbers(part: Path, name: str) -> Array:
    with np.load(part / "000001.npz") as stored:
        array: Array = stored[name]
    return array


DAMAGES: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "a chunk missing": ("000001.npz: missing", lambda p: (p / "000001.npz").unlink()),
    "the first missing": ("000000.npz: missing", lambda p: (p / "000000.npz").unlink()),
    "meta missing": ("header.json", lambda p: (p / "header.json").unlink()),
    "meta no text": ("header.json", lambda p: (p / "header.json").write_bytes(b"\xff\xfe")),
    "meta a list": ("header.json", lambda p: (p / "header.json").write_text("[]")),
    "meta lacks": ("header.json.*missing: robot", lambda p: remeta(p, robot="drop")),
    "meta wrong": ("header.json.*notes", lambda p: remeta(p, notes=3)),
    "limits": ('0000.*"active_limits" does not fit', lambda p: remeta(p, bound_limits=[])),
    "order": ('"t" does not increase', lambda p: shutil.copy(p / "000002.npz", p / "000001.npz")),
    "truncated": (
        "000001.npz: damaged",
        lambda p: os.truncate(p / "000001.npz", (p / "000001.npz").stat().st_size // 2),
    ),
    "array missing": ("000001.npz.*nu_d", lambda p: rewrite(p / "000001.npz", nu_d=None)),
    "NaN": ("000001.npz.*\"q\"", lambda p: rewrite(p / "000001.npz", q=numbers(p, "q") * np.nan)),
    "width": (
        '000001.npz.*"q" does not fit',
        lambda p: rewrite(p / "000001.npz", q=numbers(p, "q")[:, :-1]),
    ),
    "some": (
        '"nu_cmd" is missing in some',
        lambda p: rewrite(p / "000001.npz", nu_cmd=np.zeros((8, 4))),
    ),
    "objects": ("000001.npz", lambda p: rewrite(p / "000001.npz", q=np.array([{}] * 8))),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_parts_are_refused_by_file(stopped: Path, tmp_path: Path, damage: str) -> None:
    part = tmp_path / "one"
    shutil.copytree(stopped / "one", part)
    message, harm = DAMAGES[damage]
    harm(part)
    with pytest.raises(RunFileError, match=rf"{re.escape(str(part))}.*({message})") as caught:
        Run.load(part)
    assert "\n" not in str(caught.value)


def test_damaged_bytes_are_refused(stopped: Path, tmp_path: Path, rng: np.random.Generator) -> None:
    """Each entry of a chunk has a checksum; the rest is the archive's own."""
    shutil.copytree(stopped / "one", tmp_path / "one")
    chunk, whole = tmp_path / "one" / "000001.npz", Run.load(stopped / "one")
    data = chunk.read_bytes()
    for place in rng.integers(0, len(data), 12).tolist():
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(rng.integers(8))
        chunk.write_bytes(bytes(flipped))
        try:
            found = Run.load(tmp_path / "one")
        except RunFileError as error:
            assert str(chunk) in str(error)
        else:  # in what nobody reads: a date, or room between entries
            check_same(found, whole, COUNT + 1)
    assert zipfile.is_zipfile(io.BytesIO(data))
