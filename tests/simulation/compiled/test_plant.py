"""The plant of a compiled loop against `dynamics.motion.step`."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl.dynamics.motion import step
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.program import Buffer, Program, Until
from rpctl.robot.model import Robot
from rpctl.simulation.compiled.implicit_step import PlantBuffers
from rpctl.simulation.compiled.loop import plant_fragment
from tests.grids import cells
from tests.kernels.interpreted import Interpreted
from tests.robots import add_losses

LANES, DT, STEPS = 3, 0.002, 2
TOLERANCE = 1e-12  # of states of size 1; rounding leaves 1e-14


def step_both(robot: Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return q, ν, work and loss (nq + dof + 2, lanes) of both plants after some steps."""
    dynamics, rng = rpctl.ReducedDynamics(robot), np.random.default_rng(seed)
    symbolic = SymbolicDynamics(robot)
    sizes = {
        "q": robot.nq,
        "nu": robot.dof,
        "tau": len(robot.actuators),
        "energy": 2,
        "reaction": robot.dof,
        "p": 0,
    }
    at = PlantBuffers(**{name: Buffer(name, size) for name, size in sizes.items()})
    plant = plant_fragment(symbolic, at, DT, STEPS)
    program = Program((*plant.start, *plant.steps))
    kernel = Interpreted(program, LANES)
    workspace = kernel.workspace()
    expected = []
    for lane in range(LANES):
        arm = robot.home + 0.1 * rng.normal(size=len(robot.joints))
        q = robot.configuration_at(rng.normal(size=3), arm)
        # One lane rests: friction holds it, and its trips of Newton's method differ from others'.
        nu = rng.normal(size=robot.dof) * (lane > 0)
        tau = rng.normal(size=len(robot.actuators))
        workspace[at.q][:, lane] = q
        workspace[at.nu][:, lane] = nu
        workspace[at.tau][:, lane] = tau
        energy = np.zeros(2)
        for _ in range(STEPS):
            q, nu, work, lost = step(dynamics, q, nu, tau, DT)
            energy += work, lost
        expected.append(np.concatenate([q, nu, energy]))
    kernel.run(0, 1, workspace, {})
    searches = [
        each
        for each in program.statements()
        if isinstance(each, Until) and each.going.name == "search going"
    ]
    assert bool(searches) == (robot.losses is not None)
    for search in searches:  # each found its rates before its last trip
        assert not workspace[search.going].any()
    found = np.vstack([workspace[at.q], workspace[at.nu], workspace[at.energy]])
    return found, np.array(expected).T


def test_a_plant_without_losses_takes_the_same_steps(paper: Robot) -> None:
    found, expected = step_both(paper, 0)
    assert np.abs(found - expected).max() < TOLERANCE


def test_a_plant_with_losses_takes_the_same_steps(paper: Robot) -> None:
    robot = add_losses(paper, {}, dict.fromkeys(paper.actuators, 0.3))
    found, expected = step_both(robot, 1)
    assert expected[-1].min() > 0.0
    assert np.abs(found - expected).max() < TOLERANCE


DRIVES = ["tiago", "swerve", "casters", "car", "mecanum", "arm", "omni"]


@pytest.mark.parametrize("name", cells(DRIVES, (), {"tiago", "swerve"}))
def test_plants_of_all_drives(name: str) -> None:
    found, expected = step_both(rpctl.load(name), 2)
    assert np.abs(found - expected).max() < TOLERANCE
