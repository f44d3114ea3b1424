"""``rpctl track`` refuses to start inside an obstacle, and exits 1 after a collision."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpctl.cli.app import app
from tests.folding import folding

DISC = """[kinematic]
law = "horizon"
[[kinematic.base_obstacles]]
shape = "disc"
x = 0.3
y = 0.0
radius = 0.1
"""
HOME = ("--home", "shoulder=-0.3", "--home", "elbow=0.6")


def track(folder: Path, *words: str) -> tuple[int, str, str]:
    robot = folding(folder).source
    out = str(folder / "out")
    found = CliRunner().invoke(
        app, ["track", robot, "--out", out, "--samples", "0", "--no-perturbed", *HOME, *words]
    )
    return found.exit_code, found.stdout, " ".join(found.stderr.split())


def test_a_start_inside_an_obstacle_is_refused(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text(DISC)
    code, _, err = track(tmp_path, "--config", str(config), "--duration", "0.1")
    assert code == 2
    assert "the robot starts inside an obstacle: " in err
    assert "deep in the disc at (0.3, 0) m, radius 0.1 m; start elsewhere (--initial-error)" in err
    assert "Traceback" not in err


@pytest.mark.slow
def test_a_collision_is_exit_code_1_and_told(tmp_path: Path) -> None:
    goal = ("--arm-goal", "shoulder=0.6", "--arm-goal", "elbow=0.9", "--duration", "3")
    code, out, _ = track(tmp_path, *goal)
    assert code == 1
    words = " ".join(out.split())
    assert "collided forearm ran into the ground at 1.3" in words
    assert "nearest to itself " in words
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["outcome"] == "collided"
    assert summary["collisions"][0]["depth"] > 0.2
    code, out, _ = track(tmp_path, *goal, "--no-collisions")
    assert code == 0
    assert "nearest to" not in out
