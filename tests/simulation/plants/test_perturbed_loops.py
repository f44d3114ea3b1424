"""Closed loops whose plants differ from what their controllers know."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Plant, Robot, RpctlError, summarize, track
from rpctl.arrays import Array
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.law import Command
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.variation import CarriedLoad
from rpctl.robot.vary import set_limits
from rpctl.simulation.config import Config, read_config, write_config
from rpctl.simulation.plants.sensors import sample_times
from rpctl.simulation.plants.settings import Noise, SensorBias, Wrench
from tests.robots import SET_A, ball, platform, write

ALL = Plant(
    payload=CarriedLoad("tool_link", 1.5, (0.0, 0.1, 0.0)),
    losses=3.0,
    effort=0.5,
    effort_lag=0.01,
    backlash={"arm_*": 1e-3},
    encoder_bits=12,
    sensor_bias=SensorBias(heading=-1e-3),
    jitter=1e-4,
    slope=(0.02, -0.01),
    wrenches=(Wrench("tool_link", (1.0, 0.0, 0.0)), Wrench("base_link", start=0.01, end=0.5)),
    noise=Noise(position=1e-4),
    seed=7,
)


def test_a_file_says_all_of_it(tmp_path: Path) -> None:
    config = Config(plant=ALL)
    assert read_config(write_config(config, tmp_path / "run.toml")) == config
    (tmp_path / "bad.toml").write_text(
        "[plant]\nslope = [0.1]\nencoder_bits = 12.0\n[plant.payload]\nmas = 1.0\n"
        "[plant.sensor_bias]\nspeed = true\n[[plant.wrenches]]\nforce = [1.0, 0.0, 0.0]\n"
    )
    with pytest.raises(RpctlError) as found:
        read_config(tmp_path / "bad.toml")
    for part in (
        "plant.slope: is [0.1]; give 2 numbers",
        "plant.encoder_bits: is 12.0; give a whole number",
        "did you mean mass",
        "plant.sensor_bias.speed: is True; give a number",
        "plant.wrenches[1]: missing: link",
    ):
        assert part in str(found.value)


@pytest.mark.thorough
def test_efforts_that_saturate_unseen_still_get_there(tmp_path: Path) -> None:
    """They saturate at the start, as no law knows, and nothing has wound up at the end."""
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=ball(0.8))))
    robot = set_limits(robot, effort={"*": 40.0})
    weak, plain = (
        track(
            robot,
            "line",
            duration=4.0,
            initial_error=(0.3, 0.1, 0.2),
            plant=plant,
            control_period=0.005,
            plant_step=0.005,
            collisions=False,
        )
        for plant in (Plant(effort=0.08), None)
    )
    reached = np.abs(weak.tau).max(axis=1)
    assert reached.max() == pytest.approx(0.08 * 40.0)
    assert np.abs(plain.tau).max() > 2.0 * 0.08 * 40.0
    assert (reached > 0.0799 * 40.0).sum() > 10
    apart = np.linalg.norm(weak.log.base[:, :2] - plain.log.base[:, :2], axis=1)
    assert apart.max() > 1e-3
    assert apart[-1] < 0.2 * apart.max()
    assert np.abs(weak.tau[-1] - plain.tau[-1]).max() < 0.1


def test_the_controller_is_told_when_its_samples_were_taken(paper: Robot) -> None:
    """Its reference is that of the sample, and the motion between two lasts as long as it says."""
    plant = Plant(jitter=3e-4, seed=2)
    run = track(
        paper, "circle", duration=0.1, plant=plant, dynamic=PaperDynamic(), collisions=False
    )
    np.testing.assert_allclose(run.t, sample_times(plant, 0.002, 51), atol=1e-15)
    assert np.diff(run.t).std() > 1e-4
    plain = track(paper, "circle", duration=0.1, dynamic=PaperDynamic(), collisions=False)
    between = [np.interp(run.t, plain.t, plain.base_ref[:, k]) for k in range(2)]
    np.testing.assert_allclose(run.base_ref[1:-1, :2], np.transpose(between)[1:-1], atol=1e-6)
    assert summarize(run).energy_residual < 1e-6


def test_odometry_believes_the_radii_that_it_knows(paper: Robot) -> None:
    """Wheels that are larger by a tenth drive faster by a tenth than their encoders say."""
    seen: list[Array] = []

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Array:
        seen.append(nu)
        return PaperDynamic()(dynamics, q, nu, command)

    plant = Plant(encoder_bits=24, radii={"wheel_*": 1.1})
    run = track(
        paper,
        "line",
        duration=0.3,
        initial_error=(0.5, 0.0, 0.0),
        dynamic=law,
        plant=plant,
        collisions=False,
    )
    mean = 0.5 * (run.nu[100, 0] + run.nu[101, 0])
    assert mean > 0.05
    assert seen[101][0] == pytest.approx(mean / 1.1, rel=1e-3)


@pytest.mark.parametrize(
    "plant",
    [
        Plant(effort=0.5),
        Plant(effort_lag=0.1),
        Plant(backlash={"*": 0.1}),
        Plant(jitter=1e-4),
        Plant(wrenches=(Wrench("base_link"),)),
    ],
)
def test_who_takes_speeds_has_no_efforts_to_saturate(paper: Robot, plant: Plant) -> None:
    with pytest.raises(RpctlError, match="applies to robots that take efforts"):
        track(paper, "line", duration=0.1, plant=plant, output="velocity", collisions=False)
