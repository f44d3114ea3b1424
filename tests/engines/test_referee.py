"""The referee on small robots in MuJoCo: what is planted is named, and nothing where all agrees."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

import rpctl
from rpctl.arrays import Array
from rpctl.engines.engine import (
    ALL_MENDED,
    Mended,
    Switch,
    installed_engines,
)
from rpctl.engines.mujoco.engine import MujocoRun, MujocoSimulator
from rpctl.engines.referee import EngineVerdict, Referee, beyond
from rpctl.equivalence.contact import mujoco_body
from rpctl.errors import EngineMissing, RpctlError, UnknownNameError
from rpctl.robot.model import Robot
from tests.cli.test_app import run
from tests.grids import cells
from tests.urdf import ROUND, inertial, joint, limit, link, shape
from tests.urdf import robot as urdf

mujoco = pytest.importorskip("mujoco")
DURATION = 1.5  # s
CYLINDER = 'cylinder radius="0.1" length="0.04"'


@dataclass(frozen=True)
class Planted(MujocoSimulator):
    """MuJoCo with all mended by default but what is planted; few switches are tried."""

    planted: tuple[str, ...] = ()

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the planted ones, and two others."""
        tried = (*self.planted, "cone", "timestep")
        return tuple(switch for switch in super().switches(robot) if switch.name in tried)

    def start(self, robot: Robot, q: Array, mended: Mended, friction: float) -> MujocoRun:
        """Start with the switches that are not planted mended."""
        return super().start(robot, q, mended | (ALL_MENDED - {*self.planted}), friction)


def rover(wheel: str = CYLINDER, ball: str = "collision", extra: str = "") -> str:
    """Return a differential drive of 12 kg: two wheels, and a ball in front."""
    parts = [link("base", inertial(10.0, (0.2, 0.3, 0.4), xyz=(0.1, 0, 0.15)))]
    for side, y in (("left", 0.25), ("right", -0.25)):
        inertia = inertial(0.8, (2e-3, 4e-3, 2e-3))
        parts.append(link(side, inertia, shape(wheel, rpy=ROUND if "cyl" in wheel else "")))
        parts.append(
            joint(f"{side}_joint", "continuous", ("base", side), (0, y, 0.1), axis="0 1 0")
        )
    parts.append(link("ball", shape('sphere radius="0.05"', ball)))
    parts.append(joint("ball_joint", "fixed", ("base", "ball"), (0.35, 0, 0.05)))
    return urdf("rover", *parts, extra)


def judged(robot: Robot, *planted: str) -> EngineVerdict:
    return Referee(robot, duration=DURATION).judge(Planted(planted=planted))


@pytest.fixture
def load(tmp_path: Path) -> Callable[[str], Robot]:
    def loaded(text: str) -> Robot:
        file = tmp_path / "rover.urdf"
        file.write_text(text)
        return rpctl.load(file, "differential")

    return loaded


def named(verdict: EngineVerdict) -> list[tuple[str, ...]]:
    assert verdict.trace is not None
    return [cause.names for cause in verdict.trace.causes]


@pytest.mark.parametrize(
    "name",
    cells(["paper", "car", "mecanum", "casters", "tiago", "tiago_no_hand"], slow=["mecanum"]),
)
def test_the_mended_engine_agrees_with_the_reduced_model(name: str) -> None:
    judge = Referee(rpctl.load(name), duration=DURATION)
    _, model = judge.motion(MujocoSimulator().tick)
    gaps = judge.compare(model, judge.run(MujocoSimulator(), ALL_MENDED))
    assert not beyond(gaps), gaps[0]
    assert {gap.name for gap in gaps} >= {"path", "heading", "slip", "load", "energy", "tilt"}


@pytest.mark.slow
def test_nothing_is_named_where_engines_agree(load: Callable[[str], Robot]) -> None:
    verdict = judged(load(rover()))
    assert verdict.agrees and verdict.traced and verdict.trace is None
    assert verdict.line == f"MuJoCo {mujoco.__version__}: agrees with the reduced model"


TRAY = link("tray", shape('box size="0.2 0.2 0.1"')) + joint(
    "tray_joint", "fixed", ("base", "tray"), (0.1, 0, 0.4)
)  # drawn and not weighed: 4 kg at 1000 kg/m³
TURRET = link(
    "turret", inertial(1.0, (0.01, 0.01, 0.01)), shape('box size="0.1 0.52 0.05"')
) + joint(
    "turret_joint", "revolute", ("base", "turret"), (0, 0, 0.12), "0 0 1",
    limit(-1.0, 1.0, 20.0, 2.0),
)  # fmt: skip
PLANTED = [  # a switch, the robot that it concerns, and words of the line
    ("wheel", rover(), ("cylinders 40 mm wide", 'type="ellipsoid" size="0.1 0.1 0.02"/>')),
    ("caster", rover(), ("ball drags with friction", 'condim="1"')),
    ("caster", rover(ball="visual"), ("ball has no <collision>",)),
    ("inertia", rover(extra=TRAY), ("tray", "1000 kg/m³")),
    ("collisions", rover(extra=TURRET), ("links that overlap",)),
]


