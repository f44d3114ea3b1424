"""The horizon law of robots that lean: its program by what the best has, its law by Riccati's."""

from __future__ import annotations

import time
from functools import partial
from itertools import product

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

import rpctl
from rpctl import Plant, ReducedDynamics, Wrench
from rpctl.arrays import Array
from rpctl.control.balance import Balance
from rpctl.control.bandwidth import knowing_delay
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.leaning_plan import REACH, LeaningHorizon, LeaningPlanner
from rpctl.control.horizon.planner import Asked
from rpctl.control.horizon.process import PlanningProcess
from rpctl.control.horizon.regulation import STIFFNESS, Box, Regulated, Regulator, Steps
from rpctl.control.horizon.simulated import SimulatedTime, in_simulated_time
from rpctl.control.law import EffortCommand, LeaningCommand
from rpctl.control.obstacles import Disc
from rpctl.control.steady_motion import Posture, SteadyMotion, sampled
from rpctl.control.unified import UnifiedKinematic
from rpctl.errors import RpctlError, UnfitLawError
from rpctl.reference.motion import Reference, ReferenceState
from tests.grids import cells
from tests.leaning import COARSE, OWN, leaning

PERIOD, SEED = 0.002, 7
UNBOUND = 1e6
PATIENCE = 60.0  # s that a busy machine may take
BETWEEN = 1.013  # s: no multiple of a step
SMALL = 1e-5  # of deviations: a leash takes 1e-9 of them


def in_line(leaning: LeaningHorizon) -> Horizon:
    """Return the law with its plans made within their samples."""
    return Horizon(leaning=leaning, asynchronous=False)


def random_steps(count: int = 12) -> Steps:
    """Return unstable steps, each another, with drifts."""
    rng = np.random.default_rng(SEED)
    n, m = 4, 2
    A, B = rng.normal(size=(count, n, n)), rng.normal(size=(count, n, m))
    A[:, 0, 0] += 3.0
    F, G = map(
        np.array, zip(*(sampled(*each, 0.1) for each in zip(A, B, strict=True)), strict=True)
    )
    P = 5.0 * np.eye(n) + 0.5 * np.ones((n, n))
    R = 0.1 * np.eye(m) * rng.uniform(0.5, 2.0, (count, 1, 1))
    return Steps(F, G, 0.1 * rng.normal(size=(count, n)), np.diag([1.0, 2.0, 3.0, 0.5]), R, P)


def box(steps: Steps, most: float, high: float) -> Box:
    """Return bounds of all inputs, and of the first and the third state."""
    N, _, m = steps.G.shape
    upper = np.hstack([np.full((N, m), most), np.full((N, 2), high)])
    return Box(-upper, upper, np.array([0, 2]))


def cost_slopes(steps: Steps, kept: Box, found: Regulated) -> Array:
    """Return the derivatives of the whole cost by the inputs (N, m), from the last step back."""
    bounds = (each[:, steps.G.shape[2] :] for each in (kept.lower, kept.upper))
    low, high = bounds
    slopes, costate = np.empty_like(found.u), np.zeros(len(steps.Q))
    for k in reversed(range(len(found.u))):
        x, last = found.x[k + 1], k + 1 == len(found.u)
        costate = costate + (steps.P if last else steps.Q) @ x
        own = x[kept.states]
        costate[kept.states] += STIFFNESS * (
            np.maximum(own - high[k], 0.0) - np.maximum(low[k] - own, 0.0)
        )
        slopes[k] = steps.R[k] @ found.u[k] + steps.G[k].T @ costate
        costate = steps.F[k].T @ costate
    return slopes


@pytest.mark.parametrize(("most", "high"), [(UNBOUND, UNBOUND), (1.0, UNBOUND), (4.0, 0.3)])
def test_no_other_motion_within_bounds_costs_less(most: float, high: float) -> None:
    """It is the robot's, and where an input may change, no change of it pays: it is convex."""
    steps = random_steps()
    kept, start = box(steps, most, high), np.array([0.5, -0.5, 0.2, 0.1])
    found = Regulator(steps)(start, kept)
    assert found.solved and (found.x[0] == start).all()
    moved = np.matvec(steps.F, found.x[:-1]) + np.matvec(steps.G, found.u) + steps.d
    assert found.x[1:] == pytest.approx(moved, abs=1e-9)
    slopes, at = cost_slopes(steps, kept, found), np.abs(found.u) > most - 1e-6
    assert np.abs(found.u).max() <= most + 1e-6
    assert at.any() == (most < UNBOUND)  # the case is what it is there for
    assert (np.abs(found.x[1:, kept.states]).max() > high - 1e-4) == (high < UNBOUND)
    assert np.abs(slopes[~at]).max() < 1e-5
    assert (slopes * np.sign(found.u))[at].max(initial=0.0) < 1e-5


