"""The commands that show a run: ``rpctl view`` and ``rpctl plot``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import (
    DensityOption,
    DriveOption,
    JsonOption,
    LockOption,
    PackageDirOption,
    StrictOption,
    load_robot,
)
from rpctl.cli.show import progress_bar
from rpctl.errors import RpctlError
from rpctl.files.writing import to_json, write_atomically
from rpctl.robot.model import Robot
from rpctl.view.plots.panels import PANELS

DEFAULT_FIGURE = "figure.pdf"
RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="A run's folder or its run.npz.")]


def view_command(
    what: Annotated[
        list[str],
        typer.Argument(
            metavar="ROBOT|RUN...", help="A robot, or runs: their folders or run.npz files."
        ),
    ],
    lock: LockOption = None,
    drive: DriveOption = None,
    density: DensityOption = None,
    strict: StrictOption = False,
    package_dir: PackageDirOption = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the page; serve nothing.")
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a film, .mp4 or .gif; serve nothing."),
    ] = None,
    png: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write one picture; serve nothing.")
    ] = None,
    at: Annotated[
        float | None, typer.Option(metavar="S", help="Time of the picture, s; else the run's end.")
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Pixels; else 1280x720, of a GIF 800x450.")
    ] = None,
    fps: Annotated[
        int | None, typer.Option(min=1, max=120, help="Pictures a second; else 30, of a GIF 20.")
    ] = None,
) -> None:
    """Serve a page on this machine only, until Ctrl-C: a robot with sliders, or runs that play.

    Or write the page, a film or a picture.
    """
    from rpctl.view.pages.robot_page import robot_page
    from rpctl.view.run_folder import is_run, report_source
    from rpctl.view.serve.live import serve

    for name, value, needed in (("at", at, png), ("fps", fps, video), ("size", size, png or video)):
        if value is not None and needed is None:
            raise RpctlError(f"--{name} is for a picture or a film; give --png or --video, too")
    if png is not None or video is not None:
        _film(what, png, video, at, size, fps)
        return

    def robot() -> Robot:
        return load_robot(what[0], drive, lock, density, strict, package_dir)

    if len(what) > 1 or is_run(what[0]):
        page = report_source([Path(each) for each in what], package_dir or ())
    else:
        robot()  # what is wrong with it is said here; of a file that is edited, by the page

        def page() -> bytes:
            return robot_page(robot()).encode()

    if html is not None:
        typer.echo(f"wrote {write_atomically(html, page())}")
        return
    serve(page, lambda url: typer.echo(f"{url}  (Ctrl-C ends it)"))


def _film(
    what: list[str],
    png: Path | None,
    video: Path | None,
    at: float | None,
    size: str | None,
    fps: int | None,
) -> None:
    """Write a picture, a film, or both, of one run."""
    from rpctl.view.film.film import write_film, write_still
    from rpctl.view.run_folder import is_run, load_run

    if len(what) > 1 or not is_run(what[0]):
        raise RpctlError(f"{' '.join(what)} is no run; films and pictures are of one run")
    loaded, pixels = load_run(Path(what[0])), _read_size(size)
    if png is not None:
        typer.echo(f"wrote {write_still(loaded, png, size=pixels, time=at)}")
    if video is not None:
        with progress_bar("film") as advance:
            write_film(loaded, video, size=pixels, rate=fps, progress=advance)
        typer.echo(f"wrote {video}")


def plot_command(
    run: RunArgument,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help=f"A .pdf or .png; else {DEFAULT_FIGURE} beside the run."),
    ] = None,
    panels: Annotated[
        str, typer.Option(metavar="NAME,...", help=f"Some panels only: {', '.join(PANELS)}.")
    ] = "",
    column: Annotated[
        bool, typer.Option("--column", help="88 mm wide, for one of two columns; else 180 mm.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write the figure of a run for a paper: lines and text as PDF, or pixels as PNG."""
    from rpctl.view.plots.figures import save_figure
    from rpctl.view.run_folder import load_run

    path = out or (run if run.is_dir() else run.parent) / DEFAULT_FIGURE
    chosen = [name.strip() for name in panels.split(",")] if panels else []
    save_figure(load_run(run), path, panels=chosen, column=column)
    typer.echo(to_json({"figure": str(path)}) if as_json else f"wrote {path}")


def _read_size(text: str | None) -> tuple[int, int] | None:
    """Return the numbers of ``WxH``."""
    if text is None:
        return None
    try:
        width, height = (int(word) for word in text.lower().split("x"))
    except ValueError:
        raise RpctlError(f"--size {text}: give two numbers of pixels, as 1280x720") from None
    return width, height
