"""Laws as one kernel: its answers are those of track, of any backend, and those of its parts."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import BoundedDynamic, Controller, Robot, set_limits
from rpctl.arrays import Array
from rpctl.control import bounded_statements
from rpctl.control import law_kernel as kernels
from rpctl.control.law_kernel import law_kernel
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DiffersError
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.closed_loop import rest_at_start
from rpctl.simulation.loop.track import simulate
from tests.grids import cells

PERIOD = 0.002
WHOLE = cells(
    [("paper", "effort"), ("paper", "velocity"), ("swerve", "velocity"), ("car", "effort"),
     ("tiago", "effort")],
    [("paper", "effort"), ("paper", "velocity")],
    slow=[("swerve", "velocity")],
)  # fmt: skip


def following(controller: Controller, count: int = 60) -> list[tuple[float, Array, Array]]:
    """Return samples of a robot near its reference, off by some centimetres."""
    robot, found = controller.robot, []
    for t in PERIOD * np.arange(count):
        state = controller.reference(t)
        off = np.array([0.02, -0.03, 0.05])
        q = robot.configuration_at(np.asarray(state.pose) + off, state.joints)
        found.append((float(t), q, np.full(robot.dof, 0.01 * np.sin(9.0 * t))))
    return found


@pytest.mark.parametrize("name", [pytest.param("car", marks=pytest.mark.slow), "paper"])
def test_a_robot_is_sent_what_track_computes_to_the_last_bit(name: str) -> None:
    """Also far from the reference, where a car first finds a way up to it."""
    robot = rpctl.load(name)
    error = (0.4, 0.5, 1.0) if name == "car" else (0.1, -0.1, 0.2)
    config = Config(run=RunSettings("circle", 0.3, error))
    run = simulate(robot, config, collisions=False, backend="compiled")
    assert not run.notes
    reference = config.run.load_reference(robot)
    rest = rest_at_start(ReducedDynamics(robot), config, reference)
    controller = Controller(robot, reference, rest=rest)
    for k, t in enumerate(run.t):
        output = controller.step(t, run.q[k], run.nu[k])
        assert output.status == "ok"
        np.testing.assert_array_equal(output.efforts, run.tau[k])
        np.testing.assert_array_equal(output.command.nu_d, run.log.nu_d[k])


@pytest.mark.parametrize(("name", "output"), WHOLE)
def test_both_machines_answer_the_same(name: str, output: str) -> None:
    """And each says which it is."""
    robot = rpctl.load(name)
    pair = [
        Controller(robot, "eight", output=output, compiled=compiled) for compiled in (True, False)
    ]
    for sample in following(pair[0]):
        native, virtual = (controller.step(*sample) for controller in pair)
        assert native.status == virtual.status == "ok"
        for a, b in ((native.efforts, virtual.efforts), (native.speeds, virtual.speeds)):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
        assert native.limits == virtual.limits
    assert [controller.report()["machine_code"] for controller in pair] == [1.0, 0.0]


def test_a_law_within_limits_alone_is_that_of_the_whole_kernel(paper: Robot) -> None:
    """A function for the kinematic law leaves the command to it, and the rest to the kernel."""
    law = rpctl.UnifiedKinematic(approach=None)

    def plain(*sample: Any) -> rpctl.Command:
        return law(*sample)

    whole = Controller(paper, "circle", kinematic=law, compiled=False)
    parts = Controller(paper, "circle", kinematic=plain, compiled=False)
    assert parts.report()["machine_code"] == 0.0
    for sample in following(whole):
        one, other = whole.step(*sample), parts.step(*sample)
        np.testing.assert_allclose(one.efforts, other.efforts, rtol=1e-12, atol=1e-12)
        assert one.limits == other.limits


def test_a_search_that_does_not_end_has_a_substitute(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It keeps the limits, and the integral goes on from what was remembered before."""
    monkeypatch.setattr(bounded_statements, "MAX_STEPS", 0)
    weak = set_limits(paper, effort={"wheel_*": 0.05})
    controller = Controller(weak, "circle", compiled=False)
    outputs = [controller.step(*sample) for sample in following(controller, 5)]
    assert {output.status for output in outputs} == {"fallback"}
    assert "the search for efforts within limits found no" in outputs[0].reason
    assert all(np.abs(output.efforts[:2]).max() <= 0.05 for output in outputs)
    assert controller.report()["fallbacks"] == 5


def test_machine_code_that_is_not_pinocchios_is_not_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    paper, right = rpctl.load("paper"), BoundedDynamic.free_efforts

    def wrong(*given: Any) -> Array:
        return right(*given) + 1e-6

    monkeypatch.setattr(BoundedDynamic, "free_efforts", wrong)
    with pytest.raises(DiffersError, match="gives other efforts than Pinocchio, by 1e-06"):
        law_kernel(None, BoundedDynamic(), ReducedDynamics(paper), PERIOD, compiled=True)
    controller = Controller(paper, "circle", dynamic=BoundedDynamic())
    assert controller.report()["machine_code"] == 0.0
    assert controller.step(*following(controller)[0]).status == "ok"


def test_a_step_leaves_nothing_behind(paper: Robot) -> None:
    controller = Controller(paper, "circle")
    _, q, nu = following(controller, 1)[0]

    def steps(first: int) -> int:
        for k in range(first, first + 500):
            controller.step(PERIOD * k, q, nu)
        return tracemalloc.get_traced_memory()[0]

    steps(0)
    tracemalloc.start()
    try:
        before = steps(500)
        assert steps(1000) - before < 2000  # bytes, of 500 steps
    finally:
        tracemalloc.stop()


def test_machine_code_with_another_robots_limits_is_not_used() -> None:
    """Near home no limit binds, and both robots' efforts are the same: it is tried further, too."""
    strong = rpctl.load("paper")
    weak, laws = set_limits(strong, effort={"wheel_*": 2.0}), (None, BoundedDynamic())
    kernel = law_kernel(*laws, ReducedDynamics(strong), PERIOD, compiled=True)
    kernels._require_equal(kernel, laws, ReducedDynamics(strong), PERIOD)
    with pytest.raises(DiffersError, match="asks wheel_left_joint for more than its limit"):
        kernels._require_equal(kernel, laws, ReducedDynamics(weak), PERIOD)


def test_machine_code_that_answers_nothing_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    paper, laws = rpctl.load("paper"), (None, BoundedDynamic())
    kernel = law_kernel(*laws, ReducedDynamics(paper), PERIOD, compiled=True)
    monkeypatch.setattr(kernels.RunningLaws, "follow", lambda *given: False)
    with pytest.raises(DiffersError, match="answers no state near home"):
        kernels._require_equal(kernel, laws, ReducedDynamics(paper), PERIOD)
