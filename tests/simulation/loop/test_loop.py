"""The closed loop on whole robots: it tracks, conserves, and says when it diverges."""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import (
    PaperDynamic,
    PaperKinematic,
    ReducedDynamics,
    Robot,
    RpctlError,
    Run,
    summarize,
    track,
)
from rpctl.arrays import Array
from rpctl.control.law import (
    Command,
    DynamicFunction,
    Efforts,
    Rest,
)
from rpctl.errors import DivergedError
from rpctl.reference.load import load_reference
from rpctl.reference.named import reference_by_name
from rpctl.simulation.loop.track import default_duration
from tests.grids import cells

OFF = (0.1, -0.1, 0.1)
COARSE: dict[str, Any] = {
    "control_period": 0.01,
    "plant_step": 0.01,
}  # s; where no rounding is looked for
TURNS = list(product(("paper", "mixed_chain", "tiago_dual"), ("circle", "spin", "eight")))
TURNS_IN_CI = {("paper", "spin")}
PATHS = ("line", "reverse", "spin", "circle", "eight")


@pytest.fixture(scope="module")
def eight(mixed_chain: Robot) -> Run:
    return track(mixed_chain, "eight", duration=14.0, initial_error=OFF, collisions=False)


def test_it_ends_within_a_millimetre(eight: Run) -> None:
    figures = summarize(eight)
    assert figures.settled_base_error < 1e-3
    assert (figures.settled_end_effector_error or np.inf) < 2e-3
    assert figures.final_base_error < 1e-3
    assert not figures.limits_violated


@pytest.mark.slow
def test_energy_and_constraints_hold(eight: Run) -> None:
    """A step with losses is of second order, one without is of fourth."""
    figures = summarize(eight)
    assert figures.energy_residual < 1e-5
    assert figures.constraint_residual < 1e-12
    ideal = summarize(
        track(rpctl.load("paper", losses=False), "eight", duration=0.2, initial_error=OFF)
    )
    assert ideal.energy_residual < 1e-8


def test_it_starts_where_it_was_told(eight: Run) -> None:
    np.testing.assert_allclose(eight.log.e[0, :3], OFF, atol=1e-12)
    assert not eight.nu[0].any()
    # The world's view: the reference is ahead, to the right and turned to the left of the robot.
    x, y, heading = eight.log.base[0]
    ahead = eight.base_ref[0, :2] - [x, y]
    seen = [
        ahead @ [math.cos(heading), math.sin(heading)],
        ahead @ [-math.sin(heading), math.cos(heading)],
    ]
    np.testing.assert_allclose(seen, OFF[:2], atol=1e-12)


def test_the_log_is_of_one_motion(eight: Run, mixed_chain: Robot) -> None:
    """Base, joints and end effector are q's; ν is the base's and the joints' rate."""
    data = mixed_chain.model.createData()
    for k in (0, 1234, len(eight.t) - 1):
        np.testing.assert_allclose(eight.log.joints[k], mixed_chain.joint_positions(eight.q[k]))
        np.testing.assert_allclose(
            np.exp(1j * eight.log.base[k, 2]), np.exp(1j * mixed_chain.base_pose(eight.q[k])[2])
        )
        pose = mixed_chain.end_effector_pose(data, eight.q[k])
        np.testing.assert_allclose(eight.log.ee[k], pose.translation)
    period = eight.t[1] - eight.t[0]
    rates = (eight.log.joints[2:] - eight.log.joints[:-2]) / (2 * period)
    np.testing.assert_allclose(rates, eight.nu[1:-1, 2:], atol=5e-4)
    forward = np.hypot(*np.gradient(eight.log.base[:, :2], period, axis=0)[1:-1].T)
    np.testing.assert_allclose(forward, np.abs(eight.nu[1:-1, 0]), atol=1e-3)


def test_friction_is_kept_and_scales_the_grip(paper: Robot) -> None:
    low, high = (
        track(paper, "circle", duration=0.5, initial_error=OFF, friction=f) for f in (0.35, 0.7)
    )
    assert low.ground.friction == 0.35
    np.testing.assert_allclose(low.log.slip_ratio, 2.0 * high.log.slip_ratio, rtol=1e-12)
    with pytest.raises(RpctlError, match="friction is 0; give a positive number"):
        track(paper, "circle", duration=0.5, friction=0.0)


@pytest.mark.parametrize(("name", "reference"), cells(TURNS, slow=TURNS_IN_CI))
def test_robots_track_where_the_base_turns(name: str, reference: str) -> None:
    run = track(
        rpctl.load(name),
        reference,
        duration=12.0,
        initial_error=OFF,
        **COARSE,
    )
    figures = summarize(run)
    assert figures.final_base_error < 0.03 * figures.rms_base_error + 1e-3
    assert (figures.final_end_effector_error or np.inf) < 0.01


@pytest.mark.parametrize("reference", cells(("line", "reverse"), slow={"line"}))
def test_the_papers_law_keeps_the_lateral_error_of_a_line(paper: Robot, reference: str) -> None:
    figures = summarize(
        track(
            paper,
            reference,
            duration=10.0,
            initial_error=(0.0, 0.2, 0.0),
            kinematic=PaperKinematic(),
        )
    )
    assert figures.final_lateral_error == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize("reference", cells(PATHS, slow={"line"}))
