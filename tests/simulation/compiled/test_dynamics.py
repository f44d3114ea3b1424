"""The dynamics in symbols say what Pinocchio says, of every drive and of variants."""

from __future__ import annotations

from dataclasses import replace

import pytest

import rpctl
from rpctl.robot import catalog
from rpctl.robot.vary import add_friction, scale_masses
from rpctl.simulation.compiled.comparison import check
from rpctl.simulation.compiled.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.parameters import Varied
from tests.grids import cells

OWN = [entry.name for entry in catalog.ENTRIES if entry.own]


@pytest.mark.parametrize("name", cells([*OWN, "tiago"], {"car", "casters"}, {*OWN[1:3], "tiago"}))
def test_own_robots(name: str) -> None:
    check(SymbolicDynamics(rpctl.load(name)))


@pytest.mark.parametrize("name", cells(OWN, {"paper"}, {"car", "swerve"}))
def test_variants(name: str) -> None:
    """One graph is right for robots with other masses, radii and friction."""
    robot = rpctl.load(name)
    everything = Varied(tuple(robot.model.names[1:]), True, robot.actuators)
    wheels = tuple(replace(wheel, radius=1.1 * wheel.radius) for wheel in robot.drive.wheels)
    variant = replace(robot, drive=replace(robot.drive, wheels=wheels))
    variant = scale_masses(add_friction(variant, {robot.actuators[-1]: 0.3}), "*", 1.3)
    check(SymbolicDynamics(robot, everything), variant)
