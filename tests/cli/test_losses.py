"""Losses and rotors on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

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
    with pytest.raises(RpctlError, match=r"--armature left: .* write NAME=0\.01"):
        LoadOptions({"armature": ["left"]}).load(source)
