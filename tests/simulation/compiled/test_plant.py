"""The plant of a compiled loop against `dynamics.stops.stopping_step`."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl.dynamics.stops import Stops, stopping_step
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


def step_both(robot: Robot, seed: int, at_stops: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return q, ν, work and loss (nq + dof + 2, lanes) of both plants after some steps.

    Args:
        robot: The robot.
        seed: Of its states.
        at_stops: Whether its joints begin at limits of their positions, but for one lane's.
    """
    dynamics, rng = rpctl.ReducedDynamics(robot), np.random.default_rng(seed)
    stops, ends = Stops(robot), np.array([(joint.lower, joint.upper) for joint in robot.joints])
    steps, met = 10 * STEPS if at_stops else STEPS, 0
    at, program = plant_program(robot, steps)
    kernel = Interpreted(program, LANES)
    workspace = kernel.workspace()
    expected = []
    for lane in range(LANES):
        arm = robot.home + 0.1 * rng.normal(size=len(robot.joints))
        room = np.minimum(0.02, 0.1 * (ends[:, 1] - ends[:, 0]))
        arm = np.clip(arm, ends[:, 0] + room, ends[:, 1] - room)  # away from its stops
        if at_stops and lane:
            arm = np.array([rng.choice(pair) for pair in np.clip(ends, -1.0, 1.0)])
        q = robot.configuration_at(rng.normal(size=3), arm)
        # One lane rests: friction holds it, and its trips of Newton's method differ from others'.
        nu = rng.normal(size=robot.dof) * (lane > 0)
        tau = rng.normal(size=len(robot.actuators))
        workspace[at.q][:, lane] = q
        workspace[at.nu][:, lane] = nu
        workspace[at.tau][:, lane] = tau
        energy = np.zeros(2)
        for _ in range(steps):
            q, nu, work, lost = stopping_step(dynamics, stops, (q, nu), tau, DT)
            energy += work, lost
            met += bool(stops.sides(q, stops.ends(q)).any())
        expected.append(np.concatenate([q, nu, energy]))
    kernel.run(0, 1, workspace, {})
    searches = [each for each in program.statements() if isinstance(each, Until)]
    searches = [each for each in searches if each.going.name == "search going"]
    assert bool(searches) == (robot.losses is not None)
    for search in searches:  # each found its rates before its last trip
        assert not workspace[search.going].any()
    assert bool(met) == at_stops
    found = np.vstack([workspace[at.q], workspace[at.nu], workspace[at.energy]])
    return found, np.array(expected).T


def plant_program(robot: Robot, steps: int) -> tuple[PlantBuffers, Program]:
    """Return what a plant works on, and its program of some steps."""
    sizes = {"q": robot.nq, "nu": robot.dof, "tau": len(robot.actuators), "energy": 2}
    sizes |= {"reaction": robot.dof, "p": 0}
    at = PlantBuffers(**{name: Buffer(name, size) for name, size in sizes.items()})
    plant = plant_fragment(SymbolicDynamics(robot), at, DT, steps)
    return at, Program((*plant.start, *plant.steps))


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


STOPPING = cells(("paper", "lossy", "tiago", "car"), ("paper", "lossy"), {"tiago", "car"})


def at_stops(name: str) -> Robot:
    """Return a robot of the catalogue, or the paper's with friction in its joints."""
    if name != "lossy":
        return rpctl.load(name)
    paper = rpctl.load("paper")
    return add_losses(paper, {}, dict.fromkeys(paper.actuators, 0.3))


@pytest.mark.parametrize("name", STOPPING)
def test_plants_at_their_stops(name: str) -> None:
    """Stops hold joints from the first step on, others are met on the way."""
    found, expected = step_both(at_stops(name), 3, at_stops=True)
    assert np.abs(found - expected).max() < 100.0 * TOLERANCE  # impacts make more of rounding


@pytest.mark.parametrize("name", ["paper", "lossy"])
def test_a_robot_at_its_stops_changes_no_bit_of_one_beside_it(name: str) -> None:
    robot = at_stops(name)
    (at, program), rng = plant_program(robot, 10 * STEPS), np.random.default_rng(4)
    tau, nu = rng.normal(size=len(robot.actuators)), rng.normal(size=robot.dof)
    lowest = np.clip([joint.lower for joint in robot.joints], -1.0, 1.0)
    alone, both = (Interpreted(program, lanes) for lanes in (1, 2))
    found = []
    for kernel in (alone, both):
        workspace = kernel.workspace()
        for lane, arm in zip(range(kernel.lanes), (robot.home, lowest), strict=False):
            workspace[at.q][:, lane] = robot.configuration_at(np.zeros(3), arm)
        workspace[at.nu][:], workspace[at.tau][:] = nu[:, None], tau[:, None]
        kernel.run(0, 1, workspace, {})
        found.append(np.vstack([workspace[at.q], workspace[at.nu], workspace[at.energy]]))
    assert found[0][:, 0].tobytes() == found[1][:, 0].tobytes()
    assert np.abs(found[1][:, 1] - found[1][:, 0]).max() > 1e-3
