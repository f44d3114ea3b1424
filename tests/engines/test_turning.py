"""Turning in place by scrubbing: the track on which a skid-steer base seems to run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rpctl
from rpctl.engines.mujoco.engine import MujocoSimulator
from rpctl.engines.referee import Referee
from rpctl.engines.turning import (
    Turn,
    TurnVerdict,
    _measured,
    scrubbing_track,
    wheel_places,
)

W, L = 0.64, 0.54  # m, track and wheelbase of urdf/skid_steer.urdf
CORNERS = 0.5 * np.array([(L, W), (L, -W), (-L, W), (-L, -W)])
EVEN = (1.0, 1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("load", "track"),
    [
        (EVEN, W + L**2 / W),
        ((2.0, 1.0, 1.0, 2.0), W + L**2 / W),  # rocking on a diagonal changes nothing
        ((1.0, 1.0, 0.0, 0.0), W),  # it stands on one axle, and rolls
    ],
)
def test_a_base_scrubs_on_the_track_of_paper_and_pencil(
    load: tuple[float, ...], track: float
) -> None:
    assert scrubbing_track(CORNERS, load) == pytest.approx(track, rel=1e-6)
    moved = CORNERS + np.array([0.3, 0.0])  # P lies elsewhere: the same base
    assert scrubbing_track(moved, load) == pytest.approx(track, rel=1e-6)


def test_forces_balance_on_the_scrubbing_track_of_uneven_loads() -> None:
    load, b, a = np.array([3.0, 3.0, 2.0, 2.0]), 0.5 * W, 0.5 * L
    omega = 2.0 / scrubbing_track(CORNERS, load)
    ahead = 1.0 - b * omega  # m/s that wheels slip along themselves; forces are N u/|u|
    sideways = [(load[0], x) for x in np.linspace(-a, a, 2001)]
    # The centre of rotation x ahead of the middle, where the axles' side forces cancel.
    lateral = [
        load[0] * (a - x) / np.hypot(ahead, (a - x) * omega)
        - load[2] * (a + x) / np.hypot(ahead, (a + x) * omega)
        for _, x in sideways
    ]
    x = sideways[int(np.abs(lateral).argmin())][1]
    drive, resist = 0.0, 0.0
    for weight, arm in ((load[0], a - x), (load[2], a + x)):
        slip = np.hypot(ahead, arm * omega)
        drive += weight * b * ahead / slip
        resist += weight * arm * arm * omega / slip
    assert x > 0.01 and drive == pytest.approx(resist, rel=1e-2)


def test_a_turn_is_measured_by_its_heading_and_its_rims() -> None:
    t, side = 0.002 * np.arange(500), np.array([1.0, -1.0])
    rims = 0.2 * np.stack([-np.ones_like(t), np.ones_like(t)], axis=1)
    loads = np.stack([10.0 + 3.0 * np.sign(np.sin(40.0 * np.pi * t + 0.1)), 20.0 + 0.0 * t], axis=1)
    heading = (3.0 + 0.5 * t + np.pi) % (2.0 * np.pi) - np.pi
    turn = _measured(np.column_stack([heading, rims, loads]), side, 0.002, 0.25)
    assert turn.track == pytest.approx(0.8) and turn.off == pytest.approx(0.2)
    assert turn.swing == pytest.approx(0.3, rel=2e-2)
    np.testing.assert_allclose(turn.load, [10.0, 20.0], rtol=2e-2)


def verdict_of(default: float, mended: float, declared: float, swing: float = 0.0) -> TurnVerdict:
    hopping = Turn(default, np.ones(4), swing, 0.0)
    return TurnVerdict(hopping, Turn(mended, np.ones(4), 0.0, 0.0), declared, 1.1, "mend it")


def test_the_line_tells_the_tracks_and_what_to_declare() -> None:
    said = verdict_of(2.9, 1.1, 0.64, swing=0.4).line("E 1")
    assert "track of 2.90 m and its wheels hop; once corrected, as on a track of 1.10 m" in said
    assert "0.64 m, declared; from the wheels' positions: 1.10 m): mend it; declare" in said
    assert said.endswith("[drive] track = 1.1")
    assert "mend it" not in verdict_of(1.1, 1.1, 0.64).line("E 1")
    assert "declare [" not in verdict_of(2.9, 1.1, 1.1).line("E 1")
    assert "does not turn" in verdict_of(np.inf, 1.1, 1.1).line("E 1")
    assert verdict_of(2.9, 1.2, 0.64).line("E 1") == ""  # nothing explains it: nothing is said
    turn = verdict_of(2.9, 1.1, 0.64)
    assert turn.agrees and not replace(turn, mended=replace(turn.mended, off=0.1)).agrees


@pytest.mark.slow
def test_mujoco_turns_a_skid_steer_base_as_its_wheels_places_say_once_wheels_stay_down() -> None:
    robot = rpctl.load("skid_steer")
    np.testing.assert_allclose(np.sort(wheel_places(robot), 0), np.sort(CORNERS, 0), atol=1e-9)
    verdict = Referee(robot, duration=0.6).judge(MujocoSimulator())
    turn = verdict.turn
    assert turn is not None and turn.agrees and turn.default is not None
    assert turn.declared == pytest.approx(W)
    assert turn.mended.track == pytest.approx(W + L**2 / W, rel=5e-3)
    assert turn.mended.swing < 0.02 and turn.mended.off < 0.01
    assert turn.default.track > 2.0 * turn.own and turn.default.swing > 0.3
