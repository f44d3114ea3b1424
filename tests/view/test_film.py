from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

import rpctl
from rpctl import Robot, Run
from rpctl.view import film as browser
from rpctl.view.film import write_film, write_still
from tests.view.samples import short_run

SMALL = (160, 90)
needs_browser = pytest.mark.skipif(
    not any(map(shutil.which, browser.BROWSER_NAMES)), reason="no chromium on PATH"
)


def changed(a: Image.Image, b: Image.Image) -> int:
    difference = np.asarray(a.convert("RGB")).astype(int) - np.asarray(b.convert("RGB"))
    return int((np.abs(difference).max(axis=2) > 24).sum())


@needs_browser
@pytest.mark.slow
def test_still_shows_the_moment_asked_for(paper_run: Run, tmp_path: Path) -> None:
    pictures = []
    for moment in (0.0, 2.0, 2.0):
        path = write_still(paper_run, tmp_path / "a.png", size=(320, 180), time=moment)
        pictures.append(Image.open(path).copy())
    start, later, again = pictures
    assert start.size == (320, 180)
    assert changed(start, later) > 200
    assert changed(later, again) == 0
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.png"]


@needs_browser
@pytest.mark.slow
def test_film_is_in_real_time_at_a_constant_rate(paper_run: Run, tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="PyAV is not installed")
    message: list[tuple[int, int]] = []
    path = write_film(
        paper_run,
        tmp_path / "a.mp4",
        size=SMALL,
        rate=5,
        progress=lambda *done: message.append(done),
    )
    with av.open(str(path)) as film:
        (stream,) = film.streams.video
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        frames = list(film.decode(video=0))
    assert [float(frame.time) for frame in frames] == pytest.approx(np.arange(16) / 5)
    assert (frames[0].width, frames[0].height) == SMALL
    assert changed(frames[0].to_image(), frames[10].to_image()) > 100
    assert message == [(k + 1, 16) for k in range(16)]
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")  # it plays before all of it has come


@pytest.mark.slow
@needs_browser
def test_gif_is_in_real_time_and_repeats(paper: Robot, tmp_path: Path) -> None:
    path = write_film(short_run(paper, 0.5), tmp_path / "a.gif", size=SMALL, rate=4)
    with Image.open(path) as film:
        assert film.info["loop"] == 0
        lengths = [frame.info["duration"] for frame in ImageSequence.Iterator(film)]
        film.seek(len(lengths) - 1)
        assert film.size == SMALL
    assert lengths == [250, 250, 250]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.avi", {}, r"a\.avi: films are \.mp4 or \.gif"),
        ("a.gif", {"rate": 30}, "GIF cannot have 30"),
        ("a.mp4", {"size": (161, 90)}, "161x90"),
        ("none/a.mp4", {}, "no folder"),
        ("a.mp4", {"rate": 10**6}, "a film of .* pictures, over .*RPCTL_MAX_PICTURES"),
    ],
)
def test_wrong_films_are_refused_at_once(
    paper_run: Run, tmp_path: Path, name: str, options: dict[str, object], message: str
) -> None:
    with pytest.raises(rpctl.RpctlError, match=message):
        write_film(paper_run, tmp_path / name, **options)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "moment", "message"), [("a.jpg", 0.0, r"\.png"), ("a.png", 99.0, "99 s is not within")]
)
def test_wrong_stills_are_refused(
    paper_run: Run, tmp_path: Path, name: str, moment: float, message: str
) -> None:
    with pytest.raises(rpctl.RpctlError, match=message):
        write_still(paper_run, tmp_path / name, time=moment)


def test_missing_browser_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("playwright", reason="playwright is not installed")
    monkeypatch.setattr(browser, "BROWSER_NAMES", ())
    monkeypatch.setenv("PLAYWRIGHT_BROWSERS_PATH", str(tmp_path))
    with pytest.raises(rpctl.RpctlError, match="playwright install chromium"):
        browser.require_browser()


@needs_browser
@pytest.mark.slow
def test_ctrl_c_leaves_neither_file_nor_browser(paper: Robot, tmp_path: Path) -> None:
    run = short_run(paper, 5.0)
    source, film = run.save(tmp_path / "run.npz"), tmp_path / "a.mp4"
    scratch = Path(tempfile.mkdtemp())  # short: Chromium's sockets in it have short names only
    command = [sys.executable, "-m", "rpctl", "view", str(source), "--video", str(film)]
    command += ["--pixels", "160x90"]
    with subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        start_new_session=True,
        # Jobs in the background inherit a Ctrl-C that is ignored.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        env={**os.environ, "TMPDIR": str(scratch)},
    ) as process:
        deadline = time.monotonic() + 60.0
        while not list(scratch.rglob("film.mp4")) and time.monotonic() < deadline:
            time.sleep(0.2)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert error.decode().strip() == "interrupted"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["run.npz"]
    assert not list(scratch.rglob("film.mp4"))
    shutil.rmtree(scratch)
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
