"""TIAGo on the eight in MuJoCo, its wheels 3 cm wide, friction .7: what the default laws leave.

Their gains withstand 50 ms of delay; with those of 10 ms the base was 2 mm off, not 4.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rpctl
from rpctl import Plant, Robot
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.robot.variation import CarriedLoad
from rpctl.robot.vary import without_losses
from rpctl.simulation.config import Config, RunSettings

pytest.importorskip("mujoco")
CONTACT = Plant(kind="contact", contact=ContactSettings(wheel_width=0.03))


def settled(
    robot: Robot, plant: Plant, duration: float = 20.0, delay: float | None = None
) -> tuple[float, float]:
    """Return the rms errors of base and end effector over the second half of a run, mm."""
    config = Config(run=RunSettings(delay=delay))
    log = rpctl.track(robot, "eight", config, duration=duration, plant=plant, collisions=False).log
    half = slice(len(log.t) // 2, None)
    base = np.hypot(*log.e[half, :2].T)
    tip = np.linalg.norm(log.ee[half] - log.ee_ref[half], axis=1)
    return 1e3 * float(np.sqrt(np.mean(base**2))), 1e3 * float(np.sqrt(np.mean(tip**2)))


@pytest.mark.thorough
def test_without_losses(tiago: Robot) -> None:
    base, tip = settled(without_losses(tiago), CONTACT)
    assert 0.5 < base < 6.0  # an ideal plant leaves .01: contact it is
    assert tip < 6.0


@pytest.mark.thorough
@pytest.mark.parametrize("known", [True, False])
def test_with_the_losses_of_the_file(tiago: Robot, known: bool) -> None:
    model = None if known else without_losses(tiago)
    base, tip = settled(tiago, replace(CONTACT, controller_model=model), 8.0)
    assert base < 6.0
    # Friction that nobody tells stands against stiffness, which falls with the bandwidth's square.
    assert tip < (8.0 if known else 35.0)


@pytest.mark.slow
def test_a_delay_that_is_told_to_be_none_makes_joints_stiff(tiago: Robot) -> None:
    """Friction that nobody tells leaves 9 mm; with gains for 50 ms that nobody tells, 28."""
    plant = replace(CONTACT, controller_model=without_losses(tiago))
    base, tip = settled(tiago, plant, 8.0, delay=0.0)
    assert base < 6.0
    assert tip < 12.0


@pytest.mark.thorough
def test_with_a_payload_of_a_kilogram_that_the_controller_does_not_know(tiago: Robot) -> None:
    base, tip = settled(tiago, replace(CONTACT, payload=CarriedLoad(mass=1.0)))
    assert base < 10.0
    assert tip < 10.0


@pytest.mark.thorough
def test_a_minute_without_drift(tiago: Robot) -> None:
    """The last quarter of the minute is no worse than the third, by more than the path's own."""
    run = rpctl.track(tiago, "eight", duration=60.0, plant=CONTACT, collisions=False)
    error = np.hypot(*run.log.e[:, :2].T)
    third, last = (error[(run.t >= a) & (run.t < a + 15.0)] for a in (30.0, 45.0))
    assert np.sqrt(np.mean(last**2)) < 1.25 * np.sqrt(np.mean(third**2))
    assert np.sqrt(np.mean(last**2)) < 6e-3
