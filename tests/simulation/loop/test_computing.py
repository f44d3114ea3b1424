"""Computing that takes time: efforts come late, busy controllers miss samples, plans apply late."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Horizon, PaperKinematic, Plant, ReducedDynamics, Robot, RpctlError, Run
from rpctl.control.horizon.law import HorizonLaw
from rpctl.control.horizon.planner import Planned
from rpctl.control.horizon.simulated import SimulatedTime, in_simulated_time
from rpctl.control.law import KinematicLaw
from rpctl.reference.named import reference_by_name
from rpctl.simulation.plants.interfaces import HeldCommands

PERIOD = 0.01  # s


def track(robot: Robot, law: KinematicLaw, plant: Plant, duration: float = 0.3) -> Run:
    return rpctl.track(
        robot,
        "eight",
        duration=duration,
        initial_error=(0.1, -0.1, 0.2),
        kinematic=law,
        dynamic=rpctl.PaperDynamic(),
        control_period=PERIOD,
        plant_step=PERIOD,
        plant=plant,
    )


def test_efforts_hold_until_others_come() -> None:
    held = HeldCommands(np.array([0.0]))
    held.send(0.003, np.array([1.0]))
    held.send(0.010, np.array([2.0]))
    held.send(0.023, np.array([3.0]))
    found = [
        [(round(s, 9), float(tau[0])) for s, tau in held.during(t, 0.01)] for t in (0.0, 0.01, 0.02)
    ]
    assert found == [[(0.003, 0.0), (0.007, 1.0)], [(0.01, 2.0)], [(0.003, 2.0), (0.007, 3.0)]]


def test_computing_for_a_period_is_a_delay_of_a_period(paper: Robot) -> None:
    computing, delay = (
        track(paper, PaperKinematic(), plant)
        for plant in (Plant(computing_time=PERIOD), Plant(delay=PERIOD))
    )
    np.testing.assert_allclose(computing.q, delay.q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(computing.tau, delay.tau, rtol=0.0, atol=1e-9)
    assert np.abs(computing.q - track(paper, PaperKinematic(), Plant()).q).max() > 1e-3


def test_a_busy_controller_misses_samples(paper: Robot) -> None:
    run = track(paper, PaperKinematic(), Plant(computing_time=2.5 * PERIOD))
    changed = np.flatnonzero(np.abs(np.diff(run.log.nu_d, axis=0)).max(axis=1)) + 1
    np.testing.assert_array_equal(changed, np.arange(3, len(run.t), 3))


def test_only_a_sample_that_plans_takes_the_time_of_a_plan(paper: Robot) -> None:
    """Of two samples the first plans: its efforts come with those of the second, which count."""
    late = track(paper, Horizon(asynchronous=False), Plant(computing_time=PERIOD), 0.1)
    assert summary(late)["solves"] == 6
    moved = np.abs(np.diff(late.tau, axis=0)).max(axis=1) > 0.0
    np.testing.assert_array_equal(moved, [True, False] * 5)


def summary(run: Run) -> dict[str, float]:
    return dict(rpctl.summarize(run).kinematic_report)


def started(law: Horizon, robot: Robot, computing_time: float) -> HorizonLaw:
    with in_simulated_time(SimulatedTime(computing_time)):
        found = law.start(ReducedDynamics(robot), 0.002)
    assert isinstance(found, HorizonLaw)
    return found


def test_a_plan_from_beside_applies_when_it_is_there(paper: Robot) -> None:
    law = started(Horizon(asynchronous=True), paper, 0.007)
    dynamics, reference = ReducedDynamics(paper), reference_by_name(paper, "eight")
    q, nu = paper.configuration_at(reference(0.0).pose, reference(0.0).joints), np.zeros(paper.dof)
    times = 0.002 * np.arange(24)
    plans = [law.solves for t in times.tolist() if law(dynamics, reference, t, q, nu)]
    changed = np.flatnonzero(np.diff(plans)) + 1
    # Before the first plan, at 8 ms, the fallback answers; the next begins at 20 ms.
    np.testing.assert_array_equal(changed, [4, 14])
    assert law.report()["largest_delay"] == 0.008
    assert law.solves == 2


def test_a_plan_from_beside_starts_where_the_robot_will_be(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    law = started(Horizon(asynchronous=True), paper, 0.01)
    dynamics, reference = ReducedDynamics(paper), reference_by_name(paper, "eight")
    q, nu = paper.configuration_at(np.zeros(3), reference(0.0).joints), np.zeros(paper.dof)
    asked, plan = list[tuple[float, float, float]](), law.planner.plan

    def noted(*arguments: Any) -> Planned:
        asked.append((arguments[1], arguments[2][0], arguments[3][0]))
        return plan(*arguments)

    monkeypatch.setattr(law.planner, "plan", noted)
    nu[0] = 0.5
    for k in range(5):
        command = law(dynamics, reference, 0.01 * k, q, nu)
        if k == 1:
            along = command.nu_d_dot[0]  # the first plan is there, and holds until the next
    expected = [(0.0, 0.0, 0.5)] + [
        (t + 0.01, 0.5 * 0.01 + 0.5 * along * 0.01**2, 0.5 + 0.01 * along) for t in (0.02,)
    ]
    np.testing.assert_allclose(asked[:2], expected, atol=1e-12)


def test_a_measured_time_delays_too(paper: Robot) -> None:
    run = track(paper, Horizon(asynchronous=True), Plant(computing_time="measured"))
    assert 0.0 < summary(run)["largest_delay"] < 0.3
    assert summary(run)["solves"] > 0


@pytest.mark.parametrize("wrong", [-1.0, math.nan, math.inf, "soon"])
def test_a_time_that_is_none_is_refused(wrong: float | str) -> None:
    with pytest.raises(RpctlError, match="computing_time is"):
        Plant(computing_time=wrong)
