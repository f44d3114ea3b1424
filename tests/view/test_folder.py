"""A run's folder: its files say of which run they are; the report's size; what is shown of it."""

from __future__ import annotations

import io
import json
import os
from contextlib import nullcontext
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from markupsafe import escape
from PIL import Image

import rpctl
from rpctl import Robot, RpctlError, Run
from rpctl.files.writing import write_atomically
from rpctl.simulation.config import Config
from rpctl.simulation.loop.track import simulate
from rpctl.simulation.run.part import PartWriter
from rpctl.view import run_folder
from rpctl.view.labels import JSON_KEY, mark_of
from rpctl.view.pages.settings import GAINS
from rpctl.view.run_folder import (
    BYTES_PER_MB,
    MADE_FILES,
    RunPage,
    find_faults,
    is_run,
    load_run,
    write_folder,
)
from tests.view.samples import mesh_visual, short_run, write_cart

SIZES = (0.3, 0.5)  # m; no two meshes are alike, so each is sent


@pytest.fixture(scope="module")
def fine_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Return a run of a cart with more triangles than anybody can see."""
    folder = tmp_path_factory.mktemp("fine")
    for size in SIZES:
        trimesh.creation.icosphere(6, size).export(folder / f"{size}.stl")
    path = write_cart(folder, "".join(mesh_visual(f"{size}.stl") for size in SIZES))
    return short_run(rpctl.load(path), 0.3)


@pytest.mark.slow
def test_meshes_are_simplified_until_the_report_keeps_its_size(
    fine_run: Run, tmp_path: Path
) -> None:
    free = write_folder(fine_run, tmp_path / "free")
    assert free.report_bytes == (tmp_path / "free/report.html").stat().st_size
    budget = free.report_bytes - 600_000
    written = write_folder(fine_run, tmp_path / "small", budget / BYTES_PER_MB)
    assert written.notes == free.notes
    assert all(note.startswith("gains: ") for note in written.notes)
    assert 0.4 * budget < written.report_bytes <= budget
    assert json.loads((tmp_path / "small/summary.json").read_text())["report_bytes"] == (
        written.report_bytes
    )


def test_size_that_cannot_be_kept_is_told(cart_run: Run, tmp_path: Path) -> None:
    written = write_folder(cart_run, tmp_path / "tiny", 0.5)
    *_, note = written.notes
    assert f"{written.report_bytes / BYTES_PER_MB:.2f} MB" in note


def test_each_file_says_of_which_run_it_is(paper: Robot, tmp_path: Path) -> None:
    run = rpctl.track(paper, "circle", duration=0.02, kinematic=rpctl.PaperKinematic())
    written = write_folder(run, tmp_path)
    ignored, gains = rpctl.Run.load(tmp_path / "run.npz").law_sentences
    assert "does not reduce the lateral error on a straight line" in ignored
    assert gains.startswith("gains: 2.5 Hz")
    assert {ignored, gains} <= set(written.notes)
    assert {ignored, gains} <= set(json.loads((tmp_path / "summary.json").read_text())["notes"])
    digest = sha256((tmp_path / "run.npz").read_bytes()).hexdigest()
    assert written.digest == digest
    assert json.loads((tmp_path / "summary.json").read_text())["run_sha256"] == digest
    assert {mark_of(tmp_path / name) for name in MADE_FILES} == {digest}
    assert not find_faults(tmp_path, digest)
    report = (tmp_path / "report.html").read_bytes()
    assert report.count(digest.encode()) == 1
    assert str(escape(ignored)) in report.decode()
    assert str(escape(gains.removeprefix(GAINS))) in report.decode()


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw nothing: files hold what tells them from others, and their marks."""

    def page(run: Run, *_: object) -> tuple[bytes, Any]:
        return marked(run.digest) + run.robot.name.encode(), NoScene()

    monkeypatch.setattr(run_folder, "sized_report", page)
    monkeypatch.setattr(run_folder, "tracking_image", lambda run: PIXEL + marked(run.digest))


def marked(digest: str | None) -> bytes:
    """Return what a file may hold to say of which run it is."""
    return f'"{JSON_KEY}": "{digest}"'.encode()


class NoScene:
    notes = ()


def pixel() -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (1, 1)).save(buffer, "PNG")
    return buffer.getvalue()


PIXEL = pixel()


@pytest.fixture(scope="module")
def two_runs(paper: Robot) -> tuple[Run, Run]:
    return rpctl.track(paper, "circle", duration=0.02), rpctl.track(paper, "line", duration=0.02)


class Killed(BaseException):
    """What no handler of the code in question expects."""


