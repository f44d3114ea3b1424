"""One graph serves many robots: what is varied is a number, what is not has to be the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi
import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.dynamics.symbols.numbers import NOTHING, Varied
from rpctl.errors import RpctlError
from rpctl.robot import catalog
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.variation import LinkInertias, Variation, vary
from rpctl.robot.vary import add_losses, without_losses
from tests.dynamics.symbols.comparison import check
from tests.grids import cells

OWN = [entry.name for entry in catalog.ENTRIES if entry.own]


def everything(robot: Robot) -> Varied:
    return Varied(tuple(robot.model.names[ROOT_JOINT:]), True, tuple(robot.entries))


def other(robot: Robot) -> Robot:
    """Return a robot that differs in all that a plant may vary, its wheels still round."""
    names = LinkInertias(robot).names
    rolling = {wheel.joint for wheel in robot.drive.wheels}
    round_links = {robot.description.joint[name].child for name in rolling}
    varied = vary(
        robot,
        Variation(
            masses={name: 1.0 + 0.1 * k for k, name in enumerate(names)},
            centres={name: (0.01, -0.02, 0.03) for name in names if name not in round_links},
            inertias={"*": 1.2},
            radii=dict.fromkeys(rolling, 1.07),
            damping={"*": 0.05},
        ),
    )
    return add_losses(varied, {}, {robot.actuators[0]: 0.3, robot.actuators[-1]: 0.1})


@pytest.mark.parametrize("name", cells(OWN, {"car"}, {"swerve"}))
def test_variants(name: str) -> None:
    robot = rpctl.load(name)
    dynamics = SymbolicDynamics(robot, everything(robot))
    check(dynamics, other(robot), samples=2)


def test_the_track_may_differ(paper: Robot) -> None:
    dynamics = SymbolicDynamics(paper, Varied(rolling=True))
    check(dynamics, vary(paper, Variation(track=1.1)), samples=1)


CHANGES: dict[str, Callable[[Robot], Robot]] = {
    "inertia": lambda robot: vary(robot, Variation(masses={"*": 1.1})),
    "S": lambda robot: vary(robot, Variation(radii={"*": 1.1})),
    "damping": lambda robot: vary(robot, Variation(damping={"*": 0.1})),
    "friction": lambda robot: add_losses(robot, {}, {robot.actuators[0]: 0.1}),
    "point": lambda robot: replace(robot, drive=replace(robot.drive, point=(0.1, 0.0))),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_not_varied_has_to_be_the_same(name: str, paper: Robot) -> None:
    dynamics, variant = SymbolicDynamics(paper, NOTHING), CHANGES[name](paper)
    with pytest.raises(RpctlError, match=rf"more than what is varied \({name}\)"):
        dynamics.parameters_of(variant)


def test_another_robot_is_no_variant(paper: Robot) -> None:
    with pytest.raises(RpctlError, match="arm is no variant of paper"):
        SymbolicDynamics(paper, everything(paper)).parameters_of(rpctl.load("arm"))


def test_a_round_wheel_has_to_stay_round(paper: Robot) -> None:
    wheel = paper.drive.wheels[0].joint
    dynamics = SymbolicDynamics(paper, Varied(bodies=(wheel,)))
    link = paper.description.joint[wheel].child
    check(dynamics, vary(paper, Variation(masses={link: 1.5})), samples=1)
    with pytest.raises(RpctlError, match=r"more than what is varied \(inertia\)"):
        dynamics.parameters_of(vary(paper, Variation(centres={link: (0.01, 0.0, 0.01)})))


def test_only_the_losses_that_are_varied_are_symbols(paper: Robot) -> None:
    dynamics = SymbolicDynamics(without_losses(paper), Varied(losses=(paper.actuators[-1],)))
    assert dynamics.lossy and dynamics.p.numel() == 2
    check(dynamics, add_losses(without_losses(paper), {}, {paper.actuators[-1]: 0.2}), samples=1)


def test_stacks_of_inertias_give_stacks_of_parameters(rng: np.random.Generator) -> None:
    """Each row is what its robot alone has, to the bit, whatever stands in the other rows."""
    robot = rpctl.load("car")
    dynamics, links = SymbolicDynamics(robot, everything(robot)), LinkInertias(robot)
    masses = rng.uniform(0.5, 2.0, (7, len(links.names)))
    stack = dynamics.parameters(robot, links.bodies(masses))
    assert stack.shape == (7, dynamics.p.numel())
    np.testing.assert_array_equal(
        dynamics.parameters(robot, links.bodies(masses[4:5]))[0], stack[4]
    )
    alone = vary(robot, Variation(masses=dict(zip(links.names, masses[4], strict=True))))
    np.testing.assert_allclose(stack[4], dynamics.parameters_of(alone), rtol=0, atol=1e-13)


def test_a_symbol_is_asked_for_only_where_it_counts(paper: Robot) -> None:
    """The base's height of mass, say, is felt by nobody on a plane."""
    dynamics = SymbolicDynamics(paper, Varied(bodies=("root_joint",)))
    assert dynamics.p.numel() == 4  # m, m c_x, m c_y, I_zz
    q, nu = casadi.SX.sym("q", paper.nq), casadi.SX.sym("nu", paper.dof)
    forces = casadi.vertcat(casadi.vec(dynamics.inertia(q)), dynamics.bias(q, nu))
    assert all(casadi.which_depends(forces, dynamics.p, 1, False))
