"""Plans from a process of its own: they are the plans, and whatever happens to it stops no step."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError
from rpctl.arrays import Array
from rpctl.control.horizon.law import Horizon, HorizonLaw
from rpctl.control.horizon.planner import Asked, Planned, Planner, Planning, start_planning
from rpctl.control.horizon.process import NumbersAhead, PlanningProcess, ReadAhead
from rpctl.control.law import Command
from rpctl.control.obstacles import Disc, LinearBounds
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.named import reference_by_name
from tests.grids import cells

PATIENCE = 60.0  # s that a busy machine may take
LAW = Horizon(steps=8)
EIGHT = reference_by_name(rpctl.load("paper"), "eight")


def any_function(t: float) -> ReferenceState:
    """A reference that no other process could be given: it knows what stands here."""
    return (lambda: EIGHT(t))()


def until(done: Callable[[], object]) -> None:
    ends = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < ends
        time.sleep(0.002)


def gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


class Steps:
    """A law that is asked every 2 ms of a time that stands still in between."""

    def __init__(self, robot: Robot, law: Horizon, reference: Reference = any_function) -> None:
        self.dynamics, self.reference, self.t = ReducedDynamics(robot), reference, 0.0
        started = law.start(self.dynamics, 0.002)
        assert isinstance(started, HorizonLaw)
        self.law = started
        self.q, self.nu = self.state(0.0)

    def state(self, t: float) -> tuple[Array, Array]:
        robot, state = self.dynamics.robot, self.reference(t)
        q = robot.configuration_at(state.pose, state.joints)
        return q, np.array([state.twist[0], state.twist[2], *state.joint_rates])

    def step(self, elapsed: float = 0.002) -> Command:
        return self.ask(elapsed, *self.state(self.t + elapsed))

    def ask(self, elapsed: float, q: Array, nu: Array) -> Command:
        self.t += elapsed
        return self.law(self.dynamics, self.reference, self.t, q, nu)

    @property
    def pid(self) -> int:
        process = self.law.process
        assert process is not None
        assert process._process is not None
        return process._process.pid

    def until_solved(self, more: int = 1) -> None:
        """Step until there are more plans; the time stays where it is, but for rounding."""
        wanted = self.law.solves + more
        until(lambda: (self.step(1e-4), self.law.solves >= wanted)[1])


def test_numbers_of_a_reference_are_the_reference(paper: Robot) -> None:
    """What a row's second derivatives leave out 12.5 ms from there is 3e-7 of a jerk."""
    ahead, read = ReadAhead(paper, 0.1), NumbersAhead(41, 0.1)
    until(lambda: ahead.reaches(any_function, 1.03, 4.0))
    *numbers, _, rows = ahead.taken()
    assert numbers == [1, 41]  # at 1.025 s
    read.add(rows, 0.0)
    until(lambda: ahead.reaches(any_function, 1.05, 5.0))
    read.add(ahead.taken()[-1], 2.02)  # what is before 2 s is forgotten
    for t in np.linspace(2.0, 5.0, 301).tolist():
        found, expected = read(t), EIGHT(t)
        for name in ("pose", "twist", "joints", "joint_rates"):
            np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=6e-5)
        np.testing.assert_allclose(found.pose, expected.pose, atol=4e-7)
        np.testing.assert_allclose(found.joints, expected.joints, atol=4e-7)
    np.testing.assert_allclose(read(1.9).pose, EIGHT(2.0).pose, atol=0.1)
    until(lambda: ahead.reaches(EIGHT, 3.0, 4.0))
    assert ahead.taken()[:2] == (2, 120)


def test_a_plan_from_a_process_is_the_plan(paper: Robot) -> None:
    """Of a reference that cannot be sent; what differs is what lies between its rows."""
    process = PlanningProcess(partial(start_planning, LAW), paper, LAW.dt, LAW.steps + 2)
    process.await_ready()
    planning = Planning(Planner(LAW, ReducedDynamics(paper)))
    state = EIGHT(3.0)
    q = paper.configuration_at(state.pose + np.array([0.02, -0.01, 0.03]), state.joints)
    nu = np.array([state.twist[0], state.twist[2], *state.joint_rates])
    for t in (3.0, 3.013):
        asked = Asked(t, q, nu, 0.013, 0.01 * np.ones(4))
        until(partial(process.can_begin, any_function, t, 0.0, 0.013))
        process.begin(any_function, asked)
        found = list[Planned]()
        ends = time.monotonic() + PATIENCE
        while not found and time.monotonic() < ends:
            found += filter(None, [process.result(t)])
        expected = planning(EIGHT, asked)
        assert found[0].plan is not None
        assert expected.plan is not None
        assert found[0].plan.t == expected.plan.t == t + 0.013
        np.testing.assert_allclose(found[0].plan.nu_dot, expected.plan.nu_dot, atol=2e-4)
        feedback = found[0].plan.feedback or (), expected.plan.feedback or ()
        for one, other in zip(*feedback, strict=True):
            np.testing.assert_allclose(one, other, atol=2e-3)


