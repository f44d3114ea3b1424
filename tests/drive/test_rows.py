"""The rows of wheels that swivel: the velocity of their contacts, and where three axles meet."""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Drive
from rpctl.arrays import Array
from rpctl.drive.drive import Swivel
from rpctl.drive.rows import angle_of, drive_rows, lateral_row
from tests.robots import write
from tests.vehicles import vehicle

TURNING = ["casters", "car-like", "parallel", "tricycle", "bicycle", "steered", "twin"]
STEP = 1e-6
ROUNDING = 1e-14


def drive_of(folder: Path, kind: str) -> Drive:
    return rpctl.load(write(folder, vehicle(kind))).drive


def cross(turn: float, arm: Array) -> Array:
    """Return turn ẑ × arm."""
    return turn * np.array([-arm[1], arm[0]])


def contact_speeds(drive: Drive, swivel: Swivel, position: float, motion: Array) -> Array:
    """Return the mean speed along and across its wheels of a swivel's contacts (n_wheels, 2).

    ``motion`` is the base's twist and the swivel's rate; the wheels themselves stand still.
    """
    angle = angle_of(swivel, position)
    ahead, left = np.array([cos(angle), sin(angle)]), np.array([-sin(angle), cos(angle)])
    found = []
    for wheel in drive.carried(swivel):
        arm = swivel.trail * ahead + drive.wheels[wheel].lateral * left
        velocity = motion[:2] + cross(motion[2], np.array(swivel.pivot))
        velocity = velocity + cross(motion[2] + swivel.sign * motion[3], arm)
        found.append([ahead @ velocity, left @ velocity])
    return np.array(found)


@pytest.mark.parametrize("kind", TURNING)
def test_rows_are_the_contacts_velocities(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    """Along for each wheel, across for each swivel, the sum over those that share a row."""
    drive = drive_of(tmp_path, kind)
    rows = drive_rows(drive)
    lateral = {wheel: row for row, wheels in rows.across for wheel in wheels}
    positions, motion = rng.normal(size=len(drive.swivels)), rng.normal(size=3 + len(drive.swivels))
    found = rows.matrix.at(rows.matrix.turn(positions)) @ motion
    across = np.zeros(len(found))
    for i, (swivel, position) in enumerate(zip(drive.swivels, positions, strict=True)):
        own = np.append(motion[:3], motion[3 + i])
        speeds = contact_speeds(drive, swivel, float(position), own)
        carried = drive.carried(swivel)
        np.testing.assert_allclose(found[list(carried)], speeds[:, 0], atol=ROUNDING)
        if swivel.role != "follower":
            across[lateral[carried[0]]] += speeds[0, 1]
    if drive.has_axle:
        left = np.array([-sin(drive.heading), cos(drive.heading)])
        across[len(drive.wheels)] = left @ (motion[:2] + cross(motion[2], np.array(drive.point)))
    meeting = {s.joint for s in drive.followers}
    held = [row for row, wheels in rows.across if not wheels or meeting.isdisjoint(
        {drive.wheels[wheel].swivel for wheel in wheels[:1]})]  # fmt: skip
    np.testing.assert_allclose(found[held], across[held], atol=ROUNDING)


@pytest.mark.parametrize("kind", ["car-like", "steered", "twin"])
def test_a_followers_row_is_the_rate_at_which_axles_part(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    """Anywhere, not just where three axles meet, it is d/dt det(l₁, l₂, l₃)."""
    drive = drive_of(tmp_path, kind)
    rows = drive_rows(drive).matrix
    order = {swivel.joint: i for i, swivel in enumerate(drive.swivels)}
    meeting = np.flatnonzero(rows.harmonics[:, :, 3:].any(axis=(0, 2)))
    for _ in range(5):
        positions, rates = rng.normal(size=(2, len(drive.swivels)))
        A = rows.at(rows.turn(positions))
        parted = []
        for follower in drive.followers:
            held = [lateral_row(drive.point, drive.heading)] if drive.has_axle else []

            def apart(time: float) -> float:
                p = positions + time * rates  # noqa: B023 - called in this turn only
                lines = [
                    lateral_row(s.pivot, angle_of(s, p[order[s.joint]]))
                    for s in (*drive.steered, follower)  # noqa: B023
                ]
                return float(np.linalg.det(np.array(held + lines)))  # noqa: B023

            parted.append((apart(STEP) - apart(-STEP)) / (2 * STEP))
        np.testing.assert_allclose(A[meeting, 3:] @ rates, parted, atol=1e-8)
        np.testing.assert_array_equal(A[meeting, :3], 0.0)


@pytest.mark.parametrize("kind", TURNING)
def test_the_rate_is_that_of_the_rows_at_many_postures(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    matrix = drive_rows(drive_of(tmp_path, kind)).matrix
    positions, rates = rng.normal(size=(2, 4, matrix.G.shape[1]))
    many = matrix.rate(matrix.turn(positions), rates)
    ends = (matrix.at(matrix.turn(positions + s * rates)) for s in (STEP, -STEP))
    ahead, behind = ends
    np.testing.assert_allclose(many, (ahead - behind) / (2 * STEP), atol=1e-8)
    for k, (p, rate) in enumerate(zip(positions, rates, strict=True)):
        u = matrix.turn(p)
        np.testing.assert_allclose(matrix.at(u), matrix.at(matrix.turn(positions))[k])
        np.testing.assert_allclose(matrix.rate(u, rate), many[k], atol=ROUNDING)


def test_swivels_that_glide_keep_their_angle(tmp_path: Path, rng: np.random.Generator) -> None:
    """The row of one is its rate, its wheels' are empty; the others are as they were."""
    drive = drive_of(tmp_path, "casters")
    steered = replace(drive.swivels[0], role="steered")
    drive = replace(drive, type="steered", swivels=(steered, *drive.swivels[1:]))
    rolling, gliding = drive_rows(drive), drive_rows(drive, [s.joint for s in drive.idle_casters])
    positions = rng.normal(size=3)
    A, found = (rows.matrix.at(rows.matrix.turn(positions)) for rows in (rolling, gliding))
    held = sorted(gliding.gliding)
    wheels = [wheel for swivel in drive.swivels[1:] for wheel in drive.carried(swivel)]
    rows = [row for row in held if row not in wheels]
    assert len(rows) == 2
    assert set(held) == {*wheels, *rows}
    np.testing.assert_array_equal(found[wheels], 0.0)
    np.testing.assert_array_equal(found[rows], np.eye(6)[4:])
    others = [row for row in range(len(A)) if row not in held]
    np.testing.assert_allclose(found[others], A[others], atol=ROUNDING)


def test_a_fixed_base_has_no_rows() -> None:
    rows = drive_rows(Drive("fixed"))
    assert rows.matrix.constant.shape == (0, 3)
    assert rows.matrix.harmonics.shape == (0, 0, 3)
