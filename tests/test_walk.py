"""The whole way through the command line: inspect, verify, track, report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.drive.drive import BASE_SPEEDS, LEANING
from rpctl.reference.named import BASE_PATHS
from rpctl.robot.catalog import ENTRIES, names
from tests.grids import cells

ROBOTS = {  # quasi-velocities, drive
    "paper": (4, "differential"),
    "mixed_chain": (7, "differential"),
    "casters": (5, "differential"),
    "skid_steer": (5, "skid-steer"),
    "car": (5, "car-like"),
    "tricycle": (3, "tricycle"),
    "loader": (4, "articulated"),
    "bicycle": (2, "bicycle"),
    "swerve": (6, "steered"),
    "twin_casters": (5, "steered"),
    "caster_drive": (5, "powered-casters"),
    "omni": (6, "omni"),
    "mecanum": (8, "mecanum"),
    "arm": (5, "fixed"),
    "tiago": (12, "differential"),
    "tiago_pro": (20, "mecanum"),
    "pr2": (18, "fixed"),
    "panda": (7, "fixed"),
    "ur5": (6, "fixed"),
}
OWN = tuple(entry.name for entry in ENTRIES if entry.own and not entry.leans)
SLOW_WALKS = {"arm", "car", "mecanum", "tiago"}
LIMITS_KEPT = {"mixed_chain", "tricycle"}  # by plain `track` in CI
ON_AXLES = [
    name for name in OWN if ROBOTS[name][1] in ("car-like", "tricycle", "articulated", "bicycle")
]
PAIRS = [
    (name, reference)
    for name in OWN
    for reference in BASE_PATHS
    if ROBOTS[name][1] != "fixed" and not (reference == "spin" and name in ON_AXLES)
]
PAIRS_IN_CI = {
    ("loader", "reverse"),
    ("caster_drive", "eight"),
    ("omni", "spin"),
}
OFF = (0.1, -0.1, 0.1)  # m, m, rad: the error at the start of a robot that drives
SHRUNK = 0.05  # m: the base's error after 3.5 s, which was 0.14 m
SETTLED = 2e-3  # m: the base's error after 12 s
SPUN = 1e-2  # m: the same where it turns on the spot, which mends what lies beside it slowly
BACKED = 5e-3  # m: the same where the rear axle leads, which first has to come to its path
FOLLOWED = 5e-4  # m: the end effector's error of an arm that starts on its reference
SAGGING = {  # springs that a URDF does not tell bear the shoulders: their motors alone are too weak
    "pr2": "l_shoulder_lift_joint: 49.1 of 30 N m",
    "baxter": "right_s1: 51.4 of 50 N m",
}
TRACKED = [name for name in names() if name not in {*SAGGING, "double_pendulum"}]  # not driven
REPORT_SIZE = 500_000  # bytes: the viewer alone is larger


def json_of(*words: str, code: int = 0) -> Any:
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == code, result.output
    return json.loads(result.stdout)


def test_there_is_an_own_robot_of_every_drive() -> None:
    assert {ROBOTS[name][1] for name in OWN} == BASE_SPEEDS.keys() - set(LEANING)


@pytest.mark.parametrize("name", cells(ROBOTS, slow=SLOW_WALKS))
def test_a_robot_walks_from_its_description_to_its_report(name: str, tmp_path: Path) -> None:
    dof, drive = ROBOTS[name]
    facts = json_of("inspect", name)
    assert (facts["dof"], facts["drive"]["type"]) == (dof, drive)
    weak = ["holds its joints at home"] if name in SAGGING else []
    proof = json_of("verify", name, "--samples", "3", code=len(weak))
    assert [check["name"] for check in proof["checks"] if not check["passed"]] == weak

    off = ("--initial-error", ",".join(map(str, OFF))) if drive != "fixed" else ()
    words = ("--duration", "3.5", *off, "--samples", "3", "--out", str(tmp_path))
    if weak:
        refused = CliRunner().invoke(app, ["track", name, *words])
        assert refused.exit_code == 2
        assert SAGGING[name] in refused.output
        return
    summary = json_of("track", name, *words)
    assert not summary["limits_violated"]
    assert all(note.startswith("gains: ") for note in summary["notes"])
    assert summary["final_base_error"] < SHRUNK
    assert drive != "fixed" or summary["final_end_effector_error"] < FOLLOWED
    report = tmp_path / "report.html"
    assert summary["report"] == str(report)
    assert report.stat().st_size > REPORT_SIZE


@pytest.mark.parametrize("name", cells(TRACKED, slow=LIMITS_KEPT))
def test_plain_track_keeps_every_limit(name: str) -> None:
    """The default reference fits the robot, whichever it is."""
    run = rpctl.track(rpctl.load(name))
    summary = rpctl.summarize(run)
    assert not summary.limits_violated
    assert summary.outcome == "tracked"
    assert summary.sizing is not None
    assert run.t[-1] == pytest.approx(summary.sizing.duration, abs=0.01)


@pytest.mark.parametrize(("name", "reference"), cells(PAIRS, slow=PAIRS_IN_CI))
def test_every_drive_follows_every_reference(name: str, reference: str) -> None:
    robot = rpctl.load(name)
    summary = rpctl.summarize(rpctl.track(robot, reference, duration=12.0, initial_error=OFF))
    assert summary.limits_violated == ()
    bounds = {"spin": SPUN, "reverse": BACKED if name == "loader" else SETTLED}
    assert summary.final_base_error < bounds.get(reference, SETTLED)
