"""The horizon law in closed loop: it keeps limits, balance and distance, and counts failures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import (
    EndEffector,
    IntegralDynamic,
    PaperKinematic,
    Plant,
    ReducedDynamics,
    Robot,
    RpctlError,
    Run,
    summarize,
)
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.qp import CondensedQp, CondensedSolution
from rpctl.control.law import KinematicLaw, as_law
from rpctl.control.obstacles import Disc, HalfPlane
from rpctl.control.registry import read_law
from rpctl.reference.motion import Reference
from rpctl.reference.named import reference_by_name
from rpctl.reference.sizing import SizingRequest
from tests.control.tight_limits import limited, tall
from tests.grids import cells

OFF = (0.3, -0.4, 0.8)
PERIOD = 0.01  # s
PILLAR, WALL = Disc(1.54, 1.55, 0.12), HalfPlane(0.0, -1.0, -1.3)
CLOSE = 5e-3  # m: what bounds that are linear, and kept at steps, may be missed by


def track(
    robot: Robot,
    reference: str | Reference,
    duration: float,
    law: KinematicLaw | None = None,
    off: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **others: Any,
) -> Run:
    return rpctl.track(
        robot,
        reference,
        duration=duration,
        initial_error=off,
        kinematic=law,
        control_period=PERIOD,
        plant_step=PERIOD,
        **others,
    )


def faster(robot: Robot, name: str, rate: float) -> Reference:
    return replace(reference_by_name(robot, name), rate=rate, ramp=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mixed_chain"])
def test_no_limit_is_broken(name: str) -> None:
    """With limits halved, from a start that asks the paper's law for more than there is."""
    usual = rpctl.load(name)
    robot, eight = limited(usual, effort=0.5, speed=0.5), reference_by_name(usual, "eight")
    horizon, paper = (
        summarize(track(robot, eight, 4.0, law, OFF, dynamic=rpctl.PaperDynamic()))
        for law in (Horizon(), PaperKinematic())
    )
    assert paper.limits_violated
    assert not horizon.limits_violated
    assert horizon.rms_base_error < paper.rms_base_error
    assert horizon.kinematic_report["fallbacks"] == 0


@pytest.mark.slow
@pytest.mark.parametrize(("path", "rate"), [("eight", 1.0)])
def test_an_aggressive_reference_slows_down_instead_of_tipping(
    tmp_path: Path, path: str, rate: float
) -> None:
    robot = tall(tmp_path)
    reference = faster(robot, path, rate)
    horizon, paper = (track(robot, reference, 4.0, law) for law in (Horizon(), PaperKinematic()))
    assert paper.log.tip_margin.min() < -0.05
    assert horizon.log.tip_margin.min() > 0.01
    assert horizon.log.slip_ratio.max() < 1.0
    report = summarize(horizon).kinematic_report
    assert report["fallbacks"] == 0
    if path == "eight":  # along the path, but later
        assert report["largest_lag"] > 0.5
        ahead = np.linspace(0.0, 4.0, 800)
        places = np.array([reference(t).pose[:2] for t in ahead])
        gaps = np.linalg.norm(horizon.log.base[:, None, :2] - places, axis=2).min(axis=1)
        assert gaps.max() < 0.15


@pytest.mark.parametrize("y", cells((0.2, 0.0, -0.4)))  # .05 is in test_plan.py
def test_the_base_drives_round_a_disc(paper: Robot, y: float) -> None:
    disc = Disc(1.2, y, 0.3)
    law = Horizon(base_obstacles=(disc,), base_radius=0.3)
    run = track(paper, "line", 10.0, law, collisions=False)  # a base smaller than the hull
    assert disc.distance(run.base_ref[:, :2]).min() < 0.3
    assert disc.distance(run.log.base[:, :2]).min() > 0.3 - CLOSE
    assert run.log.base[-1, 0] > 2.0
    assert summarize(run).final_base_error < 0.3


