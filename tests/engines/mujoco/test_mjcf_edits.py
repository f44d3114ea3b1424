"""Edits of an exported file: each is named, and those that can change the motion void it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

import rpctl
from rpctl.engines.mujoco.certificate import find_certificate
from rpctl.engines.mujoco.check import check_file, compare_tables, read_certified
from rpctl.engines.mujoco.mjcf_reader import Table, parse_mjcf
from rpctl.engines.mujoco.trial import run_on_ground
from rpctl.simulation.mjcf_file import check_mjcf
from tests.cli.test_app import run
from tests.engines.mujoco.exports import export_quickly, quickly

mujoco = pytest.importorskip("mujoco")

Edit = Callable[[Any], None]
WHEEL = ".//body[@name='wheel_rear_left_link']"
MOTOR = ".//motor[@name='wheel_rear_left_joint']"


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The car: steered, with a tie between its steered wheels, an arm, and supports."""
    path = tmp_path_factory.mktemp("mjcf") / "car.xml"
    export_quickly(rpctl.load("car"), path)
    return path


def put(xpath: str, name: str, value: str) -> Edit:
    """Return the edit that sets an attribute."""

    def edit(root: Any) -> None:
        (element,) = root.findall(xpath)
        element.set(name, value)

    return edit


def remove(xpath: str) -> Edit:
    """Return the edit that removes an element."""

    def edit(root: Any) -> None:
        (element,) = root.findall(xpath)
        element.getparent().remove(element)

    return edit


def add(xpath: str, xml: str, first: bool = False) -> Edit:
    """Return the edit that adds an element."""

    def edit(root: Any) -> None:
        (element,) = root.findall(xpath)
        element.insert(0 if first else len(element), etree.fromstring(xml))

    return edit


def edited(path: Path, edit: Edit) -> bytes:
    """Return the bytes of an edited file."""
    root = etree.parse(path).getroot()
    edit(root)
    return bytes(etree.tostring(root))


@cache
def exported_table(path: Path) -> Table:
    """Return what a file says that it means."""
    return find_certificate(parse_mjcf(path.read_bytes(), path).texts, path).table


def sentences(path: Path, data: bytes) -> tuple[list[str], list[str]]:
    """Return what is said of the edits that matter, and of the others."""
    edits = compare_tables(exported_table(path), parse_mjcf(data, path).table).edits
    return (
        [edit.sentence for edit in edits if edit.matters],
        [edit.sentence for edit in edits if not edit.matters],
    )


def reverse_motors(root: Any) -> None:
    """Turn the order of the controls round."""
    section = root.find("actuator")
    section[:] = section[::-1]


