"""What a robot steps: bad samples, laws that fail, wrong objects, and a stop that is controlled."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Controller, Robot
from rpctl.arrays import Array
from rpctl.control.law import Command, Efforts, Rest
from rpctl.dynamics.motion import rk4_step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SolverError
from rpctl.reference.load import load_reference
from tests.catalogue import robot_of
from tests.control.simulated import PERIOD, Simulated


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture
def controller(paper: Robot) -> Controller:
    return Controller(paper, "circle", kinematic="unified", dynamic="integral")


@pytest.fixture(scope="module")
def undisturbed(paper: Robot) -> Array:
    """Return where that controller has brought its robot after .2 s."""
    clean = Simulated(Controller(paper, "circle", kinematic="unified", dynamic="integral"))
    clean.run(0.2)
    return clean.q


def test_track_steps_this_object(paper: Robot) -> None:
    run = rpctl.track(
        paper,
        "circle",
        duration=0.2,
        initial_error=(0.1, -0.1, 0.2),
        dynamic=rpctl.IntegralDynamic(),
        backend="compiled",
    )
    rest = Rest(run.q[0], run.tau[0] * 0.0)
    controller = Controller(paper, "circle", kinematic="unified", dynamic="integral", rest=rest)
    for k, t in enumerate(run.t):
        output = controller.step(t, run.q[k], run.nu[k])
        assert output.status == "ok"
        np.testing.assert_array_equal(output.efforts, run.tau[k])
        np.testing.assert_array_equal(output.command.nu_d, run.log.nu_d[k])
    assert controller.report()["samples"] == len(run.t)


class Unspeakable:
    """Is no number, and raises what it likes when it is asked for one."""

    def __float__(self) -> float:
        raise KeyError("it does not say")


BAD: dict[str, Callable[[float, Array, Array], tuple[Any, Any, Any]]] = {
    "q has numbers": lambda t, q, nu: (t, np.where(np.arange(len(q)) == 1, np.nan, q), nu),
    "nu has numbers that are not finite": lambda t, q, nu: (t, q, np.full_like(nu, -np.inf)),
    "t is nan": lambda t, q, nu: (math.nan, q, nu),
    "t is inf": lambda t, q, nu: (math.inf, q, nu),
    "at most 1e+10 s": lambda t, q, nu: (1e308, q, nu),
    "int too large": lambda t, q, nu: (t, [10**400] * len(q), nu),
    "it does not say": lambda t, q, nu: (Unspeakable(), q, nu),
    "not later than": lambda t, q, nu: (t - PERIOD, q, nu),
    "q has the shape": lambda t, q, nu: (t, q[:-1], nu),
    "nu has the shape": lambda t, q, nu: (t, q, nu[:, None]),
    "are not those of an angle": lambda t, q, nu: (t, np.where(np.arange(len(q)) == 2, 0.5, q), nu),
    "entries that are not numbers: could not": lambda t, q, nu: (t, q, ["fast"] * len(nu)),
    "not numbers": lambda t, q, nu: (None, q, nu),
    "larger than 1e+06": lambda t, q, nu: (t, q, np.full_like(nu, 1e9)),
}


@pytest.mark.parametrize("reason", BAD)
def test_a_bad_sample_is_held_and_leaves_no_trace(
    controller: Controller, undisturbed: Array, reason: str
) -> None:
    def measure(t: float, q: Array, nu: Array) -> tuple[Any, Any, Any]:
        bad = controller.report()["samples"] in (20, 21, 60)
        return BAD[reason](t, q, nu) if bad else (t, q, nu)

    robot = Simulated(controller)
    robot.run(0.2, measure)
    statuses = [output.status for output in robot.outputs]
    assert [k for k, status in enumerate(statuses) if status != "ok"] == [20, 21, 60]
    for k in (20, 21, 60):
        assert statuses[k] == "held"
        assert reason in robot.outputs[k].reason
        np.testing.assert_array_equal(robot.outputs[k].efforts, robot.outputs[k - 1].efforts)
    report = controller.report()
    assert (report["samples"], report["held"], report["stopped"]) == (100, 3, 0)
    np.testing.assert_allclose(robot.q, undisturbed, atol=2e-6)


def test_before_the_first_good_sample_the_efforts_are_those_of_the_rest(paper: Robot) -> None:
    nothing = np.full(paper.nq, np.nan)
    output = Controller(paper, "circle").step(0.0, nothing, np.zeros(4))
    assert output.status == "held"
    np.testing.assert_array_equal(output.efforts, np.zeros(4))
    rest = Rest(paper.configuration(), np.array([0.0, 0.0, 0.5, -0.5]))
    controller = Controller(paper, "circle", rest=rest)
    for k in range(100):
        output = controller.step(k * PERIOD, nothing, np.zeros(4))
        assert output.status == (
            "held" if k * PERIOD <= controller.guards.stale_after else "stopped"
        )
        np.testing.assert_array_equal(output.efforts, rest.tau)


@pytest.mark.slow
def test_silence_ends_in_a_stop_and_the_next_good_sample_ends_that(paper: Robot) -> None:
    controller = Controller(
        paper,
        "circle",
        kinematic="unified",
        dynamic="integral",
        guards=rpctl.Guards(stale_after=0.05),
    )
    robot = Simulated(controller)
    robot.run(1.0)
    before = robot.nu.copy()
    assert np.linalg.norm(before) > 0.1
    robot.run(1.6, lambda t, q, nu: (t, q * np.nan, nu))
    statuses = [output.status for output in robot.outputs]
    held = round(0.05 / PERIOD)
    assert statuses[500:] == ["held"] * held + ["stopped"] * (800 - held)
    assert all(np.isfinite(output.efforts).all() for output in robot.outputs)
    assert np.linalg.norm(robot.nu) < 1e-2 * np.linalg.norm(before)
    robot.run(4.0)
    assert robot.outputs[-1].status == "ok"
    # The reference stood as long as the robot was braked, and took a second to its pace.
    assert np.hypot(*robot.error(robot.t - 1.55 - 0.5)[:2]) < 0.02
    assert controller.report()["stopped"] == 800 - held
    assert "braked the robot at 775 samples" in controller.notes()[-1]


@pytest.mark.slow
def test_lost_and_jittering_samples_cost_little(paper: Robot, rng: np.random.Generator) -> None:
    """The integral knows how long ago the last sample was; a period for each loses 3.8 mm."""
    controller = Controller(paper, "circle", kinematic="unified", dynamic="integral")
    lossy = rms(Simulated(controller).run(
        3.0,
        lambda *sample: sample if sample[0] == 0.0 or rng.random() > 0.3 else None,
        lambda: PERIOD * rng.uniform(0.5, 1.5),
    ))  # fmt: skip
    controller.reset()
    assert controller.report()["samples"] == 0
    assert lossy < 4.0 * rms(Simulated(controller).run(3.0)) < 4e-4


def gives_up(*when: int) -> Callable[..., Any]:
    """Return a dynamic law that gives up at some of its calls."""
    calls: list[None] = []

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        calls.append(None)
        if len(calls) - 1 in when:
            raise SolverError("no solution")
        return np.asarray(rpctl.PaperDynamic()(dynamics, q, nu, command))

    return law


def test_a_solver_that_gives_up_stops_nothing(paper: Robot) -> None:
    """Its substitute is the paper's law, which here is the law itself."""
    robot = Simulated(Controller(paper, "circle", kinematic="unified", dynamic=gives_up(0, 7, 8)))
    robot.run(0.04)
    clean = Simulated(Controller(paper, "circle", kinematic="unified", dynamic="paper"))
    clean.run(0.04)
    np.testing.assert_allclose(robot.q, clean.q, rtol=0.0, atol=1e-15)
    statuses = [output.status for output in robot.outputs]
    assert [k for k, status in enumerate(statuses) if status == "fallback"] == [0, 7, 8]
    assert robot.outputs[7].reason == "no solution"
    assert robot.controller.report()["fallbacks"] == 3
    assert robot.controller.notes() == (
        "the dynamic law failed at 3 of 20 samples, where a fallback law replaced it; first at t "
        "= 0 s: no solution",
    )