@pytest.mark.parametrize("obstacle", cells((PILLAR, WALL), slow={PILLAR}))
def test_the_end_effector_keeps_clear(paper: Robot, obstacle: Disc | HalfPlane) -> None:
    quick = reference_by_name(paper, "eight", SizingRequest(speed=0.72))
    free, kept = (
        track(paper, quick, 4.0, Horizon(end_effector_obstacles=obstacles))
        for obstacles in ((), (obstacle,))
    )
    assert obstacle.distance(free.log.ee[:, :2]).min() < 0.05 - 0.03
    assert obstacle.distance(kept.log.ee[:, :2]).min() > 0.05 - CLOSE


def test_a_failed_solve_falls_back_and_is_counted(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve = CondensedQp.solve
    failing = [3, 4, 9]  # of the solves
    count = iter(range(1000))

    def sometimes(self: CondensedQp, *arguments: Any) -> CondensedSolution:
        # The first sample takes three passes.
        return solve(self, *arguments)._replace(solved=next(count) not in failing)

    monkeypatch.setattr(CondensedQp, "solve", sometimes)
    called: list[float] = []
    inner = PaperKinematic()

    def fallback(dynamics: Any, reference: Any, t: float, q: Any, nu: Any) -> Any:
        called.append(t)
        return inner(dynamics, reference, t, q, nu)

    law = Horizon(fallback=as_law(fallback))
    run = track(paper, "eight", 0.3, law, (0.05, 0.0, 0.0))
    # The second and third solves fail, both within one pass; two samples each.
    np.testing.assert_allclose(called[:4], [0.02, 0.03, 0.04, 0.05])
    assert summarize(run).kinematic_report["fallbacks"] == 3
    assert len(called) == 6


def test_command_and_rate_agree(paper: Robot) -> None:
    reference, dynamics = reference_by_name(paper, "eight"), ReducedDynamics(paper)
    law = Horizon(asynchronous=False).start(dynamics, PERIOD)
    q, nu = paper.configuration_at(reference(1.0).pose, reference(1.0).joints), np.zeros(paper.dof)
    commands = [law(dynamics, reference, 1.0 + t, q, nu) for t in (0.0, 0.008, 0.016)]
    rate = (commands[2].nu_d - commands[0].nu_d) / 0.016
    np.testing.assert_allclose(commands[1].nu_d_dot, rate, atol=1e-12)
    np.testing.assert_array_equal(commands[0].nu_d, nu)


def test_a_plan_goes_on_from_the_last(paper: Robot) -> None:
    """A push of the robot is not what the next plan asks for: three quarters of it are an error."""
    dynamics, reference = ReducedDynamics(paper), reference_by_name(paper, "eight")
    law, state = Horizon(asynchronous=False).start(dynamics, PERIOD), reference(0.0)
    q = paper.configuration_at(state.pose, state.joints)
    still, push = np.zeros(4), np.array([0.02, -0.03, 0.04, 0.01])
    law(dynamics, reference, 0.0, q, still)
    planned = law(dynamics, reference, 0.02 - 1e-6, q, still).nu_d
    law(dynamics, reference, 0.02, q, planned + push)
    assert law.solves == 2
    asked = law(dynamics, reference, 0.02, q, planned + push).nu_d
    np.testing.assert_allclose(asked - planned, 0.25 * push, atol=1e-5)


@pytest.mark.thorough
def test_efforts_that_come_late_do_not_make_light_joints_run_away(tiago: Robot) -> None:
    """20 ms: where two axes of TIAGo's wrist align, .003 kg m² are all that resists a motion."""
    law, plant = EndEffector(), Plant(delay=0.02)
    run = rpctl.track(
        tiago,
        "spin",
        duration=10.0,
        initial_error=(0.1, -0.1, 0.1),
        kinematic=law,
        dynamic=IntegralDynamic(),
        plant=plant,
    )
    assert summarize(run).limits_violated == ()


def test_settings_that_predict_nothing_are_refused() -> None:
    assert isinstance(read_law("kinematic", "horizon"), Horizon)
    with pytest.raises(RpctlError, match="steps is 1; give 2 to 200"):
        Horizon(steps=1)
    with pytest.raises(RpctlError, match=r"period 0.2 s is longer than a step; give at most 0.1 s"):
        Horizon(period=0.2)
