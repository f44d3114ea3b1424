"""``--home``, ``--free`` and ``--end-effector`` of commands that load a robot."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpctl.cli.app import app
from tests.robot.arms import arm, write
from tests.robot.test_grippers import SLIDES
from tests.robot.test_home import SRDF


@pytest.fixture
def robot(tmp_path: Path) -> tuple[str, ...]:
    (tmp_path / "arm.srdf").write_text(SRDF, encoding="utf-8")
    return str(write(tmp_path, arm(), *SLIDES)), "--drive", "fixed"


def homes(*words: str) -> dict[str, float]:
    result = CliRunner().invoke(app, ["inspect", *words, "--json"])
    assert result.exit_code == 0, result.output
    return {joint["name"]: joint["home"] for joint in json.loads(result.stdout)["joints"]}


def test_words_of_home_follow_one_another(robot: tuple[str, ...], tmp_path: Path) -> None:
    state = f"{tmp_path / 'arm.srdf'}:home"
    found = homes(*robot, "--home", state, "--home", "rod_2_joint=0.6,rod_3_joint=-1")
    assert found == {"rod_1_joint": 0.4, "rod_2_joint": 0.6, "rod_3_joint": -1.0}
    assert set(homes(*robot, "--home", "zero").values()) == {0.0}
    assert homes(*robot, "--home", "auto") != homes(*robot, "--home", "zero")
