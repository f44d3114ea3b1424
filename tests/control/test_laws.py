"""What every kinematic law must do, on every drive, and what stands in for a law."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import (
    EndEffector,
    Horizon,
    PaperDynamic,
    PaperKinematic,
    ReducedDynamics,
    Robot,
    RpctlError,
    Run,
)
from rpctl.arrays import Array
from rpctl.control.horizon.planner import Planned
from rpctl.control.horizon.simulated import SimulatedTime, in_simulated_time
from rpctl.control.law import Command, KinematicFunction, KinematicLaw, as_law
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS, Unregistered, read_law
from rpctl.control.twist_law import BaseLaw
from rpctl.errors import UnknownNameError
from rpctl.reference.motion import Reference
from rpctl.reference.named import reference_by_name
from tests.catalogue import robot_of
from tests.grids import cells
from tests.leaning import leaning

STEP = 1e-6
APART = ("horizon", "end-effector")  # the one plans and may be late, the other needs an arm
EXACT = [name for name in KINEMATIC_LAWS if name not in APART]
LAWS: dict[str, Any] = {name: KINEMATIC_LAWS[name]() for name in EXACT}
LAWS["paper, smooth sign"] = PaperKinematic(smoothing=0.3)


@pytest.mark.parametrize("robot", ["paper", "mixed_chain"], indirect=True)
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_the_derivative_is_that_of_the_law_along_the_actual_motion(
    robot: Robot, law: BaseLaw, rng: np.random.Generator
) -> None:
    """The motion has nothing to do with the reference, but for v̇, which follows the law.

    Only feedback linearisation asks what v̇ is.
    """
    reference, dynamics = reference_by_name(robot, "eight"), ReducedDynamics(robot)
    for t in (3.5, 5.0, 9.0, 14.0):
        nu, nu_dot = rng.normal(size=(2, robot.dof))
        pose = reference(t).pose + rng.normal(size=3) * [0.3, 0.3, 0.5]
        joints = robot.home + 0.05 * rng.normal(size=len(robot.joints))
        q = robot.configuration_at(pose, joints)
        v = dynamics.basis(q) @ nu
        rate = law(dynamics, reference, t, q, nu).nu_d_dot
        nu_dot[0] = rate[0]

        def asked(s: float) -> Array:
            at = pin.integrate(robot.model, q, s * v)  # noqa: B023 - called in this turn only
            return law(dynamics, reference, t + s, at, nu + s * nu_dot).nu_d  # noqa: B023

        expected = (asked(STEP) - asked(-STEP)) / (2 * STEP)
        np.testing.assert_allclose(rate, expected, atol=1e-6 * (1 + np.abs(rate).max()))


@pytest.mark.parametrize(
    ("name", "reference"), [("unified", "eight"), ("paper", "circle"), ("kanayama", "reverse")]
)
def test_the_derivative_holds_in_a_soft_start(paper: Robot, name: str, reference: str) -> None:
    dynamics = ReducedDynamics(paper)
    law = read_law("kinematic", name).start(dynamics, 0.002)
    motion, nu, t = reference_by_name(paper, reference), np.array([0.3, -0.2, 0.1, 0.4]), 0.8
    q = paper.configuration(x=-0.2, y=0.1, theta=0.4)
    v = dynamics.basis(q) @ nu
    ahead, behind = (
        law(dynamics, motion, t + s, pin.integrate(paper.model, q, s * v), nu).nu_d
        for s in (STEP, -STEP)
    )
    rate = law(dynamics, motion, t, q, nu).nu_d_dot
    np.testing.assert_allclose(rate, (ahead - behind) / (2 * STEP), atol=1e-7)


@pytest.mark.parametrize(
    ("robot_name", "name"),
    cells(
        product(("paper", "mecanum"), EXACT),
        [*product(["paper"], EXACT), ("mecanum", "unified"), ("mecanum", "samson")],
    ),
)
def test_on_the_reference_every_law_asks_for_the_reference(name: str, robot_name: str) -> None:
    robot = robot_of(robot_name)
    dynamics = ReducedDynamics(robot)
    law = read_law("kinematic", name).start(dynamics, 0.002)
    reference = reference_by_name(robot, "eight")
    state, later, earlier = (reference(5.0 + s) for s in (0.0, STEP, -STEP))
    q = robot.configuration_at(state.pose, state.joints)
    keep = [0, 2] if robot.drive.has_axle else range(len(robot.drive.base_speeds))
    nu = np.concatenate([state.twist[keep], state.joint_rates])
    nu_d, nu_d_dot = law(dynamics, reference, 5.0, q, nu)
    np.testing.assert_allclose(nu_d, nu, atol=1e-12)
    base = (later.twist - earlier.twist)[keep] / (2 * STEP)
    expected = np.concatenate([base, state.joint_accelerations])
    np.testing.assert_allclose(nu_d_dot, expected, atol=1e-8)


def test_unknown_laws_are_told() -> None:
    with pytest.raises(UnknownNameError, match="kinematic law 'papr' is not known; did you mean"):
        read_law("kinematic", "papr")


WRONG_LAWS = {
    "kinematic is PaperDynamic, a law for dynamic=": ("kinematic", PaperDynamic()),
    "dynamic is Horizon, a law for kinematic=": ("dynamic", Horizon()),
    "kinematic is the class Horizon; give one of its objects": ("kinematic", Horizon),
    "dynamic is 3 .int.; give a function": ("dynamic", 3),
}


@pytest.mark.parametrize("told", WRONG_LAWS)
def test_what_is_no_law_of_its_kind_is_told_wherever_laws_are_taken(
    paper: Robot, told: str
) -> None:
    kind, law = WRONG_LAWS[told]
    given: Any = {kind: law}
    takers: list[Callable[[], object]] = [
        lambda: rpctl.Config(**given),
        lambda: rpctl.Config().with_laws(**given),
        lambda: rpctl.Controller(paper, "line", **given),
        lambda: rpctl.track(paper, "line", **given),
        lambda: rpctl.rollout(paper, "line", **given),
        lambda: rpctl.derive_law(paper, **given),
    ]
    for take in takers:
        with pytest.raises(RpctlError, match=told):
            take()


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
        collisions=False,
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
    expected = run(paper, EndEffector(base=PaperKinematic()))
    found = run(paper, EndEffector(base=plain))  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.log.nu_d, expected.log.nu_d)
    monkeypatch.setattr("rpctl.control.horizon.planner.Planner.plan", lambda *_: Planned(None))
    fallback = run(paper, Horizon(fallback=plain))  # type: ignore[arg-type]
    np.testing.assert_array_equal(fallback.log.nu_d, run(paper, PaperKinematic()).log.nu_d)


def test_a_controller_started_by_hand_keeps_its_report(paper: Robot) -> None:
    expected = run(paper, Horizon(asynchronous=False))
    found = run(paper, Horizon(asynchronous=False).start(ReducedDynamics(paper), PERIOD))
    np.testing.assert_array_equal(found.log.nu_d, expected.log.nu_d)
    assert found.kinematic_report == expected.kinematic_report
    assert found.kinematic_report["solves"] == 6


COUNTED = {"solves", "fallbacks", "softened", "unplanned", "largest_lag", "largest_age"}
COUNTED |= {"largest_delay"}  # where plans take time; those of a process: test_process.py


REPORTING = {
    f"{kind} {name}": make
    for kind, laws in (("kinematic", KINEMATIC_LAWS), ("dynamic", DYNAMIC_LAWS))
    for name, make in laws.items()
}


@pytest.mark.parametrize("name", REPORTING)
def test_every_law_has_a_report(paper: Robot, name: str) -> None:
    law = REPORTING[name]()
    robot = leaning("balancer") if name == "dynamic balance" else paper
    with in_simulated_time(SimulatedTime(0.05)):  # in which no process is started
        report = law.start(ReducedDynamics(robot), PERIOD).report()
    assert set(report) == (COUNTED if isinstance(law, Horizon | EndEffector) else set())
