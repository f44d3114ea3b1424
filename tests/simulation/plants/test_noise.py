"""Noise of what is measured: its stream, its size, and that only the controller sees it."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

import rpctl
from rpctl import PaperDynamic, Plant, ReducedDynamics, Robot, RpctlError, summarize, track
from rpctl.arrays import Array
from rpctl.control.law import Command
from rpctl.simulation.plants.sensors import BLOCK, Measurement, Sensors, random_stream
from rpctl.simulation.plants.settings import Noise

ALL = Noise(position=0.01, heading=0.02, joints=0.03, speed=0.04, turn_rate=0.05, joint_rates=0.06)


def test_a_stream_is_the_same_in_any_blocks() -> None:
    whole = random_stream(7).standard_normal((9, 5))
    stream = random_stream(7)
    parts = [stream.standard_normal((count, 5)) for count in (2, 1, 6)]
    assert np.array_equal(whole, np.vstack(parts))
    assert not np.array_equal(whole, random_stream(8).standard_normal((9, 5)))


def test_samples_follow_the_stream_across_blocks(paper: Robot) -> None:
    measure, sensors = Measurement(paper, Plant(noise=ALL, seed=3)), Sensors(paper)
    q, nu = paper.state((1.0, 2.0, 0.3), (0.4, 0.5), rates=dict.fromkeys(paper.joint_names, 0.0))
    rows = random_stream(3).standard_normal((BLOCK + 2, sensors.width)) * sensors.row(ALL)
    for _ in rows:
        found = measure(q, nu, 0.0)
    expected = sensors.measured(q, nu, rows[-1])
    assert [each.tolist() for each in found] == [each.tolist() for each in expected]


def test_each_quantity_has_its_deviation(paper: Robot) -> None:
    """x, y, heading, a joint that turns and one that slides, v, ω and two rates."""
    measure, count = Measurement(paper, Plant(noise=ALL, seed=1)), 4000
    rates = dict.fromkeys(paper.joint_names, 0.0)
    q, nu = paper.state(
        (1.0, -2.0, 3.1), (0.4, -0.5), joints={paper.joint_names[0]: 0.6}, rates=rates
    )
    states = [measure(q, nu, 0.0) for _ in range(count)]
    poses = [paper.base_pose(each) for each, _ in states]
    turned = [np.angle(np.exp(1j * (pose[2] - 3.1))) for pose in poses]
    joints = [paper.joint_positions(each) for each, _ in states]
    found = np.column_stack(
        [np.array([each[:2] for each, _ in states]), turned, joints, [each for _, each in states]]
    )
    expected = [0.01, 0.01, 0.02, 0.03, 0.03, 0.04, 0.05, 0.06, 0.06]
    np.testing.assert_allclose(found.std(axis=0), expected, rtol=0.05)
    truth = [1.0, -2.0, 0.0, 0.6, paper.joint_positions(q)[1], 0.4, -0.5, 0.0, 0.0]
    np.testing.assert_allclose(found.mean(axis=0), truth, atol=4 * 0.06 / np.sqrt(count))
    assert np.abs(np.corrcoef(found.T) - np.eye(9)).max() < 0.07


def test_what_one_is_drawn_from_is_not_the_others_affair(paper: Robot) -> None:
    q, nu = paper.state(twist=(0.0, 0.0), rates=dict.fromkeys(paper.joint_names, 0.0))
    one, two = (
        Measurement(paper, Plant(noise=noise, seed=3))(q, nu, 0.0)
        for noise in (ALL, Noise(joint_rates=0.06))
    )
    assert np.array_equal(one[1][2:], two[1][2:])
    assert np.array_equal(two[1][:2], nu[:2])
    assert np.array_equal(two[0], q)


@pytest.mark.parametrize("name", ["swerve", "omni"])
def test_symbols_say_the_same(name: str, rng: np.random.Generator) -> None:
    robot = rpctl.load(name)
    sensors = Sensors(robot)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    row = rng.normal(size=sensors.width)
    symbols = [
        casadi.SX.sym(x, n)
        for x, n in zip("abc", (robot.nq, robot.dof, sensors.width), strict=True)
    ]
    function = casadi.Function("f", symbols, sensors.symbolic(*symbols))
    for ours, other in zip(sensors.measured(q, nu, row), function(q, nu, row), strict=True):
        np.testing.assert_allclose(ours, other.full().ravel(), rtol=1e-14, atol=1e-14)
    steered = [swivel.joint for swivel in robot.drive.steered]
    moved = {n: robot.joint_position(sensors.measured(q, nu, row)[0], n) for n in steered}
    assert all(moved[n] != robot.joint_position(q, n) for n in steered)


def test_a_fixed_base_knows_where_it_stands() -> None:
    robot = rpctl.load("arm")
    q, nu = robot.state()
    found, _ = Measurement(robot, Plant(noise=ALL))(q, nu, 0.0)
    assert np.array_equal(found[:4], q[:4])
    assert (found[4:] != q[4:]).all()


def test_only_the_controller_sees_it(paper: Robot) -> None:
    """Errors and energy are of the true state; the law computes at the measured one."""
    seen: list[Array] = []

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        seen.append(np.concatenate([q, nu]))
        return PaperDynamic()(dynamics, q, nu, command)

    noise = Noise(position=0.001, speed=0.001)
    plant = Plant(noise=noise, seed=4)
    run = track(
        paper,
        "eight",
        duration=0.05,
        initial_error=(0.1, 0.0, 0.0),
        dynamic=law,
        plant=plant,
        collisions=False,
    )
    sensors = Sensors(paper)
    rows = random_stream(4).standard_normal((len(run.t), sensors.width)) * sensors.row(noise)
    for k, sample in enumerate(seen):
        expected = np.concatenate(sensors.measured(run.q[k], run.nu[k], rows[k]))
        np.testing.assert_array_equal(sample, expected)
    assert len(seen) == len(run.t)
    assert run.log.e[0, 0] == pytest.approx(0.1)
    assert summarize(run).energy_residual < 1e-6
    assert not summarize(run).nominal


def test_a_deviation_is_not_negative() -> None:
    with pytest.raises(RpctlError, match="noise of heading is -1; give a deviation of 0 or more"):
        Noise(heading=-1.0)
    with pytest.raises(RpctlError, match="seed is -1; give a whole number"):
        Plant(seed=-1)
