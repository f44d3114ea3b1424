"""A run as a film in real time, or as one picture, drawn by headless Chromium."""

from __future__ import annotations

import base64
import io
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.errors import RpctlError
from rpctl.files.caps import cap, how_to_raise
from rpctl.files.writing import require_writable, write_atomically
from rpctl.libraries import install_command
from rpctl.robot.model import Robot
from rpctl.simulation.run.run import Run
from rpctl.view.labels import MARK, comment
from rpctl.view.pages.page import asset, embed, render, render_page, stand_in_entry
from rpctl.view.pages.report import robot_of
from rpctl.view.pages.third_party import licences, meshcat_script
from rpctl.view.scene.scene import Scene, build_scene

if TYPE_CHECKING:
    from PIL.Image import Image

Size = tuple[int, int]
STILL_SUFFIX, SCENE_FILE = ".png", "scene.png"  # suffix of pictures; the one in a run's folder
FRAME_TOLERANCE = 1e-6  # of a picture: the last sample's time is a sum
MIN_EDGE_PX, MAX_EDGE_PX = 64, 4096  # pixels
BROWSER_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
BROWSER_FLAGS = (
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)  # WebGL without a graphics card
NO_BROWSER = (
    "films and pictures need Chromium or Chrome, which rpctl cannot find; run: playwright "
    "install chromium, or install your system's package"
)
QUALITY = "18"  # x264's constant rate factor: the eye sees no loss
BT709 = "colorprim=bt709:transfer=bt709:colormatrix=bt709"  # what players take HD video for
PALETTE_SAMPLES = 6  # pictures that give a GIF its palette
GIF_COLOURS = 256  # of a GIF
CENTISECONDS = 100  # in a second; a GIF counts in them
MAX_GIF_RATE_HZ = 50  # Hz; browsers slow down what is faster

TakePicture = Callable[[int], "Image"]
Progress = Callable[[int, int], object]  # called with the number of pictures done and their total


