"""The rows of rolling on the file's measurement: a contact behind any chain of upright joints."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.drive.drive import Swivel
from rpctl.equivalence.file_drive import read
from rpctl.equivalence.rolling_rows import LEFT, FileRows
from rpctl.equivalence.tree import FLOATS, Tree
from rpctl.equivalence.wheel_slip import FileMotion
from tests.drive.drive_cases import body, xml
from tests.robots import write
from tests.vehicles import KINDS, vehicle

HITCHES = {"first": (-0.3, 0.1, 1.0), "second": (-0.8, 0.15, -1.0)}  # x, y (m), sign of the axis
PLACE = (-0.4, 0.05)  # of a contact, ahead and to the left of the second one


def chain(folder: Path) -> tuple[Robot, Tree, Swivel]:
    """Return a differential drive with a joint behind a joint, its tree, and the last of them.

    Both turn about upright axes, which the drive's record is made to know as swivels.
    """
    parts = body()
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts.wheel(side, "base", f"0 {y} 0.1")
    carrier, at = "base", np.zeros(2)
    for name, (x, y, sign) in HITCHES.items():
        parts.link(f"{name}_link", 2.0)
        origin = " ".join(map(repr, ((x, y) - at).tolist()))
        parts.joint(name, "revolute", (carrier, f"{name}_link"), f"{origin} 0.1", f"0 0 {sign}")
        carrier, at = f"{name}_link", np.array([x, y])
    robot = rpctl.load(write(folder, xml(parts)), drive="differential")
    reading = read(robot)
    swivels = tuple(
        Swivel(name, "caster", (x, y), heading=0.2, sign=sign, parent=parent)
        for (name, (x, y, sign)), parent in zip(HITCHES.items(), (None, "first"), strict=True)
    )
    drive = dataclasses.replace(reading.drive, swivels=swivels)
    return robot, Tree(robot, FLOATS, dataclasses.replace(reading, drive=drive)), swivels[-1]


@pytest.mark.parametrize("aside", [0.0, LEFT, 0.7])
def test_a_contact_behind_a_joint_behind_a_joint(
    tmp_path: Path, rng: np.random.Generator, aside: float
) -> None:
    """Its velocity by twist and rates is that of the same point walked to through the file."""
    robot, tree, last = chain(tmp_path)
    raw, rates = tree.reading.raw, dict(zip(HITCHES, (0.9, -0.4), strict=True))
    positions, twist = dict(zip(HITCHES, (0.5, 1.1), strict=True)), np.array([0.7, -0.2, 0.6])
    poses = raw.poses(positions)
    cos, sin = math.cos(last.heading), math.sin(last.heading)
    place = (cos * PLACE[0] - sin * PLACE[1], sin * PLACE[0] + cos * PLACE[1], -0.1, 1.0)
    motion = FileMotion(raw, tree.reading.drive, positions, twist, rates, poses)
    point = (poses["second_link"] @ place)[:3]
    angle = 0.2 + 0.5 - 1.1 + aside  # the second one's axis points down
    wanted = np.array([math.cos(angle), math.sin(angle), 0.0]) @ motion.velocity(
        "second_link", point
    )
    v = np.zeros(robot.nv)
    v[:3] = twist
    for name, rate in rates.items():
        v[robot.velocity_index(name)] = rate
    rows = FileRows(robot, tree)
    rows.positions = positions
    assert rows.contact(last, PLACE, aside) @ v == pytest.approx(wanted, rel=1e-14)


def assert_rates(robot: Robot, rows: FileRows, rng: np.random.Generator) -> None:
    """Ȧ v is the difference of A over a short while along v, times v."""
    q, v, step = robot.random_configuration(rng), rng.normal(size=robot.nv), 1e-6
    ahead, behind = (
        rows.at(pin.integrate(robot.model, q, side * step * v), v)[0] for side in (1.0, -1.0)
    )
    drift = rows.at(q, v)[1]
    assert np.abs((ahead - behind) @ v / (2.0 * step) - drift).max() < 1e-7 * np.abs(v).max() ** 2


def test_the_drift_of_a_chain_is_the_rate_of_its_rows(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    robot, tree, _ = chain(tmp_path)
    rows = FileRows(robot, tree)
    assert_rates(robot, rows, rng)
    assert np.abs(rows.at(robot.random_configuration(rng), np.ones(robot.nv))[1]).max() > 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_the_rows_of_any_drive(tmp_path: Path, rng: np.random.Generator, kind: str) -> None:
    """S ν fulfils them, and so does its acceleration; they leave no other motion."""
    robot = rpctl.load(write(tmp_path, vehicle(kind)))
    rows, dynamics = FileRows(robot, Tree(robot, FLOATS)), ReducedDynamics(robot)
    assert_rates(robot, rows, rng)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    S, v_dot = dynamics.basis(q), dynamics.basis_drift(q, nu)
    A, drift = rows.at(q, S @ nu)
    assert np.linalg.matrix_rank(A, tol=1e-9) == robot.nv - robot.dof
    np.testing.assert_allclose(A @ S, 0.0, atol=1e-13 * np.abs(S).max())
    size = max(1.0, np.abs(v_dot).max())
    np.testing.assert_allclose(A @ v_dot, -drift, atol=1e-12 * size)
