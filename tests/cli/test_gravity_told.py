"""What an actuator cannot hold at home is told: by ``inspect``, and by ``track`` before the run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpctl.cli.app import app
from tests import urdf
from tests.robots import SET_A, platform, wheel, write

TOLD = "gravity at home exceeds the effort limit of arm_joint: 9.81 of 5 N m; give another posture"


def level_arm(folder: Path, effort: float) -> str:
    """Return the URDF of a platform with an arm of 2 kg, 0.5 m ahead of its joint."""
    limit = urdf.limit(-2.0, 2.0, effort, 2.0)
    parts = [
        urdf.link("arm", urdf.inertial(2.0, (0.01, 0.01, 0.01), xyz=(0.5, 0, 0))),
        urdf.joint("arm_joint", "revolute", ("base", "arm"), "0 0 0.5", "0 1 0", limit),
    ]
    return str(write(folder, platform(SET_A, extra="\n".join(parts))))


def said(*words: str) -> str:
    found = CliRunner().invoke(app, list(words))
    assert found.exit_code in (0, 1), found.output
    return found.output


def weaknesses(*words: str) -> list[str]:
    findings = json.loads(said("inspect", *words, "--json"))["findings"]
    return [each["message"] for each in findings if "gravity" in each["message"]]


def test_inspect_finds_a_joint_too_weak_for_gravity(tmp_path: Path) -> None:
    home = ("--home", "zero")
    (message,) = weaknesses(level_arm(tmp_path, 5.0), *home)
    assert message.startswith(TOLD)
    assert weaknesses(level_arm(tmp_path, 10.0), *home) == []


def test_inspect_finds_that_a_robot_does_not_stand(tmp_path: Path) -> None:
    path = str(write(tmp_path, platform(SET_A)))
    findings = json.loads(said("inspect", path, "--json"))["findings"]
    assert [each["message"] for each in findings if "stand" in each["message"]] == [
        "it does not stand in its home posture: only left_joint, right_joint touch the ground, "
        "on one line"
    ]
    assert "does not stand" not in said("inspect", "paper")


@pytest.mark.usefixtures("undrawn")
def test_what_is_doubtful_of_the_drive_is_told_with_the_proof_and_before_the_run(
    tmp_path: Path,
) -> None:
    """Four parallel wheels could be mecanum wheels: no row can question that."""
    path = str(
        write(
            tmp_path,
            platform(
                SET_A,
                extra="\n".join(
                    wheel("far", (-0.6, 0.75), 1, SET_A) + wheel("back", (-0.6, -0.75), 1, SET_A)
                ),
            ),
        )
    )
    told = "4 parallel wheels: rpctl assumes ordinary ones, skid-steer"
    assert f"doubtful, {told}" in " ".join(said("verify", path, "--samples", "1").split())
    words = (
        "--samples",
        "0",
        "--no-perturbed",
        "--duration",
        "0.1",
        "--out",
        str(tmp_path / "out"),
    )
    assert f"doubt {told}" in " ".join(said("track", path, *words).split())


@pytest.mark.usefixtures("undrawn")
def test_track_refuses_a_joint_too_weak_for_gravity_unless_it_may_sink(tmp_path: Path) -> None:
    path, folder = level_arm(tmp_path, 5.0), str(tmp_path / "run")
    words = ("track", path, "--home", "zero", "--duration", "0.02", "--out", folder)
    refused = CliRunner().invoke(app, [*words, "--samples", "0"])
    assert refused.exit_code == 2
    assert TOLD in " ".join(refused.output.split())
    assert "--allow-sag" in refused.output
    assert not (tmp_path / "run").exists()
    allowed = said(*words, "--samples", "0", "--allow-sag", "--no-perturbed")
    assert TOLD in " ".join(allowed.split())
    assert (tmp_path / "run" / "report.html").exists()
