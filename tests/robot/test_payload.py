"""A payload is in every derivation, and a run knows of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl.robot.build import build

CENTRE = (0.02, -0.01, 0.1)
INERTIA = ((0.02, 0.001, 0.0), (0.001, 0.03, 0.002), (0.0, 0.002, 0.025))


@pytest.fixture(scope="module")
def loaded() -> rpctl.Robot:
    robot = rpctl.load("mixed_chain")
    assert robot.end_effector is not None
    return rpctl.with_payload(robot, robot.end_effector, 2.5, com=CENTRE, inertia=INERTIA)


def test_the_model_is_that_of_the_file_with_the_load(loaded: rpctl.Robot) -> None:
    built = build(loaded.tree)
    q, v = loaded.random_configuration(np.random.default_rng(0)), np.ones(loaded.nv)
    for function in (pin.crba, pin.nonLinearEffects):
        args = (q,) if function is pin.crba else (q, v)
        ours, files = (function(m, m.createData(), *args) for m in (loaded.model, built))
        np.testing.assert_allclose(ours, files, atol=1e-12)


def test_energy_of_a_point_mass() -> None:
    """½ m |velocity|² of the load's centre is what the load adds."""
    robot = rpctl.load("paper")
    link = robot.end_effector
    assert link is not None
    loaded = rpctl.with_payload(robot, link, 1.7, com=CENTRE)
    assert loaded.mass == pytest.approx(robot.mass + 1.7)
    q, nu = robot.state((0.3, 0.1, 0.4), (0.5, -0.8), rates=dict.fromkeys(robot.joint_names, 0.6))
    J = rpctl.ReducedDynamics(robot).jacobian(q, link)
    R = robot.end_effector_pose(robot.model.createData(), q).rotation
    velocity = J[:3] @ nu + np.cross(J[3:] @ nu, R @ np.array(CENTRE))
    M, heavier = (rpctl.ReducedDynamics(each).inertia(q) for each in (robot, loaded))
    assert 0.5 * nu @ (heavier - M) @ nu == pytest.approx(0.5 * 1.7 * velocity @ velocity)


def test_a_second_load_adds_to_the_first(loaded: rpctl.Robot) -> None:
    assert loaded.end_effector is not None
    twice = rpctl.with_payload(loaded, loaded.end_effector, 1.0)
    assert twice.mass == pytest.approx(loaded.mass + 1.0)
    assert [each.mass for each in twice.loaded_with.payloads] == [2.5, 1.0]
    assert rpctl.verify(twice, samples=2).passed


def test_a_run_loads_its_payload_again(loaded: rpctl.Robot, tmp_path: Path) -> None:
    run = rpctl.track(loaded, "line", duration=0.01)
    again = rpctl.Run.load(run.save(tmp_path / "run.npz")).load_robot()
    q = loaded.configuration()
    np.testing.assert_allclose(
        rpctl.ReducedDynamics(again).inertia(q), rpctl.ReducedDynamics(loaded).inertia(q)
    )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"link": "nothing"}, "link 'nothing' is not known"),
        ({"mass": 0.0}, "payload's mass is 0"),
        ({"mass": float("nan")}, "payload's mass is nan"),
        ({"com": (0.0, 1.0)}, "give x, y, z in m"),
        ({"com": (0.0, 1.0, float("inf"))}, "give x, y, z in m"),
        ({"inertia": np.eye(2)}, "impossible for a rigid body"),
        ({"inertia": np.diag([1.0, 1.0, 2.1])}, "impossible for a rigid body"),
        ({"inertia": np.diag([-1.0, 1.0, 1.0])}, "impossible for a rigid body"),
        (
            {"inertia": [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]},
            "impossible for a rigid body",
        ),
        ({"inertia": np.full((3, 3), np.nan)}, "impossible for a rigid body"),
    ],
)
def test_wrong_payloads_are_refused(given: dict[str, Any], message: str) -> None:
    robot = rpctl.load("paper")
    with pytest.raises(rpctl.RpctlError, match=message):
        rpctl.with_payload(robot, **{"link": robot.end_effector, "mass": 1.0, **given})