def test_substitutes_keep_the_limits(paper: Robot) -> None:
    limited = rpctl.set_limits(paper, effort={"wheel_*": 0.5})
    controller = Controller(limited, "circle", kinematic="unified", dynamic=gives_up(0))
    output = Simulated(controller, (0.4, 0.0, 0.0)).controller.step(
        0.0, limited.configuration(-0.5), np.zeros(4)
    )
    assert output.status == "fallback"
    assert np.abs(output.efforts[:2]).max() == 0.5
    assert {limit.kind for limit in output.limits} == {"effort"}


def test_where_both_laws_fail_the_robot_is_braked(paper: Robot) -> None:
    """It is measured all the while, so it stands in the end wherever it was pushed."""
    good = Controller(paper, "circle").reference

    def reference(t: float) -> Any:
        if t > 1.001:
            raise SolverError("the planner is gone")
        return good(t)

    robot = Simulated(Controller(paper, reference, kinematic="unified", dynamic="integral"))
    robot.run(1.0)
    for _ in range(800):
        output = robot.controller.step(robot.t, robot.q, robot.nu)
        step = rk4_step(robot.dynamics, robot.q, robot.nu, output.efforts, PERIOD)
        robot.q, robot.nu, robot.t = step.q, step.nu, robot.t + PERIOD
    assert output.status == "stopped"
    assert output.reason == "the planner is gone"
    assert np.linalg.norm(robot.nu) < 2e-3