VOID = {
    "mass": (put(f"{WHEEL}/inertial", "mass", "1.3"), 'body "wheel_rear_left_link": mass'),
    "centre": (
        put(f"{WHEEL}/inertial", "pos", "0 0 0.01"),
        'body "wheel_rear_left_link": ipos',
    ),
    "inertia": (
        put(f"{WHEEL}/inertial", "diaginertia", "0.02 0.02 0.03"),
        'body "wheel_rear_left_link": inertia',
    ),
    "place": (put(WHEEL, "pos", "0 0.5 0.2"), 'body "wheel_rear_left_link": pos'),
    "gear": (put(MOTOR, "gear", "2"), 'actuator "wheel_rear_left_joint": gear 1 0 0 0 0 0 → 2'),
    "limit": (
        put(MOTOR, "ctrlrange", "-1 1"),
        'actuator "wheel_rear_left_joint": ctrlrange',
    ),
    "range": (
        put(".//joint[@name='steering_left_joint']", "range", "-1 1"),
        'joint "steering_left_joint": range',
    ),
    "damping": (
        put(".//joint[@name='steering_left_joint']", "damping", "3"),
        'joint "steering_left_joint": damping',
    ),
    "armature": (
        put(".//joint[@name='steering_left_joint']", "armature", "3"),
        'joint "steering_left_joint": armature',
    ),
    "axis": (
        put(".//joint[@name='wheel_rear_left_joint']", "axis", "0 0.9999 0.01"),
        'joint "wheel_rear_left_joint": axis',
    ),
    "wheel": (
        put(".//geom[@name='wheel_rear_left_joint']", "size", "0.2 0.2 0.01"),
        'geom "wheel_rear_left_joint": size',
    ),
    "friction": (
        put(".//pair[@name='wheel_rear_left_joint']", "friction", "0.2 0.2 0 0 0"),
        'pair "wheel_rear_left_joint": friction 0.7 0.7 0 0 0 → 0.2 0.2 0 0 0',
    ),
    "softness": (
        put(".//pair[@name='wheel_rear_left_joint']", "solreffriction", "-1 -9"),
        'pair "wheel_rear_left_joint": solreffriction',
    ),
    "contact removed": (
        remove(".//pair[@name='wheel_rear_left_joint']"),
        'pair "wheel_rear_left_joint" was removed',
    ),
    "tie removed": (
        remove(".//equality/joint"),
        'equality "steering_right_joint_tie" was removed',
    ),
    "tie": (put(".//equality/joint", "polycoef", "0 1 0 0 0"), "_tie\": data"),
    "body added": (
        add(WHEEL, "<body name='bag'><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/></body>"),
        'body "bag" was added',
    ),
    "collision added": (
        add(".//worldbody", "<geom name='wall' type='box' size='1 1 1' pos='3 0 0'/>"),
        'geom "wall" was added',
    ),
    "pair added": (
        add("contact", "<pair name='x' geom1='ground' geom2='wheel_rear_left_joint'/>"),
        'pair "x" was added',
    ),
    "timestep": (put("option", "timestep", "0.004"), "option: timestep 0.001 → 0.004"),
    "gravity": (put("option", "gravity", "0 0 -9.8"), "option: gravity 0 0 -9.81 → 0 0 -9.8"),
    "integrator": (put("option", "integrator", "RK4"), "option: integrator"),
    "wind": (add("option", "<flag contact='disable'/>"), "option: disableflags"),
    "order": (reverse_motors, "actuator: order"),
    "sensor removed": (
        remove(".//sensor/framelinvel"),
        'sensor "base_velocity" was removed',
    ),
    "sensor of another thing": (
        put(".//sensor/framepos", "objname", "wheel_rear_left_link"),
        'sensor "base_position": objid',
    ),
    "motor of another joint": (
        put(MOTOR, "joint", "wheel_rear_right_joint"),
        'actuator "wheel_rear_left_joint": trnid',
    ),
    "weightless": (put(WHEEL, "gravcomp", "1"), 'body "wheel_rear_left_link": gravcomp'),
    "a picture that collides": (
        add(WHEEL, "<geom name='x' type='sphere' size='.1' conaffinity='1' contype='0'/>"),
        'geom "x" was added',
    ),
}  # fmt: skip
VOID |= {  # who starts there does not start where the robot stands
    "key that moves": (put(".//key", "qvel", " ".join("1" * 13)), 'key "home": qvel'),
    "key elsewhere": (add("keyframe", "<key name='far' time='1'/>"), 'key "far" was added'),
}
HARMLESS = {
    "colour": (
        put(".//geom[@name='ground']", "rgba", "1 0 0 1"),
        'geom "ground": rgba 0.5 0.5 0.5 1 → 1 0 0 1',
    ),
    "light": (add(".//worldbody", "<light name='lamp' pos='0 0 1'/>"), 'light "lamp" was added'),
    "camera": (add(".//worldbody", "<camera name='eye'/>"), 'camera "eye" was added'),
    "picture": (
        add(WHEEL, "<geom name='x' type='sphere' size='.1' conaffinity='0' contype='0'/>"),
        'geom "x" was added',
    ),
    "one more sensor": (
        add("sensor", "<gyro name='imu' site='tool_link'/>"),
        'sensor "imu" was added',
    ),
}


@pytest.mark.parametrize("edit, said", VOID.values(), ids=VOID)
def test_an_edit_that_can_change_the_motion_is_named(exported: Path, edit: Edit, said: str) -> None:
    void, _ = sentences(exported, edited(exported, edit))
    assert len([each for each in void if said in each]) == 1, void


@pytest.mark.parametrize("edit, said", HARMLESS.values(), ids=HARMLESS)
def test_an_edit_that_only_shows_is_named_and_harmless(
    exported: Path, edit: Edit, said: str
) -> None:
    void, harmless = sentences(exported, edited(exported, edit))
    assert not void
    assert [each for each in harmless if said in each], harmless


def test_the_way_that_a_file_is_written_is_no_edit(exported: Path) -> None:
    root = etree.parse(exported).getroot()
    for element in root.iter(etree.Element):
        attributes = sorted(element.attrib.items(), reverse=True)
        element.attrib.clear()
        element.attrib.update(attributes)
        element.text = element.tail = "\n\t "
    root.insert(0, etree.Comment("mine now"))
    root.append(root.find("worldbody"))  # sections in another order
    assert sentences(exported, etree.tostring(root)) == ([], [])


def test_what_mujoco_saves_is_the_file_rounded(exported: Path, tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(exported))
    mujoco.mj_saveLastXML(str(tmp_path / "saved.xml"), model)
    file, certificate = read_certified(tmp_path / "saved.xml")
    found = check_file(file, certificate, None)
    assert found.passed, ([edit.sentence for edit in found.edits], found.checks)
    assert not [edit for edit in found.edits if edit.matters]
    assert any("rounded by at most" in note for note in found.notes)


def test_a_heavier_wheel_fails_in_the_equations(exported: Path) -> None:
    data = edited(exported, put(f"{WHEEL}/inertial", "mass", "30"))
    file = parse_mjcf(data, exported)
    heavy = check_file(file, find_certificate(file.texts, exported), None)
    assert not heavy.passed
    assert [check.name for check in heavy.checks if not check.passed] == ["inertia M", "bias h"]


