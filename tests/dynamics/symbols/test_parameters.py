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
from rpctl.errors import RpctlError
from rpctl.robot import catalog
from rpctl.robot.variation import LINK, BuiltNumbers, CarriedLoad, Variation, vary
from rpctl.robot.vary import without_losses
from tests.dynamics.symbols.comparison import check
from tests.grids import cells
from tests.robots import add_losses

OWN = [entry.name for entry in catalog.ENTRIES if entry.own and not entry.leans]


def made_for(robot: Robot, *others: Variation) -> SymbolicDynamics:
    """Return dynamics of a robot and of others, and of all that lie between them."""
    return SymbolicDynamics(robot, BuiltNumbers(robot, [Variation(), *others]))


def everything(robot: Robot, size: float, rolling: float = 1.07) -> Variation:
    """Return a variation of all that there is but the track, the wheels still round."""
    names = BuiltNumbers(robot, [Variation()]).names[LINK]
    wheels = {wheel.joint for wheel in robot.drive.wheels}
    round_links = {robot.description.joint[name].child for name in wheels}
    others = [name for name in names if name not in round_links]
    return Variation(
        masses={name: 1.0 + size * (k + 1) for k, name in enumerate(names)},
        centres=dict.fromkeys(others, (0.1 * size, -0.2 * size, 0.3 * size)),
        inertias={"*": 1.0 + 2.0 * size},
        radii=dict.fromkeys(wheels, rolling),
        damping={"*": size, robot.actuators[-1]: 2.0 * size},
        joint_friction={robot.actuators[0]: 3.0 * size, robot.actuators[-1]: size},
        losses=1.0 + size,
        payload=CarriedLoad(others[-1], 10.0 * size, (size, 0.2 * size, -size)),
        slope=(size, -0.3 * size),
    )


@pytest.mark.parametrize("name", cells(OWN, {"car"}, {"swerve"}))
def test_parameters_of_a_perturbed_robot_are_pinocchio_s(name: str) -> None:
    """M, h and B of a graph that was made for other robots, with the parameters of a setting;
    beside Pinocchio's model of the robot that this setting makes, and a stack of both."""
    bare = rpctl.load(name)
    robot = add_losses(bare, dict.fromkeys(bare.entries, 0.3), {bare.actuators[0]: 0.2})
    dynamics = made_for(robot, everything(robot, 0.1), everything(robot, 0.17, 1.2))
    others = everything(robot, 0.04, 1.03), everything(robot, 0.3, 0.9)
    stack = dynamics.parameters(BuiltNumbers(robot, others))
    for p, other in zip(stack, others, strict=True):
        alone = vary(robot, other)
        check(dynamics, alone, samples=2, p=p)
        np.testing.assert_array_equal(dynamics.parameters(BuiltNumbers(robot, [other]))[0], p)
        np.testing.assert_allclose(dynamics.parameters_of(alone), p, rtol=1e-12, atol=1e-12)


def test_the_track_may_differ(paper: Robot) -> None:
    dynamics, other = made_for(paper, Variation(track=1.1)), Variation(track=0.8)
    p = dynamics.parameters(BuiltNumbers(paper, [other]))[0]
    check(dynamics, vary(paper, other), samples=1, p=p)
    radii = [Variation(radii={paper.drive.wheels[k].joint: 1.1}, track=1.2) for k in range(2)]
    dynamics, other = made_for(paper, *radii), Variation(radii={"*": 1.5}, track=0.7)
    p = dynamics.parameters(BuiltNumbers(paper, [other]))[0]
    check(dynamics, vary(paper, other), samples=1, p=p)


CHANGES: dict[str, Callable[[Robot], Robot]] = {
    "inertia": lambda robot: vary(robot, Variation(masses={"*": 1.1})),
    "S": lambda robot: vary(robot, Variation(radii={"*": 1.1})),
    "damping": lambda robot: vary(robot, Variation(damping={"*": 0.1})),
    "friction": lambda robot: add_losses(robot, {}, {robot.actuators[0]: 0.1}),
    "lift": lambda robot: vary(robot, Variation(slope=(0.1, 0.0))),
    "point": lambda robot: replace(robot, drive=replace(robot.drive, point=(0.1, 0.0))),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_not_varied_has_to_be_the_same(name: str, paper: Robot) -> None:
    variant = CHANGES[name](paper)
    for one, other in ((paper, variant), (variant, paper)):  # more, and less of it
        with pytest.raises(RpctlError, match=rf"more than what is varied \({name}\)"):
            SymbolicDynamics(one).parameters_of(other)


def test_another_robot_is_no_variant(paper: Robot) -> None:
    with pytest.raises(RpctlError, match="arm is no variant of paper"):
        SymbolicDynamics(paper).parameters_of(rpctl.load("arm"))


def test_a_round_wheel_has_to_stay_round(paper: Robot) -> None:
    link = paper.description.joint[paper.drive.wheels[0].joint].child
    heavy, askew = Variation(masses={link: 1.5}), Variation(centres={link: (0.01, 0.0, 0.01)})
    check(made_for(paper, heavy), vary(paper, Variation(masses={link: 0.7})), samples=1)
    with pytest.raises(RpctlError, match=r"more than what is varied \(inertia\)"):
        made_for(paper, heavy).parameters(BuiltNumbers(paper, [askew]))
    other = Variation(centres={link: (0.03, 0.0, -0.02)})
    dynamics = made_for(paper, askew, Variation(centres={link: (0.02, 0.0, 0.05)}))
    p = dynamics.parameters(BuiltNumbers(paper, [other]))[0]
    check(dynamics, vary(paper, other), samples=1, p=p)


def test_only_the_losses_that_are_varied_are_symbols(paper: Robot) -> None:
    bare, last = without_losses(paper), paper.actuators[-1]
    dynamics = made_for(bare, Variation(damping={last: 0.1}, joint_friction={last: 0.1}))
    assert dynamics.lossy and dynamics.p.numel() == 2
    check(dynamics, add_losses(bare, {}, {last: 0.2}), samples=1)


def test_a_symbol_is_asked_for_only_where_it_counts(paper: Robot) -> None:
    """The base's height of mass, say, is felt by nobody on a plane."""
    base = paper.description.root
    moved = Variation(masses={base: 1.3}, centres={base: (0.1, 0.2, 0.3)}, inertias={base: 1.2})
    dynamics = made_for(paper, moved)
    assert dynamics.p.numel() == 4  # m, m c_x, m c_y, I_zz
    q, nu = casadi.SX.sym("q", paper.nq), casadi.SX.sym("nu", paper.dof)
    forces = casadi.vertcat(casadi.vec(dynamics.inertia(q)), dynamics.bias(q, nu))
    assert all(casadi.which_depends(forces, dynamics.p, 1, False))
