"""What is measured, and when: encoders, constant errors, and moments that jitter."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, Robot, RpctlError
from rpctl.simulation.plants.sensors import (
    Encoders,
    Measurement,
    sample_times,
)
from rpctl.simulation.plants.settings import SensorBias

BITS, TURN = 10, 2.0 * math.pi


def whole(steps: float) -> bool:
    return abs(steps - round(steps)) < 1e-6


def test_encoders_know_whole_steps(paper: Robot) -> None:
    """A turn by 2^bits, the slide's range by 2^bits; the base's pose is not theirs."""
    encoders, joints = Encoders(paper, BITS), paper.joint_names
    q, nu = paper.state((0.1234567, 0.2, 0.3), joints=dict(zip(joints, (0.4321, 0.2), strict=True)))
    found, rates = encoders(q, nu, 0.0)
    np.testing.assert_array_equal(found[:4], q[:4])
    assert not rates.any()
    slide = paper.description.joint[joints[1]]
    for name, quantum in zip(joints, (TURN, slide.upper - slide.lower), strict=True):
        steps = paper.joint_position(found, name) / quantum * 2**BITS
        assert whole(steps)
        away = paper.joint_position(found, name) - paper.joint_position(q, name)
        assert 0.0 < abs(away) <= 0.5 * quantum / 2**BITS + 1e-12


def test_speeds_are_those_of_the_steps_of_the_wheels(paper: Robot) -> None:
    """v = r (φ̇_l + φ̇_r)/2, ω = r (φ̇_r − φ̇_l)/(2 b), of differences of whole steps."""
    encoders, dt, r = Encoders(paper, BITS), 0.004, paper.drive.wheels[0].radius
    lefts = (0.3, 0.35, 3.13, -3.13)  # the last one passes half a turn
    rights = (0.1, 0.17, 0.2, 0.6)
    quantum, before = TURN / 2**BITS, np.zeros(2)
    for k, pair in enumerate(zip(lefts, rights, strict=True)):
        q = paper.configuration()
        for wheel, angle in zip(paper.drive.wheels, pair, strict=True):
            paper.set_joint(q, wheel.joint, angle)
        _, nu = encoders(q, np.zeros(4), k * dt)
        now = quantum * np.round(np.array(pair) / quantum)
        if k:
            moved = (now - before + math.pi) % TURN - math.pi
            left, right = moved / dt
            half_track = 0.5 * paper.drive.track
            expected = [0.5 * r * (left + right), 0.5 * r * (right - left) / half_track]
            np.testing.assert_allclose(nu[:2], expected, rtol=1e-9)
        before = now


@pytest.mark.parametrize("name", ["swerve", "omni", "car"])
def test_fine_encoders_find_the_speeds_of_any_base(name: str, rng: np.random.Generator) -> None:
    """Differences over a short time, so the error is of first order in it."""
    robot = rpctl.load(name)
    dynamics, dt = ReducedDynamics(robot), 1e-6
    q, nu = robot.configuration(), 0.5 * rng.normal(size=robot.dof)
    encoders = Encoders(robot, 32)
    encoders(q, nu, 0.0)
    import pinocchio as pin

    after = np.asarray(pin.integrate(robot.model, q, dt * dynamics.basis(q) @ nu))
    _, found = encoders(after, nu, dt)
    np.testing.assert_allclose(found, nu, atol=5e-3)


def test_constant_errors_add(paper: Robot) -> None:
    bias = SensorBias(
        position=0.01, heading=-0.02, joints=0.03, speed=-0.04, turn_rate=0.05, joint_rates=-0.06
    )
    measure = Measurement(paper, Plant(sensor_bias=bias))
    q, nu = paper.state((1.0, 2.0, 0.3), (0.4, 0.5), rates=dict.fromkeys(paper.joint_names, 0.0))
    for t in (0.0, 0.1):
        found, rates = measure(q, nu, t)
        pose = np.subtract([*found[:2], math.atan2(found[3], found[2])], [1.0, 2.0, 0.3])
        np.testing.assert_allclose(pose, [0.01, 0.01, -0.02], atol=1e-12)
        joints = paper.joint_positions(found) - paper.joint_positions(q)
        np.testing.assert_allclose(joints, 0.03, atol=1e-12)
        np.testing.assert_allclose(rates - nu, [-0.04, 0.05, -0.06, -0.06], atol=1e-12)
    assert not SensorBias()
    with pytest.raises(RpctlError, match="sensor_bias of speed is nan"):
        SensorBias(speed=math.nan)


def test_samples_jitter_in_order() -> None:
    period, count = 0.002, 5000
    plant = Plant(jitter=2e-4, seed=3)
    late = sample_times(plant, period, count) - period * np.arange(count)
    assert late[0] == 0.0
    assert late.std() == pytest.approx(2e-4, rel=0.05)
    assert abs(late.mean()) < 1e-5
    np.testing.assert_array_equal(
        sample_times(plant, period, 10), sample_times(plant, period, 20)[:10]
    )
    wild = sample_times(Plant(jitter=1.0), period, count)
    assert np.diff(wild).min() >= 0.1 * period * (1.0 - 1e-9)
    assert np.abs(wild - period * np.arange(count)).max() <= 0.45 * period * (1.0 + 1e-9)
    np.testing.assert_array_equal(sample_times(Plant(seed=9), period, 5), period * np.arange(5))


def test_bits_are_whole() -> None:
    for bits in (-1, 33, 1.5, True):
        with pytest.raises(RpctlError, match="give a whole number from 0 to 32"):
            Plant(encoder_bits=bits)  # type: ignore[arg-type]
