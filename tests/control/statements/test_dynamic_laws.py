"""The dynamic laws as statements against NumPy's, sample by sample, limits binding or not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import BoundedDynamic, IntegralDynamic, PaperDynamic, Robot, UnifiedKinematic
from rpctl.control import bounded_statements
from rpctl.control.fragment import NO_COMMAND, NO_EFFORTS, LimitNames
from rpctl.control.law import Limit, Rest
from tests.control.statements.law_cases import PERIOD, RunningLaws, Sample, drifting_samples
from tests.control.tight_limits import limited
from tests.grids import cells

KINEMATIC = UnifiedKinematic(approach=None)
LAWS = {
    "paper": PaperDynamic(),
    "paper in the middle": PaperDynamic(joint_horizon_dyn=0.07, midpoint=True),
    "bounded": BoundedDynamic(along=0.1),
    "bounded at the sample": BoundedDynamic(midpoint=False, joint_horizon_dyn=0.1),
    "integral": IntegralDynamic(gain=5.0, joint_gain=20.0),
    "integral by bandwidth": IntegralDynamic(),
}
ROBOTS = ["paper", "skid_steer", "mecanum", "car", "swerve", "tiago", "tricycle", "caster_drive"]
ROBOTS += ["arm", "omni", "bicycle", "twin_casters", "mixed_chain"]
GRID = [(robot, law) for robot in ROBOTS for law in LAWS]
QUICK = {("paper", "paper"), ("paper", "paper in the middle"), ("paper", "bounded at the sample")}
QUICK |= {("paper", "integral"), ("mecanum", "integral by bandwidth")}
SLOW = {("car", "integral by bandwidth"), ("caster_drive", "bounded")}
SLOW |= {("tricycle", "bounded at the sample"), ("omni", "integral"), ("arm", "bounded")}
LANES, COUNT = 4, 10
ROUNDING = 1e-9  # of efforts and their limits: what DAQP and the steps here may differ by


def tight(name: str) -> Robot:
    """Return a robot that often meets its limits."""
    return limited(rpctl.load(name), effort=0.4, speed=0.5)


def running(robot: Robot, law: Any, rng: np.random.Generator, lanes: int = LANES) -> RunningLaws:
    """Return a law on a robot whose lanes begin in random states of rest."""
    count = len(robot.actuators)
    rests = [Rest(robot.random_configuration(rng), rng.normal(size=count)) for _ in range(lanes)]
    return RunningLaws(robot, KINEMATIC, law, rests)


def random_runs(laws: RunningLaws, rng: np.random.Generator, count: int) -> list[list[Sample]]:
    """Return samples of all lanes: nothing, something, or much is asked of the robot."""
    jerks = [0.0, 0.01, 0.05, 0.002]
    each = [drifting_samples(laws.dynamics, rng, count, jerk) for jerk in jerks[: len(laws.laws)]]
    return [list(samples) for samples in zip(*each, strict=True)]


def compare(laws: RunningLaws, samples: list[Sample]) -> int:
    """Compare a sample in all lanes; return how many limits bind."""
    fragment, robot, at = laws.fragment, laws.robot, laws.workspace
    laws.compiled(samples)
    unit = np.where(np.isfinite(robot.effort_limits), robot.effort_limits, 1.0)
    bound = 0
    for lane, sample in enumerate(samples):
        command, efforts = laws.python(lane, sample)
        assert at[fragment.failed][0, lane] == 0.0
        np.testing.assert_allclose(at[fragment.nu_d][:, lane], command.nu_d, rtol=0.0, atol=1e-10)
        scale = unit + np.abs(efforts.tau)
        off = np.abs(at[fragment.tau][:, lane] - efforts.tau) / scale
        assert off.max() < ROUNDING
        assert fragment.limit_names(at[fragment.limits][:, lane]) == efforts.limits
        bound += len(efforts.limits)
    return bound


@pytest.mark.parametrize(("name", "law"), cells(GRID, QUICK, SLOW))
def test_efforts_and_limits_are_those_of_python(
    name: str, law: str, rng: np.random.Generator
) -> None:
    """Limits bind, do not bind, and bind again, in lanes side by side."""
    laws = running(tight(name), LAWS[law], rng)
    bound = [compare(laws, samples) for samples in random_runs(laws, rng, COUNT)]
    if not law.startswith("paper"):
        assert sum(bound) > COUNT


def test_a_pause_teaches_the_integral_as_much_as_it_lasts(
    paper: Robot, rng: np.random.Generator
) -> None:
    laws = running(paper, IntegralDynamic(gain=150.0), rng, 3)
    for k, samples in enumerate(random_runs(laws, rng, 4)):
        for lane, elapsed in enumerate((PERIOD, 0.004, 0.05)):
            laws.workspace[laws.fragment.elapsed][0, lane] = elapsed
            if k:
                laws.laws[lane][1].sampled_after(elapsed)
        compare(laws, samples)


def test_a_search_that_does_not_end_is_told(paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the lanes where it does not, and only there."""
    monkeypatch.setattr(bounded_statements, "MAX_STEPS", 1)
    rng = np.random.default_rng(0)
    law = BoundedDynamic(0.15, joint_horizon_dyn=0.06)
    laws = running(limited(paper, effort=0.4, speed=0.5), law, rng)
    failed = []
    for samples in random_runs(laws, rng, 12):
        for buffer in laws.fragment.memory:
            laws.workspace[buffer][:] = 0.0  # from nothing: a step for each limit, and one more
        laws.compiled(samples)
        told = [laws.python(lane, s)[1].limits for lane, s in enumerate(samples)]
        counts = np.array([sum(limit.kind == "effort" for limit in limits) for limits in told])
        failed.append(laws.workspace[laws.fragment.failed][0])
        assert (failed[-1][counts > 0] == NO_EFFORTS).all()
        assert (failed[-1][[not limits for limits in told]] == 0.0).all()
    assert 0 < np.count_nonzero(failed) < np.size(failed)


