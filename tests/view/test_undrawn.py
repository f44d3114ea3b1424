"""Runs that somebody else sent: shown from what they hold, and without a robot if need be."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl import Robot, RpctlError, Run
from rpctl.cli.app import app
from rpctl.description.meshes.service import SERVICE
from rpctl.files.array_messages import pack
from rpctl.robot.coordinates import read_root
from rpctl.view import run_folder
from rpctl.view.pages.report import robot_of, write_report
from rpctl.view.scene.robot_meshes import base_marker
from rpctl.view.scene.scene import base_poses, build_scene, joint_poses
from tests.leaning import leaning
from tests.runs import vary
from tests.view.readers import embedded
from tests.view.samples import write_cart

REASON = RpctlError("there is no file")


def test_the_marker_moves_as_the_base_does(paper: Robot, paper_run: Run) -> None:
    q = paper_run.q[::100]
    poses, whole = base_poses(q), joint_poses(paper, q)[:, :2]
    signs = np.sign(np.einsum("kij,kij->ki", poses[..., 3:], whole[..., 3:]))[..., None]
    whole[..., 3:] *= signs  # of either sign a quaternion is the same turn
    np.testing.assert_allclose(poses, whole, atol=1e-12)


def test_the_marker_leans_as_the_base_does() -> None:
    robot = leaning("balancer")
    q = np.array([robot.configuration(0.3, -0.2, 1.0, tilt=tilt) for tilt in (0.0, 0.4)])
    poses, whole = base_poses(q, leans=True), joint_poses(robot, q)[:, :2]
    whole[..., 3:] *= np.sign(np.einsum("kij,kij->ki", poses[..., 3:], whole[..., 3:]))[..., None]
    np.testing.assert_allclose(poses, whole, atol=1e-12)
    assert poses[0, 1, 2] == pytest.approx(-robot.drive.ground)  # the wheels' radius up


def test_the_marker_points_forward_and_lies_among_the_contacts(paper_run: Run) -> None:
    bodies = base_marker(paper_run, "no file")
    (surface,) = bodies.surfaces
    points, drive = np.array(paper_run.ground.points), paper_run.robot.drive
    corners = surface.vertices[:, :2] - points.mean(axis=0)
    forward = corners @ np.array([np.cos(drive.heading), np.sin(drive.heading)])
    size = np.ptp(points, axis=0).max()
    assert forward.max() == pytest.approx(0.6 * size, rel=1e-6)
    assert forward.min() == pytest.approx(-0.4 * size, rel=1e-6)
    assert np.ptp(surface.vertices[:, 2]) == pytest.approx(0.2 * size, rel=1e-6)
    assert surface.vertices[:, 2].min() == pytest.approx(drive.ground)
    volume = np.einsum(
        "ki,ki->", surface.vertices[surface.faces[:, 0]],
        np.cross(surface.vertices[surface.faces[:, 1]], surface.vertices[surface.faces[:, 2]]),
    ) / 6.0  # fmt: skip
    assert volume == pytest.approx(0.5 * 0.6 * size * size * 0.2 * size, rel=1e-5)


def test_a_run_is_reported_without_its_robot(paper_run: Run, tmp_path: Path) -> None:
    older = vary(paper_run, urdf="<robot/>")  # not the one whose digest it tells
    older = replace(older, simulated=None)
    assert isinstance(robot_of(older), RpctlError)
    text = write_report(older, tmp_path / "a.html").read_text()
    data = embedded(text)
    assert "a wedge represents its base: " in text
    assert data["effort"]["joints"] == [0] * len(older.robot.actuators)
    whole = embedded(write_report(paper_run, tmp_path / "b.html").read_text())
    assert data["plots"] == whole["plots"]
    assert (data["stance"], data["duration"]) == (whole["stance"], whole["duration"])
    scene = build_scene(REASON, older)
    assert scene.follow == "robot-1"
    assert scene.origin[:2].tolist() == list(read_root(older.q[0]))[:2]


@pytest.fixture
def hostile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a run that names a .xacro; a process that were started would fail."""
    folder = tmp_path / "sent"
    folder.mkdir()
    (tmp_path / "evil.urdf.xacro").write_text("${open('/etc/passwd')}")
    run = rpctl.track(rpctl.load(write_cart(tmp_path)), "circle", duration=0.02)
    vary(run, source=str(tmp_path / "evil.urdf.xacro")).save(folder / "run.npz")

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a process was started")

    sphere = pack({"job": "primitive", "kind": "sphere", "size": [0.1]})
    SERVICE.ask(sphere)  # confined, and the only process that pages need
    monkeypatch.setattr(subprocess, "Popen", refuse)
    monkeypatch.setattr(run_folder, "tracking_image", lambda run: b"a picture takes its time")
    return folder


def test_the_command_line_shows_a_hostile_folder_as_data(hostile: Path, tmp_path: Path) -> None:
    page = tmp_path / "a.html"
    result = CliRunner().invoke(app, ["view", str(hostile), "--html", str(page)])
    assert (result.exit_code, result.stdout) == (0, f"wrote {page}\n")
    assert "summary.json is missing, tracking.png is missing" in result.stderr
    assert page.read_bytes() == (hostile / "report.html").read_bytes()
    assert json.loads((hostile / "summary.json").read_text())["outcome"]
    assert "wedge" not in page.read_text()
