"""Figures of merit: each is what its name says."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rpctl import Robot, Run, summarize, track
from rpctl.simulation.summary import violations


@pytest.fixture(scope="module")
def run(paper: Robot) -> Run:
    return track(paper, "eight", 1.0, (0.1, 0.0, 0.0))


def test_errors(run: Run) -> None:
    e = np.zeros_like(run.e)
    e[:, 0], e[:, 1] = 0.3, -0.4
    e[-1, :2] = 0.06, -0.08
    e[:, 4] = -0.02
    figures = summarize(dataclasses.replace(run, e=e))
    assert figures["final_base_error"] == pytest.approx(0.1)
    assert figures["final_lateral_error"] == pytest.approx(0.08)
    assert figures["settled_base_error"] == pytest.approx(0.5)
    assert figures["rms_base_error"] == pytest.approx(0.5, rel=1e-2)
    slide = figures["joint_errors"][1]
    assert slide["joint"] == "arm_prismatic_joint"
    assert slide["unit"] == "m"
    assert slide["rms"] == pytest.approx(0.02)
    assert slide["final"] == 0.02


def test_efforts(run: Run) -> None:
    tau = np.zeros_like(run.tau)
    tau[7, 1] = -20.0
    figures = summarize(dataclasses.replace(run, tau=tau))
    assert figures["max_effort_ratio"] == 0.5
    assert figures["max_effort_joint"] == "wheel_right_joint"
    assert figures["limits_violated"] == []


def test_violations_name_the_limit_and_the_time(run: Run) -> None:
    tau, rates, joints = run.tau.copy(), run.rates.copy(), run.joints.copy()
    tau[10:20, 0] = -41.0
    rates[30, 3] = 0.7
    joints[40, 1] = 0.34
    found = violations(dataclasses.replace(run, tau=tau, rates=rates, joints=joints))
    assert [(f["joint"], f["limit"]) for f in found] == [
        ("wheel_left_joint", "effort"),
        ("arm_prismatic_joint", "velocity"),
        ("arm_prismatic_joint", "lower"),
    ]
    assert found[0]["first_time"] == pytest.approx(run.t[10])
    assert found[0]["duration"] == pytest.approx(0.02, rel=0.01)
    assert found[0]["value"] == 41.0
    assert found[0]["allowed"] == 40.0


def test_a_limit_may_be_touched(run: Run) -> None:
    tau = np.zeros_like(run.tau)
    tau[:, 0] = 40.0
    assert violations(dataclasses.replace(run, tau=tau)) == []
