"""Which robots lean, and which are kept level."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl.errors import DriveError
from tests import urdf
from tests.drive.drive_cases import Files, body
from tests.vehicles import Parts, rear_axle


def pair() -> Parts:
    """Return a box on two wheels of one axle."""
    parts = body()
    rear_axle(parts)
    return parts


def in_line(lean: str = "0 0 1") -> Parts:
    """Return a box on two wheels one behind the other, the front one steered."""
    parts = body()
    parts.wheel("rear", "base", "-0.4 0 0.1")
    parts.swivel("steer", "0.4 0 0.3", "revolute", axis=lean)
    parts.wheel("front", "steer_fork", "0 0 -0.2")
    return parts


def test_two_wheels_alone_lean(files: Files) -> None:
    robot = files.load(pair(), root=None)
    assert robot.drive.type == "self-balancing"
    assert robot.quasi_velocities == ("v", "omega", "pitch_rate")
    assert robot.model.nq == 7 + 4 and robot.model.nv == 8
    assert files.load(pair(), root="planar").drive.type == "differential"
    assert files.load(pair(), "differential", root=None).drive.type == "differential"


def test_a_caster_keeps_it_level(files: Files) -> None:
    ball = '<collision><origin xyz="0.25 0 0.03"/><geometry><sphere radius="0.03"/></geometry>'
    parts = pair()
    parts.link("caster", 0.1, f"{ball}</collision>")
    parts.joint("caster_mount", "fixed", ("base", "caster"), "0 0 0", "0 0 1")
    assert files.load(parts, root=None).drive.type == "differential"


def test_of_a_body_without_shapes_nobody_knows_what_stands(files: Files) -> None:
    parts = Parts([])
    parts.link("base", 25.0)
    rear_axle(parts)
    assert files.load(parts, root=None).drive.type == "differential"
    assert files.load(parts, root="free").drive.type == "self-balancing"


def test_a_mesh_that_is_missing_may_be_a_caster(files: Files) -> None:
    parts = pair()
    parts.link("tail", 0.1, urdf.shape('mesh filename="lost.stl"', "visual"))
    parts.joint("tail_mount", "fixed", ("base", "tail"), "-0.3 0 0.05", "0 0 1")
    assert files.load(parts, root=None).drive.type == "differential"


@pytest.mark.parametrize("lean", ["0 0 1", "-0.3 0 0.95"])
def test_two_wheels_in_line_lean(files: Files, lean: str) -> None:
    robot = files.load(in_line(lean), root=None)
    assert robot.drive.type == "leaning-bicycle"
    assert robot.quasi_velocities == ("v", "roll_rate", "steer")
    assert [wheel.joint for wheel in robot.drive.wheels] == ["front", "rear"]
    if lean == "0 0 1":
        assert files.load(in_line(lean), root="planar").drive.type == "bicycle"


def test_what_stands_by_itself_is_refused_a_free_root(files: Files) -> None:
    text = files.refusal(pair(), "leaning-bicycle", root=None)
    assert "it is a self-balancing robot" in text
    with pytest.raises(DriveError, match="on a free root only two wheels may touch"):
        rpctl.load("paper", root="free")


def test_wheels_at_the_ends_of_legs() -> None:
    robot = rpctl.load("wheel_legs")
    assert robot.drive.type == "wheel-legs"
    assert robot.quasi_velocities[:3] == ("v", "omega", "pitch_rate")
    assert robot.legs == set(robot.joint_names) and len(robot.legs) == 4
    assert robot.drive.ground == pytest.approx(-0.48)


def test_a_revolute_wheel_without_a_range_turns(tmp_path: Path) -> None:
    """Upkie's wheels are written so: URDF's default range is 0 to 0, in which nothing rolls."""
    source = rpctl.load("balancer").description.raw.decode()
    source = source.replace('name="wheel_left_joint" type="continuous"',
                            'name="wheel_left_joint" type="revolute"')  # fmt: skip
    path = tmp_path / "balancer.urdf"
    path.write_text(source)
    robot = rpctl.load(path)
    assert robot.drive.type == "self-balancing"
    (told,) = (f.message for f in robot.findings if "no lower and upper" in f.message)
    assert "treats it as unlimited" in told
