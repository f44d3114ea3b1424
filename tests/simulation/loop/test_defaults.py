"""The laws that run where nobody names any: they keep the limits, and no joint stays behind."""

from __future__ import annotations

import pytest

from rpctl import (
    PaperDynamic,
    PaperKinematic,
    Robot,
    scale_limits,
    summarize,
    track,
)

FAR = (0.1, 0.3, 0.3)


@pytest.mark.slow
def test_from_afar_they_keep_the_limits_that_the_papers_dynamic_law_breaks(paper: Robot) -> None:
    weak = scale_limits(paper, effort=0.15)
    broken = summarize(
        track(
            weak,
            "line",
            duration=0.3,
            initial_error=FAR,
            kinematic=PaperKinematic(),
            dynamic=PaperDynamic(),
        )
    )
    kept = summarize(track(weak, "line", duration=0.3, initial_error=FAR))
    assert (broken.max_effort_ratio or 0.0) > 1.05
    assert not broken.succeeded
    assert 0.9 < (kept.max_effort_ratio or 0.0) <= 1.0
    assert kept.limits_violated == ()
    assert {bound.limit for bound in kept.limits_bound} == {"effort"}


@pytest.mark.thorough
def test_on_tiago_they_keep_every_limit_and_bring_all_joints_home(tiago: Robot) -> None:
    """From (0.1, 0.3, 0.3) on a line; and what `make demo` shows, every joint below 1 mrad."""
    line = summarize(track(tiago, "line", initial_error=FAR))
    assert line.succeeded
    assert (line.max_effort_ratio or 2.0) <= 1.0
    demo = summarize(track(tiago, "eight", initial_error=(0.1, -0.1, 0.1)))
    assert max(joint.final for joint in demo.joint_errors) < 5e-5
    assert demo.final_end_effector_error is not None
    assert demo.final_end_effector_error < 2e-5
