"""What stands in for a law: a plain function, and a controller that was started by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import rpctl
from rpctl import EndEffector, Horizon, PaperKinematic, ReducedDynamics, Robot, Run
from rpctl.arrays import Array
from rpctl.control.horizon.planner import Planned
from rpctl.control.law import Command, KinematicFunction, KinematicLaw, as_law
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.control.unregistered import Unregistered
from rpctl.reference.motion import Reference

PERIOD = 0.01  # s


def plain(
    dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
) -> Command:
    return PaperKinematic()(dynamics, reference, t, q, nu)


def run(robot: Robot, law: KinematicLaw | KinematicFunction) -> Run:
    return rpctl.track(
        robot,
        "eight",
        duration=0.1,
        initial_error=(0.1, 0.0, 0.0),
        kinematic=law,
        control_period=PERIOD,
    )


def test_a_function_gives_the_run_of_the_law_that_it_calls(paper: Robot) -> None:
    expected = run(paper, PaperKinematic())
    assert as_law(PaperKinematic()) == PaperKinematic()
    for law in (plain, as_law(plain)):
        found = run(paper, law)
        np.testing.assert_array_equal(found.log.nu_d, expected.log.nu_d)
        assert found.kinematic_report == {}
    assert found.config.kinematic == Unregistered("plain")


def test_a_law_of_laws_takes_a_function(paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = run(paper, EndEffector(PaperKinematic()))
    found = run(paper, EndEffector(plain))  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.log.nu_d, expected.log.nu_d)
    monkeypatch.setattr("rpctl.control.horizon.planner.Planner.plan", lambda *_: Planned(None))
    fallback = run(paper, Horizon(fallback=plain))  # type: ignore[arg-type]
    np.testing.assert_array_equal(fallback.log.nu_d, run(paper, PaperKinematic()).log.nu_d)


def test_a_controller_started_by_hand_keeps_its_report(paper: Robot) -> None:
    expected = run(paper, Horizon())
    found = run(paper, Horizon().start(ReducedDynamics(paper), PERIOD))
    np.testing.assert_array_equal(found.log.nu_d, expected.log.nu_d)
    assert found.kinematic_report == expected.kinematic_report
    assert found.kinematic_report["solves"] == 6


@pytest.mark.parametrize("make", [*KINEMATIC_LAWS.values(), *DYNAMIC_LAWS.values()])
def test_every_law_has_a_report(paper: Robot, make: Callable[[], KinematicLaw]) -> None:
    law = make()
    report = law.start(ReducedDynamics(paper), PERIOD).report()
    assert set(report) == (
        {"solves", "fallbacks", "softened", "largest_lag"}
        if isinstance(law, Horizon | EndEffector)
        else set()
    )
