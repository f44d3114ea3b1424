"""Runs of older versions have the laws that they had: simulated again, they are the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Run
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.end_effector import EndEffector
from rpctl.control.feedback_linearization import FeedbackLinearization
from rpctl.control.horizon.law import Horizon
from rpctl.control.integral import IntegralDynamic
from rpctl.control.kanayama import Kanayama
from rpctl.control.kinematic import PaperKinematic
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.control.unified import UnifiedKinematic
from rpctl.simulation.config import Config, LimitOverrides, config_tables
from rpctl.simulation.loop import simulate
from rpctl.simulation.older_laws import tables_up_to_5
from rpctl.simulation.recorded import config_of

WITHOUT: dict[str, Any] = {"leash": None, "approach": None}
UNIFIED = UnifiedKinematic(joint_horizon=0.65, **WITHOUT)
BOUNDED = BoundedDynamic(joint_horizon_dyn=0.15, midpoint=False)
SINCE = {  # the settings of laws that files up to schema 5 do not hold
    "leash", "approach", "joint_horizon", "joint_horizon_dyn", "joint_gain", "midpoint",
    "body_clearance", "prepare", "asynchronous",
}  # fmt: skip


def bare(value: Any, law: str | None = None) -> Any:
    """Return tables without what no file up to schema 5 holds; a horizon law's leash is older."""
    if isinstance(value, list):
        return [bare(each) for each in value]
    if not isinstance(value, dict):
        return value
    own = value.get("law", law)
    kept = {k: v for k, v in value.items() if k not in SINCE or (k, own) == ("leash", "horizon")}
    return {key: bare(each, own) for key, each in kept.items()}


def read_back(config: Config) -> Config:
    """Return a configuration as a file of schema 5 would have held it."""
    return config_of(tables_up_to_5(bare(config_tables(config))))


@pytest.mark.parametrize("schema", [4, 5])
def test_an_older_run_is_simulated_again(schema: int) -> None:
    """The files were written by the versions then; efforts agree to rounding."""
    run = Run.load(Path(__file__).with_name(f"run_schema_{schema}.npz"))
    limits = LimitOverrides(
        effort=dict(zip(run.robot.actuators, run.robot.effort_limits, strict=True))
    )
    robot = limits.apply(rpctl.load("paper", losses=False))
    again = simulate(robot, run.config, run.config.run.load_reference(robot))
    np.testing.assert_allclose(again.tau, run.tau, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(again.nu, run.nu, rtol=1e-9, atol=1e-9)


def test_every_law_reads_back_as_it_was() -> None:
    then: dict[str, Any] = {
        "unified": UNIFIED,
        "paper": PaperKinematic(),
        "end-effector": EndEffector(base=Horizon(fallback=UNIFIED, approach=None)),
        "horizon": Horizon(fallback=UNIFIED, approach=None),
        "kanayama": Kanayama(joint_horizon=0.65, **WITHOUT),
        "feedback-linearization": FeedbackLinearization(joint_horizon=0.65, **WITHOUT),
    }
    assert then.keys() == KINEMATIC_LAWS.keys()
    for name, law in then.items():
        assert read_back(Config(KINEMATIC_LAWS[name]())).kinematic == law
    dynamic: dict[str, Any] = {
        "paper": PaperDynamic(),
        "bounded": BOUNDED,
        "integral": IntegralDynamic(inner=BOUNDED, joint_gain=15.0),
    }
    assert dynamic.keys() == DYNAMIC_LAWS.keys()
    for name, each in dynamic.items():
        assert read_back(Config(dynamic=DYNAMIC_LAWS[name]())).dynamic == each


def test_the_joints_had_the_settings_of_the_base() -> None:
    law = IntegralDynamic(7.0, BoundedDynamic(0.2))
    back = read_back(Config(UnifiedKinematic(0.5), law))
    assert back.kinematic == replace(UNIFIED, horizon=0.5, joint_horizon=0.5)
    inner = replace(BOUNDED, horizon_dyn=0.2, joint_horizon_dyn=0.2)
    assert back.dynamic == IntegralDynamic(7.0, inner, joint_gain=7.0)


def test_what_a_file_says_stands_and_what_no_law_is_known_by_stays() -> None:
    said = {"kinematic": {"law": "unified", "leash": {"distance": 0.2}, "joint_horizon": 0.3}}
    kinematic: Any = config_of(tables_up_to_5(said)).kinematic
    assert (kinematic.leash.distance, kinematic.joint_horizon, kinematic.approach) == (
        0.2, 0.3, None
    )  # fmt: skip
    odd: dict[str, Any] = {"kinematic": {"law": ["x"]}, "dynamic": 3.0, "run": {"duration": 1.0}}
    assert tables_up_to_5(odd) == odd
    own = {"kinematic": {"law": "unified", "settings": {}}, "dynamic": {"law": "Mine"}}
    assert tables_up_to_5(own) == own
    none_named = config_of(tables_up_to_5({}))
    assert (none_named.kinematic, none_named.dynamic) == (UNIFIED, PaperDynamic())
    short = {"dynamic": {"law": "integral"}, "kinematic": {"law": "end-effector"}}
    found = config_of(tables_up_to_5(short))
    assert found.dynamic == IntegralDynamic(10.0, BOUNDED, joint_gain=10.0)
    assert found.kinematic == EndEffector(base=Horizon(fallback=UNIFIED, approach=None))