@pytest.mark.parametrize(("switch", "text", "words"), cells(PLANTED))
def test_what_is_planted_is_named(
    load: Callable[[str], Robot], switch: str, text: str, words: tuple[str, ...]
) -> None:
    verdict = judged(load(text), switch)
    assert named(verdict) == [(switch,)] and verdict.traced
    assert all(word in verdict.line for word in words)


@pytest.mark.thorough
def test_tie_rods_that_are_left_out_are_named() -> None:
    verdict = judged(rpctl.load("car"), "mimic")
    assert named(verdict) == [("mimic",)]
    assert 'joint1="steering_right_joint" joint2="steering_left_joint" polycoef="' in verdict.line


@pytest.mark.slow
def test_tie_rods_as_springs_bear_the_default_step() -> None:
    judge, engine = Referee(rpctl.load("swerve"), duration=0.5), MujocoSimulator()
    judge.motion(engine.tick)
    long = judge.run(engine, ALL_MENDED - {"timestep"})
    assert not beyond(judge.compare(judge.run(engine, ALL_MENDED), long))


@pytest.mark.thorough
def test_losses_that_the_model_leaves_out_are_named(tmp_path: Path) -> None:
    text = rover().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics damping="0.2"/>')
    assert "damping" in text
    file = tmp_path / "rover.urdf"
    file.write_text(text)
    verdict = judged(rpctl.load(file, "differential", losses=False), "losses")
    assert named(verdict) == [("losses",)]
    assert "drives" in verdict.line and "too short" in verdict.line


@pytest.mark.thorough
def test_all_defaults_are_traced_and_cured(load: Callable[[str], Robot]) -> None:
    verdict = Referee(load(rover()), duration=DURATION).judge(MujocoSimulator())
    assert {name for names in named(verdict) for name in names} >= {"wheel", "caster"}
    assert verdict.traced
    plain = verdict.to_dict()
    assert json.loads(json.dumps(plain))["causes"][0]["setting"]
    assert plain["agrees"] is False and plain["line"] == verdict.line


@pytest.mark.thorough  # what remains: test_causes.py
def test_an_unknown_cause_is_not_traced(load: Callable[[str], Robot]) -> None:
    """The engine gets a heavier robot whatever is mended: no switch explains it."""
    robot = load(rover())

    @dataclass(frozen=True)
    class Heavy(Planted):
        def start(self, robot: Robot, q: Array, mended: Mended, friction: float) -> MujocoRun:
            model = robot.model.copy()
            model.inertias[1].mass *= 1.5
            return super().start(replace(robot, model=model), q, mended, friction)

    verdict = Referee(robot, duration=DURATION).judge(Heavy())
    assert not verdict.traced and verdict.trace is not None and verdict.trace.remaining
    assert "no setting explains" in verdict.line


def test_robots_without_ground_or_stance_are_refused() -> None:
    with pytest.raises(RpctlError, match="fixed base"):
        Referee(rpctl.load("panda"))
    with pytest.raises(RpctlError, match="rpctl does not know that it stands"):
        Referee(rpctl.load("bicycle"))


def test_a_missing_engine_is_told_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(mujoco_body, "import_module", absent)
    found, missing = installed_engines(["mujoco"])
    assert not found and "run pip install 'mujoco<" in missing[0]
    with pytest.raises(EngineMissing):
        MujocoSimulator()
    with pytest.raises(UnknownNameError, match="odd"):
        installed_engines(["odd"])


@pytest.mark.slow
def test_the_command_prints_what_was_found() -> None:
    code, out, _ = run("referee", "paper", "--engines", "mujoco", "--duration", "1", "--json")
    found = json.loads(out)["robots"]["paper"][0]
    assert code == 0 and found["traced"]
    assert {"wheel", "caster"} <= {name for cause in found["causes"] for name in cause["switches"]}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["panda"], "fixed base"),
        ([], "no robot is given"),
        (["paper", "--catalogue"], "either robots or --catalogue"),
        (["paper", "--engines", "odd"], "odd"),
    ],
)
def test_wrong_usage_is_told(words: list[str], said: str) -> None:
    code, _, err = run("referee", *words)
    assert code == 2 and said in err and "Traceback" not in err
