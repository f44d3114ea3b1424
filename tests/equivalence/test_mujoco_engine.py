"""MuJoCo agrees; what it refuses is told; a robot that is not quite the file's is noticed."""

from __future__ import annotations

import dataclasses
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError
from rpctl.arrays import Array
from rpctl.equivalence import mujoco_engine
from rpctl.equivalence.gibbs_appell import GibbsAppell
from rpctl.equivalence.mujoco_engine import EngineRefused, EngineTerms, MujocoEngine
from rpctl.robot.catalog import ENTRIES
from tests.grids import cells
from tests.robots import SET_A, platform, write

if not mujoco_engine.installed():
    pytest.skip("MuJoCo is optional", allow_module_level=True)

EXACT = 1e-12  # rounding over a tree of tens of links, with two decades to spare
HEAVY = "tiago_pro", "pr2"
ROBOTS = [each.name for each in ENTRIES if not (each.leans or each.name in HEAVY)]
STATES = 5
ONE_A_KIND = ("paper", "mecanum", "car", "swerve", "panda")

LIMB = """
  <link name="stub">{inertial}</link>
  <joint name="elbow" type="revolute"><parent link="base"/><child link="stub"/>
    <origin xyz="0.1 0 0.4" rpy="0.3 0.1 -0.2"/><axis xyz="0 1 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="tip">{tip}</link>
  <joint name="stub_tip" type="fixed"><parent link="stub"/><child link="tip"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/></joint>"""
INERTIAL = """<inertial><origin xyz="0 0.02 0.1"/><mass value="{m}"/>
  <inertia ixx="{xx}" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>"""
SOUND = INERTIAL.format(m=1.0, xx=0.015)
FLAT = INERTIAL.format(m=0.1, xx=0.021)  # breaks the triangle rule
WORSE = INERTIAL.format(m=0.1, xx=0.05)
NEGATIVE = INERTIAL.format(m=0.1, xx=-0.001)


def with_limb(folder: Path, inertial: str, tip: str) -> Robot:
    text = platform(SET_A, extra=LIMB.format(inertial=inertial, tip=tip))
    return rpctl.load(write(folder, text))


def gaps(robot: Robot, engine: MujocoEngine, rng: np.random.Generator) -> tuple[float, ...]:
    """Return how far M, h and B of the two are apart at a random state, relative."""
    dynamics = ReducedDynamics(robot)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    terms, size = engine.reduced(q, nu), GibbsAppell(robot).reduced(q, nu).h_size.max()
    B, M = dynamics.actuation(q), dynamics.inertia(q)
    assert isinstance(terms, EngineTerms)
    assert all(np.isfinite(part).all() for part in (terms.M, terms.h, terms.B))
    return (
        float(np.abs(terms.M - M).max() / np.abs(M).max()),
        float(np.abs(terms.h - dynamics.bias(q, nu)).max() / (size or 1.0)),
        float(np.abs(terms.B - B).max() / np.abs(B).max()),
    )


@pytest.mark.parametrize("name", cells(ROBOTS, ONE_A_KIND))
def test_the_reduced_dynamics_agree(name: str, rng: np.random.Generator) -> None:
    robot = rpctl.load(name)
    engine = MujocoEngine(robot)
    for _ in range(STATES):
        assert max(gaps(robot, engine, rng)) <= EXACT


@pytest.mark.parametrize("position", [0.3, -0.2])
def test_locked_joints_stay_where_they_are_locked(
    position: float, rng: np.random.Generator
) -> None:
    lock = {"shoulder_joint": 2.0 * position, "telescope_joint": abs(position)}
    robot = rpctl.load("mixed_chain", lock=lock)
    assert max(gaps(robot, MujocoEngine(robot), rng)) <= EXACT


def test_links_that_mujoco_refuses_are_fused_and_told(tiago: Robot) -> None:
    engine = MujocoEngine(tiago)
    for side, refused in zip(("left", "right"), engine.refused, strict=True):
        link = tiago.description.link[f"base_antenna_{side}_link"]
        assert refused.startswith(f'link "{link.name}" (line {link.line}): inertia is not positive')


@pytest.mark.parametrize(
    ("inertial", "tip", "blamed"),
    [(SOUND, FLAT, "tip"), (FLAT, SOUND, "stub"), (SOUND, NEGATIVE, "tip"), ("", SOUND, None)],
)
def test_a_body_that_is_sound_as_a_whole_goes(
    tmp_path: Path, rng: np.random.Generator, inertial: str, tip: str, blamed: str | None
) -> None:
    robot = with_limb(tmp_path, inertial, tip)
    engine = MujocoEngine(robot)
    assert max(gaps(robot, engine, rng)) <= EXACT
    assert [text.split('"')[1] for text in engine.refused] == ([blamed] if blamed else [])


