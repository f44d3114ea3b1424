"""The command that closes the loop: ``rpctl track``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, RobotArgument, default_folder, tell
from rpctl.cli.summary import show_reference, show_summary
from rpctl.cli.terminal import console, escape, progress_bar
from rpctl.cli.track_options import ConfigOptions, ResultOptions
from rpctl.cli.verify import VerifyOptions, certificate_line, certify
from rpctl.reference.motion import Reference
from rpctl.reference.pose_goal import GOAL, is_goal
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, write_config
from rpctl.simulation.loop.budget import Budget
from rpctl.simulation.loop.periods import whole_periods
from rpctl.simulation.loop.track import default_duration, require_affordable, simulate
from rpctl.simulation.merits.expectation import expect
from rpctl.simulation.run.part import PART_FOLDER, PartWriter
from rpctl.simulation.run.run import Run

if TYPE_CHECKING:
    from rpctl.equivalence.verify import Certificate
    from rpctl.view.run_folder import RunFolder
    from rpctl.view.serve.live import Broadcast


def track_command(
    *,
    robot: RobotArgument,
    options: LoadOptions,
    settings: ConfigOptions,
    samples: Annotated[
        int, typer.Option(min=0, help="Random states of the certificate; 0 for none.")
    ] = 20,
    results: ResultOptions,
    as_json: JsonOption = False,
) -> None:
    """Close the loop with the predictive controllers; write run, figures, plots and report.

    Exit 1 if the reference was not tracked (stuck, diverging, collided; late is told, and is no
    failure), a limit of the URDF was broken, or the dynamics could not be verified.
    """
    config = settings.read()
    loaded = config.limits.apply(options.load(robot))
    config = settings.with_plant(config, loaded)
    reference = config.run.load_reference(loaded, results.collisions)
    if settings.save_config is not None:
        write_config(config, settings.save_config, schema=True)
    folder = results.out or default_folder(loaded.name, reference_label(config.run.reference))
    results.require_possible(folder)
    output = console(stderr=as_json)
    output.print(
        f"[bold]{escape(loaded.name)}[/]: {loaded.dof} quasi-velocities, {loaded.drive.type} drive"
    )
    show_reference(output, loaded, reference, options.strict)
    budget = require_affordable(loaded, config, reference)
    certificate = None
    if samples:
        certificate = certify(loaded, VerifyOptions(samples, engines="none"), options.strict)
        output.print(certificate_line(certificate))
    task = _Task(loaded, config, reference, certificate, budget)
    written = _simulate(task, results, folder, output.print)
    passed = written.summary.succeeded and (certificate is None or certificate.passed)
    tell(as_json, written.to_dict, partial(show_summary, written, folder), passed)


@dataclass(frozen=True)
class _Task:
    """What is simulated: the robot has the configuration's limits."""

    robot: Robot
    config: Config
    reference: Reference
    certificate: Certificate | None
    budget: Budget


def _simulate(
    task: _Task, results: ResultOptions, folder: Path, say: Callable[[str], object]
) -> RunFolder:
    """Simulate and write; what ends it early, Ctrl-C or an error, leaves the run so far."""
    with PartWriter(folder / PART_FOLDER) as part, _live_page(task, results.live, say) as page:
        ended: list[Run] = []
        try:
            with progress_bar("simulate", task.budget.brief) as advance:
                run = simulate(
                    task.robot,
                    task.config,
                    task.reference,
                    certificate=task.certificate,
                    progress=advance,
                    watch=page,
                    ended=ended.append,
                    part=part,
                    collisions=results.collisions,
                    backend=results.backend,
                )
        except BaseException:
            if ended:
                if page is not None:
                    page.end("Ended")
                written = _write(ended[0], page, results, folder, part)
                note = escape(ended[0].notes[-1])
                console(stderr=True).print(f"{note}: [bold]{escape(str(written.report))}[/]")
            raise
        if page is not None:
            page.end("Simulated")
        if results.perturbs(task.config):
            with _part_told(part):
                run = _with_expectation(run, task)
        return _write(run, page, results, folder, part)


def _write(
    run: Run, page: Broadcast | None, results: ResultOptions, folder: Path, part: PartWriter
) -> RunFolder:
    """Write the files of a run and show them to who watched it; its part is removed then."""
    with _part_told(part):
        written = results.write(run, folder)
    part.remove()
    if page is not None:
        page.finish(written.report)
    return written


@contextmanager
def _part_told(part: PartWriter) -> Iterator[None]:
    """Say where the samples are if something keeps the run from being written."""
    try:
        yield
    except BaseException:
        where = escape(str(part.folder))
        console(stderr=True).print(f"what was simulated is kept: [bold]{where}[/]")
        raise


def _with_expectation(run: Run, task: _Task) -> Run:
    """Return a run that tells what became of it with a perturbed plant; it cannot fail it."""
    with progress_bar("perturb"):
        expected = expect(task.robot, task.config, task.reference)
    return replace(run, perturbed=None if expected is None else expected.to_dict())


def reference_label(reference: str) -> str:
    """Return a short name for a reference: its own, its file's without suffix, or "goal"."""
    return GOAL if is_goal(reference) else Path(reference).stem


def _live_page(
    task: _Task, wanted: bool, say: Callable[[str], object]
) -> AbstractContextManager[Broadcast | None]:
    """Serve the page that shows the simulation while it runs, if it is wanted."""
    if not wanted:
        return nullcontext()
    from rpctl.simulation.merits.obstacles import find_obstacles
    from rpctl.view.serve.live import broadcast

    settings = task.config.run
    duration = settings.duration or default_duration(task.reference)
    duration = whole_periods(duration, settings.control_period) * settings.control_period
    return broadcast(task.robot, task.reference, duration, say, find_obstacles(task.config))
