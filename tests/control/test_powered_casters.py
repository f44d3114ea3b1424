"""Closed loops on powered casters: effort shared by wheels and swivels, any law, any reference."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space

import rpctl
from rpctl import ReducedDynamics, Robot, summarize, track
from rpctl.arrays import Array
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS, read_law
from rpctl.drive.steering import trailing_positions
from rpctl.reference.motion import configuration_along
from rpctl.reference.named import reference_by_name
from rpctl.robot.vary import set_limits
from tests.grids import cells

OFF = (0.03, -0.04, 0.05)  # m, m, rad
PERIOD = 0.005  # s
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def robot() -> Robot:
    return rpctl.load("caster_drive")


def test_wheels_and_swivels_share_the_effort(robot: Robot, rng: np.random.Generator) -> None:
    """B τ is exact, and any other τ with the same B τ takes more of the limits."""
    limits = {name: float(rng.uniform(1.0, 40.0)) for name in robot.actuators}
    dynamics = ReducedDynamics(set_limits(robot, effort=limits))
    scale = np.array([limits[name] for name in robot.actuators])
    for _ in range(20):
        q, force = robot.random_configuration(rng), rng.normal(size=robot.dof)
        B, tau = dynamics.actuation(q), dynamics.efforts(q, force)
        assert B.shape == (5, 8)
        np.testing.assert_allclose(B @ tau, force, atol=ROUNDING * np.abs(B).max())
        others = null_space(B)
        assert others.shape[1] == 3
        np.testing.assert_allclose(others.T @ (tau / scale**2), 0.0, atol=1e-9)
        base = tau[[robot.actuators.index(s.joint) for s in robot.drive.swivels]]
        assert np.abs(base).min() > 0.0  # swivels bear a part, too


@pytest.mark.parametrize("twist", [(0.5, 0.0, 0.0), (-0.2, 0.3, 0.9), (0.0, 0.0, -1.1)])
def test_casters_that_trail_stand_still(robot: Robot, twist: tuple[float, float, float]) -> None:
    """Along a steady twist no swivel turns, and a caster off its place comes back to it."""
    names = [swivel.joint for swivel in robot.drive.swivels]
    index = [robot.velocity_index(name) for name in names]
    dynamics, nu = ReducedDynamics(robot), np.array([*twist, 0.0, 0.0])

    def rates(positions: Array) -> Array:
        q = robot.configuration(joints=dict(zip(names, positions, strict=True)))
        return np.asarray((dynamics.basis(q) @ nu)[index])

    place = trailing_positions(robot.drive, np.array(twist))
    np.testing.assert_allclose(rates(place), 0.0, atol=1e-12)
    assert (rates(place + 0.1) < 0.0).all()
    assert (rates(place - 0.1) > 0.0).all()


@pytest.mark.parametrize(("name", "heading"), [("line", 0.0), ("reverse", np.pi)])
def test_a_run_starts_with_casters_that_trail(robot: Robot, name: str, heading: float) -> None:
    reference = reference_by_name(robot, name)
    q = configuration_along(robot, reference(0.0))
    angles = [robot.joint_position(q, swivel.joint) for swivel in robot.drive.swivels]
    np.testing.assert_allclose(np.cos(angles), np.cos(heading), atol=1e-12)
    run = track(robot, name, duration=0.02, control_period=PERIOD)
    np.testing.assert_array_equal(run.q[0], q)
    first = run.q_ref[0]
    wanted = [robot.joint_position(first, swivel.joint) for swivel in robot.drive.swivels]
    np.testing.assert_allclose(wanted, angles)


LAWS = [(k, "paper") for k in KINEMATIC_LAWS] + [
    ("unified", d) for d in DYNAMIC_LAWS if d != "paper"
]

SLOW = {("horizon", "paper")}


@pytest.mark.parametrize(("kinematic", "dynamic"), cells(LAWS, slow=SLOW))
def test_every_law_tracks(robot: Robot, kinematic: str, dynamic: str) -> None:
    laws = read_law("kinematic", kinematic), read_law("dynamic", dynamic)
    run = track(
        robot,
        "eight",
        duration=4.0,
        initial_error=OFF,
        kinematic=laws[0],
        dynamic=laws[1],
        control_period=2.0 * PERIOD,
    )
    figures = summarize(run)
    assert figures.final_base_error < 1e-3
    assert figures.final_end_effector_error is not None
    assert figures.final_end_effector_error < 1e-3
    assert not figures.limits_violated
    assert figures.energy_residual < 1e-6