def steady_reference(v: float, omega: float, joints: Array) -> Reference:
    """Return P on a circle that starts at the origin, ahead."""
    still = np.zeros_like(joints)

    def reference(t: float) -> ReferenceState:
        turned, radius = omega * t, v / omega
        pose = np.array([radius * np.sin(turned), radius * (1.0 - np.cos(turned)), turned])
        return ReferenceState(pose, np.array([v, 0.0, omega]), np.zeros(3), joints, still, still)

    return reference


def beside(
    posture: Posture, steady: SteadyMotion, state: ReferenceState, x: Array
) -> tuple[Array, Array]:
    """Return q and ν of a robot that is off a steady motion by x."""
    robot, steered = posture.robot, len(posture.steered)
    own = steady.posture + x[3 : 4 + steered]
    joints = robot.home + x[4 + steered : 3 + len(posture.index)]
    (x_r, y_r, turned), (ahead, left, more) = state.pose, x[:3]
    cos, sin = np.cos(turned), np.sin(turned)
    place = [x_r + cos * ahead - sin * left, y_r + sin * ahead + cos * left, turned + more]
    q = robot.configuration_at(np.array(place), joints, own[1:], float(own[0]))
    return q, steady.nu + x[-robot.dof :]


@pytest.mark.parametrize(
    ("name", "late"), [("balancer", 0.0), ("wheel_legs", 0.0), ("whipple", 0.0), ("balancer", 0.02)]
)
def test_where_nothing_binds_it_is_the_regulator(name: str, late: float) -> None:
    """In a bend that goes on for ever: K of the Riccati equation, from the model itself.

    A step later the robot has moved on under the steady motion's efforts.
    """
    posture = Posture(ReducedDynamics(leaning(name)))
    robot, v = posture.robot, 3.0 if name == "whipple" else 1.0
    steady, cost = posture.steady(v, 0.3, robot.home), Balance(place=0.07, lateness=late)
    A, B = posture.linear(steady)
    F, G = sampled(A, B, 0.02)
    Q, R = cost.costs(posture, B)
    P = solve_discrete_are(F, G, Q, R)
    K = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)
    x = SMALL * np.random.default_rng(SEED).normal(size=len(F))
    reference = steady_reference(v, 0.3, robot.home)
    q, nu = beside(posture, steady, reference(BETWEEN), x)
    law = in_line(LeaningHorizon(regulator=cost)).start(posture.dynamics, PERIOD)
    command = law(posture.dynamics, reference, BETWEEN, q, nu)
    assert isinstance(command, EffortCommand)
    if late:
        x = F @ x
    asked = command.efforts.tau - steady.tau
    assert asked == pytest.approx(-K @ x, rel=1e-6, abs=1e-8)
    assert np.abs(asked).max() > 1e-5 and not command.efforts.limits
    after = F @ x - G @ K @ x
    assert command.nu_d == pytest.approx((steady.nu + x[-robot.dof :]), abs=1e-9)
    assert command.nu_d_dot == pytest.approx((after - x)[-robot.dof :] / 0.02, rel=1e-5, abs=1e-8)


