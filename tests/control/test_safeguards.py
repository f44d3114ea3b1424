"""A law and its substitute: who answers, and what the law is told of the time in between."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl import IntegralDynamic, ReducedDynamics, Robot
from rpctl.control.law import LawSample, Rest
from rpctl.control.safeguards import LawWithFallback
from rpctl.errors import RpctlError, SolverError


class Failing:
    """A law that fails at the samples it is told, and keeps the times between samples."""

    def __init__(self, *failing: int) -> None:
        self._failing, self._sample = failing, -1
        self.elapsed: list[float | None] = []

    def sampled_after(self, elapsed: float | None) -> None:
        self.elapsed.append(elapsed)

    def report(self) -> dict[str, float]:
        return {}

    def __call__(self, t: float) -> str:
        self._sample += 1
        if self._sample in self._failing:
            raise SolverError("no solution")
        return "law"


def test_a_law_is_told_the_time_only_since_an_answer_of_its_own() -> None:
    """What a substitute sent is not what its integral has to go on from."""
    law = Failing(1, 2)
    both = LawWithFallback(law, lambda t: "substitute", lambda answer: answer)
    answers = []
    for k in range(5):
        if k:
            both.sampled_after(0.01 * k)
        answers.append(both(0.1 * k, 0.1 * k))
    assert answers == ["law", "substitute", "substitute", "law", "law"]
    assert law.elapsed == [0.01, None, None, 0.04]
    assert both.failures == 2
    assert both.first is not None
    assert (both.first.t, both.first.reason) == (0.1, "no solution")


def test_a_mistake_is_raised_before_the_first_answer_and_replaced_after_it() -> None:
    def refuses(t: float) -> str:
        if t in wrong:
            raise RpctlError("it does not fit")
        return "law"

    both = LawWithFallback(refuses, lambda t: "substitute", lambda answer: answer)
    wrong = {0.0}
    with pytest.raises(RpctlError, match="does not fit"):
        both(0.0, 0.0)
    wrong = {1.0}
    assert [both(t, t) for t in (0.5, 1.0, 1.5)] == ["law", "substitute", "law"]


def test_gains_of_the_integral_stay_within_the_control_period(paper: Robot) -> None:
    """k T > 1 would overshoot in one period: of 2 ms, 500 1/s is the largest, base or joints."""
    dynamics = ReducedDynamics(paper)
    assert IntegralDynamic(500.0, joint_gain=20.0).gains(dynamics, 0.002).tolist() == [
        500.0, 500.0, 20.0, 20.0
    ]  # fmt: skip
    for law in (IntegralDynamic(501.0), IntegralDynamic(15.0, joint_gain=501.0)):
        with pytest.raises(RpctlError, match=r"gain 501 1/s is too large .* give at most 500"):
            law.gains(dynamics, 0.002)


def test_the_first_efforts_of_the_integral_hold_what_held_before(paper: Robot) -> None:
    """A robot at rest under efforts that its model has too small: the law asks for no others."""
    dynamics, q, still = ReducedDynamics(paper), paper.configuration(), np.zeros(4)
    held = dynamics.efforts(q, dynamics.bias(q, still)) + np.array([0.3, -0.2, 0.1, 0.2])
    sample = LawSample(q, still, still, still)
    law = IntegralDynamic()
    assert law.free_efforts(dynamics, 0.002, sample, Rest(q, held)) == pytest.approx(held)
    assert law.free_efforts(dynamics, 0.002, sample, None) != pytest.approx(held)
