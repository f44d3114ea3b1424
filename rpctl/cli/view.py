"""The commands that show a run: ``rpctl view`` and ``rpctl plot``."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
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

_note = partial(say, err=True)
DEFAULT_FIGURE = "figure.pdf"
ADDRESS = "{}  (Ctrl-C ends it)"  # how that of a page is printed
RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="A run: its folder or its run.npz.")
]


@dataclass(frozen=True)
class FilmOptions:
    """The options of pictures and films."""

    video: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a film of the run, .mp4 or .gif; serve nothing."),
    ] = None
    png: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write one picture of the run; serve nothing."),
    ] = None
    at: Annotated[
        float | None,
        typer.Option(metavar="S", help="Time of the picture, s; default: the end of the run."),
    ] = None
    pixels: Annotated[
        str | None,
        typer.Option(
            metavar="WxH",
            help="Size of picture or film in pixels; default: 1280x720, or 800x450 for a GIF.",
        ),
    ] = None
    fps: Annotated[
        int | None,
        typer.Option(
            min=1, max=120, help="Frames per second of the film; default: 30, or 20 for a GIF."
        ),
    ] = None

    def write(self, what: list[str], package_dirs: Sequence[Path | str]) -> dict[str, str]:
        """Write the picture and the film that are asked for; return their files, by kind.

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
                raise RpctlError(f"--{name} needs a picture or a film; give --png or --video too")
        if wanted is None:
            return {}
        for path in filter(None, (self.png, self.video)):
            require_writable(path)
        from rpctl.view.film import write_film, write_still
        from rpctl.view.pages.report import robot_of
        from rpctl.view.run_folder import is_run, load_run

        if len(what) > 1 or not is_run(what[0]):
            raise RpctlError(f"{' '.join(what)} is not a run; --png and --video need one run")
        run, pixels = load_run(Path(what[0]), _note), _read_size(self.pixels)
        robot = robot_of(run, package_dirs)
        if isinstance(robot, RpctlError):
            _note(f"rpctl cannot draw the robot: {robot}")
        files: dict[str, str] = {}
        if self.png is not None:
            files["picture"] = str(
                write_still(run, self.png, size=pixels, time=self.at, robot=robot)
            )
        if self.video is not None:
            with progress_bar("film") as advance:
                write_film(
                    run, self.video, size=pixels, rate=self.fps, robot=robot, progress=advance
                )
            files["film"] = str(self.video)
        return files


def view_command(
    *,
    what: Annotated[
        list[str],
        typer.Argument(
            metavar="ROBOT|RUN...",
            help="A robot, or one or more runs: their folders or run.npz files.",
        ),
    ],
    options: LoadOptions,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the page; serve nothing.")
    ] = None,
    film: FilmOptions,
    as_json: JsonOption = False,
) -> None:
    """Show a robot with sliders, or play runs, on a page served to this machine until Ctrl-C.

    With --html, --png or --video, write a file and serve nothing. rpctl evaluates no code of a run
    and reads no folder that a run names.
    """
    from rpctl.view.run_folder import is_run

    folders = options.package_dirs
    if files := film.write(what, folders):
        _written(as_json, files)
        return
    if html is not None:
        require_writable(html)
    if len(what) > 1 or is_run(what[0]):
        from rpctl.view.serve.live import serve

        report = _report([Path(each) for each in what], folders)
        _write_or(html, report, partial(serve, report), as_json)
        return
    from rpctl.view.pages.robot_page import robot_page
    from rpctl.view.serve.go import GoServer

    robot = _load(what[0], options)  # faults of a later edit are told by the page
    words = shlex.join([what[0], *options.words()])
    server = GoServer(lambda: options.load(what[0]), f"rpctl track {words}")
    _write_or(html, lambda: robot_page(robot).encode(), server.run, as_json)


def _report(runs: Sequence[Path], package_dirs: Sequence[Path | str]) -> Callable[[], bytes]:
    """Return what returns the page of one run or several; it is drawn before."""
    from rpctl.view.run_folder import RunPage, comparison

    if len(runs) == 1:
        return RunPage(runs[0], package_dirs, _note)
    page = comparison(runs, package_dirs, _note)
    return lambda: page


def _write_or(
    html: Path | None,
    page: Callable[[], bytes],
    serve: Callable[[Callable[[str], object]], object],
    as_json: bool,
) -> None:
    """Write a page if there is a file to write, else serve it and print its address."""
    if html is None:
        serve(lambda url: _written(as_json, {"url": url}, ADDRESS))
    else:
        _written(as_json, {"page": str(write_atomically(html, page()))})


def _written(as_json: bool, files: Mapping[str, str], form: str = "wrote {}") -> None:
    """Print which files were written, or the address of what is served, by kind."""
    tell(as_json, lambda: files, lambda: say("\n".join(map(form.format, files.values()))))


def _load(name: str, options: LoadOptions) -> Robot:
    """Load a robot; what is neither a robot nor a run is called so.

    Raises:
        RpctlError: It cannot be loaded.
    """
    try:
        return options.load(name)
    except RpctlError as error:
        if is_folder(name) or (Path(name).name != name and not is_file(name)):
            what = "this folder holds no run.npz" if is_folder(name) else "no such file or folder"
            raise RpctlError(
                f"{name}: {what}; give a run's folder, a URDF file, or a name listed by "
                "`rpctl robots`"
            ) from None
        if isinstance(error, UnknownNameError) and error.name == name:
            raise UnknownNameError("robot or run", name, error.choices) from None
        raise


def plot_command(
    run: RunArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=f"File to write, .pdf or .png; default: {DEFAULT_FIGURE} beside the run.",
        ),
    ] = None,
    panels: Annotated[
        str,
        typer.Option(
            metavar="NAME,...", help=f"Panels to draw: {', '.join(PANELS)}; default: all."
        ),
    ] = "",
    column: Annotated[
        bool,
        typer.Option(
            "--column", help="Make the figure 88 mm wide, for one of two columns; default: 180 mm."
        ),
    ] = False,
    log: Annotated[bool, typer.Option("--log", help="Errors on logarithmic axes.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write the figure of a run for a paper, as PDF or PNG."""
    from rpctl.view.plots.figures import save_figure
    from rpctl.view.run_folder import load_run

    path = out or (run if is_folder(run) else run.parent) / DEFAULT_FIGURE
    if out is None and path.is_symlink():
        path.unlink()  # the folder may be another's, and the link lead to any file
    require_writable(path)
    save_figure(load_run(run, _note), path, panels=split_names(panels), column=column, log=log)
    _written(as_json, {"figure": str(path)})


def _read_size(text: str | None) -> tuple[int, int] | None:
    """Return the numbers of ``WxH``."""
    if text is None:
        return None
    try:
        width, height = (int(word) for word in text.lower().split("x"))
    except ValueError:
        raise RpctlError(f"--pixels {text}: give two numbers, such as 1280x720") from None
    return width, height
