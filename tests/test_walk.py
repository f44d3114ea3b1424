"""The whole way through the command line: inspect, verify, track, report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rpctl.cli import app
from rpctl.robot.catalog import ENTRIES

ROBOTS = {  # quasi-velocities, drive
    "paper": (4, "differential"),
    "mixed_chain": (7, "differential"),
    "skid_steer": (5, "skid-steer"),
    "mecanum": (8, "mecanum"),
    "tiago": (12, "differential"),
}
REPORT_SIZE = 500_000  # bytes: the viewer alone is larger


def told(*words: str) -> Any:
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_every_own_robot_walks() -> None:
    assert {entry.name for entry in ENTRIES if entry.own} == ROBOTS.keys() - {"tiago"}


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_walks_from_its_description_to_its_report(name: str, tmp_path: Path) -> None:
    dof, drive = ROBOTS[name]
    facts = told("inspect", name)
    assert (facts["dof"], facts["drive"]["type"]) == (dof, drive)
    assert told("verify", name, "--samples", "3")["passed"]

    words = ("--duration", "2", "--initial-error", "0.1,-0.1,0.1", "--samples", "3")
    summary = told("track", name, *words, "--out", str(tmp_path))
    assert summary["limits_violated"] == []
    assert summary["notes"] == []
    report = tmp_path / "report.html"
    assert summary["report"] == str(report)
    assert report.stat().st_size > REPORT_SIZE
