"""Tables of poses: read back what was written, met at their times; every bad row is named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.arrays import Array
from rpctl.errors import DescriptionError
from rpctl.reference.load import load_reference
from rpctl.reference.motion import Reference
from rpctl.reference.named import reference_by_name
from rpctl.reference.path_reference import TimedPath
from rpctl.reference.planned.arm import Arm
from rpctl.reference.recorded.table_file import read_table
from rpctl.reference.time_law import recorded_time
from tests.grids import cells
from tests.reference.differences import check_derivatives
from tests.robots import SET_A, platform, write

END = 8.0  # s of the references that are written down
LIDAR = """<link name="lidar"><inertial><mass value="1"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="lidar_joint" type="continuous"><parent link="base"/><child link="lidar"/>
  <axis xyz="0 0 1"/></joint>"""


def written(
    robot: Robot, reference: Reference, path: Path, columns: Sequence[str], times: Array
) -> str:
    """Write a reference as a table of poses and return its path."""
    arm, rows = Arm(robot), [",".join(columns)]
    for t in times:
        state = reference(t)
        held = arm.end_effector_pose(state.pose, state.joints[arm.joints]).translation
        values = dict(zip(("t", "x", "y", "theta"), (t, *state.pose), strict=True))
        values |= dict(zip(("ee_x", "ee_y", "ee_z"), held, strict=True))
        values |= {j.name: q for j, q in zip(robot.joints, state.joints, strict=True)}
        rows.append(",".join(f"{values[name]:.15g}" for name in columns))
    path.write_text("\n".join(rows))
    return str(path)


def read_back(robot: Robot, path: str) -> TimedPath:
    found = load_reference(robot, path)
    assert isinstance(found, TimedPath)
    return found


@pytest.mark.parametrize("heading", cells([True, False], [False], [True]))
def test_a_dense_table_gives_the_reference_back(
    paper: Robot, tmp_path: Path, heading: bool
) -> None:
    reference = reference_by_name(paper, "eight")
    columns = ["t", "x", "y", *["theta"] * heading, *(joint.name for joint in paper.joints)]
    times = np.arange(0.0, END + 1e-9, 0.02)
    back = read_back(paper, written(paper, reference, tmp_path / "a.csv", columns, times))
    assert back.duration == pytest.approx(END + 1.0)  # it ends in motion, so it stops later
    for t in np.linspace(0.0, END - 1.05, 150):
        was, now = reference(t), back(t)
        np.testing.assert_allclose(now.pose[:2], was.pose[:2], atol=1e-8)
        assert math.remainder(now.pose[2] - was.pose[2], 2 * math.pi) == pytest.approx(0, abs=1e-5)
        np.testing.assert_allclose(now.twist, was.twist, atol=1e-4)
        np.testing.assert_allclose(now.twist_dot, was.twist_dot, atol=1e-3)
        np.testing.assert_allclose(now.joints, was.joints, atol=1e-8)
        np.testing.assert_allclose(now.joint_rates, was.joint_rates, atol=1e-6)


def test_the_clock_is_smooth_and_on_time() -> None:
    time_law = recorded_time(10.0, True, True)
    for t in (1e-9, 1.0, 9.0, 11.0 - 1e-9):
        before, after = time_law(t - 1e-7), time_law(t + 1e-7)
        np.testing.assert_allclose(after, before, atol=1e-5)
    for t in np.linspace(0.05, 10.95, 50):
        rate = (time_law(t + 1e-6).s - time_law(t - 1e-6).s) / 2e-6
        assert time_law(t).rate == pytest.approx(rate, abs=1e-8)
        change = (time_law(t + 1e-6).rate - time_law(t - 1e-6).rate) / 2e-6
        assert time_law(t).acceleration == pytest.approx(change, abs=1e-7)
    assert time_law(5.0) == pytest.approx((5.0, 1.0, 0.0), abs=1e-12)
    assert time_law(-1.0).s == 0.0
    assert time_law(11.0) == (10.0, 0.0, 0.0)
    assert max(time_law(t).rate for t in np.linspace(8.0, 11.0, 100)) <= 1.0 + 1e-12


def table(path: Path, x: Array, y: Array, theta: Array | None = None, end: float = 10.0) -> str:
    t = np.linspace(0.0, end, len(x))
    columns = [t, x, y] if theta is None else [t, x, y, theta]
    head = "t,x,y" if theta is None else "t,x,y,theta"
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.12g")
    return str(path)


def soft(count: int = 201) -> Array:
    """Return numbers from 0 to 1 that start and end softly."""
    u = np.linspace(0.0, 1.0, count)
    return np.asarray(u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3))


def test_a_way_back_is_driven_in_reverse(tiago: Robot, tmp_path: Path) -> None:
    x = np.concatenate([soft(), 1.0 - soft()[1:]])
    back = read_back(tiago, table(tmp_path / "a.csv", x, 0.0 * x))
    assert back(2.5).twist[0] > 0.1
    assert back(7.5).twist[0] < -0.1
    for t in np.linspace(0.0, 10.0, 101):
        state = back(t)
        assert state.pose[2] == pytest.approx(0.0, abs=1e-9)
        assert state.direction is not None  # it does not vanish, though the base stands thrice
        np.testing.assert_allclose(state.direction[0], [1.0, 0.0, 0.0], atol=1e-9)


def test_a_base_may_turn_on_the_spot(tiago: Robot, tmp_path: Path) -> None:
    turn = 2.0 * soft()
    back = read_back(tiago, table(tmp_path / "a.csv", 0.0 * turn, 0.0 * turn, turn))
    state = back(5.0)
    assert state.twist[2] > 0.3
    assert state.direction is not None
    np.testing.assert_allclose(state.direction[0, :2], 0.0, atol=1e-12)
    check_derivatives(back, np.linspace(0.5, 9.5, 20))


@pytest.mark.parametrize("turns", [1.5, -1.5])
def test_angles_that_wrap_in_a_table_do_not_in_the_reference(tmp_path: Path, turns: float) -> None:
    """A base and a joint without limits that turn once and a half, written within ±π."""
    robot = rpctl.load(write(tmp_path, platform(SET_A, extra=LIDAR)))
    angle, t = 2 * math.pi * turns * soft(), np.linspace(0.0, 10.0, 201)
    short = np.remainder(angle + math.pi, 2 * math.pi) - math.pi
    rows = np.column_stack([t, 0.0 * t, 0.0 * t, short, short])
    head, path = "t,x,y,theta,lidar_joint", tmp_path / "a.csv"
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.15g")
    back = read_back(robot, str(path))
    for k, at in enumerate(t):
        state = back(at)
        assert state.pose[2] == pytest.approx(angle[k], abs=1e-9)
        assert state.joints == pytest.approx([angle[k]], abs=1e-9)
    # The polynomial's slope midway is 35/16 of the mean one.
    fastest = 35.0 / 16.0 * angle[-1] / 10.0
    assert back(5.0).twist[2] == pytest.approx(fastest, rel=1e-4)
    assert back(5.0).joint_rates == pytest.approx([fastest], rel=1e-4)


def test_only_a_base_that_can_may_slide(tiago: Robot, tmp_path: Path) -> None:
    y = soft(41)
    path = table(tmp_path / "a.csv", 0.0 * y, y, 0.5 * y)
    with pytest.raises(DescriptionError) as told:
        load_reference(tiago, path)
    first = told.value.findings[0]
    assert first.line is not None
    assert "tiago would have to slide sideways at 0.0" in first.message
    assert 5 < first.line < 20
    slides = read_back(rpctl.load("mecanum"), path)
    assert slides(5.0).twist[1] > 0.1
    check_derivatives(slides, np.linspace(0.5, 9.5, 20))


@pytest.mark.slow
def test_an_end_effector_alone_has_a_base_planned(tiago: Robot, tmp_path: Path) -> None:
    reference = reference_by_name(tiago, "eight")
    columns, times = ["t", "ee_x", "ee_y", "ee_z"], np.arange(0.0, END + 1e-9, 0.05)
    back = read_back(tiago, written(tiago, reference, tmp_path / "a.csv", columns, times))
    arm = Arm(tiago)
    for t in np.linspace(0.0, END - 1.0, 80):
        was, now = reference(t), back(t)
        wanted = arm.end_effector_pose(was.pose, was.joints[arm.joints]).translation
        found = arm.end_effector_pose(now.pose, now.joints[arm.joints]).translation
        assert np.linalg.norm(found - wanted) < 1e-3
        assert now.twist[1] == 0.0
        for joint, position, rate in zip(tiago.joints, now.joints, now.joint_rates, strict=True):
            assert joint.lower <= position <= joint.upper
            assert abs(rate) <= joint.velocity


@pytest.mark.slow
def test_an_orientation_is_met(tmp_path: Path) -> None:
    robot = rpctl.load("panda")
    arm, t = Arm(robot), np.linspace(0.0, 4.0, 81)
    middle = arm.comfortable_posture(None)
    q = middle + 0.2 * np.outer(soft(81), np.ones(len(middle))) * arm.half_range
    import pinocchio as pin

    poses = [arm.end_effector_pose(np.zeros(3), row) for row in q]
    quaternions = [pin.Quaternion(pose.rotation).coeffs() for pose in poses]
    rows = np.column_stack([t, [pose.translation for pose in poses], quaternions])
    head = "t,ee_x,ee_y,ee_z,ee_qx,ee_qy,ee_qz,ee_qw"
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=head, comments="", fmt="%.12g")
    back = read_back(robot, str(tmp_path / "a.csv"))
    for k in range(0, 81, 8):
        found = arm.end_effector_pose(np.zeros(3), back(float(t[k])).joints[arm.joints])
        assert np.linalg.norm(pin.log6(found.actInv(poses[k])).vector) < 5e-3


GOOD = "\n".join(f"{0.1 * k:.1f},{0.01 * k * k:.4f},0" for k in range(8))
FAULTS = {
    "": "a.csv: error: empty; give a header such as t,x,y,theta, and rows",
    "t,x,y": "a.csv:1: error: 0 rows; give 6 or more",
    "t\n1": "a.csv:1: error: there are only times; add x,y or ee_x,ee_y,ee_z or joints",
    f"x,y\n{GOOD}": "a.csv:1: error: there is no column t; add the time in s",
    f"t,x,z\n{GOOD}": 'a.csv:1: error: column "z" is not known; columns are t, x, y, theta',
    f"t,x,thet\n{GOOD}": 'a.csv:1: error: column "thet" is not known; did you mean theta?',
    f"t,x\n{GOOD}": "a.csv:1: error: column y is missing beside x; add it",
    f"t,x,x,y\n{GOOD}": 'a.csv:1: error: column "x" occurs 2 times; keep one',
    f"t,theta\n{GOOD}": "a.csv:1: error: column theta needs x, y beside it; add them",
    f"t,x,y\n{GOOD}\n0.8,1": "a.csv:10: error: 2 entries, but the header has 3; complete",
    f"t,x,y\n{GOOD}\n0.8,nan,0": 'a.csv:10: error: x "nan" is not finite; give a finite number',
    f"t,x,y\n{GOOD}\n0.8,1m,0": 'a.csv:10: error: x "1m" is not a number: leave out the unit',
    f"t,x,y\n{GOOD}\n0.8,,0": "a.csv:10: error: x is empty; give a number or leave the row out",
    f"t,x,y\n{GOOD}\n0.7,1,0": "a.csv:10: error: t is 0.7 after 0.7; times must increase",
    f"# made by hand\n\nt,x,y\n{GOOD}\n0.2,1,0": "a.csv:12: error: t is 0.2 after 0.7",
    f"t,x,y\n{GOOD}\n0.8,1e9,0": "a.csv:10: error: x is 1e+09, which is too large",
    f"t,x,y\n{GOOD[:25]}\n": "rows; give 6 or more",
    't,x,y\n0,"1\n2': "a.csv:2: error: not CSV: unexpected end of data in a cell with quotation",
    "t,ee_x,ee_y,ee_z,ee_qx,ee_qy,ee_qz,ee_qw\n0,1,0,1,0,0,0,2": "a.csv:2: error: the quaternion "
    "ee_qx, ee_qy, ee_qz, ee_qw has length 2; scale it to length 1",
    f"t,ee_x,ee_y\n{GOOD}": "a.csv:1: error: column ee_z is missing beside ee_x; add it",
    f"t,theta1_joint,x\n{GOOD}": "column y is missing beside x",
}


@pytest.mark.parametrize("text", FAULTS)
def test_bad_tables_are_told(text: str, tmp_path: Path, paper: Robot) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(DescriptionError) as told:
        load_reference(paper, str(path))
    assert FAULTS[text] in str(told.value)


@pytest.mark.parametrize(
    ("name", "head", "told"),
    [
        ("panda", "t,x,y", "a.csv:1: error: panda has a fixed base; leave out x, y, theta"),
        ("paper", "t,theta1,eta", "column"),
    ],
)
def test_tables_that_do_not_fit_a_robot(name: str, head: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"{head}\n{GOOD}")
    with pytest.raises(DescriptionError) as error:
        load_reference(rpctl.load(name), str(path))
    assert told in str(error.value)


def test_caps_bound_a_table(tmp_path: Path, paper: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"t,x,y\n{GOOD}")
    monkeypatch.setenv("RPCTL_MAX_ROWS", "5")
    with pytest.raises(DescriptionError, match="over 5 rows; thin it out, or"):
        load_reference(paper, str(path))
    monkeypatch.setenv("RPCTL_MAX_BYTES", "20")
    with pytest.raises(DescriptionError, match="over 20 bytes"):
        load_reference(paper, str(path))
    with pytest.raises(DescriptionError, match=r"none\.csv: error: No such file"):
        load_reference(paper, "none.csv")
    (tmp_path / "b.csv").write_bytes(b"t,x,\xff")
    with pytest.raises(DescriptionError, match="not UTF-8"):
        read_table(tmp_path / "b.csv")