@pytest.mark.parametrize("name", ["timestep", "key that moves"])
def test_an_edit_that_no_row_shows_voids_the_certificate(exported: Path, name: str) -> None:
    """M and h of the file are those of the robot, and yet it would not move as the robot does."""
    file = parse_mjcf(edited(exported, VOID[name][0]), exported)
    found = check_file(file, find_certificate(file.texts, exported), None)
    assert found.checks
    assert [check for check in found.checks if not check.passed] == []
    assert not found.passed


def test_a_file_that_lost_a_joint_is_void_and_says_so(exported: Path) -> None:
    data = edited(exported, remove(".//body[@name='arm_rail_link']"))
    root = etree.fromstring(data)
    for element in root.xpath("//*[@joint='arm_extension_joint']"):
        element.getparent().remove(element)
    root.remove(root.find("keyframe"))
    file = parse_mjcf(etree.tostring(root), exported)
    found = check_file(file, find_certificate(file.texts, exported), rpctl.load("car"))
    assert not found.passed
    assert 'joint "arm_extension_joint"' in found.checks[0].entry
    assert not [check for check in found.checks if check.passed]


BROKEN = {
    b"": "not well-formed",
    b"<robot name='x'/>": "its root is <robot>",
    b"<!DOCTYPE mujoco [<!ENTITY x 'y'>]><mujoco>&x;</mujoco>": "DOCTYPE",
    b"<mujoco><include file='/etc/passwd'/></mujoco>": "<include> reads another file",
    b"<mujoco><extension><plugin plugin='x'/></extension></mujoco>": "runs foreign code",
    b"<mujoco><worldbody><replicate count='1000000000'/></worldbody></mujoco>": "makes copies",
    b"<mujoco><worldbody><body><joint type='x'/></body></worldbody></mujoco>": "MuJoCo refuses it",
    b"<mujoco><size memory='900G'/></mujoco>": "requests memory",
    b"<?xml version='1.0' encoding='UTF-7'?><mujoco><include file='x'/></mujoco>": "reads another",
    b"<?xml version='1.0' encoding='UTF-7'?><mujoco><!--+AC0ALQA+--></mujoco>": "no certificate",
    b"<mujoco/>": "no certificate of rpctl",
    b"<mujoco><custom><text name='rpctl_certificate' data='eA=='/></custom></mujoco>": "damaged",
}


@pytest.mark.parametrize("data, said", BROKEN.items())
def test_a_file_of_others_is_refused_in_words(data: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "x.xml"
    path.write_bytes(data)
    with pytest.raises(rpctl.RpctlError, match=said) as refusal:
        check_mjcf(path)
    assert str(refusal.value).startswith(str(path))


def test_a_file_that_diverges_is_void_and_quiet(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    file = parse_mjcf(edited(exported, put("option", "timestep", "0.5")), exported)
    robot = rpctl.load("car")
    with pytest.raises(rpctl.RpctlError, match="diverges"):
        run_on_ground(robot, file.model, "base_link")
    assert not list(tmp_path.iterdir())  # MuJoCo writes its warnings into a file
    assert capfd.readouterr() == ("", "")


def test_a_certificate_that_was_edited_is_refused(exported: Path) -> None:
    with pytest.raises(rpctl.RpctlError, match="its certificate was edited"):
        file = parse_mjcf(
            edited(exported, put(".//text[@name='rpctl_certificate_sha256']", "data", "0" * 64)),
            exported,
        )
        find_certificate(file.texts, exported)


@pytest.mark.parametrize("table", [{"body": {"x": {"mass": {}}}}, {"body": [1.0]}, "table"])
def test_a_forged_certificate_ends_in_a_message(exported: Path, table: Any) -> None:
    """Its digest is right: whoever writes a file can write that, too."""
    known = find_certificate(parse_mjcf(exported.read_bytes(), exported).texts, exported)
    forged = dataclasses.replace(known, table=table).parts("")
    with pytest.raises(rpctl.RpctlError, match="its certificate is damaged"):
        find_certificate({each.get("name"): each.get("data") for each in forged}, exported)


def test_the_commands_say_it_with_their_exit_codes(tmp_path: Path) -> None:
    out = tmp_path / "car.xml"
    with quickly():
        code, said, _ = run("export", "car", "--format", "mjcf", "--out", str(out))
        assert code == 0 and "wrote" in said and out.exists()
        assert run("check", str(out))[0] == 0
        out.write_bytes(edited(out, put(f"{WHEEL}/inertial", "mass", "30")))
        code, said, _ = run("check", str(out))
    assert code == 1 and 'body "wheel_rear_left_link": mass' in said and "void" in said
    code, _, said = run("export", "car", "--format", "sdf")
    assert code == 2 and "mjcf" in said
    code, _, said = run("export", "arm")
    assert code == 2 and "has no wheels" in said
    assert run("check", str(Path(__file__)))[0] == 2