def write_film(
    run: Run,
    path: str | Path,
    *,
    size: Size | None = None,
    rate: int | None = None,
    robot: Robot | RpctlError | None = None,
    progress: Progress = lambda done, total: None,
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
    path, form = Path(path), FORMATS.get(Path(path).suffix.lower())
    if form is None:
        raise RpctlError(f"{path}: films are .mp4 or .gif; give a name with that ending")
    size, rate = _checked(size or form.size), rate or form.rate
    require_writable(path)
    count = _picture_count(run, path, rate)
    with _camera(run, size, robot) as photograph:

        def take(number: int) -> Image:
            picture = photograph(number / rate, True)
            progress(number + 1, count)
            return picture

        film = form.encode(take, count, rate, comment(run.digest))
    return write_atomically(path, film)


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
    from PIL.PngImagePlugin import PngInfo

    path, duration = Path(path), float(run.t[-1] - run.t[0])
    if path.suffix.lower() != STILL_SUFFIX:
        raise RpctlError(f"{path}: pictures are {STILL_SUFFIX}; give a name with that ending")
    time = duration if time is None else time
    if not 0.0 <= time <= duration:
        raise RpctlError(f"{time:g} s is not within the run; give 0 to {duration:g}")
    require_writable(path)
    with _camera(run, _checked(size or FORMATS[".mp4"].size), robot) as photograph:
        picture = photograph(time, False)
    buffer, info = io.BytesIO(), PngInfo()
    if run.digest is not None:
        info.add_text(MARK, run.digest)
    picture.save(buffer, "PNG", pnginfo=info)
    return write_atomically(path, buffer.getvalue())


def _picture_count(run: Run, path: Path, rate: int) -> int:
    if path.suffix.lower() == ".gif" and (CENTISECONDS % rate or rate > MAX_GIF_RATE_HZ):
        raise RpctlError(f"a GIF cannot have {rate} pictures a second; give 50, 25, 20, 10, 5 or 4")
    count = int(np.floor((run.t[-1] - run.t[0]) * rate + FRAME_TOLERANCE)) + 1
    if count > cap("MAX_PICTURES"):
        raise RpctlError(
            f"{path}: a film of {count:,} pictures, over {cap('MAX_PICTURES'):,}; "
            f"give a lower rate; {how_to_raise('MAX_PICTURES')}"
        )
    return count


def _checked(size: Size) -> Size:
    """Return a size that can be drawn and encoded; colours are stored for two pixels at a time."""
    for edge in size:
        if edge % 2 or not MIN_EDGE_PX <= edge <= MAX_EDGE_PX:
            raise RpctlError(
                f"size {size[0]}x{size[1]}: give even numbers from {MIN_EDGE_PX} to "
                f"{MAX_EDGE_PX}, such as 1280x720"
            )
    return size


@contextmanager
def _camera(
    run: Run, size: Size, robot: Robot | RpctlError | None
) -> Iterator[Callable[[float, bool], Image]]:
    """Open the scene of a run; yields what takes a picture at a time (s), stamped or not."""
    from PIL.Image import open as decode

    html = player(build_scene(robot or robot_of(run), run), run.robot.name, asset("film.js"))
    with open_page(html, *size) as page:

        def photograph(time: float, stamped: bool) -> Image:
            stamp = f"{time:.1f} s" if stamped else ""
            url = page.evaluate("([time, stamp]) => film.photograph(time, stamp)", [time, stamp])
            return decode(io.BytesIO(base64.b64decode(url.partition(",")[2]))).convert("RGB")

        yield photograph


# ---- formats ------------------------------------------------------------


def mp4(take: TakePicture, count: int, rate: int, remark: str) -> bytes:
    """Return pictures as an MP4 that every browser plays.

    Args:
        take: Returns a picture by its number; all are of one size, even both ways.
        count: How many there are.
        rate: Pictures a second.
        remark: That the file keeps.

    Raises:
        RpctlError: PyAV is not installed.
    """
    try:
        import av
    except ImportError:
        raise RpctlError(f"films need PyAV; run {install_command('film')}") from None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
            container.metadata["comment"] = remark
            options = {"crf": QUALITY, "x264-params": BT709}
            stream: Any = container.add_stream("libx264", rate=rate, options=options)
            stream.pix_fmt = "yuv420p"
            for number in range(count):
                picture = take(number)
                if not number:
                    stream.width, stream.height = picture.size
                shot = av.VideoFrame.from_ndarray(np.asarray(picture), format="rgb24")
                container.mux(stream.encode(shot.reformat(format="yuv420p", dst_colorspace=1)))
            container.mux(stream.encode())
        return path.read_bytes()


def gif(take: TakePicture, count: int, rate: int, remark: str) -> bytes:
    """Return pictures as a GIF that repeats for ever, as :func:`mp4` does.

    All are in one palette, so nothing flickers; those that give it are taken twice.
    """
    from PIL import Image

    chosen = np.unique(np.linspace(0, count - 1, PALETTE_SAMPLES).astype(int)).tolist()
    samples = np.concatenate([np.asarray(take(k)) for k in chosen])
    palette = Image.fromarray(samples).quantize(GIF_COLOURS, Image.Quantize.MEDIANCUT)
    pictures = [
        take(number).quantize(palette=palette, dither=Image.Dither.NONE) for number in range(count)
    ]
    buffer = io.BytesIO()
    options: dict[str, Any] = {"comment": remark.encode()} if remark else {}
    options |= {"duration": 1000 // rate, "loop": 0}  # ms a picture; for ever
    pictures[0].save(buffer, "GIF", save_all=True, append_images=pictures[1:], **options)
    return buffer.getvalue()


@dataclass(frozen=True)
class FilmFormat:
    """A film's format: its encoder, and the size (pixels) and rate (Hz) where none is asked for."""

    encode: Callable[[TakePicture, int, int, str], bytes]
    size: Size
    rate: int


FORMATS = {".mp4": FilmFormat(mp4, (1280, 720), 30), ".gif": FilmFormat(gif, (800, 450), 20)}


# ---- the browser ------------------------------------------------------------


def require_browser() -> None:
    """Raise if no browser is found; called before anything is computed for a page.

    Raises:
        RpctlError: Playwright or a browser is missing.
    """
    with _driver() as driver:
        _executable(driver)


@contextmanager
def open_page(html: str, width: int, height: int) -> Iterator[Any]:
    """Open a page in headless Chromium, cut off from the network; yields Playwright's page.

    Args:
        html: The page.
        width: Of the window, pixels.
        height: Of the window, pixels.

    Raises:
        RpctlError: Playwright or a browser is missing, or the page fails.
    """
    playwright = _playwright()
    try:
        with _driver() as driver:
            browser = driver.chromium.launch(
                executable_path=_executable(driver), args=list(BROWSER_FLAGS), handle_sigint=False
            )
            try:
                size = {"width": width, "height": height}
                page = browser.new_page(viewport=size, offline=True, color_scheme="light")
                page.set_content(html)
                yield page
            finally:
                browser.close()
    except playwright.Error as error:
        raise RpctlError(f"the browser failed: {error.message.splitlines()[0]}") from None


def _playwright() -> Any:
    """Return Playwright's module, if it is installed."""
    try:
        from playwright import sync_api
    except ImportError:
        raise RpctlError(
            f"films and pictures need Playwright; run {install_command('film')}"
        ) from None
    return sync_api


@contextmanager
def _driver() -> Iterator[Any]:
    starting = _playwright().sync_playwright()
    with _interrupts_blocked():
        driver = starting.__enter__()
    try:
        yield driver
    finally:
        starting.__exit__(None, None, None)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Let processes that start meanwhile ignore Ctrl-C; this process closes them in order."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _executable(driver: Any) -> str:
    """Return the browser: the system's, or the one that Playwright installed."""
    for path in (*map(shutil.which, BROWSER_NAMES), driver.chromium.executable_path):
        if path and Path(path).is_file():
            return str(path)
    raise RpctlError(NO_BROWSER)


HIDDEN_GHOST_DISTANCE = 2e-3  # m, rad: a ghost as near as that is hidden behind its robot
ASPECT = 16.0 / 9.0  # of the scene in a notebook
MAX_WIDTH_PX = 960  # pixels, at most


def player(scene: Scene, title: str, script: str, controls: bool = False) -> str:
    """Return a page that shows a scene and nothing else.

    Args:
        scene: The scene.
        title: What it shows.
        script: What moves the scene, by ``player.show(time)``.
        controls: Whether a timeline lies over the scene.
    """
    data = {
        "duration": scene.duration,
        "frames": len(scene.times),
        "covered": HIDDEN_GHOST_DISTANCE,
        "hull": np.round(scene.hull, 3).tolist(),
        "commands": [base64.b64encode(command).decode() for command in scene.commands],
    }
    return render_page(
        "player.html",
        title=title,
        styles=["player.css"],
        scripts=(meshcat_script(), asset("player.js") + asset("camera.js"), script),
        dark=False,
        controls=controls,
        stand_in=stand_in_entry(scene.stand_ins),
        licences=licences(charts=False),
        data=embed(data),
    )


def show(run: Run) -> str:
    """Return a run as HTML for a notebook: one line of text, and its scene with controls.

    Where the robot cannot be loaded any more, the reason stands in the place of the scene.
    """
    robot, name = robot_of(run), run.robot.name
    shown = {"fault": str(robot), "page": ""}
    if not isinstance(robot, RpctlError):
        scene = build_scene(robot, run)
        shown = {"fault": "", "page": player(scene, name, asset("notebook.js"), controls=True)}
    shown |= {"width": str(MAX_WIDTH_PX), "aspect": f"{ASPECT:.4f}"}
    return render("notebook.html", summary=_summary_line(run), title=name, **shown)


def _summary_line(run: Run) -> str:
    """Return what the run is, and how well it ended, in one line."""
    errors = []
    if run.robot.drive.wheels:
        errors.append(f"base {1e3 * np.hypot(*run.log.e[-1, :2]):.3g} mm")
    if run.robot.end_effector is not None:
        errors.append(
            f"end effector {1e3 * np.linalg.norm(run.log.ee_ref[-1] - run.log.ee[-1]):.3g} mm"
        )
    reference = PurePath(run.config.run.reference).name  # no folder of this machine
    duration = run.t[-1] - run.t[0]
    return f"{run.robot.name}, {reference}, {duration:.4g} s; final error: {', '.join(errors)}"
