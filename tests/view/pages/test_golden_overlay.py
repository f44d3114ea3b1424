"""Efforts and ground reactions of a run that is known on paper, as a page holds them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rpctl import Robot, Run
from rpctl.view.pages.motion_data import contact_forces, overlay
from tests import golden as made
from tests.golden import COUNT, TIMES, part
from tests.runs import vary
from tests.view.readers import floats

FLOAT32 = 1e-6  # relative: what a page holds is rounded so


def test_efforts_tint_what_their_actuators_move(tricycle: Robot, golden: Run) -> None:
    """A frame tells the largest effort until the next one, of either sign."""
    late = part(golden, slice(0, COUNT), 2.0)
    for run in (golden, late):
        effort = overlay(tricycle, run, (run.t - run.t[0])[[0, 2, 5]])["effort"]
        names = [tricycle.model.names[joint] for joint in effort["joints"]]
        assert names == list(made.ACTUATORS)
        shares = floats(effort["share"]).reshape(3, 5)
        assert shares == pytest.approx(
            np.array(
                [  # the right wheel has no limit: of its peak, 50 N·m
                    [30 / 40, 50 / 50, 3 / 15, 16 / 20, 60 / 80],
                    [10 / 40, 10 / 50, 1.5 / 15, 8 / 20, 56 / 80],
                    [4 / 40, 3 / 50, 0.25 / 15, 4.5 / 20, 42 / 80],
                ]
            ),
            rel=FLOAT32,
        )


def test_stance_is_told_in_the_root_links_frame(tricycle: Robot, golden: Run) -> None:
    run = vary(golden, zmp=golden.q[:, :2] + np.array([0.05, -0.02]))
    stance = overlay(tricycle, run, TIMES[[1, 4]])["stance"]
    assert stance["height"] == pytest.approx(-0.05)
    assert np.array(stance["points"]) == pytest.approx(np.array(made.CONTACT_POINTS))
    corners = np.array(stance["points"])[stance["polygon"]]
    following = np.roll(corners, -1, axis=0)
    area = 0.5 * (corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum()
    assert area == pytest.approx(0.5 * 0.6 * 0.8)  # base times height, counter-clockwise
    pose = floats(stance["pose"]).reshape(-1, 3)
    assert pose == pytest.approx(np.array([[0.2, 0.03, 0.3], [0.8, 0.48, 1.2]]), rel=FLOAT32)
    for (x, y), theta in zip(floats(stance["zmp"]).reshape(-1, 2), (0.3, 1.2), strict=True):
        cos, sin = np.cos(theta), np.sin(theta)
        assert (x, y) == pytest.approx((0.05 * cos - 0.02 * sin, -0.05 * sin - 0.02 * cos))
    assert floats(stance["margin"]) == pytest.approx([0.25, 0.2])
    assert stance["largest"] == 120.0
    force = floats(stance["force"]).reshape(2, 3, 3)
    assert force[0] == pytest.approx(np.array([[0, 0, 81], [0, 0, 60], [0, 0, 119]]))
    pulled = np.array(run.log.contact_load)
    pulled[3, 1] = -500.0
    assert overlay(tricycle, vary(run, contact_load=pulled), TIMES)["stance"]["largest"] == 500.0
    blind = overlay(tricycle, vary(run, contact_load=np.empty((COUNT, 0))), TIMES[[1, 4]])
    assert "force" not in blind["stance"]
    assert blind["stance"]["margin"] == stance["margin"]


def test_forces_are_those_of_their_wheels(golden: Run) -> None:
    """Forward each wheel's own; to the left its share of its axle's, by its load."""
    run = vary(golden, quasi_velocities=("v", "omega", "swing_joint", "slide_joint"))
    first = contact_forces(run)[0]
    expected = np.array([[11.0, -4.0, 80.0], [-19.0, 2.0, 60.0], [31.0, 4.0, 120.0]])
    assert first == pytest.approx(expected)
    last = contact_forces(run)[-1]  # 11 N over 60 and 115 N; -14 N in front
    expected = np.array([[16, -14, 85], [-14, 11 * 60 / 175, 60], [36, 11 * 115 / 175, 115]])
    assert last == pytest.approx(expected)
    turned = contact_forces(vary(run, drive=replace(run.robot.drive, heading=0.5 * np.pi)))[0]
    expected = np.array([[4.0, 11.0, 80.0], [-2.0, -19.0, 60.0], [-4.0, 31.0, 120.0]])
    assert turned == pytest.approx(expected)
    lifted = np.array(run.log.contact_load)
    lifted[:, 1] = -5.0  # a contact that would pull bears no lateral force
    first = contact_forces(vary(run, contact_load=lifted))[0]
    assert first[:, 1] == pytest.approx([-4.0, 0.0, 6.0])
    assert first[:, 2] == pytest.approx([80.0, -5.0, 120.0])
    supported = np.column_stack(
        [run.log.contact_load, np.full(COUNT, 7.0)]
    )  # a ball bears load only
    fourth = contact_forces(
        vary(run, contact_load=supported, contacts=(*run.ground.contacts, "ball"))
    )
    assert fourth[0, 3] == pytest.approx([0.0, 0.0, 7.0])
    steered = contact_forces(golden)  # the log does not hold where its wheels point
    assert not steered[:, :, :2].any()
    assert steered[0, :, 2] == pytest.approx([80.0, 60.0, 120.0])
