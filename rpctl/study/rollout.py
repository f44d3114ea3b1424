"""Rollouts: many closed loops of one robot, each with settings of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.defaults import default_laws
from rpctl.control.law import DynamicLaw, KinematicLaw
from rpctl.errors import RpctlError
from rpctl.reference.motion import Reference
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config, RunSettings
from rpctl.study.design import Design
from rpctl.study.experiment import Experiment
from rpctl.study.rollouts import Rollouts
from rpctl.study.run_rows import run_rows
from rpctl.study.scatter import Scatter, scatter_of, settings_at


def rollout(
    robot: Robot,
    reference: str | Reference = RunSettings.reference,
    scatter: Scatter | Mapping[str, Any] | None = None,
    count: int = 1000,
    duration: float | None = 10.0,
    seed: int = 0,
    *,
    kinematic: KinematicLaw | None = None,
    dynamic: DynamicLaw | None = None,
    control_period: float = RunSettings.control_period,
    plant_step: float = RunSettings.plant_step,
    merits: Sequence[str] | None = None,
    samples: int = 200,
    backend: str = "auto",
    progress: Callable[[int, int], object] | None = None,
) -> Rollouts:
    """Simulate a robot many times, each time with settings of its own, drawn at random.

    Run i depends on the seed and on i only: a larger count adds runs.

    Args:
        robot: The robot, as its controller knows it.
        reference: A reference, the name of one, or a file, as of :func:`rpctl.track`.
        scatter: Distributions by path of the setting, see :mod:`rpctl.study.scatter`:
            ``{"plant.masses.arm_*": Uniform(0.9, 1.1), "run.initial_error.y": Normal(0.0, 0.1)}``.
        count: Number of runs.
        duration: Of each, s; None: as long as the reference moves.
        seed: Of all that is random.
        kinematic: The kinematic law; None takes the default.
        dynamic: The dynamic law; None takes the default.
        control_period: s.
        plant_step: s.
        merits: Names of the merits that are wanted, see :mod:`rpctl.study.merits`; None: all.
        samples: How many samples over time are kept of a run, at most.
        backend: ``"compiled"``, ``"pinocchio"``, or ``"auto"``: the first that can do it.
        progress: Called with the runs done and their number.

    Raises:
        UnknownNameError: There is no such setting or merit.
        RpctlError: A setting is out of range, or the reference does not fit the robot.
    """
    if count < 1:
        raise RpctlError(f"count is {count}; give a whole number, 1 or more")
    usual = default_laws(robot)
    named = isinstance(reference, str)
    run = RunSettings(
        reference=str(reference) if named else type(reference).__name__,
        duration=duration,
        control_period=control_period,
        plant_step=plant_step,
    )
    config = Config(kinematic=kinematic or usual[0], dynamic=dynamic or usual[1], run=run)
    settings = scatter_of(scatter, config)
    experiment = Experiment(
        config,
        settings.names,
        seed,
        None if merits is None else tuple(merits),
        samples,
        backend=backend,
        reference=None if isinstance(reference, str) else reference,
    )
    values = draw(settings, count, seed)
    results = run_rows(robot, experiment, values, np.arange(count), progress)
    return Rollouts(experiment, settings.names, values, results)


def draw(scatter: Scatter, count: int, seed: int) -> Array:
    """Return the settings (count, n) of runs; a row depends on the seed and its number only.

    Args:
        scatter: Their distributions.
        count: Number of runs.
        seed: Of the draws.
    """
    points = Design(count=count, seed=seed).points(len(scatter.names))
    return settings_at(scatter, points)
