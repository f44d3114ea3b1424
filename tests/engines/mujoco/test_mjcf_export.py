"""Exported files: they are the robot to the last digit, or they are not written."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree

import rpctl
from rpctl.engines.mujoco import export, mjcf_writer
from rpctl.engines.mujoco.equations import as_plain, compare_with_witness, from_plain, take_witness
from rpctl.engines.mujoco.export import prepare
from rpctl.engines.mujoco.mjcf_writer import draw
from rpctl.simulation.mjcf_file import check_mjcf, export_mjcf
from tests import urdf
from tests.engines.mujoco.exports import export_quickly, quickly
from tests.grids import cells
from tests.robots import SET_A, ball, platform, write

mujoco = pytest.importorskip("mujoco")

CATALOGUE = ("paper", "mixed_chain", "skid_steer", "mecanum", "car", "tricycle", "bicycle",
             "swerve", "twin_casters", "casters", "caster_drive", "omni", "tiago", "tiago_no_hand",
             "tiago_dual", "tiago_pro")  # fmt: skip
TELLING = ("swerve",)  # ties that no file has
TETRAHEDRON = """solid t
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 0 0.2 0
vertex 0.1 0 0
endloop
endfacet
facet normal 0 0 0
outer loop
vertex 0 0 0
vertex 0.1 0 0
vertex 0 0 0.3
endloop
endfacet
endsolid t
"""
SHAPE = '    <visual><geometry><mesh filename="part.stl" scale="1 -2 1"/></geometry></visual>'


def robot_text(*more: str) -> str:
    """Return a platform called world, with a joint and one that mimics it."""
    limit = urdf.limit(-1, 1, 5, 2)
    parts = [
        ball(0.6),
        urdf.link("finger", urdf.inertial(0.2, (1e-3, 1e-3, 1e-3), xyz="0.1 0 0"), *more),
        urdf.joint("bend", "revolute", ("base", "finger"), "0.1 0 0.5", "0 0 1",
                   f'{limit}<dynamics damping="0.3" friction="0.01"/>'),
        urdf.link("other", urdf.inertial(0.2, (1e-3, 2e-3, 2e-3), (1e-4, 0, 0), "0.1 0 0")),
        urdf.joint("mirror", "revolute", ("base", "other"), "0.1 0.2 0.5", "0 1 0",
                   f'{limit}<mimic joint="bend" multiplier="-0.5" offset="0.1"/>'),
    ]  # fmt: skip
    return platform(SET_A, extra="\n".join(parts)).replace('"base"', '"world"')


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> rpctl.Robot:
    """A platform with a joint and one that mimics it."""
    return rpctl.load(write(tmp_path_factory.mktemp("robot"), robot_text()))


@pytest.fixture(scope="module")
def exported(robot: rpctl.Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its file."""
    path = tmp_path_factory.mktemp("mjcf") / "robot.xml"
    export_quickly(robot, path)
    return path


def test_the_file_has_the_names_limits_and_losses_of_the_urdf(exported: Path) -> None:
    root = etree.parse(exported).getroot()
    assert {body.get("name") for body in root.iter("body")} == {
        "world_link", "left_wheel", "right_wheel", "finger", "other",
    }  # fmt: skip
    motors = {motor.get("name"): motor.get("ctrlrange") for motor in root.iter("motor")}
    assert motors == {"left_joint": None, "right_joint": None, "bend": "-5 5"}
    (bend,) = root.findall(".//joint[@name='bend']")
    assert (bend.get("range"), bend.get("damping"), bend.get("frictionloss")) == (
        "-1 1", "0.3", "0.01",
    )  # fmt: skip
    (tyre,) = root.findall(".//geom[@name='left_joint']")
    assert tyre.get("group") == "3"  # hidden behind the shape that is drawn
    (tie,) = root.findall("equality/joint")
    assert (tie.get("joint1"), tie.get("joint2")) == ("mirror", "bend")
    assert tie.get("polycoef") == "0.1 -0.5 0 0 0"