@pytest.mark.parametrize(
    ("name", "samples"),
    cells(product(OWN, (3, 10, 24)), [("balancer", 3), ("wheel_legs", 10), ("whipple", 24)]),
)
def test_a_late_plan_is_followed_from_where_it_is_by_then(name: str, samples: int) -> None:
    """Where nothing binds a plan is that of the regulator, K, and so is the way back to it.

    Until it is there the fallback answers. 24 samples later two steps of 10 are gone.
    """
    posture = Posture(ReducedDynamics(leaning(name)))
    robot, v = posture.robot, 3.0 if name == "whipple" else 1.0
    steady, cost = posture.steady(v, 0.3, robot.home), Balance(lateness=0.0)
    A, B = posture.linear(steady)
    F, G = sampled(A, B, 0.02)
    Q, R = cost.costs(posture, B)
    P = solve_discrete_are(F, G, Q, R)
    K = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)
    reference, comes = steady_reference(v, 0.3, robot.home), samples * PERIOD
    with in_simulated_time(SimulatedTime(comes)):
        law = Horizon(leaning=LeaningHorizon(regulator=cost)).start(posture.dynamics, PERIOD)
    states = SMALL * np.random.default_rng(SEED).normal(size=(3, len(F)))
    for t, x in zip(BETWEEN + np.array([0.0, 0.5, 1.0]) * comes, states, strict=True):
        q, nu = beside(posture, steady, reference(t), x)
        command = law(posture.dynamics, reference, float(t), q, nu)
        assert isinstance(command, LeaningCommand) == bool(t < BETWEEN + 0.9 * comes)
    assert isinstance(command, EffortCommand)
    step, share = divmod(samples, 10)
    planned = np.linalg.matrix_power(F - G @ K, step) @ states[0]
    aim = planned + 0.1 * share * (F @ planned - G @ K @ planned - planned)
    wanted = -K @ planned - K @ (states[2] - aim)
    assert command.efforts.tau - steady.tau == pytest.approx(wanted, rel=1e-6, abs=1e-8)
    assert law.report()["unplanned"] == 2.0
    assert law.report()["largest_delay"] == pytest.approx(comes)


def sets_off(at: float, acceleration: float, joints: Array) -> Reference:
    """Return P at rest, from a time (s) on faster and faster."""
    still = np.zeros_like(joints)

    def reference(t: float) -> ReferenceState:
        since = max(t - at, 0.0)
        pose, twist = np.array([[0.5 * since, 0.0, 0.0], [1.0, 0.0, 0.0]]) * acceleration * since
        return ReferenceState(pose, twist, np.zeros(3), joints, still, still)

    return reference


def test_it_leans_before_it_sets_off() -> None:
    """Wheels that roll back bring the mass ahead of them: what a push would do otherwise."""
    robot = leaning("balancer")
    dynamics = ReducedDynamics(robot)
    steady = Posture(dynamics).steady(0.0, 0.0, robot.home)
    q = robot.configuration_at(np.zeros(3), robot.home, np.empty(0), float(steady.posture[0]))
    found = []
    for acceleration in (0.0, 1.0):
        law = in_line(LeaningHorizon()).start(dynamics, PERIOD)
        reference = sets_off(BETWEEN + 0.3, acceleration, robot.home)
        command = law(dynamics, reference, BETWEEN, q, np.zeros(robot.dof))
        assert isinstance(command, EffortCommand)
        found.append(command.efforts.tau - steady.tau)
    resting, leaning_ahead = found
    assert np.abs(resting).max() < 1e-6
    assert (leaning_ahead[:2] < -0.05).all()


def test_a_delay_that_is_told_is_foretold() -> None:
    told = knowing_delay(Horizon(), PERIOD, 0.02)
    assert told.leaning.regulator.lateness == 0.02
    own = Horizon(leaning=LeaningHorizon(regulator=Balance(lateness=0.005)))
    assert knowing_delay(own, PERIOD, 0.02).leaning == own.leaning


def test_efforts_stay_within_limits_and_are_named() -> None:
    """It falls forward fast: its wheels drive under it as hard as they can."""
    robot = leaning("balancer")
    controller = rpctl.Controller(robot, "line", kinematic=Horizon(asynchronous=False))
    q, nu = robot.state(twist=(0.0, 0.0, 0.0), rates={"shoulder_joint": 0.0}, tilt=0.45)
    output = controller.step(0.0, q, nu)
    assert output.status == "ok"
    assert (output.efforts[:2] == robot.effort_limits[:2]).all()
    assert {limit.joint for limit in output.limits} >= set(robot.actuators[:2])
    assert controller.report()["kinematic.fallbacks"] == 0.0


