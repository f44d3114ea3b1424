"""A run as a film in real time, or as one picture, drawn by headless Chromium."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpctl.errors import RpctlError
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.writing import require_writable, write_atomically
from rpctl.robot.model import Robot
from rpctl.simulation.run import Run
from rpctl.view.film.browser import open_page
from rpctl.view.film.video import CENTISECONDS, MAX_GIF_RATE_HZ, Encoder, gif, mp4
from rpctl.view.marks import marked
from rpctl.view.pages.page import asset
from rpctl.view.pages.report import robot_of
from rpctl.view.pages.scene_page import player
from rpctl.view.scene.scene import build_scene

if TYPE_CHECKING:
    from PIL.Image import Image

Size = tuple[int, int]
STILL_SUFFIX, SCENE_FILE = ".png", "scene.png"  # suffix of pictures; the one in a run's folder
FRAME_TOLERANCE = 1e-6  # of a picture: the last sample's time is a sum
MIN_EDGE_PX, MAX_EDGE_PX = 64, 4096  # pixels


@dataclass(frozen=True)
class FilmFormat:
    """A film's format: its encoder, and the size (pixels) and rate (Hz) where none is asked for."""

    encode: Encoder
    size: Size
    rate: int


FORMATS = {".mp4": FilmFormat(mp4, (1280, 720), 30), ".gif": FilmFormat(gif, (800, 450), 20)}


def write_film(
    run: Run,
    path: str | Path,
    *,
    size: Size | None = None,
    rate: int | None = None,
    robot: Robot | RpctlError | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write a film of a run, in real time; the file is there whole or not at all.

    Args:
        run: The run.
        path: The file, .mp4 or .gif.
        size: Width and height, even numbers of pixels; 1280 by 720, of a GIF 800 by 450.
        rate: Pictures a second; 30, of a GIF 20. A GIF can have 50, 25, 20, 10, 5, ... of them.
        robot: The robot of the run, where it is loaded already, or why it cannot be had.
        progress: Called with the number of pictures done and their total.

    Returns:
        The path.

    Raises:
        RpctlError: The suffix, size or rate cannot be had, or the browser or encoder is missing.
    """
    from PIL.Image import open as decode

    path = Path(path)
    form = FORMATS.get(path.suffix.lower())
    if form is None:
        raise RpctlError(f"{path}: films are .mp4 or .gif; give a name that ends so")
    size, rate = _checked(size or form.size), rate or form.rate
    if form.encode is gif and (CENTISECONDS % rate or rate > MAX_GIF_RATE_HZ):
        raise RpctlError(f"a GIF cannot have {rate} pictures a second; give 50, 25, 20, 10, 5 or 4")
    require_writable(path)
    count = int(np.floor((run.t[-1] - run.t[0]) * rate + FRAME_TOLERANCE)) + 1
    if count > cap("MAX_PICTURES"):
        fault = f"{path}: a film of {count:,} pictures, over {cap('MAX_PICTURES'):,}"
        raise RpctlError(f"{fault}; give a lower rate; {how_to_raise('MAX_PICTURES')}")
    with _camera(run, size, robot) as photograph:

        def take(number: int) -> Image:
            return decode(io.BytesIO(photograph(number / rate, True))).convert("RGB")

        film = form.encode(take, count, rate, progress)
    return write_atomically(path, marked(film, path.suffix, run.digest))


def write_still(
    run: Run,
    path: str | Path,
    *,
    size: Size | None = None,
    time: float | None = None,
    robot: Robot | RpctlError | None = None,
) -> Path:
    """Write one picture of a run as PNG; the file is there whole or not at all.

    Args:
        run: The run.
        path: The file.
        size: Width and height, pixels; 1280 by 720 if not given.
        time: Since the start of the run, s; its end if not given.
        robot: The robot of the run, where it is loaded already, or why it cannot be had.

    Returns:
        The path.

    Raises:
        RpctlError: The suffix, size or time cannot be had, or the browser is missing.
    """
    path, duration = Path(path), float(run.t[-1] - run.t[0])
    if path.suffix.lower() != STILL_SUFFIX:
        raise RpctlError(f"{path}: pictures are {STILL_SUFFIX}; give a name that ends so")
    time = duration if time is None else time
    if not 0.0 <= time <= duration:
        raise RpctlError(f"{time:g} s is not within the run; give 0 to {duration:g}")
    require_writable(path)
    with _camera(run, _checked(size or FORMATS[".mp4"].size), robot) as photograph:
        picture = photograph(time, False)
    return write_atomically(path, marked(picture, path.suffix, run.digest))


def _checked(size: Size) -> Size:
    """Return a size that can be drawn and encoded; colours are stored for two pixels at a time."""
    for edge in size:
        if edge % 2 or not MIN_EDGE_PX <= edge <= MAX_EDGE_PX:
            wanted = f"even numbers from {MIN_EDGE_PX} to {MAX_EDGE_PX}"
            raise RpctlError(f"size {size[0]}x{size[1]}: give {wanted}, as 1280x720")
    return size


@contextmanager
def _camera(
    run: Run, size: Size, robot: Robot | RpctlError | None
) -> Iterator[Callable[[float, bool], bytes]]:
    """Open the scene of a run; yields a function that takes a PNG at a time (s), stamped or not."""
    scene = build_scene(robot or robot_of(run), run)
    html = player(scene, run.robot.name, size[0] / size[1], asset("film.js"))
    with open_page(html, *size) as page:

        def photograph(time: float, stamped: bool) -> bytes:
            stamp = f"{time:.1f} s" if stamped else ""
            url = page.evaluate("([time, stamp]) => film.photograph(time, stamp)", [time, stamp])
            return base64.b64decode(url.partition(",")[2])

        yield photograph