def test_rotors_are_in_the_file(tmp_path: Path) -> None:
    """As given, in kg m²; the others have none."""
    path = tmp_path / "robot.xml"
    source = write(tmp_path, robot_text())
    export_quickly(rpctl.load(source, armature={"bend": 0.25}), path)
    joints = etree.parse(path).getroot().iter("joint")
    rotors = {joint.get("name"): joint.get("armature") for joint in joints if joint.get("name")}
    assert rotors.pop("bend") == "0.25"
    assert rotors and set(rotors.values()) <= {None, "0"}


def test_a_state_that_is_set_in_mujoco_is_measured(robot: rpctl.Robot, exported: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(exported))
    data, own = mujoco.MjData(model), rpctl.MjcfRobot(robot, model)
    rng = np.random.default_rng(3)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    own.place(data, q)
    measured, still = own.state(data)
    assert measured == pytest.approx(q, abs=2e-3)  # the casters and wheels as they were put
    assert not still.any()
    velocity = rpctl.ReducedDynamics(robot).basis(q) @ nu
    theta = math.atan2(q[3], q[2])
    data.qvel[:2] = (
        math.cos(theta) * velocity[0] - math.sin(theta) * velocity[1],
        math.sin(theta) * velocity[0] + math.cos(theta) * velocity[1],
    )
    data.qvel[5] = velocity[2]
    for name in robot.moving_joint_names:
        data.joint(name).qvel[0] = velocity[robot.velocity_index(name)]
    mujoco.mj_forward(model, data)
    assert own.state(data)[1] == pytest.approx(nu, abs=1e-12)
    assert [model.actuator(k).name for k in own.actuators] == list(robot.actuators)


def test_a_robot_that_is_not_in_the_model_is_refused(exported: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(exported))
    with pytest.raises(rpctl.RpctlError, match="arm_revolute_joint_position"):
        rpctl.MjcfRobot(rpctl.load("paper"), model)


def test_a_witness_comes_whole_out_of_json(robot: rpctl.Robot) -> None:
    witness = take_witness(robot, "world_link", samples=1)
    again = from_plain(as_plain(witness))
    assert as_plain(again) == as_plain(witness)
    broken = as_plain(witness)
    broken["effort"] = broken["effort"][1:]
    with pytest.raises(ValueError, match=r"effort has the shape \(2,\), not \(3,\)"):
        from_plain(broken)


def faults(model: Any) -> dict[str, Any]:
    """Return what of a model is edited for each row, and what it becomes."""
    bend, left = model.joint("bend"), model.actuator("left_joint")
    dof = int(bend.dofadr[0])
    return {
        "inertia M": (model.body_mass, int(model.body("finger").id), 0.3),
        "actuation B": (model.actuator_gear, int(left.id), [-1, 0, 0, 0, 0, 0]),
        "joint ranges": (model.jnt_range, int(bend.id), [-1, 2]),
        "effort limits": (model.actuator_ctrlrange, int(model.actuator("bend").id), [-5, 6]),
        "damping": (np.asarray(model.dof_damping).reshape(model.nv, -1), dof, 0.2),
        "frictionloss": (model.dof_frictionloss, dof, 0.0),
        "armature": (model.dof_armature, dof, 0.1),
    }


@pytest.mark.parametrize(
    "row", ["inertia M", "actuation B", "joint ranges", "effort limits", "damping",
            "frictionloss", "armature"]
)  # fmt: skip
def test_each_row_of_a_witness_finds_its_fault(
    robot: rpctl.Robot, exported: Path, row: str
) -> None:
    witness = take_witness(robot, "world_link", samples=1)
    model = mujoco.MjModel.from_xml_path(str(exported))
    assert all(check.passed for check in compare_with_witness(model, witness))
    array, index, value = faults(model)[row]
    array[index] = value
    failed = [check.name for check in compare_with_witness(model, witness) if not check.passed]
    assert row in failed
    assert set(failed) <= {row, "inertia M", "bias h"}  # a mass or a rotor is in M, too


