"""Robots built otherwise than drawn: their models, their files and their wheels agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError
from rpctl.robot.build import build
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.variation import LINK, BuiltNumbers, Variation, pseudo_inertia, vary
from tests import closed_form, urdf
from tests.proofs import failed
from tests.robots import SET_A, cargo, platform, write


def everything(robot: Robot) -> Variation:
    """Return a variation of all that a robot has."""
    links = [link.name for link in robot.description.links if link.mass]
    return Variation(
        masses={"*": 1.1, links[-1]: 0.7},
        centres={links[0]: (0.01, -0.02, 0.03), links[-1]: (0.0, 0.01, 0.0)},
        inertias={links[len(links) // 2]: 1.3},
        radii={"*": 1.05, robot.drive.wheels[0].joint: 1.04},
        track=1.1,
        damping={"*": 0.3},
    )


@pytest.mark.parametrize("name", ["casters", pytest.param("mecanum", marks=pytest.mark.slow)])
def test_a_varied_robot_is_verified(name: str) -> None:
    robot = rpctl.load(name)
    varied = vary(robot, everything(robot))
    engines = ("mujoco",) if name == "casters" else ()
    assert rpctl.verify(varied, samples=1, engines=engines).passed
    faults = [
        replace(varied, description=robot.description),  # a file that knows of nothing
        replace(varied, model=robot.model),
        replace(varied, drive=replace(varied.drive, declared=())),
        replace(varied, drive=replace(varied.drive, ground=robot.drive.ground)),
        replace(varied, losses=robot.losses),
    ]
    assert not any(rpctl.verify(fault, samples=1, engines=()).passed for fault in faults)


def test_the_model_is_that_of_the_file(tiago: Robot) -> None:
    """Locked joints, fixed links and bodies of many links included."""
    links = [link.name for link in tiago.description.links if link.mass]
    fixed = [name for name in links if "hand" in name]
    assert len(fixed) > 3
    varied = vary(
        tiago,
        Variation(
            masses={"*": 1.2, "hand_*": 2.0},
            centres={"hand_*": (0.01, 0.02, 0.0)},
            inertias={"base*": 0.5},
        ),
    )
    built = build(varied.tree)
    for ours, files in zip(varied.model.inertias, built.inertias, strict=True):
        np.testing.assert_allclose(ours.matrix(), files.matrix(), rtol=1e-12, atol=1e-12)
    assert varied.mass > 1.2 * tiago.mass
    assert tiago.model.inertias[1].mass < varied.model.inertias[1].mass


def test_masses_radii_and_track_are_those_on_paper(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """M of the closed form, with the numbers changed in it."""
    varied = vary(paper, Variation(masses={"*": 1.5}, radii={"wheel_*": 1.2}, track=1.1))
    names = ("m0", "J0", "m_w", "I_s", "I_d", "m1", "J1", "m2", "J2")
    for name in names:
        monkeypatch.setattr(closed_form, name, 1.5 * getattr(closed_form, name))
    r = 1.2 * closed_form.r
    monkeypatch.setattr(closed_form, "r", r)
    theta, eta = 0.7, 0.6
    M = closed_form.inertia(theta, eta)
    # The wheels stay where they are and turn as those of a wider robot.
    M[1, 1] += 2 * closed_form.I_s * (1.1**2 - 1.0) * closed_form.b**2 / r**2
    q = varied.configuration(joints=dict(zip(varied.joint_names, (theta, eta), strict=True)))
    dynamics = ReducedDynamics(varied)
    np.testing.assert_allclose(dynamics.inertia(q), M, rtol=1e-12, atol=1e-12)
    b = 1.1 * closed_form.b
    np.testing.assert_allclose(
        dynamics.actuation(q)[:2, :2], [[1 / r, 1 / r], [-b / r, b / r]], rtol=1e-12
    )
    assert varied.drive.track == pytest.approx(2 * b)
    assert varied.drive.ground == pytest.approx(paper.drive.ground - 0.2 * 0.15)
    assert paper.drive.wheels[0].radius == pytest.approx(0.15)


def test_many_robots_at_once_are_each_alone(mixed_chain: Robot, rng: np.random.Generator) -> None:
    names = BuiltNumbers(mixed_chain, [Variation()]).names[LINK]
    others = [
        Variation(
            masses=dict(zip(names, rng.uniform(0.5, 2.0, len(names)).tolist(), strict=True)),
            centres={name: tuple(rng.normal(size=3).tolist()) for name in names},
            inertias=dict(zip(names, rng.uniform(0.5, 2.0, len(names)).tolist(), strict=True)),
        )
        for _ in range(3)
    ]
    built = BuiltNumbers(mixed_chain, others)
    for k, other in enumerate(others):
        np.testing.assert_array_equal(BuiltNumbers(mixed_chain, [other]).bodies[0], built.bodies[k])
        alone = vary(mixed_chain, other)
        bodies = [pseudo_inertia(each) for each in list(alone.model.inertias)[ROOT_JOINT:]]
        np.testing.assert_allclose(built.bodies[k], bodies, rtol=1e-12, atol=1e-12)
        of_file = build(alone.tree)
        q = alone.random_configuration(rng)
        M, files = (pin.crba(each, each.createData(), q) for each in (alone.model, of_file))
        np.testing.assert_allclose(M, files, rtol=1e-12, atol=1e-10)


def test_estimates_stay_estimates(tmp_path: Path) -> None:
    """A link without <inertial> has none afterwards in the user's text."""
    box = urdf.link("box", urdf.shape('box size="0.2 0.2 0.1"'))
    joint = urdf.joint("box_joint", "fixed", ("base", "box"), "0.1 0 0.3")
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=f"{box}\n{joint}")), density=500.0)
    varied = vary(robot, Variation(masses={"box": 1.5}, centres={"box": (0.0, 0.1, 0.0)}))
    assert varied.description.link["box"].estimated
    assert varied.mass == pytest.approx(robot.mass + 0.5 * 500.0 * 0.004)
    assert varied.description.raw.count(b"<inertial") == robot.description.raw.count(b"<inertial")
    assert not failed(rpctl.verify(varied, samples=1, engines=()))


