"""Any vehicle: the drive is found as it was built, and every derivation agrees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from tests.grids import cells
from tests.proofs import failed
from tests.random_vehicles import DRIVE_FILES, DRIVE_TYPES, KINDS, Vehicle, vehicle
from tests.robots import write


def check(folder: Path, kind: str, seed: int) -> None:
    """Write, load, verify; the file that fails stays in the test's folder."""
    text, built = vehicle(kind, seed)
    path = write(folder, text, f"{kind}_{seed}.urdf")
    drive = write(folder, DRIVE_FILES[kind], f"{kind}.toml") if kind in DRIVE_FILES else None
    robot = rpctl.load(path, drive=drive)
    check_drive(robot, kind, built)
    proof = rpctl.verify(robot, samples=2, seed=seed)
    assert not failed(proof), path


def check_drive(robot: Robot, kind: str, built: Vehicle) -> None:
    drive, slack = robot.drive, 1e-12 + 2.0 * built.tilt
    assert drive.type == DRIVE_TYPES.get(kind, kind)
    assert {wheel.joint: wheel.radius for wheel in drive.wheels} == built.radii
    roles = {swivel.joint: swivel.role for swivel in drive.swivels}
    if kind == "steered":  # which two lead is the detection's to say
        assert len(drive.steered) == 2
        assert roles.keys() == built.roles.keys()
    else:
        assert roles == built.roles
    assert drive.ground == pytest.approx(built.ground, abs=slack)
    if drive.has_axle:
        assert drive.point == pytest.approx(tuple(built.point), abs=slack)
        assert drive.heading == pytest.approx(built.heading, abs=slack)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", cells(range(3), (0,)))
def test_vehicles_are_verified(tmp_path: Path, kind: str, seed: int) -> None:
    check(tmp_path, kind, seed)


@pytest.mark.parametrize(("kind", "seed"), [("tied", 14), ("free", 24)])
def test_steered_wheels_of_a_base_that_heads_along_y_share_a_lateral_force(
    tmp_path: Path, kind: str, seed: int
) -> None:
    """Their axles lie nearly along x, one a hair to this side and one to the other.

    Their own forward directions are opposite then, and the mean of their sideways speeds must not
    become the difference.
    """
    check(tmp_path, kind, seed)


@pytest.mark.parametrize("seeds", cells([range(3, 6), range(6, 103)], slow=[range(3, 6)]))
@pytest.mark.parametrize("kind", KINDS)
def test_many_vehicles_are_verified(tmp_path: Path, kind: str, seeds: range) -> None:
    for seed in seeds:
        check(tmp_path, kind, seed)


def test_vehicles_carry_the_rounding_of_cad(tmp_path: Path) -> None:
    tilts = [vehicle("tricycle", seed)[1].tilt for seed in range(20)]
    assert 0.0 in tilts
    assert 1e-5 < max(tilts) < 1e-4
    assert np.ptp([vehicle("tricycle", seed)[1].ground for seed in range(20)]) > 1.0
