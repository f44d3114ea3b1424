"""Standing at home: by hand, on a base whose centre of mass lies where the test puts it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import rpctl
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.standing import Standing, stand_at_home
from rpctl.equivalence.verify import Certificate
from rpctl.robot.model import Robot
from tests import urdf
from tests.proofs import failed
from tests.robots import write

HALF_TRACK, BEHIND = 0.25, 0.4  # m, of the wheels and of the caster
MASS = 10.0 + 2.0 + 5.0  # kg: base, wheels, arm
BALL = 'sphere radius="0.05"'


def on_two_wheels(
    folder: Path, arm_x: float, ball: str = BALL, name: str = "ball", effort: float = 50.0
) -> Robot:
    """Return a base of 10 kg over its axle, an arm of 5 kg 0.2 m ahead of its joint at arm_x."""
    parts = [urdf.link("base", urdf.inertial(10.0, (0.3, 0.3, 0.3)))]
    tyre = urdf.shape('cylinder radius="0.1" length="0.04"', rpy=urdf.ROUND)
    for wheel, y in (("left", HALF_TRACK), ("right", -HALF_TRACK)):
        parts.append(urdf.link(wheel, urdf.inertial(1.0, (5e-3, 5e-3, 5e-3)), tyre))
        limit = '<limit effort="20" velocity="20"/>'
        ends = "base", wheel
        parts.append(
            urdf.joint(f"{wheel}_joint", "continuous", ends, (0.0, y, 0.0), "0 1 0", limit)
        )
    if ball:
        parts.append(urdf.link(name, urdf.shape(ball)))
        place = (-BEHIND, 0.0, -0.05)
        parts.append(urdf.joint("ball_joint", "fixed", ("base", name), place))
    parts.append(urdf.link("arm", urdf.inertial(5.0, (0.1, 0.1, 0.1), xyz="0.2 0 0")))
    limit = urdf.limit(-0.5, 0.5, effort, 1.0)
    parts.append(
        urdf.joint("arm_joint", "revolute", ("base", "arm"), (arm_x, 0.0, 0.3), "0 1 0", limit)
    )
    return rpctl.load(write(folder, urdf.robot("base", *parts)), home=("zero",), root="planar")


def standing(robot: Robot) -> Standing:
    found = stand_at_home(ReducedDynamics(robot))
    assert found is not None
    return found


def verified(robot: Robot) -> tuple[Certificate, list[str]]:
    proof = rpctl.verify(robot, samples=1, engines=())
    assert not failed(proof)
    return proof, [check.name for check in proof.checks if not check.passed]


def test_the_margin_and_the_loads_are_those_of_statics(tmp_path: Path) -> None:
    robot = on_two_wheels(tmp_path, -0.7)
    behind = 5.0 * 0.5 / MASS
    aside = (BEHIND - behind) * HALF_TRACK / math.hypot(BEHIND, HALF_TRACK)
    found = standing(robot)
    assert found.margin == pytest.approx(min(behind, aside))
    on_ball = behind / BEHIND
    assert found.load == pytest.approx(MASS * 9.81 * min(on_ball, 0.5 * (1.0 - on_ball)))
    proof, void = verified(robot)
    assert proof.passed and not void
    assert proof.scope.margin == found.margin
    assert f"it stands, {found.margin:.3g} m from tipping at home" in proof.scope.line


def test_an_arm_ahead_of_the_axle_tips_it(tmp_path: Path) -> None:
    robot = on_two_wheels(tmp_path, 0.3)
    found = standing(robot)
    assert found.margin == pytest.approx(-5.0 * 0.5 / MASS)
    assert "0.147 m outside the support polygon of left_joint, right_joint, ball" in found.fault
    proof, void = verified(robot)
    assert not proof.passed and void == ["stands at home"]
    assert "which is not true" in proof.scope.line


def test_a_centre_of_mass_at_the_edge_is_not_enough(tmp_path: Path) -> None:
    """5 mm inside, where contacts are up to half a metre apart: 10 mm are asked for."""
    found = standing(on_two_wheels(tmp_path, -0.2 - 5e-3 * MASS / 5.0))
    assert found.margin == pytest.approx(5e-3)
    assert found.least == pytest.approx(0.02 * 2.0 * HALF_TRACK)
    assert "less than 0.01 m" in found.fault


def test_two_wheels_on_one_axle_do_not_stand(tmp_path: Path) -> None:
    proof, void = verified(on_two_wheels(tmp_path, -0.7, ball=""))
    assert void == ["stands at home"] and proof.scope.margin is None
    (row,) = (check for check in proof.checks if not check.passed)
    assert row.entry == "only left_joint, right_joint touch the ground, on one line"


@pytest.mark.parametrize(("name", "known"), [("rear_caster", False), ("tail", True)])
def test_a_mesh_that_is_missing_may_be_a_caster_by_its_name(
    tmp_path: Path, name: str, known: bool
) -> None:
    robot = on_two_wheels(tmp_path, -0.7, 'mesh filename="lost.stl"', name)
    found = standing(robot)
    assert bool(found.fault) is known and bool(found.unknown) is not known
    proof, void = verified(robot)
    assert bool(void) is known
    assert ("stands at home" in {row.name for row in proof.skipped}) is not known


def test_a_motor_too_weak_for_its_joint_is_no_proof(tmp_path: Path) -> None:
    """5 kg at 0.2 m take 9.81 N m."""
    _, void = verified(on_two_wheels(tmp_path, -0.7, effort=9.8))
    assert void == ["holds its joints at home"]
    assert not verified(on_two_wheels(tmp_path, -0.7, effort=9.82))[1]


def test_what_was_asked_for_and_cannot_be_done_is_not_passed(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    proof = rpctl.verify(on_two_wheels(tmp_path, 0.3), samples=1, trials=["contact"])
    (row,) = (check for check in failed(proof) if check.name == "motion on the ground")
    assert row.entry.endswith("it tips") and not proof.passed


def test_a_bicycle_is_held_upright_by_something_else() -> None:
    proof = rpctl.verify(rpctl.load("bicycle"), samples=1, engines=())
    assert (
        proof.passed
        and "a bicycle leans" in {row.name: row.note for row in proof.skipped}["stands at home"]
    )


@pytest.mark.parametrize(
    ("aside", "lifted"), [(0.3, "wheel_right_joint"), (-0.3, "wheel_left_joint")]
)
def test_a_law_balances_nothing_beyond_the_ends_of_an_axle(
    tmp_path: Path, aside: float, lifted: str
) -> None:
    """12 of 15.4 kg .3 m aside: .0338 m beyond a wheel .2 m aside; the other would have to pull.

    What it pulls with is 15.4 · 9.81 · .0338/.4 = 12.75 N.
    """
    text = (Path(__file__).parents[2] / "urdf/balancer.urdf").read_text()
    moved = text.replace('<origin xyz="0 0 0.22"/>', f'<origin xyz="0 {aside} 0.22"/>', 1)
    found = stand_at_home(ReducedDynamics(rpctl.load(write(tmp_path, moved))))
    assert found is not None and found.margin == pytest.approx(0.2 - 12.0 * 0.3 / 15.4)
    assert found.weakest == lifted and found.load == pytest.approx(-12.753, abs=1e-3)
    assert f"0.0338 m beyond wheel_{'left' if aside > 0.0 else 'right'}_joint" in found.fault
    proof = rpctl.verify(rpctl.load(write(tmp_path, moved)), samples=1)
    assert (
        not failed(proof)
        and not proof.passed
        and "which is not true: its centre" in proof.scope.line
    )
    with pytest.raises(rpctl.RpctlError, match=r"falls over.*: its centre of mass lies 0\.0338 m"):
        rpctl.track(rpctl.load(write(tmp_path, moved)), "line", duration=0.1, collisions=False)
    inside = stand_at_home(ReducedDynamics(rpctl.load("balancer")))
    assert inside is not None and not inside.fault and inside.unknown
