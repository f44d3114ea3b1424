"""Many robots before the referee: each in each engine, in processes of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from rpctl.cli.options import LoadOptions
from rpctl.cli.streams import say
from rpctl.cli.terminal import progress_bar
from rpctl.engines.engine import Engine
from rpctl.engines.referee import EngineVerdict, Referee
from rpctl.errors import RpctlError
from rpctl.study.executor import Executor, LostChunksError, ProcessExecutor


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
