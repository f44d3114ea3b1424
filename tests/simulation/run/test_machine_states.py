"""Many states at once: machine code says what Pinocchio does, and leaves it what is singular."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.dynamics.reduced import OutsideForce
from rpctl.errors import SingularBasisError
from rpctl.robot.variation import Variation, vary
from rpctl.robot.vary import scale_masses
from rpctl.simulation.run.states import MachineStates, PinocchioStates, StateColumns
from tests.grids import cells
from tests.robots import write
from tests.vehicles import vehicle

COUNT = 12
KINDS = ["car-like", "casters"]  # whose contacts move, and whose S does not turn
CATALOGUE = ["car", "arm", "tiago", "caster_drive"]


@pytest.fixture(params=cells([*KINDS, *CATALOGUE], [*KINDS, "arm"], ["caster_drive"]))
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    if request.param in CATALOGUE:
        return rpctl.load(request.param)
    return rpctl.load(write(tmp_path, vehicle(request.param)))


def both(robot: Robot) -> tuple[PinocchioStates, MachineStates]:
    dynamics = ReducedDynamics(robot)
    states = PinocchioStates(dynamics, find_contacts(dynamics))
    return states, MachineStates(states)


def states_of(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    q, wanted = (
        np.array([robot.random_configuration(rng) for _ in range(COUNT)]) for _ in range(2)
    )
    nu, tau = rng.normal(size=(COUNT, robot.dof)), rng.normal(size=(COUNT, len(robot.actuators)))
    return q, nu, tau, wanted


def require_same(found: StateColumns, expected: StateColumns) -> None:
    pairs = zip((*found.reactions, *found[1:]), (*expected.reactions, *expected[1:]), strict=True)
    for x, y in pairs:
        if x is None or y is None:
            assert x is y
        else:
            size = np.abs(y).max(initial=1.0)
            np.testing.assert_allclose(x, y, rtol=0.0, atol=1e-11 * size)


def test_machine_code_says_what_pinocchio_says(robot: Robot, rng: np.random.Generator) -> None:
    """Also of a robot that has losses, stands on a slope and is pushed."""
    lossy = {name: 0.1 + 0.2 * k for k, name in enumerate(robot.actuators)}
    varied = Variation(damping=lossy, joint_friction=lossy, slope=(0.1, -0.05))
    for each in (robot, vary(robot, varied)):
        pinocchio, machine = both(each)
        given = states_of(each, rng)
        require_same(machine(*given), pinocchio(*given))
        assert machine.agrees(*given)
        pushed = OutsideForce(rng.normal(size=(COUNT, each.nv)), rng.normal(size=(COUNT, 6)))
        require_same(machine(*given, pushed), pinocchio(*given, pushed))


def test_machine_code_that_says_something_else_does_not_agree(
    paper: Robot, rng: np.random.Generator
) -> None:
    pinocchio, machine = both(paper)
    heavier = scale_masses(paper, "arm_*", 1.0 + 1e-6)
    given = states_of(paper, rng)
    machine._pinocchio = PinocchioStates(ReducedDynamics(heavier), None)
    assert not machine.agrees(*given)
    assert pinocchio.moving is None


def test_singular_steering_is_refused_as_by_pinocchio(rng: np.random.Generator) -> None:
    swerve = rpctl.load("swerve")
    _, machine = both(swerve)
    q, nu, tau, wanted = states_of(swerve, rng)
    q[3] = swerve.configuration(joints={s.joint: 0.5 * np.pi for s in swerve.drive.steered})
    with pytest.raises(SingularBasisError, match="steering_front_left_joint at 90°"):
        machine(q, nu, tau, wanted)


def test_machine_code_pays_for_many_states_only(paper: Robot, tiago: Robot) -> None:
    small, large = both(paper)[0], PinocchioStates(ReducedDynamics(tiago), None)
    assert not small.are_many(100)
    assert small.are_many(2000)
    assert not large.are_many(2000)
    assert large.are_many(20_000)