@pytest.mark.parametrize(
    ("variation", "message"),
    [
        (lambda: Variation(masses={"leg_*": 1.1}), r"link with a mass 'leg_\*' is not known"),
        (lambda: Variation(inertias={"leg": 1.1}), "link with a mass 'leg' is not known"),
        (lambda: Variation(centres={"leg": (0.0, 0.0, 0.0)}), "link with a mass 'leg'"),
        (lambda: Variation(radii={"base": 1.1}), "wheel 'base' is not known"),
        (lambda: Variation(damping={"base": 1.1}), "joint 'base' is not known"),
        (lambda: Variation(masses={"base": 0.0}), r"masses of base is 0; give a positive number"),
        (lambda: Variation(inertias={"base": -1.0}), "inertias of base is -1; give a positive"),
        (lambda: Variation(radii={"*": float("nan")}), r"radii of \* is nan; give a positive"),
        (lambda: Variation(track=-0.1), "track is -0.1; give a positive number"),
        (lambda: Variation(damping={"*": -0.1}), r"damping of \* is -0.1; give 0 or more"),
        (lambda: Variation(centres={"base": (0.0, 1.0)}), "give x, y, z in m"),  # type: ignore[dict-item]
        (lambda: Variation(centres={"base": (0.0, 1e4, 0.0)}), "centres of base is 10000"),
        (lambda: Variation(radii={"left_joint": 0.8}), 'wheel "left_joint" would not reach'),
        (lambda: Variation(radii={"left_joint": 1.2}), 'wheel "right_joint" would not reach'),
    ],
)
def test_what_no_robot_can_be_is_refused(
    variation: Callable[[], Variation], message: str, tmp_path: Path
) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    with pytest.raises(RpctlError, match=message):
        vary(robot, variation())


def test_a_track_needs_wheels_beside_the_middle_line() -> None:
    with pytest.raises(RpctlError, match="track: no wheel that the root link holds"):
        vary(rpctl.load("bicycle"), Variation(track=1.1))


def test_inertias_without_dynamics_are_refused(tmp_path: Path) -> None:
    """A negative moment that another link hides is laid open where that becomes lighter."""
    text = platform(SET_A, extra=cargo(4.0, 0.0, 0.0, 0.5))
    before, found, after = text.rpartition('izz="0"')
    assert found
    robot = rpctl.load(write(tmp_path, f'{before}izz="-10"{after}'))
    with pytest.raises(RpctlError, match=r"not positive definite .*; vary them by less"):
        vary(robot, Variation(inertias={"cargo": 20.0}))
