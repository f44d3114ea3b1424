"""Files made to harm: refused in bounded time and memory, with one clear message."""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.description.urdf.reader import read
from rpctl.errors import DescriptionError, RpctlError
from rpctl.files import caps
from tests.description.corpus import BASE
from tests.description.test_fuzz import PATIENCE, patience
from tests.grids import cells

SECRET = "root:x:0:0"
LAUGHS = "<!ENTITY a0 'ha'>" + "".join(
    f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 12)
)
LINK = '<link name="l{0}"/>'
JOINT = '<joint name="j{0}" type="{1}"><parent link="l{2}"/><child link="l{0}"/></joint>'
MASS = """<inertial><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>""".replace("\n", " ")


def chain(count: int, kind: str = "fixed") -> str:
    """Return a robot of links in one row, which is as deep as it has links."""
    links = (f'<link name="l{i}">{MASS}</link>' for i in range(count))
    joints = (JOINT.format(i, kind, i - 1) for i in range(1, count))
    return f'<robot name="r">{"".join(links)}{"".join(joints)}</robot>'


def star(count: int) -> str:
    links = (LINK.format(i) for i in range(count))
    joints = (JOINT.format(i, "fixed", 0) for i in range(1, count))
    return f'<robot name="r">{"".join(links)}{"".join(joints)}</robot>'


# Long texts are made when they are read: all of them take 300 MB.
HOSTILE: dict[str, tuple[str | Callable[[], str], str]] = {
    "billion laughs": (
        f'<!DOCTYPE r [{LAUGHS}]><robot name="&a11;"><link name="a"/></robot>',
        "rpctl never reads its entities",
    ),
    "external entity": (
        '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/passwd">]><robot name="&e;"/>',
        "rpctl never reads its entities",
    ),
    "external document type": (
        '<!DOCTYPE r SYSTEM "http://localhost:1/x.dtd"><robot name="a"/>',
        "a DOCTYPE is not part of URDF",
    ),
    "parameter entities": (
        '<!-- x --><!DOCTYPE r [<!ENTITY % p SYSTEM "/dev/zero"> %p;]><robot name="a"/>',
        "rpctl never reads its entities",
    ),
    "entity without a document type": (BASE.replace('"30"', '"&e;"'), "Entity 'e' not defined"),
    "100 MB of blanks": (lambda: " " * 100 * 2**20, "the file is over 33554432 bytes"),
    "31 MB of blanks": (lambda: " " * 31 * 2**20 + "x", 'it begins with "x"'),
    "depth 90000": (
        lambda: '<robot name="r">' + "<a>" * 90_000 + "</a>" * 90_000 + "</robot>",
        "elements are nested over 256 deep",
    ),
    "100000 links": (
        lambda: star(100_000),
        "100000 links; at most 2000 are allowed; to allow it, set",
    ),
    "a row of 100000 links": (lambda: chain(100_000), "100000 links; at most 2000 are allowed"),
    "an attribute of 11 MB": (
        lambda: BASE.replace('"30"', f'"{"1" * 11 * 2**20}"'),
        "a tag or text is over 10 MB",
    ),
    "a number of 9 MB": (lambda: BASE.replace('"30"', f'"{"1" * 9 * 2**20}"'), "is not a number"),
    "a million attributes": (
        lambda: "<robot " + " ".join(f"a{i}='1'" for i in range(10**6)) + "/>",
        "",
    ),
    "1000 undeclared prefixes": (
        BASE.replace("<visual>", "".join(f"<p{i}:a/>" for i in range(1000)) + "<visual>"),
        "Namespace prefix p20",
    ),
    "300000 shapes": (
        lambda: f'<robot name="r"><link name="l0">{"<visual/>" * 300_000}</link></robot>',
        "300002 elements; at most 100000 are allowed",
    ),
    "2 million elements": (
        lambda: f"<robot name='r'>{'<a/>' * 2_000_000}</robot>",
        "2000001 elements; at most 100000 are allowed; to allow it, set RPCTL_MAX_ELEMENTS",
    ),
    "2 million elements of a namespace": (
        lambda: f"<robot name='r' xmlns='u'>{'<a/>' * 2_000_000}</robot>",
        "2000001 elements; at most 100000 are allowed",
    ),
    "5 million attributes": (
        lambda: "<robot name='r'>" + f"<link {' '.join(f'a{i}=1' for i in range(99))}/>\n" * 51_000,
        "5049001 attributes; at most 1000000 are allowed; to allow it, set RPCTL_MAX_ATTRIBUTES",
    ),
    "2 million comments": (
        lambda: "<robot name='r'>" + "<!--" * 2_000_000,
        "Double hyphen within comment",
    ),
    "100000 unknown elements": (
        lambda: (
            "<robot name='r'>"
            + "".join(f"<liink{i}/>" for i in range(99_000))
            + "<link name='l'/></robot>"
        ),
        "no link has a mass",
    ),
    "1900 mimics in a row": (
        lambda: (
            star(1900)
            .replace('type="fixed">', 'type="continuous"><mimic joint="j{}"/>')
            .format(*range(2, 1901))
        ),
        "mimics through a chain of over 20",
    ),
    "unclosed comments": (lambda: "<robot>" + "<!--" * 10**6, "truncated"),
    "500 moving joints": (chain(501, "continuous"), "500 moving joints; at most 150 are allowed"),
}


