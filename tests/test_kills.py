"""Commands killed at random moments: nothing is half-written, nothing written is lost."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rpctl
from rpctl import Run
from rpctl.errors import RunFileError
from rpctl.simulation.config import read_config
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.run.part import PART_FOLDER, chunk_files
from rpctl.view.labels import digest, mark_of
from rpctl.view.run_folder import find_faults
from tests.grids import cells

# Every kill is at another moment of the command, from its start to behind its end.
# A run is what one would miss; the others are killed before a release.
KILLS = cells((1, 50), slow=[1])
SIMULATED = ("track", "paper", "--samples", "0", "--no-perturbed", "--duration")
LONG_S, LONG_ROWS = "6", 3001  # of several chunks


def run_for(seconds: float | None, *words: str, folder: Path) -> float:
    """Run a command and kill it after a time (s), None: not at all; return what it took, s."""
    began = time.perf_counter()
    with (folder.parent / "stdout").open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "rpctl", *words],
            cwd=folder, stdout=out, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return time.perf_counter() - began


def moments(count: int, whole: float) -> list[float]:
    """Return times (s) spread over a command that takes ``whole`` s, and a little longer."""
    rng = np.random.default_rng(14)
    return sorted(rng.uniform(0.0, 1.05 * whole, count))


def files(folder: Path) -> dict[str, bytes]:
    """Return what a user sees in a folder: no name that begins with a dot."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.startswith(".") and PART_FOLDER not in path.parts
    }