@pytest.mark.parametrize(("inertial", "tip"), [(WORSE, WORSE), (FLAT, ""), ("", WORSE)])
def test_a_body_that_is_unphysical_as_a_whole_is_refused_by_name(
    tmp_path: Path, inertial: str, tip: str
) -> None:
    robot = with_limb(tmp_path, inertial, tip)
    with pytest.raises(EngineRefused) as refusal:
        MujocoEngine(robot)
    for name, part in (("stub", inertial), ("tip", tip)):
        assert (f'link "{name}" (line' in str(refusal.value)) == bool(part)
    assert "triangle rule" in str(refusal.value)
    assert isinstance(refusal.value, RpctlError)


def changed(robot: Robot, old: str, new: str) -> Robot:
    """Return the robot with other bytes in its file; what was read of them before stays."""
    raw = robot.description.raw.replace(old.encode(), new.encode())
    assert raw != robot.description.raw
    description = dataclasses.replace(robot.description, raw=raw)
    return dataclasses.replace(robot, description=description)


CHANGES = {
    "heavier": ('<mass value="3.6"/>', '<mass value="3.600001"/>'),
    "turned axis": ('axis xyz="0.36 0.48 0.8"', 'axis xyz="0.360001 0.48 0.8"'),
    "moved joint": ('xyz="-0.001 -0.167 0.06"', 'xyz="-0.001 -0.167001 0.06"'),
    "larger wheels": ('cylinder radius="0.11"', 'cylinder radius="0.110001"'),
}


@pytest.mark.parametrize("change", CHANGES)
def test_another_robot_is_noticed(
    mixed_chain: Robot, rng: np.random.Generator, change: str
) -> None:
    """The engine reads the user's bytes by itself, here a part in 1e6 off."""
    difference = max(gaps(mixed_chain, MujocoEngine(changed(mixed_chain, *CHANGES[change])), rng))
    assert 1e-9 < difference < 1e-3


def test_the_drift_of_the_basis_matters(
    mixed_chain: Robot, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In MuJoCo's world-frame base speeds S turns with the robot: without Ṡν it disagrees."""
    engine = MujocoEngine(mixed_chain)
    solve = mujoco_engine._solve

    def without_drift(rows: Array, wanted: Array) -> Array:
        return solve(rows, wanted if wanted.ndim == 2 else np.zeros_like(wanted))

    monkeypatch.setattr(mujoco_engine, "_solve", without_drift)
    assert gaps(mixed_chain, engine, rng)[1] > 1e-6


@pytest.mark.parametrize(
    ("version", "enough"), [("3.13.0", False), ("3.14.0", True), ("4.0.0", True)]
)
def test_an_old_mujoco_does_not_count(
    monkeypatch: pytest.MonkeyPatch, version: str, enough: bool
) -> None:
    monkeypatch.setattr(metadata, "version", lambda _: version)
    assert mujoco_engine.installed() == enough


def test_a_body_that_is_a_rod_as_a_whole_is_refused(tmp_path: Path) -> None:
    """The moments of stub and tip about x, −.001 and .001, cancel; the others are .02."""
    parts = [INERTIAL.format(m=0.1, xx=xx) for xx in (-0.001, 0.001)]
    limb = LIMB.format(inertial=parts[0], tip=parts[1])
    limb = limb.replace('xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"', 'xyz="0 0 0"')
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=limb)))
    with pytest.raises(EngineRefused, match="has the same fault: a principal moment is 0"):
        MujocoEngine(robot)


@pytest.mark.parametrize(
    ("rows", "wanted"),
    [
        ([[1.0, 0.0], [2.0, 0.0]], [1.0, 2.0]),  # many motions
        ([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], [1.0, 1.0, 2.1]),  # none
    ],
)
def test_rows_that_do_not_determine_one_motion_are_refused(
    rows: list[list[float]], wanted: list[float]
) -> None:
    with pytest.raises(RpctlError, match="do not determine the motion"):
        mujoco_engine._solve(np.array(rows), np.array(wanted))
    one = mujoco_engine._solve(np.array([[1.0, 0.0], [0.0, 2.0], [1.0, 2.0]]), np.array([1, 4, 5]))
    np.testing.assert_allclose(one, [1.0, 2.0], rtol=1e-12)