def test_mistakes_are_raised_at_the_first_sample(paper: Robot) -> None:
    def short(*state: Any) -> Efforts:
        return Efforts(np.zeros(3))

    with pytest.raises(rpctl.RpctlError, match="give 4 real numbers"):
        Controller(paper, "circle", kinematic="unified", dynamic=short).step(
            0.0, paper.configuration(), np.zeros(4)
        )
    for settings in ({"period": 0.0}, {"period": math.nan}, {"kinematic": "fast"}):
        with pytest.raises(rpctl.RpctlError):
            Controller(paper, "circle", **settings)


@pytest.mark.parametrize("number", [math.nan, 1e200])
def test_no_sample_raises_or_is_answered_without_numbers(paper: Robot, number: float) -> None:
    """Every entry in turn, under the laws that are used where nobody names any."""
    controller = Controller(paper, "circle", compiled=False)
    q, nu = paper.configuration(), np.zeros(paper.dof)
    for k, entry in enumerate(range(paper.nq + paper.dof)):
        state = np.concatenate([q, nu])
        state[entry] = number
        output = controller.step(k * PERIOD, state[: paper.nq], state[paper.nq :])
        assert np.isfinite(output.efforts).all()
        missing = math.isnan(number) and entry >= paper.nq  # a rate that nobody measures is none
        assert output.status in (("ok",) if missing else ("held", "stopped"))


ZEROS = np.zeros(4)
NAN = np.array([0.1, np.nan, 0.0])


def track(**given: Any) -> rpctl.Run:
    settings = {"reference": "line", "duration": 0.02, "collisions": False}
    return rpctl.track(robot_of("paper"), **{**settings, **given})


def returned(**fields: Any) -> Any:
    """Return a reference that is a line's but for some fields of its states."""
    good = load_reference(robot_of("paper"), "line")
    return lambda t: good(t)._replace(**fields)


def commanded(**fields: Any) -> Any:
    return lambda *state: rpctl.Command(ZEROS, ZEROS)._replace(**fields)


CASES: list[tuple[dict[str, Any], str]] = [
    ({"reference": lambda t: None}, "(NoneType) at t = 0 s; return a rpctl.ReferenceState"),
    ({"reference": lambda t: NAN}, "(ndarray) at t = 0 s; return a rpctl.ReferenceState"),
    ({"reference": lambda t: returned()(t) if t < 0.009 else None}, "(NoneType) at t = 0.01 s"),
    ({"reference": returned(pose=[0.0, 0.0])}, "pose of the reference is [0.0, 0.0] (list); give"),
    ({"reference": returned(twist=np.zeros(7))}, "twist of the reference is an array (7,)"),
    ({"reference": returned(twist_dot=None)}, "twist_dot of the reference is None"),
    ({"reference": returned(joints=np.zeros(7))}, "the reference has 7 joints, paper has 2"),
    ({"reference": returned(joint_rates=None)}, "joint_rates of the reference is None"),
    ({"reference": returned(twist=NAN)}, "give finite numbers"),
    (
        {"kinematic": rpctl.UnifiedKinematic},
        "kinematic is the class UnifiedKinematic; give one of its objects: UnifiedKinematic(...)",
    ),
    ({"reference": 7}, "the reference is 7 (int); give a name, a file"),
    ({"dynamic": 7}, "dynamic is 7 (int); give a function"),
    ({"kinematic": lambda *state: (ZEROS, ZEROS)}, "(tuple); return a rpctl.Command("),
    ({"kinematic": commanded(nu_d=np.zeros(3))}, "nu_d of the kinematic law is an array (3,) of"),
    ({"kinematic": commanded(nu_d_dot=np.zeros(3))}, "nu_d_dot of the kinematic law is an array"),
    *(
        ({"dynamic": lambda *state, value=value: value}, "tau of the dynamic law is ")
        for value in (None, 0.0, np.zeros(2), np.full(4, np.nan), np.array(["a"] * 4))
    ),
]  # fmt: skip


@pytest.mark.parametrize(("given", "told"), CASES)
def test_what_to_give_instead_is_told(given: dict[str, Any], told: str) -> None:
    with pytest.raises(rpctl.RpctlError) as refused:
        track(**given)
    assert told in str(refused.value)


def test_the_efforts_of_a_plain_function_are_used() -> None:
    tau = np.array([0.1, -0.2, 0.0, 0.0])
    np.testing.assert_array_equal(track(dynamic=lambda *state: tau).tau[0], tau)


@pytest.mark.parametrize(("periods", "late"), [(1.4, 0), (1.6, 3)])
def test_a_sample_is_late_from_one_and_a_half_periods_on(
    paper: Robot, periods: float, late: int
) -> None:
    robot = Simulated(Controller(paper, "circle"))
    robot.run(4 * periods * PERIOD, steps=lambda: periods * PERIOD)
    assert robot.controller.report()["samples"] == 4
    assert robot.controller.report()["late"] == late
