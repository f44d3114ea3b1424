"""The result file: it comes back as it was, and refuses what it does not understand."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import (
    Disc,
    EndEffector,
    Horizon,
    Plant,
    ReducedDynamics,
    Robot,
    RpctlError,
    Run,
    UnifiedKinematic,
    track,
    verify,
)
from rpctl.arrays import Array
from rpctl.control.law import Command, KinematicFunction
from rpctl.control.registry import Unregistered
from rpctl.files.records import read_record, to_plain
from rpctl.reference.motion import Reference
from rpctl.simulation.config import Config, write_config
from rpctl.simulation.run.header import recorded, require_plain
from tests.robot import arms
from tests.robot.test_grippers import SLIDES
from tests.robots import SET_A, platform, write


@pytest.fixture(scope="module")
def run(paper: Robot) -> Run:
    return track(
        paper,
        "eight",
        duration=0.2,
        initial_error=(0.1, 0.0, 0.0),
        certificate=verify(paper, samples=1),
    )


@dataclass(frozen=True)
class _Own:
    inner: KinematicFunction
    gains: Any
    least: Any
    around: tuple[Disc, ...]
    odd: object

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        return self.inner(dynamics, reference, t, q, nu)


def test_settings_within_settings_come_back(paper: Robot, tmp_path: Path) -> None:
    """Obstacles, and what a law of one's own may have: NumPy's numbers, a function."""
    inner = UnifiedKinematic(leash=None, approach=None)
    law = _Own(inner, np.array([1, 2]), np.float64(0.5), (Disc(1.0, 2.0, 0.3),), len)
    run = track(paper, "line", duration=0.1, kinematic=law)
    assert run.config.kinematic == Unregistered(
        "_Own",
        {
            "inner": Unregistered("UnifiedKinematic", vars(inner)),
            "gains": (1, 2),
            "least": 0.5,
            "around": (Disc(1.0, 2.0, 0.3),),
            "odd": Unregistered("len"),
        },
    )
    assert Run.load(run.save(tmp_path / "run.npz")).config == run.config


def test_what_has_no_name_within_a_law_comes_back(paper: Robot, tmp_path: Path) -> None:
    """The rest of the law keeps its types; a plain function is a law."""
    disc, odd = Disc(1.0, 2.0, 0.3), _Blob(2.0)
    base = Horizon(base_obstacles=(disc, odd), fallback=_function)  # type: ignore[arg-type]
    law = EndEffector(base=base, horizon=0.3)
    plant = Plant(tau_bias={"wheel_left_joint": 1.0}, delay=0.01, controller_model=paper)
    config = Config(law, _function, plant=plant)  # type: ignore[arg-type]
    kept = recorded(config, 100)
    blob, function = Unregistered("_Blob", {"size": 2.0}), Unregistered("_function")
    inner = Horizon(base_obstacles=(disc, blob), fallback=function)  # type: ignore[arg-type]
    assert kept.kinematic == EndEffector(base=inner, horizon=0.3)
    assert kept.dynamic == function
    assert kept.run.duration == pytest.approx(0.2)
    assert kept.plant == Plant(tau_bias={"wheel_left_joint": 1.0}, delay=0.01)
    assert config_of(kept) == kept
    with pytest.raises(RpctlError, match=r"dynamic.law: dynamic law '_function' is not known"):
        write_config(kept, tmp_path / "config.toml")


def config_of(kept: Config) -> Config | None:
    """Return a configuration as a run's header brings it back."""
    header = json.loads(json.dumps({"config": to_plain(kept)}))
    faults = require_plain(header)
    found = read_record(Config, header["config"], "config", faults)
    assert not faults
    return found


@dataclass(frozen=True)
class _Blob:
    size: float


def _function(*_: object) -> Command:
    raise NotImplementedError


def test_a_law_with_a_setting_that_no_file_can_say_is_kept_by_its_class() -> None:
    odd = Config(Horizon(steps=np.int64(10)))  # type: ignore[arg-type]
    kept = recorded(odd, 10)
    assert isinstance(kept.kinematic, Unregistered)
    assert (kept.kinematic.name, kept.kinematic.settings["steps"]) == ("Horizon", 10)
    assert config_of(kept) == kept


def test_no_arm_comes_back_too(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    back = Run.load(track(robot, "circle", duration=0.01).save(tmp_path / "run.npz"))
    assert back.log.ee.shape == (len(back.t), 0)
    assert np.isinf(back.robot.effort_limits).all()
    assert back.log.tip_margin.shape == back.log.slip_ratio.shape == (len(back.t), 0)
    assert back.log.zmp.shape == (len(back.t), 2)
    fixed = Run.load(track(rpctl.load("arm"), "eight", duration=0.01).save(tmp_path / "fixed.npz"))
    assert not (fixed.ground.contacts or fixed.ground.axles or fixed.ground.notes)
    assert fixed.log.zmp.shape == fixed.log.wheel_force.shape == (len(fixed.t), 0)


def test_the_robot_of_a_run_has_its_home_and_its_free_joints(tmp_path: Path) -> None:
    path = arms.write(tmp_path, arms.arm(), *SLIDES)
    home = {"rod_2_joint": 0.6}
    robot = rpctl.load(path, "fixed", home=home, free=["l_*"], end_effector="rod_3")
    run = Run.load(track(robot, "eight", duration=0.01).save(tmp_path / "run.npz"))
    back = run.load_robot()
    assert back.home.tolist() == robot.home.tolist()
    assert back.joint_names == robot.joint_names == run.robot.joint_names
    assert dict(back.locked) == {"r_joint": 0.0}
    assert back.end_effector == "rod_3"


def test_a_run_tells_its_outcome_and_its_figures(run: Run) -> None:
    summary = rpctl.summarize(run)
    assert run.outcome == summary.outcome == "late"
    assert run.summary.to_dict() == summary.to_dict()