QUICK = {
    "billion laughs", "external document type", "entity without a document type", "depth 90000",
    "300000 shapes", "unclosed comments",
}  # fmt: skip
SLOW = {
    "external entity", "31 MB of blanks", "100000 links", "an attribute of 11 MB",
    "a million attributes", "5 million attributes", "1900 mimics in a row", "500 moving joints",
}  # fmt: skip


@pytest.mark.parametrize("name", cells(HOSTILE, QUICK, SLOW))
def test_hostile_files_are_refused_soon(name: str, tmp_path: Path) -> None:
    text, expected = HOSTILE[name]
    path = tmp_path / "hostile.urdf"
    path.write_text(text if isinstance(text, str) else text(), encoding="utf-8")
    with patience(PATIENCE), pytest.raises(RpctlError) as caught:
        rpctl.load(path)
    assert caught.value.exit_code == 2
    assert expected in str(caught.value)
    assert str(path) in str(caught.value)
    assert SECRET not in str(caught.value)
    assert len(str(caught.value)) < 10_000


HUGE = {
    "wide, fixed": lambda: star(100_000),
    "deep, fixed": lambda: chain(100_000),
    "wide, moving": lambda: star(100_000).replace("fixed", "continuous"),
    "deep, moving": lambda: chain(100_000, "continuous"),
}


@pytest.mark.parametrize("name", cells(HUGE, slow=["deep, moving"]))
def test_a_huge_file_is_told_within_half_a_gigabyte(name: str, tmp_path: Path) -> None:
    path = tmp_path / "huge.urdf"
    path.write_text(HUGE[name](), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "rpctl", "inspect", str(path)],
        capture_output=True, text=True, check=False, timeout=PATIENCE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (2**29, 2**29)),
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"{path}:1: error: 100000 links")
    assert len(done.stderr.splitlines()) == 1


def test_a_deep_robot_is_read(tmp_path: Path) -> None:
    path = tmp_path / "deep.urdf"
    path.write_text(chain(1200), encoding="utf-8")
    description = read(path)
    assert len(description.chain("l1199")) == 1199
    with patience(PATIENCE), pytest.raises(RpctlError, match="no known drive"):
        rpctl.load(path)


def test_caps_can_be_raised_and_lowered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(BASE, encoding="utf-8")
    for name, expected in (
        ("MAX_LINKS", "5 links; at most 4 are allowed"),
        ("MAX_BYTES", "the file is over 4 bytes"),
    ):
        monkeypatch.setenv(f"RPCTL_{name}", "4")
        with pytest.raises(DescriptionError, match=f"{expected}.*RPCTL_{name}"):
            rpctl.load(path)
        monkeypatch.delenv(f"RPCTL_{name}")
    monkeypatch.setenv("RPCTL_MAX_MOVING_JOINTS", "2")
    with pytest.raises(DescriptionError, match="4 moving joints; at most 2 are allowed"):
        rpctl.load(path)
    assert rpctl.load(path, lock=["shoulder", "slide"]).dof == 2
    monkeypatch.setenv("RPCTL_MAX_LINKS", "many")
    with pytest.raises(RpctlError, match="'many' is not a positive integer"):
        rpctl.load(path)
    monkeypatch.setenv("RPCTL_MAX_LINKS", "99999999")
    assert caps.cap("MAX_LINKS") == 99999999


def test_what_pinocchio_refuses_is_told_without_its_noise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(BASE, encoding="utf-8")
    monkeypatch.setattr(
        "rpctl.description.urdf.reader._engine_xml", lambda *_: '<robot name="r"><joint/></robot>'
    )
    with pytest.raises(DescriptionError, match=r"error: Pinocchio rejects this robot: .*; correct"):
        rpctl.load(path)
    assert capfd.readouterr() == ("", "")


def test_joints_can_be_locked_where_a_link_and_a_joint_share_a_name(tmp_path: Path) -> None:
    """The engine cannot freeze joints of such a robot; it gets a file where they are fixed."""
    turned = []
    for name in ("shoulder", "arm"):  # "arm" is a link, too
        path = tmp_path / f"{name}.urdf"
        path.write_text(BASE.replace('name="shoulder"', f'name="{name}"'), encoding="utf-8")
        assert rpctl.load(path).dof == 4
        model = rpctl.load(path, lock={"slide": 0.07}).model
        joint = model.getJointId(name)
        turned.append((model.nv, model.inertias[joint], model.jointPlacements[joint]))
    (count, plain, place), (other_count, shared, other_place) = turned
    assert count == other_count
    parameters = plain.toDynamicParameters()
    np.testing.assert_allclose(shared.toDynamicParameters(), parameters, atol=1e-15)
    np.testing.assert_allclose(other_place.homogeneous, place.homogeneous, atol=1e-15)