def test_what_is_not_finite_is_left_to_python(paper: Robot, rng: np.random.Generator) -> None:
    laws = running(paper, IntegralDynamic(), rng, 2)
    sample = drifting_samples(laws.dynamics, rng, 1, 0.0)[0]
    far = sample._replace(nu=1e200 * np.ones(4))
    laws.compiled([sample, far])
    assert laws.workspace[laws.fragment.failed].tolist() == [[0.0, NO_COMMAND]]


def test_singular_steering_is_left_to_python(rng: np.random.Generator) -> None:
    """Both leading wheels of a swerve head across the line between them."""
    robot = rpctl.load("swerve")
    laws = running(robot, PaperDynamic(), rng, 2)
    sample = drifting_samples(laws.dynamics, rng, 1, 0.0)[0]
    first, second = robot.drive.steered
    across = np.arctan2(*np.subtract(second.pivot, first.pivot)[::-1]) + np.pi / 2.0
    angles = {s.joint: s.sign * (across - s.heading) for s in (first, second)}
    q = robot.configuration(joints=angles)
    laws.compiled([sample, sample._replace(q=q)])
    assert laws.workspace[laws.fragment.failed].tolist() == [[0.0, NO_COMMAND]]


def test_limits_have_the_names_of_their_joints() -> None:
    labels = [Limit("left", "effort"), Limit("right", "effort")]
    names = LimitNames(tuple(labels), ("slide", "left"))
    assert names(np.zeros(4)) == ()
    assert names(np.array([0.0, 1.0, 3.0, 1.0])) == (
        Limit("right", "effort"),
        Limit("slide", "upper"),
        Limit("left", "velocity"),
    )
    assert names(np.array([1.0, 0.0, 2.0, 0.0])) == (
        Limit("left", "effort"),
        Limit("slide", "lower"),
    )