def test_it_goes_on_when_its_process_dies_or_does_not_answer(paper: Robot) -> None:
    """With the plan that it has, then with its fallback, and then with plans of another process.

    A process ends with its law.
    """
    steps = Steps(paper, LAW)
    steps.until_solved()
    report, before = steps.law.report(), steps.pid
    assert report["restarts"] == 0
    os.kill(before, signal.SIGKILL)
    until(lambda: (steps.step(1e-4), steps.law.report()["restarts"])[1])
    assert gone(before)
    unplanned = steps.law.unplanned
    steps.step(0.3)
    assert steps.law.unplanned == unplanned  # the plan lasts for .8 s
    steps.step(0.6)
    assert steps.law.unplanned == unplanned + 1
    steps.until_solved(2)
    assert steps.pid != before
    assert not gone(steps.pid)
    assert "ended, or did not answer, 1 times; rpctl started it again" in steps.law.notes()[-1]

    before = steps.pid  # of which there will be no answer
    os.kill(before, signal.SIGSTOP)
    for _ in range(220):  # of 20 ms; five horizons are 4 s
        steps.step(0.02)
    assert gone(before)
    assert steps.law.report()["restarts"] == 2
    steps.until_solved(2)
    last = steps.pid
    assert not gone(last)
    del steps.law
    assert gone(last)


def test_settings_that_cannot_be_sent_are_refused(paper: Robot) -> None:
    class Own(Disc):
        pass

    law = Horizon(base_obstacles=(Own(9.0, 0.0, 0.1),))
    with pytest.raises(RpctlError, match="cannot be sent to the planning process"):
        law.start(ReducedDynamics(paper), 0.002)


class Broken(Disc):
    """An obstacle that no plan survives."""

    def linearise(self, points: Array, radius: float, stride: float = 0.0) -> LinearBounds:
        raise ZeroDivisionError("broken")


def test_a_plan_that_fails_is_told(paper: Robot) -> None:
    """The fallback answers, and the process goes on."""
    steps = Steps(paper, replace(LAW, base_obstacles=(Broken(9.0, 0.0, 0.1),)))
    steps.until_solved(2)
    report = steps.law.report()
    assert (report["fallbacks"], report["restarts"]) == (2, 0)
    assert report["unplanned"] > 0
    assert steps.law.notes()[-1].endswith("failed: ZeroDivisionError: broken")


SCRIPT = """
import os, signal, sys, threading, time
import rpctl
from rpctl import Horizon
robot = rpctl.load("paper")
controllers = [rpctl.Controller(robot, "eight", kinematic=Horizon(steps=4)) for _ in range({count})]
q = robot.configuration_at([0.0, 0.0, 0.0], robot.home)
def pids():
    return [c._both._kinematic._controller.process._process.pid for c in controllers]
def step(c, t):
    return c.step(t, q, 0.0 * q[: robot.dof])
t = 0.0
while not all(c.kinematic_report()["solves"] for c in controllers):
    t += 0.002
    for c in controllers:
        assert step(c, t).status == "ok"
    time.sleep(0.001)
{then}
print(*pids(), flush=True)
{last}
"""


def script(then: str = "", last: str = "", count: int = 1) -> subprocess.Popen[str]:
    text = SCRIPT.format(then=then, last=last, count=count)
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, text=True, env=environment
    )


# One that ends by itself is the fork's parent; SIGTERM ends Python as SIGKILL does.
@pytest.mark.parametrize(
    "told",
    cells(
        [None, signal.SIGINT, signal.SIGTERM, signal.SIGKILL],
        slow=[signal.SIGINT, signal.SIGKILL],
    ),
)
def test_no_process_is_left(told: signal.Signals | None) -> None:
    with script(last="time.sleep(60)" if told else "") as process:
        assert process.stdout is not None
        pids = [int(word) for word in process.stdout.readline().split()]
        assert len(pids) == 1
        if told:
            process.send_signal(told)
        assert process.wait(PATIENCE) == (-told if told else 0)
    until(lambda: all(map(gone, pids)))


FORK = """
child = os.fork()
if child == 0:
    before, (c,) = pids(), controllers
    solves = c.kinematic_report()["solves"]
    while c.kinematic_report()["solves"] < solves + 2:
        t += 0.002
        step(c, t)
        time.sleep(0.001)
    assert pids() != before
    del c, controllers[:]
    os._exit(0)
status = os.waitpid(child, 0)[1]
assert status == 0, status
solves = controllers[0].kinematic_report()["solves"]
while controllers[0].kinematic_report()["solves"] < solves + 2:
    t += 0.002
    step(controllers[0], t)
    time.sleep(0.001)
assert controllers[0].report()["kinematic.restarts"] == 0
"""


@pytest.mark.slow
def test_a_process_that_is_forked_starts_its_own() -> None:
    """And leaves that of its parent alone."""
    with script(FORK) as process:
        assert process.stdout is not None
        pids = [int(word) for word in process.stdout.readline().split()]
        assert process.wait(PATIENCE) == 0
    until(lambda: all(map(gone, pids)))


@pytest.mark.thorough
def test_twenty_at_once() -> None:
    with script(count=20) as process:
        assert process.stdout is not None
        pids = [int(word) for word in process.stdout.readline().split()]
        assert process.wait(PATIENCE) == 0
    assert len(set(pids)) == 20
    until(lambda: all(map(gone, pids)))
