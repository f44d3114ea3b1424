"""What actuators exert of what they are commanded: saturation, lag and backlash."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, Robot, RpctlError
from rpctl.arrays import Array
from rpctl.errors import UnknownNameError
from rpctl.simulation.plants.actuators import Actuators, Backlash, rotor_inertias
from tests.robots import SET_A, platform, write

STILL = SimpleNamespace(q=np.zeros(8), nu=np.zeros(4))
PERIOD = 0.002


def test_they_saturate_at_their_share_of_the_limits(paper: Robot) -> None:
    actuators = Actuators(paper, Plant(effort=0.5), PERIOD, 9.0 * paper.effort_limits)
    for scale, expected in ((2.0, 0.5), (-0.7, -0.5), (0.3, 0.3)):
        ((_, tau),) = actuators.true_efforts(scale * paper.effort_limits, STILL, PERIOD)
        np.testing.assert_allclose(tau, expected * paper.effort_limits)
        np.testing.assert_allclose(actuators.at(scale * paper.effort_limits), tau)


def test_a_lag_s_step_response(paper: Robot) -> None:
    """u = c + (u0 - c) exp(-t/T), and its impulse, c t - (c - u0) T (1 - exp(-t/T))."""
    lag, command, start = 0.007, np.array([3.0, -2.0, 1.0, 0.5]), np.array([1.0, 0.0, -1.0, 0.0])
    actuators = Actuators(paper, Plant(effort_lag=lag), PERIOD, start)
    np.testing.assert_array_equal(actuators.at(command), start)
    t, impulse = 0.0, np.zeros(4)
    for duration in (PERIOD, PERIOD, 0.3 * PERIOD):
        for piece, tau in actuators.true_efforts(command, STILL, duration):
            t, impulse = t + piece, impulse + piece * tau
    assert t == pytest.approx(2.3 * PERIOD)
    left = math.exp(-t / lag)
    np.testing.assert_allclose(actuators.at(command), command + left * (start - command))
    expected = command * t - (command - start) * lag * (1.0 - left)
    np.testing.assert_allclose(impulse, expected, rtol=1e-12)


class Gap:
    """One of the platform's wheels behind a gap, its rates given."""

    def __init__(self, folder: Path, width: float, rest: float = 0.0) -> None:
        robot = rpctl.load(write(folder, platform(SET_A)))
        self.dynamics = ReducedDynamics(robot)
        self.q = robot.configuration()
        self.rotors = rotor_inertias(self.dynamics, self.q)
        widths, efforts = np.array([width, 0.0]), np.array([rest, 0.0])
        self.gap = Backlash(self.dynamics, widths, self.rotors, efforts)

    def push(self, tau: float, rate: float = 0.0, dt: float = 1e-4) -> Array:
        """Return what comes through while the base drives so that the wheels turn at a rate."""
        nu = np.array([SET_A["r"] * rate, 0.0])
        return self.gap.transmit(np.array([tau, tau]), self.q, nu, dt)


def test_the_rotor_crosses_the_gap_alone(tmp_path: Path) -> None:
    """From one end to the other it takes √(2 b J/τ); the joint gets nothing meanwhile."""
    width, tau, dt = 0.02, 0.3, 1e-4
    gap = Gap(tmp_path, width, rest=-1.0)
    expected = math.sqrt(2.0 * width * gap.rotors[0] / tau)
    steps = 0
    while not (found := gap.push(tau, dt=dt))[0]:
        assert found[1] == tau  # the other wheel has no gap
        steps += 1
    assert steps * dt == pytest.approx(expected, rel=0.02)
    # Its momentum then reaches the joint, and what it is pushed with comes through from now on.
    speed = math.sqrt(2.0 * width * tau / gap.rotors[0])
    impulse = dt * (found[0] + gap.push(tau, dt=dt)[0])
    assert impulse == pytest.approx(gap.rotors[0] * speed, rel=0.02)
    assert gap.push(tau)[0] == pytest.approx(tau, rel=1e-9)
    assert gap.gap.offset[0] == pytest.approx(0.5 * width)


def test_a_rotor_that_pushes_takes_part_in_the_acceleration(tmp_path: Path) -> None:
    """τ − J α; where the joint runs away from it, nothing, and at the other end it is dragged."""
    gap, dt, alpha = Gap(tmp_path, 0.02, rest=1.0), 1e-3, 5.0
    assert gap.push(1.0, dt=dt)[0] == pytest.approx(1.0)
    found = [gap.push(1.0, alpha * dt * k, dt)[0] for k in range(1, 4)]
    np.testing.assert_allclose(found, 1.0 - gap.rotors[0] * alpha)
    assert gap.push(1.0, 8.0, dt)[0] == 0.0
    assert gap.push(1.0, 100.0, dt)[0] < 0.0
    assert gap.gap.offset[0] == pytest.approx(-0.01)


def test_rotors_weigh_a_share_of_what_they_move(tmp_path: Path) -> None:
    """Of one wheel of two that a force pushes: 1/J = r²(1/M_v... + b²/J_w...)/4 of the platform."""
    gap = Gap(tmp_path, 0.01)
    M = gap.dynamics.inertia(gap.q)
    r, b = SET_A["r"], SET_A["b"]
    row = np.array([1.0 / r, -b / r])  # of the left wheel's effort on v and ω
    expected = 0.1 / (row @ np.linalg.solve(M, row))
    np.testing.assert_allclose(gap.rotors, [expected, expected], rtol=1e-9)


def test_a_gap_is_of_an_actuator(paper: Robot) -> None:
    with pytest.raises(UnknownNameError, match="actuator 'elbow' is not known"):
        Actuators(paper, Plant(backlash={"elbow": 0.01}), PERIOD, np.zeros(4))
    with pytest.raises(RpctlError, match="backlash of a is -1; give 0 or more"):
        Plant(backlash={"a": -1.0})
    for name in ("effort_lag", "losses", "jitter"):
        with pytest.raises(RpctlError, match=f"{name} is -1; give 0 or more"):
            Plant(**{name: -1.0})  # type: ignore[arg-type]
    with pytest.raises(RpctlError, match="effort is 0; give a positive"):
        Plant(effort=0.0)
