"""Payload, scaled losses and slope: what they make of the simulated robot, by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, Robot, RpctlError
from rpctl.dynamics.ground_reaction import find_contacts, ground_reaction
from rpctl.errors import UnknownNameError
from rpctl.robot.variation import CarriedLoad
from tests.robots import SET_A, add_losses, ball, platform, write

G = 9.81
MASS = SET_A["m_c"] + 2.0 * SET_A["m_w"]


@pytest.fixture
def standing(tmp_path: Path) -> Robot:
    """The platform on two casters, before and behind."""
    casters = ball(0.8) + ball(-0.4, name="hind")
    return rpctl.load(write(tmp_path, platform(SET_A, extra=casters)))


def test_a_payload_pulls_at_its_lever(tiago: Robot) -> None:
    """Its weight times the shift of its centre of mass for each joint's position, by differences;
    and the controller knows nothing of it."""
    plant = Plant(payload=CarriedLoad(mass=2.0, com=(0.1, 0.02, -0.05)))
    loaded = plant.simulated_robot(tiago)
    assert plant.known_robot(tiago) is tiago
    q = tiago.configuration(joints={"arm_1_joint": 0.4, "arm_2_joint": -0.3, "arm_4_joint": 1.2})

    def height(shift: dict[str, float]) -> float:
        at = q.copy()
        for name, way in shift.items():
            tiago.set_joint(at, name, tiago.joint_position(q, name) + way)
        place = tiago.end_effector_pose(tiago.model.createData(), at)
        return float(place.act(np.array([0.1, 0.02, -0.05]))[2])

    still = np.zeros(tiago.dof)
    more = ReducedDynamics(loaded).bias(q, still) - ReducedDynamics(tiago).bias(q, still)
    eps = 1e-5
    for k, name in enumerate(tiago.quasi_velocities):
        if name in tiago.joint_names:
            lever = (height({name: eps}) - height({name: -eps})) / (2.0 * eps)
            assert more[k] == pytest.approx(2.0 * G * lever, abs=1e-7)
    assert loaded.mass - tiago.mass == pytest.approx(2.0)


def test_a_payload_is_on_a_link(standing: Robot) -> None:
    with pytest.raises(RpctlError, match="has no end effector to carry the payload"):
        Plant(payload=CarriedLoad(mass=1.0)).simulated_robot(standing)
    with pytest.raises(UnknownNameError, match="link 'bas' is not known"):
        Plant(payload=CarriedLoad("bas", 1.0)).simulated_robot(standing)
    assert Plant(payload=CarriedLoad("bas")).simulated_robot(standing) is standing
    with pytest.raises(RpctlError, match="mass is -1; give 0 or more, in kg"):
        CarriedLoad("base", -1.0)
    with pytest.raises(RpctlError, match=r"com is .*; give x, y, z in m"):
        CarriedLoad("base", 1.0, (0.0, 0.0))  # type: ignore[arg-type]


def test_losses_are_scaled_but_not_those_that_the_plant_adds(paper: Robot) -> None:
    wheel, joint = paper.actuators[0], paper.joint_names[0]
    lossy = add_losses(paper, {wheel: 0.3, joint: 0.1}, {joint: 0.2})
    plant = Plant(losses=3.0, damping={wheel: 1.0}, joint_friction={joint: 0.5})
    found = plant.simulated_robot(lossy).losses
    assert found is not None
    index = {name: paper.velocity_index(name) for name in (wheel, joint)}
    assert found.damping[index[wheel]] == pytest.approx(1.9)
    assert found.damping[index[joint]] == pytest.approx(0.3)
    assert found.friction[index[joint]] == pytest.approx(1.1)
    assert plant.known_robot(lossy) is lossy
    assert Plant(losses=0.0).simulated_robot(lossy).losses is None
    assert Plant(losses=3.0).simulated_robot(paper) is paper


@pytest.mark.parametrize("heading", [0.0, 0.9])
def test_what_holds_a_robot_on_a_slope(standing: Robot, heading: float) -> None:
    """m g sin of the slope along the robot, by its wheels; m g cos on the ground, and loads whose
    moments balance those of the weight: as of a rigid body by hand, not by Pinocchio."""
    slope = (0.11, -0.07)
    dynamics = ReducedDynamics(Plant(slope=slope).simulated_robot(standing))
    q, still = standing.configuration(1.0, 2.0, heading), np.zeros(2)
    tau = dynamics.efforts(q, dynamics.bias(q, still))
    up = np.array([math.sin(slope[0]), math.sin(slope[1]), 0.0])
    up[2] = math.sqrt(1.0 - up @ up)
    cos, sin = math.cos(heading), math.sin(heading)
    along, left = cos * up[0] + sin * up[1], cos * up[1] - sin * up[0]
    yaw = SET_A["m_c"] * SET_A["d"] * G * left / SET_A["b"]  # held by the wheels, one against one
    expected = 0.5 * SET_A["r"] * (MASS * G * along + np.array([-yaw, yaw]))
    np.testing.assert_allclose(tau, expected, rtol=1e-9)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    found = ground_reaction(dynamics, contacts, q, still, tau)
    np.testing.assert_allclose(found.force, MASS * G * up, rtol=1e-9, atol=1e-9)
    assert found.load.sum() == pytest.approx(MASS * G * up[2])
    assert found.lateral.sum() == pytest.approx(MASS * G * left)
    centre = SET_A["m_c"] * SET_A["d"] / MASS
    height = (SET_A["m_c"] * 0.2 + 2.0 * SET_A["m_w"] * SET_A["r"]) / MASS
    # The weight's line meets the ground there, seen from the root link.
    local = [centre - height * along / up[2], -height * left / up[2]]
    zmp = [1.0 + cos * local[0] - sin * local[1], 2.0 + sin * local[0] + cos * local[1]]
    np.testing.assert_allclose(found.zmp, zmp, rtol=1e-9)
    moments = found.load @ contacts.points / found.load.sum()
    np.testing.assert_allclose(moments, local, rtol=1e-9, atol=1e-12)


def test_a_slope_is_one(paper: Robot) -> None:
    for slope in ((2.0, 0.0), (1.2, 1.2), (0.1,), (math.nan, 0.0)):
        with pytest.raises(RpctlError, match="slope"):
            Plant(slope=slope)  # type: ignore[arg-type]
    assert Plant(slope=(0.0, 0.0)).simulated_robot(paper) is paper
