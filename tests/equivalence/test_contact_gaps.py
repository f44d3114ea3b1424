"""The rows of the contact trial: each fails alone, at the band that is stated."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from rpctl import ReducedDynamics, Robot
from rpctl.dynamics.ground_reaction import find_contacts
from rpctl.equivalence import mujoco_engine
from rpctl.equivalence.contact.trial import ContactMotion, ContactTrial, Gap, gaps

if not mujoco_engine.installed():
    pytest.skip("MuJoCo is optional", allow_module_level=True)

G = 9.81


def moved(motion: ContactMotion, **added: Any) -> ContactMotion:
    """Return a motion to which something is added at its last sample."""
    parts = {name: values.copy() for name, values in vars(motion).items()}
    for name, amount in added.items():
        parts[name][-1] += amount
    return ContactMotion(**parts)


def rows_of(
    robot: Robot, reduced: ContactMotion, engine: ContactMotion, joints: tuple[str, ...]
) -> list[Gap]:
    contacts = find_contacts(ReducedDynamics(robot))
    assert contacts is not None
    return list(gaps(robot, contacts, joints, reduced, engine))


@pytest.mark.parametrize(
    ("row", "part", "direction", "scale", "entry"),
    [
        ("path", "pose", [0.6, 0.8, 0.0], 1e-3, ""),
        ("heading", "pose", [0.0, 0.0, 1.0], 1e-3, ""),
        ("force of the ground", "force", [0.0, -1.0, 0.0], 1.0, "y"),
        ("zero-moment point", "zmp", [-1.0, 0.0], 1e-3, "x"),
        ("wheel loads", "load", [0.0, 0.0, 1.0], 1.0, "base_link"),
        ("joint forces", "efforts", [0.0, 1.0], 1.0, "arm_prismatic_joint"),
        ("joint torques", "efforts", [-1.0, 0.0], 1.0, "arm_revolute_joint"),
    ],
)
def test_every_row_fails_alone_at_its_band(
    paper: Robot,
    trial: ContactTrial,
    row: str,
    part: str,
    direction: list[float],
    scale: float,
    entry: str,
) -> None:
    engine = trial.engine
    exact = {check.name: check for check in rows_of(paper, engine, engine, trial.joints)}
    assert all(check.residual == 0.0 for check in exact.values())
    gap = 1.5 * exact[row].band
    added = {part: gap * np.array(direction)}
    if row == "path":
        added["zmp"] = added["pose"][:2]  # the robot is elsewhere, and so is what bears it
    found = {c.name: c for c in rows_of(paper, moved(engine, **added), engine, trial.joints)}
    assert [name for name, check in found.items() if not check.passed] == [row]
    assert found[row].residual == pytest.approx(1.5)
    assert found[row].gap == pytest.approx(gap)
    assert (found[row].entry, found[row].sample) == (entry, len(engine.pose) - 1)


def test_bands_are_those_that_are_stated(paper: Robot, trial: ContactTrial) -> None:
    """Of 1 m and .8 rad a quarter of a percent more than 1 mm and 1 mrad, of 38 kg half a one."""
    bands = {check.name: check.band for check in trial.checks}
    assert bands["path"] == pytest.approx(3.5e-3, rel=1e-3)
    assert bands["heading"] == pytest.approx(3e-3, rel=1e-3)
    assert bands["force of the ground"] == pytest.approx(5e-3 * 38.0 * G, rel=1e-6)
    assert bands["wheel loads"] == bands["force of the ground"]
    largest = np.abs(trial.engine.efforts).max(axis=0)  # revolute, prismatic
    floor = 1e-6 * 38.0 * G
    assert bands["joint forces"] == pytest.approx(0.01 * largest[1] + floor)
    assert bands["joint torques"] == pytest.approx(0.01 * largest[0] + 1.5 * floor)


def test_what_is_no_number_fails(paper: Robot, trial: ContactTrial) -> None:
    lost = moved(trial.engine, pose=np.nan)
    found = {c.name: c for c in rows_of(paper, lost, trial.engine, trial.joints)}
    assert math.isinf(found["path"].residual)
    assert not found["path"].passed
    assert found["path"].to_dict()["residual"] is None
    json.dumps(found["path"].to_dict(), allow_nan=False)


def test_a_heading_near_half_a_turn_wraps(paper: Robot, trial: ContactTrial) -> None:
    turned = moved(trial.engine, pose=np.array([0.0, 0.0, 2.0 * math.pi]))
    found = {c.name: c for c in rows_of(paper, turned, trial.engine, trial.joints)}
    assert found["heading"].gap == pytest.approx(0.0, abs=1e-12)
