"""Losses and rotors on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rpctl.cli.app import app
from rpctl.cli.options import LoadOptions
from rpctl.errors import RpctlError
from tests.dynamics.test_losses import lossy
from tests.robots import SET_A, platform


def test_options_reach_the_robot(tmp_path: Path) -> None:
    source = lossy(tmp_path, platform(SET_A)).source
    robot = LoadOptions().load(source)
    assert robot.losses is not None and not robot.armature.any()
    ideal = LoadOptions({"losses": True, "armature": ["left*=0.25", "right_joint=0.5"]}).load(
        source
    )
    assert ideal.losses is None
    assert sorted(ideal.armature.tolist()) == [0.0, 0.0, 0.0, 0.25, 0.5]
    with pytest.raises(RpctlError, match="gives the inertia of a rotor"):
        LoadOptions({"armature": ["file"]}).load(source)
    with pytest.raises(RpctlError, match="--armature left: write"):
        LoadOptions({"armature": ["left"]}).load(source)


def test_inspect_lists_them(tmp_path: Path) -> None:
    source = lossy(tmp_path, platform(SET_A)).source
    words = ["inspect", source, "--armature", "left*=0.25"]
    lines = CliRunner().invoke(app, words).output
    assert "damping 0.3 N·m·s/rad, friction 0.2 N·m, rotor 0.25 kg·m²: left_joint" in lines
    assert "damping 0.3 N·m·s/rad, friction 0.2 N·m: right_joint" in lines
    found = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)["losses"]
    left = next(each for each in found if each["joint"] == "left_joint")
    assert {key: left[key] for key in ("damping", "friction", "rate", "armature")} == {
        "damping": 0.3, "friction": 0.2, "rate": 0.01, "armature": 0.25,
    }  # fmt: skip