@pytest.mark.usefixtures("plain")
@pytest.mark.parametrize("writes", range(4))
def test_killed_between_files_nothing_passes_for_another_run(
    two_runs: tuple[Run, Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writes: int
) -> None:
    """Of the files of an earlier run none is left as the new one's; ``view`` draws the rest."""
    old, new = two_runs
    first = write_folder(old, tmp_path)
    for name in ("config.toml", "notes.png"):
        (tmp_path / name).write_bytes(PIXEL)
    done = iter(range(writes))

    def kill(*words: Any, **options: Any) -> Path:
        if next(done, None) is None:
            raise Killed
        return write_atomically(*words, **options)

    monkeypatch.setattr(run_folder, "write_atomically", kill)
    with pytest.raises(Killed) if writes < 3 else nullcontext():
        write_folder(new, tmp_path)
    monkeypatch.undo()
    digest = sha256((tmp_path / "run.npz").read_bytes()).hexdigest()
    assert digest != first.digest
    left = MADE_FILES[writes:]
    assert [" ".join(fault) for fault in find_faults(tmp_path, digest).items()] == [
        f"{name} is missing" for name in left
    ]
    assert not [name for name in left if (tmp_path / name).exists()]
    assert (tmp_path / "config.toml").read_bytes() == (tmp_path / "notes.png").read_bytes() == PIXEL


@pytest.mark.usefixtures("plain")
def test_killed_before_old_files_are_removed_they_are_told(
    two_runs: tuple[Run, Run], tmp_path: Path
) -> None:
    old, new = two_runs
    written = write_folder(old, tmp_path)
    (tmp_path / "figure.pdf").write_bytes(marked(written.digest))
    new.save(tmp_path / "run.npz")
    said: list[str] = []
    page = RunPage(tmp_path, say=said.append)
    names = (*MADE_FILES, "figure.pdf")
    assert said == [
        f"{tmp_path}: {', '.join(f'{name} belongs to another run' for name in names)}",
        f"{tmp_path}: rpctl draws {', '.join(MADE_FILES)} again",
    ]
    digest = sha256((tmp_path / "run.npz").read_bytes()).hexdigest()
    assert [*find_faults(tmp_path, digest)] == ["figure.pdf"]
    assert page() == (tmp_path / "report.html").read_bytes()


@pytest.mark.usefixtures("plain")
@pytest.mark.parametrize("fault", ["foreign", "pipe", "link"])
def test_a_report_that_lies_there_is_never_shown(
    two_runs: tuple[Run, Run], tmp_path: Path, fault: str
) -> None:
    """Not even one that says that it is of this run; what a link leads to stays as it is."""
    write_folder(two_runs[0], tmp_path)
    report, outside = tmp_path / "report.html", tmp_path.parent / "outside"
    own = report.read_bytes()
    outside.write_bytes(b"mine")
    if fault == "foreign":
        report.write_bytes(b"<script>steal()</script>" + own)
    else:
        report.unlink()
        (os.mkfifo if fault == "pipe" else partial(os.symlink, outside))(report)
    assert RunPage(tmp_path)() == own
    assert outside.read_bytes() == b"mine"


@pytest.mark.usefixtures("plain")
def test_a_run_that_is_written_again_is_drawn_again(
    two_runs: tuple[Run, Run], tmp_path: Path
) -> None:
    write_folder(two_runs[0], tmp_path)
    said: list[str] = []
    page = RunPage(tmp_path / "run.npz", say=said.append)
    first = page()
    write_folder(two_runs[1], tmp_path)  # while it is served
    assert page() == (tmp_path / "report.html").read_bytes() != first
    assert said == []


@pytest.mark.usefixtures("plain")
def test_a_folder_that_cannot_be_written_to_is_shown(
    two_runs: tuple[Run, Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> Path:
        raise RpctlError("the disk is full")

    two_runs[0].save(tmp_path / "run.npz")
    monkeypatch.setattr(run_folder, "write_atomically", refuse)
    said: list[str] = []
    page = RunPage(tmp_path, say=said.append)()
    assert page.endswith(b"paper")
    assert said[-1] == "the disk is full; rpctl shows the report without saving it"


def test_a_run_is_told_from_a_robot(paper_run: Run, tmp_path: Path) -> None:
    (tmp_path / "tiago").mkdir()
    assert not is_run(str(tmp_path / "tiago"))
    paper_run.save(tmp_path / "tiago/run.npz")
    assert is_run(str(tmp_path / "tiago"))
    assert is_run(str(tmp_path / "tiago/run.npz"))
    assert is_run("typed/wrongly.npz")
    for robot in ("tiago", "paper", str(tmp_path / "robot.urdf")):
        assert not is_run(robot)
    (tmp_path / "cut" / "run.part").mkdir(parents=True)
    assert not is_run(str(tmp_path / "cut"))  # it holds no samples yet


@pytest.mark.usefixtures("plain")
def test_the_newest_motion_is_shown_after_a_loss_of_power(
    two_runs: tuple[Run, Run], paper: Robot, tmp_path: Path
) -> None:
    """An older run beside it is neither lost nor taken for it; one that ended since is shown."""
    written = write_folder(two_runs[0], tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    config = Config().with_run(reference="line", duration=0.1)
    with PartWriter(tmp_path / "run.part") as spool:
        part = simulate(paper, config, part=spool)
    assert is_run(str(tmp_path / "run.part"))
    os.utime(tmp_path / "run.npz", ns=(0, 0))
    said: list[str] = []
    run = load_run(tmp_path, said.append)
    np.testing.assert_array_equal(run.q, part.q)
    assert said == [
        f"{tmp_path / 'run.part'}: it reaches t = 0.1 s",
        f"{tmp_path / 'run.npz'} belongs to an earlier simulation and is unchanged",
    ]
    assert RunPage(tmp_path)().endswith(b"paper")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before
    assert load_run(tmp_path / "run.npz").digest == written.digest
    os.utime(tmp_path / "run.npz")  # written since, and rpctl stopped while it drew
    assert load_run(tmp_path).digest == written.digest
