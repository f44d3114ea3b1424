"""Many robots before the referee: in processes, and where one of them dies or is interrupted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import dataclass

import pytest

from rpctl.arrays import Array
from rpctl.cli.options import LoadOptions
from rpctl.cli.referee import LeagueMatch, judge_match, play_league
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.engines.engine import Mended
from rpctl.engines.mujoco.engine import MujocoRun, MujocoSimulator
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.study.executor import LostChunksError

pytest.importorskip("mujoco")
pytestmark = pytest.mark.slow
PATIENCE_S = 120.0
MOTION = FRICTION, 0.4


@dataclass(frozen=True)
class Dying(MujocoSimulator):
    """An engine that takes its process along."""

    name: str = "Dying"

    def start(self, robot: Robot, q: Array, mended: Mended, friction: float) -> MujocoRun:
        """End the process."""
        os._exit(7)


def test_an_engine_that_dies_costs_its_own_matches_only(
    capsys: pytest.CaptureFixture[str],
) -> None:
    robots, engines = ("skid_steer", "panda"), (Dying(), MujocoSimulator())
    league = play_league(robots, engines, LoadOptions(), MOTION, workers=2)
    assert [verdict.engine for verdict in league.judged["skid_steer"]] == ["MuJoCo"]
    assert set(league.refused) == {"panda", "skid_steer in Dying"} and not league.whole
    assert isinstance(league.refused["skid_steer in Dying"], LostChunksError)
    assert capsys.readouterr().out.startswith("skid_steer: MuJoCo")


def test_a_match_in_a_process_is_that_of_this_one() -> None:
    robots, engines = ("skid_steer", "casters"), (MujocoSimulator(),)
    league = play_league(robots, engines, LoadOptions(), MOTION, workers=2, as_json=True)
    assert tuple(league.judged) == robots and league.whole and not league.refused
    here = judge_match(LoadOptions(), MOTION, LeagueMatch("skid_steer", engines[0]))
    assert not isinstance(here, RpctlError)
    assert league.judged["skid_steer"][0].gaps == here.gaps


def test_an_interrupt_leaves_what_was_said() -> None:
    words = ["skid_steer", "paper", "tiago", "--engines", "mujoco", "--workers", "2"]
    command = [sys.executable, "-m", "rpctl", "referee", *words, "--duration", "0.5"]
    with subprocess.Popen(command, stdout=-1, stderr=-1, text=True) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert first.startswith("skid_steer: MuJoCo")
    assert error.strip() == "interrupted"
