"""The whole certificate on every kind of wheel."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from tests.grids import cells
from tests.robots import write
from tests.vehicles import KINDS, vehicle


@pytest.mark.parametrize("kind", cells(KINDS, [*KINDS][::3]))
def test_the_certificate_holds(tmp_path: Path, kind: str) -> None:
    robot = rpctl.load(write(tmp_path, vehicle(kind)))
    drive, speeds = KINDS[kind]
    assert robot.drive.type == drive
    assert robot.quasi_velocities == (*speeds, "arm_joint")
    proof = rpctl.verify(robot, samples=10)
    assert proof.passed, [check for check in proof.checks if not check.passed]
    assert {check.against for check in proof.checks} >= {"Gibbs-Appell", "Lagrange multipliers"}
