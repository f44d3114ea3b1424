"""Trailers against a published kinematic model, and against what every chain of them obeys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl.drive import rows
from rpctl.drive.drive import Drive, Swivel
from rpctl.dynamics.rolling import constraint, find_rolling
from rpctl.robot.model import Robot
from tests import urdf
from tests.proofs import failed
from tests.vehicles import Parts, vehicle

WHEELBASE, TRAILER = 3.6, 8.1  # m: vehicle 4 of commonroad-vehicle-models 3.0.2, a semi-trailer
# Its unit test of derivatives: state (x, y, steering angle, speed, yaw, hitch angle) and rates.
STATE = (
    *(3.9579422297936526, 0.0391650102771405, 0.0378491427211811),
    *(16.3546957860883566, 0.0294717351052816, 0.0294717351052816),
)
RATES = (
    *(16.3475935934250209, 0.4819314886013121, 0.1500000000000000),
    *(5.501539201758522, 0.1720297150523055, -0.23152742969444276),
)


@pytest.fixture(scope="module")
def truck(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A single-track truck whose hitch is on its rear axle."""
    parts = Parts([])
    parts.link("base", 25.0, com="1.8 0 1")
    parts.wheel("rear", "base", "0 0 0.1")
    parts.swivel("steer", f"{WHEELBASE} 0 0.3", "continuous")
    parts.wheel("front", "steer_fork", "0 0 -0.2")
    parts.link("semi_trailer", 50.0, com="-4 0 1")
    hinge = urdf.limit(-1.5, 1.5, 0, 6)
    parts.xml.append(
        urdf.joint("hitch", "revolute", ("base", "semi_trailer"), "0 0 0.5", "0 0 1", hinge)
    )
    parts.wheel("left", "semi_trailer", f"{-TRAILER} 1 -0.4")
    parts.wheel("right", "semi_trailer", f"{-TRAILER} -1 -0.4")
    path = tmp_path_factory.mktemp("truck") / "truck.urdf"
    path.write_text(parts.text("truck"))
    return rpctl.load(path)


def test_rates_are_those_of_the_published_single_track_model(truck: Robot) -> None:
    """To 14 digits, as that package tests its own."""
    x, y, steering, speed, yaw, hitch = STATE
    q, nu = truck.state((x, y, yaw), (speed, RATES[2]), joints={"steer": steering, "hitch": hitch})
    v = rpctl.ReducedDynamics(truck).basis(q) @ nu
    cos, sin = np.cos(yaw), np.sin(yaw)
    found = [cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], v[truck.velocity_index("steer")]]
    found += [v[2], v[truck.velocity_index("hitch")]]
    expected = [RATES[k] for k in (0, 1, 2, 4, 5)]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-14)


def test_what_pulls_decides_how_trailers_roll(tmp_path: Path, rng: np.random.Generator) -> None:
    """No axle of the chain moves sideways, and all wheels roll, seen by differences of poses."""
    path = tmp_path / "trailers.urdf"
    path.write_text(vehicle("trailers"))
    robot = rpctl.load(path)
    assert [s.joint for s in robot.drive.trailers] == ["first_hitch", "second_hitch"]
    assert [s.parent for s in robot.drive.swivels] == [None, None, "first_hitch", "second_hitch"]
    assert not {"first_hitch", "second_hitch"} & {*robot.actuators, *robot.quasi_velocities}
    dynamics, rolling = rpctl.ReducedDynamics(robot), find_rolling(robot)
    places = {"first_body": (-0.7, 0.01), "second_body": (-0.5, 0.01)}  # of their axles' middles
    for _ in range(5):
        q = robot.random_configuration(rng)
        v = dynamics.basis(q) @ rng.normal(size=robot.dof)
        np.testing.assert_allclose(constraint(rolling, q) @ v, 0.0, atol=1e-12)
        for link, (x, y) in places.items():
            ends = [_place(robot, robot_moved(robot, q, s * v), link, x, y) for s in (1e-6, -1e-6)]
            moved = (ends[0][0] - ends[1][0]) / 2e-6
            left = _place(robot, q, link, x, y)[1]
            assert abs(moved @ left) < 1e-8 * max(1.0, float(np.abs(v).max()))


@pytest.fixture(scope="module")
def train(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A car that pulls two trailers, the last of which has a caster."""
    path = tmp_path_factory.mktemp("train") / "trailers.urdf"
    path.write_text(vehicle("trailers"))
    return rpctl.load(path)


def test_the_certificate_proves_trailers(train: Robot) -> None:
    assert not failed(rpctl.verify(train, samples=3))


@pytest.mark.parametrize("fault", ["turns with its carrier", "hangs on the root link"])
def test_the_certificate_finds_wrong_rows(
    train: Robot, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows that forget how a carrier turns, or that there is one, agree with no derivation."""
    right = rows.swivel_motion

    def wrong(drive: Drive, swivel: Swivel) -> rows.SwivelMotion:
        if fault == "hangs on the root link":
            return (
                right(drive, replace(swivel, parent=None))
                if swivel.parent
                else right(drive, swivel)
            )
        motion = right(drive, swivel)
        forward = motion.forward.copy()
        forward[:, 1:, 3:] = 0.0
        return replace(motion, forward=forward)

    monkeypatch.setattr(rows, "swivel_motion", wrong)
    names = {(check.name, check.against) for check in failed(rpctl.verify(train, samples=2))}
    assert {
        ("reduced inertia M", "Gibbs-Appell"),
        ("wheels' contact at S ν", "the file's shapes"),
    } <= names


def robot_moved(robot: Robot, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return q moved along v."""
    return np.asarray(pin.integrate(robot.model, q, v))


def _place(
    robot: Robot, q: np.ndarray, link: str, x: float, y: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return a place of a link (3,) in the world, and the direction to the link's left."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    pose = data.oMf[robot.model.getFrameId(link)]
    return pose.act(np.array([x, y, 0.0])), pose.rotation[:, 1]
