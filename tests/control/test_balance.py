"""Robots that lean are balanced: the regulator by its equations, and in short loops."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import rpctl
from rpctl import Plant, ReducedDynamics, Wrench
from rpctl.control.balance import Balance, Design, mended
from rpctl.control.law import LeaningCommand, Rest
from rpctl.control.steady_motion import ERRORS, Posture, SteadyMotion, sampled
from rpctl.control.unified import UnifiedKinematic
from rpctl.errors import RpctlError, UnfitLawError
from rpctl.simulation.config import Config
from rpctl.simulation.plants.starting import start_motion
from tests.grids import cells
from tests.leaning import COARSE, OWN, leaning, pushed_on_an_eight

PERIOD = 0.002


def posture_of(name: str) -> Posture:
    return Posture(ReducedDynamics(leaning(name)))


@cache
def designed(name: str) -> tuple[Posture, SteadyMotion, Design]:
    """Return the law of a robot that goes ahead, a bicycle at 3 m/s."""
    posture = posture_of(name)
    steady = posture.steady(3.0 if name == "whipple" else 0.5, 0.0, posture.robot.home)
    return posture, steady, Balance().design(posture, steady, PERIOD)


def test_a_sampled_model_is_exact() -> None:
    """A double integrator under a held input: x = ½ a T²."""
    F, G = sampled(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [2.0]]), 0.1)
    assert np.allclose(F, [[1.0, 0.1], [0.0, 1.0]]) and np.allclose(G, [[0.01], [0.2]])
    assert np.allclose(expm(np.zeros((2, 2))), np.eye(2))


@pytest.mark.parametrize("name", OWN)
def test_a_steady_motion_goes_on(name: str) -> None:
    posture = posture_of(name)
    robot, dynamics = posture.robot, posture.dynamics
    steady = posture.steady(2.0, 0.3, robot.home)
    assert np.abs(dynamics.forward(steady.q, steady.nu, steady.tau)).max() < 1e-7
    assert dynamics.twist(steady.q, steady.nu)[[0, 2]] == pytest.approx([2.0, 0.3], abs=1e-8)


def test_a_balancer_stands_with_its_mass_above_its_axle() -> None:
    posture = posture_of("balancer")
    robot, steady = posture.robot, posture.steady(0.0, 0.0, np.array([0.8]))
    import pinocchio as pin

    com = pin.centerOfMass(robot.model, robot.model.createData(), steady.q)
    assert com[0] == pytest.approx(robot.base_pose(steady.q)[0], abs=1e-9)
    assert steady.posture[0] < -0.01  # its arm reaches forward, so it leans back


def test_a_turn_that_tilts_a_robot_has_its_steady_motion() -> None:
    """Its arm ahead, a fast turn pulls it out, and so the robot leans back by more."""
    posture = posture_of("balancer")
    slow, fast = (posture.steady(0.2, turn, np.array([0.8])) for turn in (0.0, 6.0))
    for steady in (slow, fast):
        assert np.abs(posture.dynamics.forward(steady.q, steady.nu, steady.tau)).max() < 1e-5
    assert abs(fast.posture[0] - slow.posture[0]) > 1e-3


def test_a_bicycle_leans_into_its_bend() -> None:
    """Of a point mass the lean is atan(v ω/g); wheels and their spin add some per cent."""
    posture = posture_of("whipple")
    lean = posture.steady(3.0, 0.5, np.empty(0)).posture[0]
    assert lean == pytest.approx(-np.arctan(3.0 * 0.5 / 9.81), rel=0.1)


@pytest.mark.parametrize("late", [0, 5, 10])
@pytest.mark.parametrize("name", OWN)
def test_the_regulator_is_stable_however_late_it_is(name: str, late: int) -> None:
    """It foretells 10 ms; efforts come 0, 10 or 20 ms late. The poles are those of the loop."""
    *_, (F, G, upright, mending, _) = designed(name)
    K = upright + mending
    (n, m), told = G.shape, 5
    depth = max(late, told)
    size = n + depth * m
    loop = np.zeros((size, size))
    loop[:n, :n] = F
    foretold = np.zeros((n, size))  # x, then what was sent, the last first
    foretold[:, :n] = np.linalg.matrix_power(F, told)
    for ago in range(told):
        columns = slice(n + ago * m, n + (ago + 1) * m)
        foretold[:, columns] = np.linalg.matrix_power(F, ago) @ G
    now = -K @ foretold
    if late:
        loop[:n, n + (late - 1) * m : n + late * m] = G
    else:
        loop[:n] += G @ now
    loop[n : n + m] = now
    loop[n + m :, n:-m] += np.eye(size - n - m)
    assert np.abs(np.linalg.eigvals(loop)).max() < 1.0


def test_what_the_reference_will_ask_acts_as_the_best_regulator_has_it() -> None:
    """Changes of the tilt to come, as states that move up by one each period, are regulated, too.

    The gains of the first two steps of .04 s, 20 periods each, are those of that larger regulator.
    """
    posture, steady, (F, G, _, _, ahead) = designed("balancer")
    (n, m), periods = G.shape, 40
    # Q and R are the law's: place .1 m, heading .3 rad, tilt .1, arm .03, .3 m/s and so on
    Q = np.zeros((n + periods, n + periods))
    scales = [0.1, 0.1, 0.3, 0.1, 0.03, 0.3, 1.0, 1.0, 1.0]  # rates: v, ω, tilt, arm
    Q[:n, :n] = np.diag(1.0 / np.array(scales) ** 2)
    B = posture.linear(steady)[1][[5, 6, 8]] / np.array([[3.0], [5.0], [40.0]])
    R = B.T @ B + 0.03 * np.diag((B**2).sum(axis=0))
    large = np.zeros((n + periods, n + periods))
    large[:n, :n] = F
    large[ERRORS, n] = -1.0  # of the tilt from what is wanted, which changes now
    large[n:-1, n + 1 :] = np.eye(periods - 1)
    push = np.vstack([G, np.zeros((periods, m))])
    P = solve_discrete_are(large, push, Q, R)
    gains = -np.linalg.solve(R + push.T @ P @ push, push.T @ P @ large)[:, n:]
    for k in range(2):
        mean = gains[:, 20 * k : 20 * (k + 1)].mean(axis=1)
        assert ahead[k, :, 0] == pytest.approx(mean, rel=1e-3)


@pytest.mark.parametrize("name", OWN)
def test_staying_up_goes_before_place_and_speed(name: str) -> None:
    """Near its place the law is the optimal one; far off, what it asks is bounded."""
    posture, steady, (F, G, upright, mending, _) = designed(name)
    limits = posture.robot.effort_limits
    Q, R = Balance().costs(posture, posture.linear(steady)[1])
    P = solve_discrete_are(F, G, Q, R)
    best = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)
    assert upright + mending == pytest.approx(best, rel=1e-9, abs=1e-9 * np.abs(best).max())
    loop = np.abs(np.linalg.eigvals(F - G @ upright))
    assert np.all(loop < 1.0)
    x = np.zeros(len(F))
    x[posture.outer] = 1e-3
    near = mending @ x
    assert mended(upright, near, limits) == pytest.approx(near)
    far = mended(upright, 1e5 * near, limits)
    assert far / np.linalg.norm(far) == pytest.approx(near / np.linalg.norm(near))
    lean = np.linalg.norm(far) / np.linalg.norm(upright[:, ERRORS])
    assert max(lean / 0.3, np.abs(far / limits).max() / 2.0) == pytest.approx(1.0)


def test_no_cunning_of_several_motors_keeps_legs_up() -> None:
    """Wheels do not hold legs together, which slipping would undo: gains of each motor may err.

    σ of I + L(jω), in the units of what motors cost, was .04 when only accelerations cost.
    """
    posture = posture_of("wheel_legs")
    steady = posture.steady(0.1, 0.0, posture.robot.home)
    F, G, upright, mending, _ = Balance().design(posture, steady, PERIOD)
    _, R = Balance().costs(posture, posture.linear(steady)[1])
    one, units = np.eye(len(F)), np.sqrt(np.diag(R))
    least = min(
        np.linalg.svd(np.eye(len(R)) + units[:, None] * loop / units, compute_uv=False)[-1]
        for w in np.geomspace(0.1, 1500.0, 100)
        for loop in [(upright + mending) @ np.linalg.solve(np.exp(1j * w * PERIOD) * one - F, G)]
    )
    assert least > 0.24


def test_another_reference_is_looked_ahead_at_at_once() -> None:
    """As by a regulator that never knew the one before."""
    robot = leaning("balancer")
    dynamics, law = ReducedDynamics(robot), Balance(lateness=0.0)
    wish = UnifiedKinematic().start(dynamics, PERIOD)
    line, eight = (rpctl.load_reference(robot, name) for name in ("line", "eight"))
    q, nu = robot.state(twist=(0.3, 0.0, 0.0), rates={"shoulder_joint": 0.0}, tilt=0.0)
    found = []
    for references in ((line, eight), (eight,)):
        controller = law.start(dynamics, PERIOD)
        for reference in references:
            efforts = controller(dynamics, q, nu, wish(dynamics, reference, 1.0, q, nu))
        found.append(efforts.tau)
    assert found[0] == pytest.approx(found[1], abs=1e-9)


def test_a_bicycle_goes_in_a_circle_from_the_start_however_late_it_is() -> None:
    """It begins as its reference does, and a delay that is told leaves it nothing behind."""
    for delay in (0.0, 0.02):
        run = rpctl.track(leaning("whipple"), "circle", size=8.0, speed=3.0, duration=1.0,
                          delay=delay, **COARSE)  # fmt: skip
        assert run.nu[0, 0] == pytest.approx(3.0, abs=1e-9)
        assert np.abs(run.log.e[:, :3]).max() < 1e-4


def test_a_bicycle_on_contact_begins_in_motion() -> None:
    posture = posture_of("whipple")
    robot, steady = posture.robot, posture.steady(3.0, 0.0, np.empty(0))
    rest = Rest(steady.q, steady.tau, steady.nu)
    motion = start_motion(posture.dynamics, Config(plant=Plant(kind="contact")), rest)
    assert motion.nu == pytest.approx([3.0, 0.0, 0.0], abs=1e-9)
    before = robot.base_pose(motion.q)
    motion.advance(steady.tau, 0.02)
    assert robot.base_pose(motion.q)[0] - before[0] == pytest.approx(0.06, abs=1e-3)


def test_a_bicycle_that_goes_too_slowly_is_refused() -> None:
    """v² tan(.6)/1.02 = 9.81 tan(.1) of trail and wheelbase as they are: 1.21 m/s."""
    robot = leaning("whipple")
    assert robot.balancing_speed(0.1) == pytest.approx(
        np.sqrt(9.81 * np.tan(0.1) * 1.02 / np.tan(0.6)), rel=0.05
    )
    for name, speed in (("eight", 0.65), ("line", 1.0), ("reverse", None)):
        with pytest.raises(
            RpctlError, match=r"falls over at .* m/s, the lowest speed of its reference"
        ):
            rpctl.load_reference(robot, name, speed=speed)
    with pytest.raises(RpctlError, match=r"7\.\d+ m is the least size"):
        rpctl.load_reference(robot, "eight", size=3.0)


def test_a_bicycle_goes_at_its_own_pace_in_bends_of_half_its_steering() -> None:
    """Half of tan(.6) is steered in the sharpest bend, and tan(lean) is at most half of tan(.5)."""
    robot = leaning("whipple")
    reference = rpctl.load_reference(robot, "eight")
    v, _, omega = np.array([reference(t).twist for t in np.linspace(0.0, 40.0, 400)]).T
    assert v.max() == pytest.approx(np.sqrt(9.81 * np.tan(0.5) * 1.02 / np.tan(0.6)), rel=0.05)
    assert np.abs(omega / v).max() == pytest.approx(0.5 * np.tan(0.6) / 1.02, rel=0.05)
    assert np.abs(v * omega).max() < 0.5 * 9.81 * np.tan(0.5)
    wider = rpctl.load_reference(robot, "circle", speed=6.0)
    v, _, omega = wider(1.0).twist
    assert v * omega < 0.55 * 9.81 * np.tan(0.5)


def test_a_balancer_comes_to_its_eight() -> None:
    """From .1 m and .1 rad off; the second half of 5 s is within 3 cm, its end within 1."""
    run = rpctl.track(leaning("balancer"), "eight", duration=5.0, initial_error=(0.1, -0.1, 0.1),
                      **COARSE)  # fmt: skip
    away = np.hypot(*run.log.e[:, :2].T)
    assert away[len(away) // 2 :].max() < 0.03 and away[-1] < 0.01


WITHIN = {"balancer": 0.01, "wheel_legs": 0.01, "whipple": 0.05}  # m


@pytest.mark.parametrize(
    ("name", "delay"),
    cells(product(OWN, (0.0, 0.02)), slow=[("wheel_legs", 0.02)]),
)
def test_it_settles_on_its_own_eight(name: str, delay: float) -> None:
    """From the default start, in the last quarter."""
    run = rpctl.track(leaning(name), "eight", duration=4.0, delay=delay, **COARSE)
    away = np.hypot(*run.log.e[:, :2].T)
    assert away[3 * len(away) // 4 :].max() < WITHIN[name]


def test_what_cannot_be_balanced_is_refused() -> None:
    with pytest.raises(UnfitLawError, match="paper does not lean"):
        Balance().start(ReducedDynamics(rpctl.load("paper")), PERIOD)
    with pytest.raises(RpctlError, match=r"leans.*balance"):
        rpctl.Controller(leaning("balancer"), "line", dynamic="integral")
    with pytest.raises(RpctlError, match="leans: no law of rpctl balances it if rates"):
        rpctl.Controller(leaning("balancer"), "line", rates="estimated")


def test_a_step_asks_for_its_goal() -> None:
    robot = leaning("balancer")
    controller = rpctl.Controller(robot, "line")
    q, nu = robot.state(twist=(0.0, 0.0, 0.0), rates={"shoulder_joint": 0.0}, tilt=0.05)
    output = controller.step(0.0, q, nu)
    assert output.status == "ok" and isinstance(output.command, LeaningCommand)
    wheels = output.efforts[:2]
    assert (wheels > 0.0).all()  # it leans forward, so they drive under it


@pytest.mark.parametrize(
    ("name", "delay"),
    cells(product(OWN, (0.0, 0.02)), slow=[("whipple", 0.02)]),
)
def test_it_follows_an_eight_late_and_pushed(name: str, delay: float) -> None:
    run = pushed_on_an_eight(name, Plant(delay=delay), 1.0, duration=4.0, **COARSE)
    figures = rpctl.summarize(run)
    assert figures.outcome != "fell", figures.outcome_sentence
    assert figures.final_base_error < (0.5 if name == "balancer" else 0.1)  # pushed the hardest


@pytest.mark.parametrize(
    ("name", "height"),
    cells(
        [("balancer", 0.0), ("balancer", 0.5), ("wheel_legs", 0.0)],
        slow=[("balancer", 0.5), ("wheel_legs", 0.0)],
    ),
)
def test_a_push_of_20_newton_seconds_is_survived(name: str, height: float) -> None:
    """At its body's origin, the hips of legs, or so high (m) above; efforts come at once."""
    push = Wrench("base_link", (200.0, 0.0, 0.0), (0.0, 200.0 * height, 0.0), start=0.3, end=0.4)
    robot = leaning(name)
    run = rpctl.track(robot, "line", duration=2.5, speed=0.05, plant=Plant(wrenches=(push,)),
                      **COARSE)  # fmt: skip
    tilts = np.abs([robot.tilt(q) for q in run.q[::4]])
    assert rpctl.summarize(run).outcome != "fell" and tilts.max() < 0.7 and tilts[-1] < 0.35


