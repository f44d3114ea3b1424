"""The force rows' derivatives by accelerations and speeds, on every drive: central differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.forces import ForceModel, Forces
from rpctl.control.horizon.prediction import Model
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.robot.losses import Losses
from tests.grids import cells
from tests.robots import four_wheels, write
from tests.vehicles import KINDS, vehicle

STEP = 1e-5  # of central differences; their own error is about 1e-9
TOLERANCE = 1e-6  # relative to the largest entry of a column
DRIVES = [*KINDS, "skid-steer", "mecanum", "tiago", "swerve", "caster_drive"]
QUICK = {("car-like", True), ("powered", False)}
GRID = [(kind, lossy) for kind in DRIVES for lossy in (False, True)]


def made(kind: str, lossy: bool, folder: Path, rng: np.random.Generator) -> Robot:
    if kind in ("skid-steer", "mecanum"):
        robot = four_wheels(folder, kind)
    else:
        robot = rpctl.load(write(folder, vehicle(kind)) if kind in KINDS else kind)
    size = np.append(np.zeros(3), rng.uniform(0.5, 1.5, robot.nv - 3))
    losses = Losses(0.3 * size, 0.7 * size, 0.5 * np.ones(robot.nv))
    return replace(robot, losses=losses if lossy else None)


def rows(forces: ForceModel, split: Array) -> dict[str, Callable[[Forces], Array]]:
    """What the rows are made of, and the rows; loads are split as ``split`` has it."""
    found: dict[str, Callable[[Forces], Array]] = {
        "force": lambda at: at.force,
        "wrench": lambda at: at.wrench,
        "efforts": forces.efforts,
    }
    ground = forces.ground
    if ground is not None:
        found |= {"tip": ground.tip, "grip": lambda at: ground.grip(at, split)}
    return found


@pytest.mark.parametrize(("kind", "lossy"), cells(GRID, QUICK, {*GRID} - QUICK))
def test_they_agree(kind: str, lossy: bool, tmp_path: Path, rng: np.random.Generator) -> None:
    robot = made(kind, lossy, tmp_path, rng)
    dynamics, dof = ReducedDynamics(robot), robot.dof
    model = Model(dynamics, 4, 0.05)
    forces = ForceModel(model, find_contacts(dynamics), tip_margin=0.02, grip=0.9)
    base = model.base_columns
    for _ in range(3):
        q, (nu, nu_dot) = robot.random_configuration(rng), 0.3 * rng.normal(size=(2, dof))
        if forces.ground is not None:
            forces.ground.update(q)
        found = forces.at(q, nu, nu_dot, dof, base)
        few = forces.at(q, nu, nu_dot, base, base)
        values = []  # (before, after) a step along each ν̇, then along each ν that moves the base
        for along in np.eye(2 * dof)[[*range(dof), *range(dof, dof + base)]]:
            by_nu_dot, by_nu = STEP * along.reshape(2, dof)
            values.append([forces.at(q, nu + s * by_nu, nu_dot + s * by_nu_dot) for s in (-1, 1)])
        split = np.empty(0) if forces.ground is None else forces.ground.load_split(found)
        for name, part in rows(forces, split).items():
            ends = np.array([[part(value)[:, 0] for value in pair] for pair in values])
            truth = (ends[:, 1] - ends[:, 0]).T / (2.0 * STEP)
            size = np.maximum(1.0, np.abs(truth).max(axis=0, initial=0.0))
            error = np.abs(part(found)[:, 1:] - truth) / size
            assert error.max(initial=0.0) < TOLERANCE, (name, error.max(axis=0))
            kept = [*range(1 + base), *range(1 + dof, 1 + dof + base)]
            np.testing.assert_allclose(part(few), part(found)[:, kept], rtol=1e-9, atol=1e-9)
