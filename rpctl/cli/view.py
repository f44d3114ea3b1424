"""The commands that show a run: ``rpctl view`` and ``rpctl plot``."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, split_names, tell
from rpctl.cli.terminal import progress_bar, say
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.files.caps import is_file, is_folder
from rpctl.files.writing import require_writable, write_atomically
from rpctl.robot.model import Robot
from rpctl.view.charts import PANELS

DEFAULT_FIGURE = "figure.pdf"
RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="A run's folder or its run.npz.")]


@dataclass(frozen=True)
class FilmOptions:
    """The options of pictures and films."""

    video: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a film, .mp4 or .gif; serve nothing."),
    ] = None
    png: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write one picture; serve nothing.")
    ] = None
    at: Annotated[
        float | None, typer.Option(metavar="S", help="Time of the picture, s; else the run's end.")
    ] = None
    pixels: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Of picture or film; else 1280x720, of a GIF 800x450."),
    ] = None
    fps: Annotated[
        int | None, typer.Option(min=1, max=120, help="Pictures a second; else 30, of a GIF 20.")
    ] = None

    def write(self, what: list[str], package_dirs: Sequence[Path | str]) -> bool:
        """Write the picture and the film that are asked for; return whether there are any.

        Args:
            what: The run.
            package_dirs: Where its packages or its robot's file lie.

        Raises:
            RpctlError: An option lacks another, or ``what`` is not one run.
        """
        wanted = self.png or self.video
        for name, value, needed in (
            ("at", self.at, self.png),
            ("fps", self.fps, self.video),
            ("pixels", self.pixels, wanted),
        ):
            if value is not None and needed is None:
                raise RpctlError(f"--{name} is for a picture or a film; give --png or --video, too")
        if wanted is None:
            return False
        for path in filter(None, (self.png, self.video)):
            require_writable(path)
        from rpctl.view.film import write_film, write_still
        from rpctl.view.pages.report import robot_of
        from rpctl.view.run_folder import is_run, load_run

        if len(what) > 1 or not is_run(what[0]):
            raise RpctlError(f"{' '.join(what)} is no run; films and pictures are of one run")
        run, pixels = load_run(Path(what[0]), _note), _read_size(self.pixels)
        robot = robot_of(run, package_dirs)
        if isinstance(robot, RpctlError):
            _note(f"the robot cannot be drawn: {robot}")
        if self.png is not None:
            file = write_still(run, self.png, size=pixels, time=self.at, robot=robot)
            say(f"wrote {file}")
        if self.video is not None:
            with progress_bar("film") as advance:
                write_film(
                    run, self.video, size=pixels, rate=self.fps, robot=robot, progress=advance
                )
            say(f"wrote {self.video}")
        return True


def view_command(
    *,
    what: Annotated[
        list[str],
        typer.Argument(
            metavar="ROBOT|RUN...", help="A robot, or runs: their folders or run.npz files."
        ),
    ],
    options: LoadOptions,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the page; serve nothing.")
    ] = None,
    film: FilmOptions,
) -> None:
    """Serve a page on this machine only, until Ctrl-C: a robot with sliders, or runs that play.

    Or write the page, a film or a picture. A run is data: showing it evaluates nothing, and folders
    that it names are not used.
    """
    from rpctl.view.run_folder import is_run

    folders = options.package_dirs
    if film.write(what, folders):
        return
    if html is not None:
        require_writable(html)
    if len(what) > 1 or is_run(what[0]):
        from rpctl.view.serve.live import serve

        report = _report([Path(each) for each in what], folders)
        _write_or(html, report, lambda: serve(report, _say))
        return
    from rpctl.view.pages.robot_page import robot_page
    from rpctl.view.serve.go import GoServer

    robot = _load(what[0], options)  # faults of a later edit are told by the page
    words = shlex.join([what[0], *options.words()])
    server = GoServer(lambda: options.load(what[0]), f"rpctl track {words}")
    _write_or(html, lambda: robot_page(robot).encode(), lambda: server.run(_say))


def _report(runs: Sequence[Path], package_dirs: Sequence[Path | str]) -> Callable[[], bytes]:
    """Return what returns the page of one run or several; it is drawn before."""
    from rpctl.view.run_folder import RunPage, comparison

    if len(runs) == 1:
        return RunPage(runs[0], package_dirs, _note)
    page = comparison(runs, package_dirs, _note)
    return lambda: page


def _note(text: str) -> None:
    """Print a note beside the output."""
    say(text, err=True)


def _write_or(html: Path | None, page: Callable[[], bytes], serve: Callable[[], object]) -> None:
    """Write a page if there is a file to write, else serve it."""
    if html is None:
        serve()
    else:
        say(f"wrote {write_atomically(html, page())}")


def _say(url: str) -> None:
    say(f"{url}  (Ctrl-C ends it)")


def _load(name: str, options: LoadOptions) -> Robot:
    """Load a robot; what is neither a robot nor a run is called so.

    Raises:
        RpctlError: It cannot be loaded.
    """
    try:
        return options.load(name)
    except RpctlError as error:
        if is_folder(name) or (Path(name).name != name and not is_file(name)):
            what = "a folder without a run.npz is" if is_folder(name) else "nothing is there,"
            raise RpctlError(
                f"{name}: {what} no run, and no robot; give a run's folder, a URDF file, or a name "
                "listed by `rpctl robots`"
            ) from None
        if isinstance(error, UnknownNameError) and error.name == name:
            raise UnknownNameError("robot or run", name, error.choices) from None
        raise


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
    log: Annotated[bool, typer.Option("--log", help="Errors on logarithmic axes.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write the figure of a run for a paper: lines and text as PDF, or pixels as PNG."""
    from rpctl.view.plots.figures import save_figure
    from rpctl.view.run_folder import load_run

    path = out or (run if is_folder(run) else run.parent) / DEFAULT_FIGURE
    if out is None and path.is_symlink():
        path.unlink()  # the folder may be another's, and the link lead to any file
    require_writable(path)
    save_figure(load_run(run, _note), path, panels=split_names(panels), column=column, log=log)
    tell(as_json, lambda: {"figure": str(path)}, lambda: say(f"wrote {path}"))


def _read_size(text: str | None) -> tuple[int, int] | None:
    """Return the numbers of ``WxH``."""
    if text is None:
        return None
    try:
        width, height = (int(word) for word in text.lower().split("x"))
    except ValueError:
        raise RpctlError(f"--pixels {text}: give two numbers, as 1280x720") from None
    return width, height