@pytest.mark.slow
def test_what_nobody_balances_has_fallen() -> None:
    """A push that no motor of it stands ends as ``fell``, and the run ends there."""
    push = Wrench("base_link", moment=(0.0, 1500.0, 0.0), start=0.5, end=0.6)
    run = rpctl.track(leaning("balancer"), "line", duration=8.0, plant=Plant(wrenches=(push,)),
                      **COARSE)  # fmt: skip
    assert rpctl.summarize(run).outcome == "fell" and run.t[-1] < 5.0


@pytest.mark.parametrize("name", cells(OWN, ["wheel_legs"]))  # others: on eight and circle
def test_it_stays_upright(name: str) -> None:
    robot = leaning(name)
    run = rpctl.track(robot, "line", duration=1.5, **COARSE)
    tilts = [robot.tilt(q) for q in run.q[::20]]
    assert np.abs(tilts).max() < 0.3
    assert np.abs(run.log.e[-1, :3]).max() < 0.2


@pytest.mark.slow
def test_a_robot_that_a_push_has_made_fast_turns_less() -> None:
    """70 N s along its way make it 7 m/s fast on an eight for 0.3 m/s."""
    robot = leaning("wheel_legs")
    push = Wrench("base_link", (62.0, 62.0, 0.0), start=0.2, end=1.0)
    run = rpctl.track(robot, "eight", duration=3.2, collisions=False,
                      plant=Plant(wrenches=(push,), delay=0.02))  # fmt: skip
    assert run.nu[:, 0].max() > 6.0
    assert rpctl.summarize(run).outcome != "fell"
    assert np.abs(run.nu[:, 1]).max() < 6.0