@pytest.mark.parametrize("count", KILLS)
def test_killed_simulation(count: int, tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    out = folder / "out"
    whole = run_for(None, *SIMULATED, LONG_S, "--out", "out", folder=folder)
    long = Run.load(out / "run.npz")
    assert len(long.t) == LONG_ROWS
    kept = 0
    for after in moments(count, whole):
        run_for(None, *SIMULATED, "0.1", "--out", "out", folder=folder)
        known = {digest(out / "run.npz")}
        (out / "mine.txt").write_text("mine")
        run_for(after, *SIMULATED, LONG_S, "--out", "out", folder=folder)
        run = Run.load(out / "run.npz")
        known.add(digest(out / "run.npz"))
        assert len(run.t) in (51, LONG_ROWS)
        check_made_files(out, known, is_new=len(run.t) == LONG_ROWS)
        assert (out / "mine.txt").read_text() == "mine"
        for part in out.glob(f"{PART_FOLDER}*"):
            kept += check_part(part, long)
    if count > 20:
        assert kept, "no kill came between the first chunk and the end"
    run_for(None, *SIMULATED, "0.1", "--out", "out", folder=folder)
    assert len(Run.load(out / "run.npz").t) == 51
    assert not find_faults(out, digest(out / "run.npz"))


def check_made_files(out: Path, known: set[str], is_new: bool) -> None:
    """Assert that what is drawn of a run is whole, and told where it is not of this run.

    Args:
        out: The run's folder.
        known: Digests of the runs that it may be of.
        is_new: Whether the run is the killed one: its files may not have been drawn yet.
    """
    own = digest(out / "run.npz")
    faults = find_faults(out, own)
    for name in ("summary.json", "tracking.png", "report.html"):
        path = out / name
        assert is_new or path.exists()
        if path.exists():
            assert is_whole(path)
            assert mark_of(path) in known
        assert (name in faults) == (not path.exists() or mark_of(path) != own)


def is_whole(path: Path) -> bool:
    """Return whether a file ends as its format does; one that cannot be read is an error."""
    if path.suffix == ".json":
        return bool(json.loads(path.read_text()))
    if path.suffix == ".png":
        Image.open(path).verify()
        return True
    return path.read_text().rstrip().endswith("</html>")


def check_part(part: Path, long: Run) -> bool:
    """Assert that a part is the beginning of a run; return whether it has samples."""
    if not chunk_files(part):
        with pytest.raises(RunFileError):
            Run.load(part)
        return False
    run = Run.load(part)
    np.testing.assert_array_equal(run.q, long.q[: len(run.t)])
    np.testing.assert_array_equal(run.log.energy, long.log.energy[: len(run.t)])
    assert any("ended early" in note for note in run.notes) or len(run.t) == LONG_ROWS
    return True


COMPARED = (
    "compare", "paper", "--references", "line", "--scenarios", "nominal", "--duration", "0.2",
    "--laws", "paper", "--dynamic", "paper", "--workers", "1", "--out", "out",
)  # fmt: skip


@pytest.mark.parametrize("count", KILLS[1:])
def test_killed_comparison(count: int, tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    whole = run_for(None, *COMPARED, folder=folder)
    before = files(folder / "out")
    assert before
    for after in moments(count, whole):
        run_for(after, *COMPARED, folder=folder)
        found = files(folder / "out")
        assert found.keys() <= before.keys()
        assert found.keys() >= {name for name in before if name.endswith(".json")}  # all is in it
        for name, content in found.items():
            if Path(name).suffix in (".json", ".png"):
                assert is_whole(folder / "out" / name)
            assert len(content) > 0.8 * len(before[name]), f"{name} is half-written"


@pytest.mark.parametrize("count", KILLS[1:])
@pytest.mark.parametrize("form", ["c", "latex"])
def test_killed_derivation(count: int, form: str, tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    words = ("derive", "paper", "--format", form, "--out", "paper.txt")
    whole = run_for(None, *words, folder=folder)
    text = (folder / "paper.txt").read_bytes()
    assert len(text) > 1000
    for k, after in enumerate(moments(count, whole)):
        (folder / "paper.txt").write_text("mine")
        if k % 2:
            (folder / "paper.txt").unlink()
        run_for(after, *words, folder=folder)
        assert files(folder).get("paper.txt", b"mine") in (b"mine", text)
        assert {*files(folder)} <= {"paper.txt"}


@pytest.mark.parametrize("count", KILLS[1:])
def test_killed_plot(count: int, paper: rpctl.Robot, tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    rpctl.track(paper, "line", duration=0.05).save(folder / "run.npz")
    words = ("plot", "run.npz", "--out", "figure.pdf")
    whole = run_for(None, *words, folder=folder)
    size = (folder / "figure.pdf").stat().st_size
    for k, after in enumerate(moments(count, whole)):
        if k % 2:
            (folder / "figure.pdf").unlink(missing_ok=True)
        run_for(after, *words, folder=folder)
        if (folder / "figure.pdf").exists():
            assert (folder / "figure.pdf").stat().st_size == pytest.approx(size, rel=0.01)
            assert mark_of(folder / "figure.pdf") == digest(folder / "run.npz")
        assert {*files(folder)} <= {"figure.pdf", "run.npz"}


@pytest.mark.parametrize("count", KILLS[1:])
def test_killed_save_of_a_configuration(count: int, tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    file = folder / "mine.toml"
    words = (*SIMULATED, "0.02", "--save-config", "mine.toml", "--out", "../out")
    whole = run_for(None, *words, folder=folder)
    text = file.read_text()
    for after in moments(count, whole):
        file.write_text("# mine\n[run]\nduration = 3.0\n")
        run_for(after, *words, folder=folder)
        assert file.read_text() in (text, "# mine\n[run]\nduration = 3.0\n")
        assert {*files(folder)} - {"mine.toml.schema.json"} == {"mine.toml"}
        assert json.loads(files(folder)["mine.toml.schema.json"])  # of the whole run
        read_config(file)


@pytest.mark.slow
def test_run_that_was_killed_is_the_beginning_of_the_whole_one(tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    with subprocess.Popen(
        [sys.executable, "-m", "rpctl", *SIMULATED, "600", "--out", "out"],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        until = time.monotonic() + 120.0
        while not chunk_files(folder / "out" / PART_FOLDER) and time.monotonic() < until:
            time.sleep(0.02)
        process.kill()
    run = Run.load(folder / "out" / PART_FOLDER)
    assert any("ended early" in note for note in run.notes)
    whole = simulate(rpctl.load("paper"), run.config)
    np.testing.assert_array_equal(run.q[:500], whole.q[:500])
