"""Which simulator is right: ``rpctl referee``; of many robots each in each engine, in processes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rpctl.cli.options import JsonOption, LoadOptions, split_names, tell
from rpctl.cli.terminal import console, escape, new_table, progress_bar, say
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.engines.comparison import gap_text
from rpctl.engines.engine import ENGINES, Engine, installed_engines
from rpctl.engines.referee import DURATION_S, EngineVerdict, Referee
from rpctl.errors import RpctlError
from rpctl.files.writing import require_writable
from rpctl.libraries import install_command
from rpctl.robot.catalog import ENTRIES
from rpctl.study.executor import Executor, LostChunksError, ProcessExecutor


@dataclass(frozen=True)
class RefereeOptions:
    """What drives in which engines, and how."""

    catalogue: Annotated[
        bool, typer.Option("--catalogue", help="Judge all wheeled robots of the catalogue.")
    ] = False
    engines: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help=f"Engines: {', '.join(ENGINES)}; default: those that are installed.",
        ),
    ] = ""
    friction: Annotated[
        float, typer.Option(help="Friction coefficient of the ground in the corrected runs.")
    ] = FRICTION
    duration: Annotated[float, typer.Option(help="Duration of the drive, s.")] = DURATION_S
    html: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write a page that plays the robot of each engine on one timeline."
        ),
    ] = None
    workers: Annotated[
        int,
        typer.Option(
            min=1, help="Number of processes for several robots; default: one for each processor."
        ),
    ] = os.cpu_count() or 1


def referee_command(
    *,
    options: LoadOptions,
    robots: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ROBOT]...",
            help="Robots: URDF or .xacro files, or names listed by `rpctl robots`.",
        ),
    ] = None,
    settings: RefereeOptions,
    as_json: JsonOption = False,
) -> None:
    """Drive a robot in other simulators and in the model, and explain where they disagree.

    The same efforts and the same start go to the reduced model and to each engine that is
    installed, with its own defaults. Exit 1 if a disagreement could not be traced to its causes.
    """
    os.environ.setdefault("MUJOCO_GL", "disable")  # it draws nothing here, and looks for displays
    names = _robots(robots or [], settings.catalogue)
    if settings.html is not None:
        require_writable(settings.html)
        if len(names) > 1:
            raise RpctlError("--html shows one robot; you gave several")
    found, missing = installed_engines(split_names(settings.engines))
    for sentence in missing:
        say(f"left out: {sentence}", err=True)
    if not found:
        raise RpctlError(f"no engine to compare with is installed; run {install_command('mujoco')}")
    motion = settings.friction, settings.duration
    if len(names) == 1:
        verdicts = _judge(names[0], options, found, motion, settings.html)
        league = League({names[0]: verdicts}, {}, whole=True)
    else:
        league = play_league(names, found, options, motion, settings.workers, as_json=as_json)
    traced = all(verdict.traced for verdicts in league.judged.values() for verdict in verdicts)
    plain = {
        "robots": {name: [one.to_dict() for one in found] for name, found in league.judged.items()},
        "refused": {name: str(error) for name, error in league.refused.items()},
        "missing": list(missing),
    }
    tell(as_json, lambda: plain, partial(_show, league), passed=league.whole and traced)


def _robots(given: list[str], catalogue: bool) -> list[str]:
    """Return the robots to judge.

    Raises:
        RpctlError: There are none, or the catalogue and others.
    """
    if catalogue and given:
        raise RpctlError("give either robots or --catalogue")
    if catalogue:
        return [entry.name for entry in ENTRIES if entry.base == "wheeled"]
    if not given:
        raise RpctlError("no robot is given; give a URDF file or a name, or --catalogue for all")
    return given


def _judge(
    name: str,
    options: LoadOptions,
    engines: Sequence[Engine],
    motion: tuple[float, float],
    html: Path | None,
) -> tuple[EngineVerdict, ...]:
    """Return the verdicts on the engines for a robot, and write the page if one is wanted."""
    judge = Referee(options.load(name), *motion)
    verdicts = tuple(judge.judge(engine) for engine in engines)
    if html is not None:
        from rpctl.view.pages.referee import write_referee_page

        write_referee_page(judge.robot, verdicts, html)
    return verdicts


def _show(league: League) -> None:
    """Print a row for each robot and engine; of one robot the referee's lines and notes, too."""
    judged, refused = league.judged, league.refused
    out, several = console(), len(judged) + len(refused) > 1
    robot = ("robot",) if several else ()
    table = new_table(
        "", *robot, "engine", ">path", ">heading", ">slip", ">load", ">energy", "verdict"
    )
    for name, verdicts in judged.items():
        for verdict in verdicts:
            table.add_row(_mark(verdict), *([escape(name)] if several else []), *_cells(verdict))
    out.print(table)
    for verdicts in () if several else judged.values():
        for verdict in verdicts:
            for said in filter(None, (verdict.line, verdict.turn_line)):
                out.print(escape(said), soft_wrap=True)
        for note in dict.fromkeys(note for verdict in verdicts for note in verdict.notes):
            out.print(f"[dim]note[/] {escape(note)}")
    for name, error in refused.items():
        out.print(f"[dim]-[/] {escape(name)}: {escape(str(error))}")