def test_rounded_numbers_are_not_written(
    robot: rpctl.Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mjcf_writer, "DIGITS", 6)
    with quickly():
        found = export_mjcf(robot, tmp_path / "robot.xml")
    assert not found.written
    assert "every number" in {check.name for check in found.checks if not check.passed}
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_wheel_that_rolls_wrong_is_found_by_running_the_file(
    robot: rpctl.Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def prepared(*arguments: Any, **named: Any) -> Any:
        built = prepare(*arguments, **named)
        built.spec.geom("left_joint").size = [1.05 * SET_A["r"], 1.05 * SET_A["r"], 0.02]
        return built

    monkeypatch.setattr(export, "prepare", prepared)
    found = export_mjcf(robot, tmp_path / "robot.xml")
    failed = {check.name for check in found.checks if not check.passed}
    assert failed == {"path"} and not found.written


def test_meshes_lie_beside_the_file_mirrored_as_they_are(tmp_path: Path) -> None:
    write(tmp_path, TETRAHEDRON, "part.stl")
    robot = rpctl.load(write(tmp_path, robot_text(SHAPE)))
    drawn = draw(robot, True)
    (data,) = drawn.files.values()
    assert b"v 0 -0.4 0" in data
    corners = [line.split()[1:] for line in data.decode().splitlines() if line.startswith("f")]
    points = [line.split()[1:] for line in data.decode().splitlines() if line.startswith("v")]
    a, b, c = (np.array(points[int(k) - 1], float) for k in corners[0])
    assert np.cross(b - a, c - a)[2] < 0.0  # the side that is outside stays outside
    assert not draw(robot, False).files
    part = next(part for part in drawn.parts["finger"] if part.get("type") == "mesh")
    assert part.get("contype") == part.get("conaffinity") == "0"


@pytest.mark.parametrize("name", cells(CATALOGUE, slow=TELLING))
def test_the_catalogue_is_exported_and_proved_again(name: str, tmp_path: Path) -> None:
    try:
        robot = rpctl.load(name)
    except rpctl.RpctlError as absent:
        pytest.skip(str(absent))
    found = export_mjcf(robot, tmp_path / "robot.xml")
    assert found.written, [check for check in found.checks if not check.passed]
    again = check_mjcf(tmp_path / "robot.xml")
    assert again.passed and not again.edits
    assert {"path", "heading"} <= {check.name for check in again.checks} or name == "bicycle"


@pytest.mark.thorough
def test_another_robot_is_not_the_one_in_the_file(robot: rpctl.Robot, exported: Path) -> None:
    heavier = check_mjcf(exported, rpctl.scale_masses(robot, "bend", 1.5))
    assert not heavier.passed
    assert not heavier.edits
    assert {check.against for check in heavier.checks if not check.passed} == {"platform anew"}
    assert any("other options" in note for note in heavier.notes)


def test_a_robot_that_is_not_its_file_is_not_written(robot: rpctl.Robot, tmp_path: Path) -> None:
    with quickly():
        found = export_mjcf(rpctl.scale_masses(robot, "bend", 1.5), tmp_path / "robot.xml")
    assert not found.written and not list(tmp_path.iterdir())
    (failed,) = [check.name for check in found.checks if not check.passed]
    assert failed.startswith("rpctl verify")


def test_a_fixed_base_is_refused(tmp_path: Path) -> None:
    with pytest.raises(rpctl.RpctlError, match="has no wheels"):
        export_mjcf(rpctl.load("arm"), tmp_path / "arm.xml")


def test_a_robot_that_leans_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(rpctl.RpctlError, match=r"balancer leans.*falls without a law"):
        export_mjcf(rpctl.load("balancer"), tmp_path / "balancer.xml")
