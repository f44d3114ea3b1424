"""Columns of many runs against each run's own plant, robot and laws."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, UnifiedKinematic
from rpctl.arrays import Array
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.robot.variation import CarriedLoad
from rpctl.simulation.compiled.build import holding
from rpctl.simulation.compiled.lanes import LaneInputs
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.closed_loop import start_configuration
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.settings import Noise, SensorBias
from rpctl.study.experiment import Experiment
from rpctl.study.lanes import LaneColumns
from tests.robots import add_losses

NAMES = (
    "plant.masses.*",
    "plant.centres.*.y",
    "plant.inertias.base_link",
    "plant.radii.*",
    "plant.damping.*",
    "plant.joint_friction.*",
    "plant.tau_bias.*",
    "plant.delay",
    "plant.noise.heading",
    "plant.payload.mass",
    "plant.payload.com.y",
    "plant.losses",
    "plant.effort",
    "plant.sensor_bias.heading",
    "plant.slope.along_y",
    "run.initial_error.theta",
    "kinematic.horizon",
    "dynamic.gain",
)
LOW = (
    0.5,
    -0.1,
    0.5,
    0.8,
    0.0,
    0.0,
    -1.0,
    0.0,
    0.0,
    0.1,
    -0.1,
    0.0,
    0.4,
    -0.1,
    -0.2,
    -3.0,
    0.2,
    1.0,
)
HIGH = (2.0, 0.1, 2.0, 1.2, 0.3, 0.3, 1.0, 0.03, 0.1, 3.0, 0.1, 3.0, 0.9, 0.1, 0.2, 3.0, 0.6, 9.0)


def made(
    robot: Robot, names: tuple[str, ...], values: Array, plant: Plant | None = None
) -> tuple[LaneInputs, Experiment, SymbolicDynamics, Any]:
    config = Config(
        kinematic=UnifiedKinematic(),
        run=RunSettings(initial_error=(0.1, 0.2, 0.3), duration=1.0),
        plant=plant or Plant(),
    )
    experiment = Experiment(config, names, seed=5)
    start = config.run.load_reference(robot, collisions=False)(0.0)
    columns = LaneColumns(robot, experiment, start, 1.0)
    dynamics, runs = columns.dynamics, np.arange(10, 10 + len(values))
    configs = [each for each in columns.configs(values, runs) if isinstance(each, Config)]
    assert len(configs) == len(values)
    lossless, inputs = columns.inputs(configs, holding(dynamics))
    assert not lossless.any()
    return inputs, experiment, dynamics, start


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("paper", "plant.track"),
        pytest.param("swerve", "", marks=pytest.mark.slow),
        pytest.param("mecanum", "plant.track", marks=pytest.mark.slow),
    ],
)
def test_each_run_is_its_own(name: str, more: str, rng: np.random.Generator) -> None:
    bare = rpctl.load(name)
    robot = add_losses(bare, dict.fromkeys(bare.entries, 0.3), {bare.actuators[0]: 0.2})
    names = NAMES + ((more,) if more else ())
    low, high = (np.append(each, end)[: len(names)] for each, end in ((LOW, 0.9), (HIGH, 1.1)))
    values = rng.uniform(low, high, (3, len(names)))
    links = [link.name for link in robot.description.links if link.mass]
    plant = Plant(  # what no run changes: before, behind and beside what differs
        masses={links[-1]: 1.5, "*": 9.0},
        centres={"*": (0.01, 0.0, 0.02)},
        radii={robot.drive.wheels[0].joint: 1.01},
        tau_bias={robot.actuators[-1]: 3.0},
        noise=Noise(position=0.01),
        payload=CarriedLoad(link=links[-1], com=(0.1, 0.0, 0.3)),
        sensor_bias=SensorBias(position=0.02),
        slope=(0.1, 0.0),
    )
    found, experiment, dynamics, start = made(robot, names, values, plant)
    for k in range(len(values)):
        config = experiment.config_of(values[k], 10 + k)
        variant = config.plant.simulated_robot(robot)
        expected = dynamics.parameters_of(variant)
        np.testing.assert_allclose(found.p[k], expected, rtol=1e-12, atol=1e-12)
        q = start_configuration(robot, start, config.run.initial_error)
        np.testing.assert_allclose(found.q[k], q, atol=1e-14)
        own, still = ReducedDynamics(variant), np.zeros(robot.dof)
        rest = own.efforts(q, own.bias(q, still)) - config.plant.bias(robot)
        np.testing.assert_allclose(found.rest[k], rest, rtol=1e-10, atol=1e-10)
        assert found.back[k] == round(config.plant.delay / config.run.control_period)
        np.testing.assert_allclose(found.most[k], values[k][12] * robot.effort_limits)
        assert found.seeds[k] == config.plant.seed
    assert found.rows(np.array([2, 0])).seeds == (found.seeds[2], found.seeds[0])
    assert found.rows(slice(1, 3)).q.tolist() == found.q[1:].tolist()


def test_what_does_not_differ_is_no_parameter(paper: Robot) -> None:
    none, *_ = made(paper, ("run.initial_error.x",), np.array([[0.5], [-0.5]]))
    assert none.p.shape == (2, 0)
    some, *_ = made(paper, ("plant.masses.arm_rail_link",), np.array([[1.5]]))
    assert 0 < some.p.shape[1] < 10


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("plant.masses.*", 0.0, r"masses of \* is 0"),
        ("plant.masses.*", np.nan, "nan"),
        ("plant.radii.wheel_left_joint", 0.5, 'wheel "wheel_left_joint" would not reach'),
        ("plant.radii.*", 1e12, "determine the motion"),
        ("plant.track", 1e12, "determine the motion"),
        ("plant.track", -1.0, "track is -1"),
        ("plant.joint_friction.*", -0.1, r"joint_friction of \* is -0.1"),
        ("plant.noise.heading", -0.1, "noise of heading is -0.1"),
        ("plant.delay", 1.5, "delay is 1.5 s, longer than the run of 1 s"),
        ("plant.delay", -0.1, "delay is -0.1"),
        ("kinematic.horizon", 0.0, "horizon is 0"),
        ("run.initial_error.x", 1e9, "initial_error is"),
        ("run.initial_error.x", np.inf, "initial_error is inf"),
        ("plant.centres.*.x", 1e4, r"centres of \* is 1"),
    ],
)
def test_refused_runs_say_what_their_own_run_says(
    paper: Robot, name: str, value: float, message: str
) -> None:
    config = Config(run=RunSettings(duration=1.0))
    columns = LaneColumns(
        paper,
        Experiment(config, (name,)),
        config.run.load_reference(paper, collisions=False)(0.0),
        1.0,
    )
    fine = 1.0 if "initial" in name or "plant" in name else 0.4
    tried = np.array([[fine if "delay" not in name else 0.1], [value]])
    sound, refused = columns.configs(tried, np.arange(2))
    assert isinstance(sound, Config)
    assert re.search(message, str(refused)), refused
