"""The plant's steps, the loop's clock, and what holds a robot before the first efforts arrive."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
import pytest

from rpctl import Plant, Robot, track
from rpctl.arrays import Array
from rpctl.dynamics.motion import Step
from rpctl.errors import DivergedError
from rpctl.reference.motion import ReferenceState
from rpctl.simulation.loop.track import default_duration
from rpctl.simulation.plants.rolling import in_steps


@pytest.mark.parametrize(
    ("duration", "longest", "steps"),
    [(0.005, 0.002, 3), (0.004, 0.002, 2), (0.006, 0.002, 3), (0.001, 0.002, 1), (0.3, 0.1, 3)],
)
def test_steps_are_equal_and_no_longer_than_the_longest(
    duration: float, longest: float, steps: int
) -> None:
    """0.3 is a hair more than three times 0.1: that hair takes no step of its own."""
    taken: list[float] = []

    def step(q: Array, nu: Array, dt: float) -> Step:
        taken.append(dt)
        return Step(q + 1.0, nu + 2.0, 0.5, 0.25)

    done = in_steps(step, np.zeros(4), np.zeros(4), duration, longest)
    assert taken == [duration / steps] * steps
    assert (done.work, done.lost) == (0.5 * steps, 0.25 * steps)
    np.testing.assert_array_equal([done.q, done.nu], [[steps] * 4, [2 * steps] * 4])


@pytest.mark.parametrize("bad", ["q", "nu"])
def test_a_state_that_is_not_finite_has_diverged(bad: str) -> None:
    found = {"q": np.zeros(4), "nu": np.zeros(4)} | {bad: np.array([0.0, np.inf, 0.0, 0.0])}
    end = Step(found["q"], found["nu"], 0.0, 0.0)
    with pytest.raises(DivergedError, match="the motion diverged; shorten the control period"):
        in_steps(lambda *_: end, np.zeros(4), np.zeros(4), 0.1, 0.1)


def test_what_holds_it_holds_against_a_bias(paper: Robot) -> None:
    """Until the first efforts arrive nothing moves, whatever pushes besides."""
    settings = Plant(tau_bias={"wheel_left_joint": 3.0}, delay=0.02)
    run = track(paper, "eight", duration=0.03, initial_error=(0.1, -0.1, 0.1), plant=settings)
    assert np.abs(run.nu[:11]).max() < 1e-12
    assert np.abs(run.nu[11]).max() > 1e-4
    np.testing.assert_allclose(run.tau[:10, 0], -3.0, atol=1e-12)


def test_how_long_a_reference_is_tracked() -> None:
    """A second longer than it moves; without an end 20 s."""
    assert default_duration(SimpleNamespace(duration=3.5)) == 4.5  # type: ignore[arg-type]
    assert default_duration(lambda t: ReferenceState(*np.zeros((3, 3)), *np.zeros((3, 0)))) == 20.0


def test_what_watches_is_not_the_simulations_time(paper: Robot) -> None:
    nap, began = 0.02, time.perf_counter()
    run = track(paper, "eight", duration=0.02, watch=lambda *_: time.sleep(nap))
    elapsed = time.perf_counter() - began
    assert 0.0 < run.wall_time < elapsed - nap * len(run.t)