def test_the_default_law_beats_the_papers_on_every_reference(paper: Robot, reference: str) -> None:
    """A smaller error from the same start, the lateral one of a line gone, no limit broken."""
    ours, theirs = (
        summarize(
            track(
                paper,
                reference,
                duration=15.0,
                initial_error=(0.3, 0.5, 0.8),
                kinematic=law,
                **COARSE,
            )
        )
        for law in (None, PaperKinematic())
    )
    assert ours.rms_base_error < theirs.rms_base_error
    assert ours.final_lateral_error < 2e-3
    assert not ours.limits_violated


def test_a_reference_with_an_end_is_tracked_to_it(paper: Robot, tmp_path: Path) -> None:
    path = tmp_path / "way.toml"
    path.write_text("waypoints = [[0, 0, 0], [1, 0.3], [2, 0]]")
    run = track(paper, str(path), **COARSE)
    assert 5.0 < run.t[-1] < 9.0
    np.testing.assert_allclose(run.log.base[-1, :2], [2.0, 0.0], atol=1e-3)
    assert run.config.run.reference == str(path)


@pytest.mark.parametrize(
    ("asked", "ends"), [(0.0215, 0.02), (0.0199, 0.018), (0.02, 0.02), (0.001, 0.002)]
)
def test_a_run_ends_with_the_last_whole_period(paper: Robot, asked: float, ends: float) -> None:
    run = track(paper, "eight", duration=asked)
    assert run.t[-1] == run.config.run.duration == pytest.approx(ends)
    assert summarize(run).duration == run.t[-1]
    message = (
        f"a duration of {asked:g} s is not a whole number of control periods of 0.002 s: the run "
        f"ends at {ends:g} s",
    )
    assert run.notes == (() if asked == ends else message)


def test_a_duration_that_nobody_asked_for_says_nothing(paper: Robot, tmp_path: Path) -> None:
    path = tmp_path / "way.toml"
    path.write_text("waypoints = [[0, 0, 0], [0.1, 0]]")
    run = track(paper, str(path), control_period=0.05, plant_step=0.05)
    lasts = default_duration(load_reference(paper, str(path)))
    assert run.notes == ()
    assert lasts - 0.05 < run.t[-1] <= lasts
    assert run.t[-1] == run.config.run.duration


@pytest.mark.slow
def test_a_fixed_base_moves_its_arm_only() -> None:
    panda = rpctl.load("panda")
    run = track(panda, "eight", duration=0.2)
    assert not np.abs(run.log.e[:, :3]).any()
    assert (summarize(run).final_end_effector_error or np.inf) < 2e-3
    with pytest.raises(RpctlError, match="fixed base"):
        track(panda, "eight", duration=3.0, initial_error=OFF)


@pytest.mark.slow
def test_the_feedforward_is_what_makes_it_exact(paper: Robot) -> None:
    """Without ν̇_d the same loop is far worse: the derivative is not decoration."""

    def without(law: DynamicFunction = PaperDynamic()) -> DynamicFunction:  # noqa: B008
        def efforts(
            dynamics: ReducedDynamics, q: Array, nu: Array, command: Command
        ) -> Efforts | Array:
            still = Command(command.nu_d, np.zeros_like(command.nu_d))
            return law(dynamics, q, nu, still)

        return efforts

    best = summarize(track(paper, "eight", duration=3.0)).rms_base_error
    worse = summarize(track(paper, "eight", duration=3.0, dynamic=without())).rms_base_error
    assert worse > 100 * best


def test_a_law_of_ones_own_may_remember(paper: Robot) -> None:
    """Settings with ``start`` give each run a law of its own; it is told the control period."""
    periods = []

    class Counting:
        def start(
            self, dynamics: ReducedDynamics, control_period: float, rest: Rest | None = None
        ) -> Any:
            periods.append(control_period)
            calls = iter(range(1000))

            def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
                return np.full(len(dynamics.robot.actuators), float(next(calls)))

            return law

    class Following:
        def start(self, *arguments: Any) -> Any:
            periods.append(arguments[1])
            return lambda *sample: PaperKinematic()(*sample)

    law = Counting()
    for _ in range(2):
        run = track(paper, "eight", duration=0.02, dynamic=law, control_period=0.004)
        assert run.tau[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert periods == [0.004, 0.004]
    assert track(paper, "eight", duration=0.02, kinematic=Following()).kinematic_report == {}
    assert periods[2:] == [0.002]


def test_a_reference_is_called_what_it_is(paper: Robot) -> None:
    circle = reference_by_name(paper, "circle")
    assert track(paper, "circle", duration=0.01).config.run.reference == "circle"
    assert track(paper, circle, duration=0.01).config.run.reference == type(circle).__name__
    assert track(paper, circle, duration=0.01, name="a turn").config.run.reference == "a turn"


def test_past_the_sampled_limit_it_diverges(paper: Robot) -> None:
    laws = PaperKinematic(0.2), PaperDynamic(0.05)
    with pytest.raises(DivergedError, match="diverged"):
        track(
            paper,
            "eight",
            duration=60.0,
            initial_error=OFF,
            kinematic=laws[0],
            dynamic=laws[1],
            control_period=0.15,
            plant_step=0.01,
        )


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"duration": 0.0}, "duration is 0; give a positive number"),
        ({"control_period": -1.0}, "control_period is -1"),
        ({"plant_step": math.nan}, "plant_step is nan"),
        ({"initial_error": (0.1, math.inf, 0.0)}, "initial_error is inf; give numbers from"),
        ({"initial_error": (0.1,)}, "three finite numbers"),
        ({"reference": "square"}, "reference 'square' is not known"),
    ],
)
def test_wrong_settings_are_told(paper: Robot, wrong: dict[str, object], message: str) -> None:
    with pytest.raises(RpctlError, match=message):
        track(paper, **wrong)  # type: ignore[arg-type]
