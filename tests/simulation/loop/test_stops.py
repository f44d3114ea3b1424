"""Runs of robots that sink onto their stops, and motors that are too weak."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpctl import Plant, Run, summarize, track
from rpctl.errors import RpctlError
from rpctl.reference.motion import ReferenceState
from tests.mechanisms import load_lift


def aloft(t: float) -> ReferenceState:
    """Return the lift's reference: it stays 0.3 m up."""
    still = np.zeros(3)
    return ReferenceState(still, still, still, np.array([0.3]), np.zeros(1), np.zeros(1))


def sunk(folder: Path, **settings: Any) -> Run:
    """Return a run of 0.4 s of the lift, whose 20 N have 58.86 N to hold."""
    lift = load_lift(folder)
    return track(lift, aloft, duration=0.4, allow_sag=True, **settings)


def test_a_motor_that_gravity_overcomes_is_refused(tmp_path: Path) -> None:
    told = r"gravity where the reference starts .* lift: 58\.9 of 20 N; .* --allow-sag"
    with pytest.raises(RpctlError, match=told):
        track(load_lift(tmp_path), aloft, duration=0.1)
    assert track(load_lift(tmp_path, 60.0), aloft, duration=0.01).t[-1] == pytest.approx(0.01)


def test_a_lift_sinks_to_its_stop_and_no_further(tmp_path: Path) -> None:
    """With 20 N up it falls at (58.86 − 20)/6 = 6.477 m/s², so .3 m in .3044 s.

    Its motor takes 20 · .3 = 6 J out of m g h = 17.658 J, the impact the rest.
    """
    run = sunk(tmp_path, backend="pinocchio")
    height = run.log.joints[:, 0]
    assert height.min() == 0.0
    assert run.t[int(np.argmax(height == 0.0))] == pytest.approx(0.3044, abs=0.002)
    found = summarize(run)
    assert (found.outcome, found.limits_violated) == ("cannot-hold", ())
    (joint,) = found.joint_errors
    assert joint.largest == pytest.approx(0.3)
    # It meets the stop at √(2 · 6.477 · .3) = 1.971 m/s, of 2 m/s.
    assert joint.speed_ratio == pytest.approx(1.971 / 2.0, abs=0.007)
    assert np.abs(run.tau).max() <= 20.0 + 1e-9  # the stop's reaction is no effort
    assert found.work == pytest.approx(-6.0, abs=0.2)  # the law is late by a sample or two
    assert found.lost == pytest.approx(17.658 + found.work, rel=1e-9)
    assert found.energy_residual < 1e-9


def test_machine_code_stops_where_python_does(tmp_path: Path) -> None:
    plant = Plant(masses={"*": 1.1}, joint_friction={"lift": 1.0})
    runs = [sunk(tmp_path, plant=plant, backend=name) for name in ("compiled", "pinocchio")]
    assert runs[0].notes == runs[1].notes  # none says that the loop was closed in Python
    for name in ("q", "nu", "tau", "work", "lost"):
        one, other = (getattr(run.log, name) for run in runs)
        np.testing.assert_allclose(one, other, atol=1e-10)
    assert (runs[0].log.joints[-20:] == 0.0).all()