def _mark(verdict: EngineVerdict) -> str:
    """Return a mark: agrees, disagrees and why is known, disagrees."""
    if verdict.agrees:
        return "[green]✓[/]"
    return "[yellow]![/]" if verdict.traced else "[bold red]✗[/]"


def _cells(verdict: EngineVerdict) -> list[str]:
    """Return the cells of an engine's row."""
    found = {gap.name: gap_text(gap.gap, gap.unit) for gap in verdict.gaps}
    head = f"{verdict.engine} {verdict.version}"
    gaps = [found.get(name, "–") for name in ("path", "heading", "slip", "load", "energy")]
    if verdict.trace is None:
        return [head, *gaps, "agrees"]
    causes = [" with ".join(cause.names) for cause in verdict.trace.causes]
    return [head, *gaps, f"disagrees: {', '.join(causes) or 'for no cause found'}"]


@dataclass(frozen=True)
class LeagueMatch:
    """A robot, and the engine in which it is judged."""

    robot: str
    engine: Engine

    def __str__(self) -> str:
        """Return ``paper in Drake``."""
        return f"{self.robot} in {self.engine.name}"


@dataclass(frozen=True)
class League:
    """What became of many robots.

    Attributes:
        judged: The verdicts, by robot, in the order in which robots and engines were given.
        refused: Why there is none, by robot; by match where an engine ended its process.
        whole: Whether no engine ended its process.
    """

    judged: dict[str, tuple[EngineVerdict, ...]]
    refused: dict[str, RpctlError]
    whole: bool


def play_league(
    robots: Sequence[str],
    engines: Sequence[Engine],
    options: LoadOptions,
    motion: tuple[float, float],
    workers: int,
    *,
    as_json: bool = False,
) -> League:
    """Judge robots in engines, and say each verdict's line as soon as it is known.

    Args:
        robots: As the user names them.
        options: How robots are loaded.
        motion: Coefficient of the ground, and how long the robots drive, s.
        as_json: Whether lines go to stderr.
    """
    matches = [LeagueMatch(robot, engine) for robot in robots for engine in engines]
    found: dict[LeagueMatch, EngineVerdict] = {}
    refused: dict[str, RpctlError] = {}
    lost: dict[str, RpctlError] = {}
    executor: Executor = Executor() if workers == 1 else ProcessExecutor(workers)
    work = partial(judge_match, options, motion)
    with executor, progress_bar("referee", f"{len(matches)} matches") as advance:
        try:
            for done, (match, verdict) in enumerate(executor.map_chunks(work, matches), 1):
                if isinstance(verdict, RpctlError):
                    refused[match.robot] = verdict
                else:
                    found[match] = verdict
                    say(f"{match.robot}: {verdict.line}", err=as_json)
                advance(done, len(matches))
        except LostChunksError as error:
            lost = {str(match): error for match in error.chunks}
    judged = {
        robot: verdicts
        for robot in dict.fromkeys(robots)
        if (verdicts := tuple(found[one] for one in matches if one.robot == robot and one in found))
    }
    return League(judged, refused | lost, not lost)


def judge_match(
    options: LoadOptions, motion: tuple[float, float], match: LeagueMatch
) -> EngineVerdict | RpctlError:
    """Return the verdict of a match, or why the robot is refused.

    Args:
        options: How the robot is loaded.
        motion: Coefficient of the ground, and how long the robot drives, s.
        match: The robot and the engine.
    """
    try:
        return Referee(options.load(match.robot), *motion).judge(match.engine)
    except RpctlError as error:
        return error