def test_what_it_does_not_do_is_refused() -> None:
    robot = leaning("balancer")
    for law in (Horizon(base_obstacles=(Disc(1.0, 0.0, 0.1),)), Horizon(body_clearance=0.02)):
        with pytest.raises(
            UnfitLawError, match="balancer leans: the horizon law does not keep it clear"
        ):
            law.start(ReducedDynamics(robot), PERIOD)
    with pytest.raises(RpctlError, match="leans: no law of rpctl balances it if rates"):
        rpctl.Controller(robot, "line", kinematic=Horizon(), rates="estimated")


@pytest.mark.parametrize(
    ("name", "delay"),
    cells(product(OWN, (0.0, 0.02)), slow=[("wheel_legs", 0.0), ("whipple", 0.02)]),
)
def test_it_follows_an_eight(name: str, delay: float) -> None:
    """From the default start error; a bicycle at 3 m/s."""
    size, speed = (10.0, 3.0) if name == "whipple" else (None, None)
    run = rpctl.track(leaning(name), "eight", kinematic=Horizon(), duration=4.0, **COARSE,
                      plant=Plant(delay=delay), size=size, speed=speed)  # fmt: skip
    assert rpctl.summarize(run).outcome == "tracked"
    assert np.hypot(*run.log.e[run.t > 3.0, :2].T).max() < 0.005


@pytest.mark.parametrize(
    ("name", "samples"),
    cells(product(("balancer", "wheel_legs"), (1, 4)), slow=[("balancer", 4)]),
)
def test_it_follows_an_eight_with_plans_that_come_late(name: str, samples: int) -> None:
    plant = Plant(computing_time=samples * COARSE["control_period"])
    run = rpctl.track(leaning(name), "eight", kinematic=Horizon(), duration=4.0, **COARSE,
                      plant=plant)  # fmt: skip
    figures = rpctl.summarize(run)
    assert figures.outcome == "tracked"
    assert figures.kinematic_report["unplanned"] == samples  # before the first
    assert np.hypot(*run.log.e[run.t > 3.0, :2].T).max() < 0.005


@pytest.mark.slow
def test_a_process_makes_the_plan() -> None:
    """What differs is what lies between the rows of the reference that it is sent."""
    law, robot = LeaningHorizon(), leaning("balancer")
    planner = partial(LeaningPlanner, law, PERIOD)
    process = PlanningProcess(planner, robot, law.dt, law.steps + REACH)
    process.await_ready()
    reference = steady_reference(1.0, 0.3, robot.home)
    q, nu = robot.state(twist=(1.0, 0.0, 0.3), rates={"shoulder_joint": 0.0}, tilt=0.05)
    asked = Asked(1.013, q, nu, 0.0, 0.1 * np.ones((5, 3)))
    ends = time.monotonic() + PATIENCE
    while not process.can_begin(reference, asked.t, 0.1, 0.0):
        assert time.monotonic() < ends
    process.begin(reference, asked)
    while (found := process.result(asked.t)) is None:
        assert time.monotonic() < ends
    wanted = planner(dynamics=ReducedDynamics(robot))(reference, asked).plan
    assert found.plan[:3] == wanted[:3]
    assert found.plan.motion.solved
    for one, other in zip(
        (*found.plan[3:7], *found.plan.motion[:3]), (*wanted[3:7], *wanted.motion[:3]), strict=True
    ):
        assert one == pytest.approx(other, rel=1e-3, abs=1e-4)


PUSH = Wrench("base_link", (260.0, 0.0, 0.0), (0.0, 130.0, 0.0), start=0.3, end=0.4)


@pytest.mark.parametrize(
    ("name", "computing"),
    cells(
        [("balance", 0.0), *product(["horizon"], (0.0, 0.006, 0.02))],
        slow=[("balance", 0.0), ("horizon", 0.02)],
    ),
)
def test_it_returns_from_a_push_high_up(name: str, computing: float) -> None:
    """26 N s half a metre high: its wheels' efforts and its tilt are at their bounds for long.

    Plans of the horizon law come so late (s).
    """
    robot, law = leaning("balancer"), UnifiedKinematic() if name == "balance" else Horizon()
    run = rpctl.track(robot, "line", kinematic=law, duration=4.0, **COARSE,
                      plant=Plant(wrenches=(PUSH,), computing_time=computing))  # fmt: skip
    assert rpctl.summarize(run).outcome != "fell"
    assert abs(robot.tilt(run.q[-1])) < 0.05
