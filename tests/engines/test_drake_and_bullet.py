"""Drake and PyBullet: mended they do what the reduced model does; by default what users find."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.dynamics.ground_reaction import FRICTION
from rpctl.dynamics.motion import step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.engines.bullet import BulletEngine
from rpctl.engines.drake import DrakeEngine
from rpctl.engines.engine import (
    ALL_DEFAULT,
    ALL_MENDED,
    Engine,
    EngineFault,
    EngineState,
    Mended,
)
from rpctl.engines.referee import Referee
from rpctl.errors import EngineMissing
from rpctl.robot.model import Robot
from tests import urdf
from tests.engines.test_edited_urdf import two_wheels

pytestmark = pytest.mark.slow
GRAVITY = 9.81


@pytest.fixture(params=["pybullet", "drake"])
def engine(request: pytest.FixtureRequest) -> Engine:
    pytest.importorskip("pybullet" if request.param == "pybullet" else "pydrake")
    return BulletEngine() if request.param == "pybullet" else DrakeEngine()


def moved(
    engine: Engine,
    robot: Robot,
    mended: Mended,
    efforts: dict[str, float],
    seconds: float = 0.5,
) -> EngineState:
    home = dict(zip(robot.joint_names, robot.home.tolist(), strict=True))
    run = engine.start(robot, robot.configuration(joints=home), mended, FRICTION)
    tau = np.array([efforts.get(name, 0.0) for name in robot.actuators])
    for _ in range(round(seconds / engine.tick)):
        run.advance(tau, engine.tick)
    return run.state()


def test_the_loads_are_the_weight_and_nothing_is_printed(
    engine: Engine, capfd: pytest.CaptureFixture[str]
) -> None:
    robot = rpctl.load("paper")
    state = moved(engine, robot, ALL_MENDED, {})
    assert state.load.sum() == pytest.approx(robot.mass * GRAVITY, rel=1e-3)
    assert state.tilt < 2e-3
    assert capfd.readouterr() == ("", "")


def test_rollers_are_not_compared(engine: Engine) -> None:
    robot = rpctl.load("mecanum")
    assert moved(engine, robot, ALL_DEFAULT, {}, 0.05).tilt < 0.01
    with pytest.raises(EngineFault, match="no rollers"):
        engine.start(robot, robot.configuration(), ALL_MENDED, FRICTION)


def with_finger(path: Path, dynamics: str = "", mimic: str = "") -> Robot:
    """Return two wheels and a ball with an upright finger, and one that follows it."""
    inertia = urdf.inertial(0.5, (0.02, 0.02, 0.02))
    more = urdf.link("finger", inertia) + urdf.joint(
        "leader", "revolute", ("base_link", "finger"), (0, 0, 0.5), (0, 0, 1), dynamics + LIMIT
    )
    if mimic:
        more += urdf.link("thumb", inertia) + urdf.joint(
            "led", "revolute", ("base_link", "thumb"), (0, 0, 0.6), (0, 0, 1), mimic + LIMIT
        )
    ball = urdf.shape('sphere radius="0.05"', xyz=(0.3, 0.0, 0.05))
    return rpctl.load(two_wheels(path / "finger.urdf", ball, more=more))


LIMIT = '<limit lower="-3" upper="3" effort="9" velocity="9"/>'


def test_mimic_joints_follow(engine: Engine, tmp_path: Path) -> None:
    robot = with_finger(tmp_path, mimic='<mimic joint="leader" multiplier="-2" offset="0.3"/>')
    state = moved(engine, robot, ALL_MENDED, {"leader": 0.1})
    leader, led = state.joints["leader"][0], state.joints["led"][0]
    assert leader > 0.05
    assert led == pytest.approx(0.3 - 2.0 * leader, abs=3e-3)
    if isinstance(engine, BulletEngine):
        loose = moved(engine, robot, ALL_MENDED - {"mimic"}, {"leader": 0.1})
        assert abs(loose.joints["led"][0] - (0.3 - 2.0 * loose.joints["leader"][0])) > 0.1


@pytest.mark.parametrize(("damping", "friction"), [(0.1, 0.0), (0.0, 0.03)])
def test_damping_and_dry_friction_brake_a_joint(
    engine: Engine, tmp_path: Path, damping: float, friction: float
) -> None:
    robot = with_finger(tmp_path, f'<dynamics damping="{damping}" friction="{friction}"/>')
    dynamics, q, nu = ReducedDynamics(robot), robot.configuration(), np.zeros(robot.dof)
    tau = np.array([0.05 if name == "leader" else 0.0 for name in robot.actuators])
    for _ in range(500):
        q, nu, *_ = step(dynamics, q, nu, tau, 1e-3)
    state = moved(engine, robot, ALL_MENDED, {"leader": 0.05})
    free = 0.05 * 0.5 / 0.02  # rad/s without a loss
    assert nu[-1] < 0.5 * free
    assert state.joints["leader"][1] == pytest.approx(nu[-1], rel=0.01, abs=0.02)


@pytest.fixture
def bullet() -> Iterator[BulletEngine]:
    pytest.importorskip("pybullet")
    yield BulletEngine()


@pytest.fixture
def drake() -> Iterator[DrakeEngine]:
    pytest.importorskip("pydrake")
    yield DrakeEngine()


def test_pybullet_lets_a_link_without_inertia_weigh_a_kilogram(bullet: BulletEngine) -> None:
    robot = rpctl.load("paper")  # its tool has none
    for left_out, more in (({"inertia"}, 1.0), (set(), 0.0)):
        state = moved(bullet, robot, ALL_MENDED - left_out, {})
        assert state.load.sum() == pytest.approx((robot.mass + more) * GRAVITY, rel=1e-3)


def test_pybullet_nails_a_root_without_mass_to_the_world(
    bullet: BulletEngine, tmp_path: Path
) -> None:
    root = urdf.link("footprint", '<inertial><mass value="0"/>' + NOTHING + "</inertial>")
    joint = urdf.joint("foot", "fixed", ("footprint", "base_link"))
    path = two_wheels(
        tmp_path / "two.urdf",
        urdf.shape('sphere radius="0.05"', xyz=(0.3, 0, 0.05)),
        more=root + joint,
    )
    robot = rpctl.load(path)
    efforts = {"wheel_left_joint": 0.5, "wheel_right_joint": 0.5}
    assert any("fixes the robot to the world" in s.fault for s in bullet.switches(robot))
    nailed = moved(bullet, robot, ALL_MENDED - {"inertia"}, efforts)
    assert nailed.pose[:3].tolist() == [0.0, 0.0, 0.0]
    assert moved(bullet, robot, ALL_MENDED, efforts).planar[0] > 0.01


NOTHING = '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'


def test_pybullets_cone_presses_the_wheels_of_an_axle_apart(bullet: BulletEngine) -> None:
    """Nothing in the model asks for the forces that make a wheel slip."""
    judge = Referee(rpctl.load("paper"), FRICTION, 2.5)
    cone = judge.run(bullet, ALL_MENDED - {"cone"})
    pyramid = judge.run(bullet, ALL_MENDED)
    assert np.abs(cone.slip).max() > 0.1 > 1e-3 > np.abs(pyramid.slip).max()


def test_drake_takes_a_ball_of_water_for_an_inertia_that_cannot_be(
    drake: DrakeEngine, tmp_path: Path
) -> None:
    path = two_wheels(tmp_path / "two.urdf", urdf.shape('sphere radius="0.05"', xyz=(0.3, 0, 0.05)))
    text = path.read_text()
    path.write_text(text.replace('ixx="0.2"', 'ixx="0.9"'))
    robot = rpctl.load(path)
    (found,) = (s for s in drake.switches(robot) if s.name == "inertia")
    assert found.fault == "it replaces the inertia of base_link by that of a ball of water"
    run = drake.start(robot, robot.configuration(), ALL_DEFAULT, FRICTION)
    assert any("Drake warns: " in note for note in run.notes)
    path.write_text(text)
    assert all(s.name != "inertia" for s in drake.switches(rpctl.load(path)))
    run = drake.start(rpctl.load(path), robot.configuration(), ALL_DEFAULT, FRICTION)
    assert run.notes == ()


def test_a_diverging_motion_is_a_fault(engine: Engine) -> None:
    robot = rpctl.load("paper")
    with pytest.raises(EngineFault, match=r"diverges|gives up"):
        moved(engine, robot, ALL_MENDED, {"wheel_left_joint": math.nan})


@pytest.mark.parametrize(("kind", "package"), [(BulletEngine, "pybullet"), (DrakeEngine, "drake")])
def test_an_engine_that_is_missing_names_its_package(
    monkeypatch: pytest.MonkeyPatch, kind: type[BulletEngine | DrakeEngine], package: str
) -> None:
    monkeypatch.setattr("rpctl.engines.urdf_engine.find_spec", lambda name: None)
    with pytest.raises(EngineMissing, match=f"run pip install '{package}<"):
        kind()
