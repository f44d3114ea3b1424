"""Tables as other programs write them, such as no robot can follow, and what they ask of one."""

from __future__ import annotations

import json
import math
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, set_limits
from rpctl.arrays import Array
from rpctl.errors import DescriptionError
from rpctl.reference.fitting import effort_usage, sample
from rpctl.reference.load import load_reference
from rpctl.reference.recorded.recording import RecordedPath, Recording, base_limits
from rpctl.reference.recorded.table_file import MAX_LINE, read_table
from rpctl.robot.losses import Losses
from tests.reference.test_noisy_tables import soft

HEADER = "t,x,y,theta"
ROWS = [f"{0.1 * k:.1f},{0.05 * k:.2f},0.5,0.0" for k in range(8)]
TABLE = "\n".join([HEADER, *ROWS])


def faults(path: Path, text: str, robot: Robot | None = None) -> list[str]:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        read_table(path) if robot is None else load_reference(robot, str(path))
    return [line.removeprefix(f"{path}:") for line in str(caught.value).splitlines()]


@pytest.mark.parametrize(
    ("separator", "comma", "name"),
    [(";", ".", "semicolons"), (";", ",", "semicolons"), ("\t", ",", "tabs"), ("|", ".", "bars"),
     (" ", ".", "blanks")],
)  # fmt: skip
def test_another_separator_is_named_with_a_command_that_mends_it(
    separator: str, comma: str, name: str, tmp_path: Path
) -> None:
    text = TABLE.replace(".", "·").replace(",", separator).replace("·", comma)
    (fault,) = faults(tmp_path / "FILE", text + "\n")
    assert fault.startswith(f"1: error: columns are separated by {name}; use commas")
    command = fault[fault.index("tr ") :].removesuffix(" does")
    subprocess.run(command, shell=True, check=True, cwd=tmp_path)
    mended = read_table(tmp_path / "NEW.csv")
    np.testing.assert_allclose(mended.stack(["x", "y"])[3], [0.15, 0.5], atol=1e-12)


@pytest.mark.parametrize("blank", ["", " "])
def test_a_quoted_table_is_read(blank: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    lines = (f'"{line}"'.replace(",", f'",{blank}"') for line in TABLE.split("\n"))
    path.write_text("\n".join(lines))
    assert read_table(path).columns["x"][7] == 0.35


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_lines_are_counted_however_they_end(end: str, mark: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    lines = ["# by hand", "", HEADER, *ROWS[:3], ",,,", "# half way", *ROWS[3:]]
    path.write_bytes((mark + end.join(lines)).encode())
    assert read_table(path).lines == (4, 5, 6, 9, 10, 11, 12, 13)


@pytest.mark.parametrize(
    ("header", "told"),
    [
        ("Time,X,Y,yaw", ["Time: t", "X: x", "Y: y", "yaw: theta"]),
        ("t [s],x [m],y (m),theta [rad]", ["t [s]: t", "x [m]: x", "y (m): y",
         "theta [rad]: theta"]),
        ("Zeit,x,y,heading", ["Zeit: t", "heading: theta"]),
    ],
)  # fmt: skip
def test_columns_by_other_names_are_told_theirs(
    header: str, told: list[str], tmp_path: Path
) -> None:
    found = faults(tmp_path / "a.csv", "\n".join([header, *ROWS]))
    for pair in told:
        name, meant = pair.split(": ")
        assert f'1: error: column "{name}" is not known; did you mean {meant}?' in found


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (",".join("c" * 300), "1: error: 300 columns; at most 200 are allowed; to allow it, set "
                              "RPCTL_MAX_COLUMNS"),
        (f"{TABLE}\n{'0,' * MAX_LINE}", f"10: error: a row of {2 * MAX_LINE} characters; at "
         f"most {MAX_LINE}"
         " are allowed; give only t"),
        (f"{TABLE}\n{'0,' * 250}", "10: error: 251 columns; at most 200 are allowed"),
        (f"{TABLE}\n900000,1,0,0", "10: error: t is 900000, over 86400 s after the first row; "
                                   "use seconds; to allow it, set RPCTL_MAX_REFERENCE_SECONDS"),
        (f"{TABLE}\n0.9;1;0;0", "10: error: 1 entries, but the header has 4: columns are sep"),
        (f"{TABLE}\n\0,1,0,0", r'10: error: t "\x00" is not a number'),
    ],
)  # fmt: skip
def test_rows_beyond_all_bounds_are_told_by_their_lines(
    text: str, told: str, tmp_path: Path
) -> None:
    (fault,) = faults(tmp_path / "a.csv", text)
    assert fault.startswith(told)


def test_the_robot_s_own_limits_say_what_is_impossible(tmp_path: Path, paper: Robot) -> None:
    """Wheels of 0.15 m at 12 rad/s: 1.8 m/s; at 0.75 m from the middle: 2.4 rad/s."""
    assert base_limits(paper) == pytest.approx((1.8, 2.4))
    (fault,) = faults(tmp_path / "a.csv", f"{TABLE}\n0.8,2.2,0.5,0", paper)
    assert fault == (
        "10: error: x, y move at 18.5 m/s from the row before, where paper's limit is 1.8; use s, "
        "m and rad, or correct the row"
    )
    (fault,) = faults(tmp_path / "a.csv", f"{TABLE}\n0.8,0.4,0.5,-2.5", paper)
    assert "theta turns at 25 rad/s from the row before, where paper's limit is 2.4" in fault


@pytest.mark.parametrize(
    ("name", "drive", "turn"),
    [
        ("mecanum", 16.0 / math.hypot(8.0, 8.0), 16.0 / 4.48),  # rollers at 45 degrees
        ("omni", 20.0 * 0.07, 6.087),
        ("car", 35.0 * 0.14, 35.0 * 0.14 / 0.26),  # of the rear wheels, half their track
        ("swerve", 22.0 * 0.09, math.inf),  # every wheel may stand across the turn
        ("casters", 18.0 * 0.09, 18.0 * 0.09 / 0.2),
    ],
)
def test_the_limits_of_every_drive_are_those_of_its_wheels(
    name: str, drive: float, turn: float
) -> None:
    assert base_limits(rpctl.load(name)) == pytest.approx((drive, turn), rel=1e-4)


def test_a_trajectory_becomes_a_table(tmp_path: Path) -> None:
    """The command that the message gives makes the table that is read."""
    path = tmp_path / "trajectory.txt"
    rows = [f"{1.6e9 + 0.1 * k} {0.1 * k} 0.5 0.2 0 0 {math.sin(0.1 * k)} {math.cos(0.1 * k)}"
            for k in range(8)]  # fmt: skip
    path.write_text("\n".join(["# timestamp tx ty tz qx qy qz qw", *rows]))
    with pytest.raises(
        DescriptionError, match="a trajectory of time, position and quaternion"
    ) as e:
        read_table(path)
    (command,) = re.findall(r"as (\(echo .*NEW\.csv) does", str(e.value))
    subprocess.run(
        command.replace("FILE", path.name).replace("NEW", "new"),
        shell=True, check=True, cwd=tmp_path,
    )  # fmt: skip
    table = read_table(tmp_path / "new.csv")
    np.testing.assert_allclose(table.columns["theta"], 0.2 * np.arange(8), atol=1e-5)
    np.testing.assert_allclose(table.columns["x"], 0.1 * np.arange(8), atol=1e-9)
    np.testing.assert_allclose(table.columns["y"], 0.5)


FIRST = 4  # line of the first row: comments and the header stand above


def recording_of(robot: Robot, path: Path, columns: str, *values: Array) -> Recording:
    """Return what is told of a table, whose times are the first values."""
    head = f"# recorded\n\n{columns}"
    rows = np.column_stack(values)
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.12g")
    found = load_reference(robot, str(path))
    assert isinstance(found, RecordedPath)
    assert found.recording is not None
    return found.recording


def line(t: Array, share: float, distance: float) -> Array:
    """Return x (K,) of a base that goes a distance in the given share of the time, its middle."""
    return distance * soft((t / t[-1] - 0.5) / share + 0.5)


TIMES = np.linspace(0.0, 10.0, 201)


def test_a_speed_beyond_the_wheels_is_told_by_row(paper: Robot, tmp_path: Path) -> None:
    """The largest slope of the polynomial is 35/16 of the mean: 3 m in 2.5 s are 2.625 m/s."""
    robot = set_limits(paper, effort={"*": 1e9})
    x = line(TIMES, 0.25, 3.0)
    found = recording_of(robot, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    assert [each.joint for each in found.demands] == ["wheel_left_joint", "wheel_right_joint"]
    for each in found.demands:
        assert (each.quantity, each.unit, each.limit) == ("velocity", "rad/s", 12.0)
        assert each.value == pytest.approx(35.0 / 16.0 * 3.0 / 2.5 / 0.15, rel=1e-4)
        assert each.ratio == pytest.approx(each.value / 12.0)
        assert each.time == pytest.approx(5.0, abs=0.02)
        assert each.line in (FIRST + 99, FIRST + 100)
        (beyond,) = each.stretches
        speed = np.gradient(x, TIMES)
        rows = np.flatnonzero(speed > 1.8)
        assert beyond.start == pytest.approx(TIMES[rows[0]], abs=0.06)
        assert beyond.end == pytest.approx(TIMES[rows[-1]], abs=0.06)
        assert abs(beyond.first_line - FIRST - rows[0]) <= 1
        assert abs(beyond.last_line - FIRST - rows[-1]) <= 1


def test_an_effort_is_that_of_the_inverse_dynamics(paper: Robot, tmp_path: Path) -> None:
    """On a line two wheels share M ẍ: τ = M r ẍ/2."""
    weak = set_limits(paper, effort={"wheel_right_joint": 0.5})
    x = line(TIMES, 1.0, 4.0)
    found = recording_of(weak, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    home = weak.configuration(joints=dict(zip(weak.joint_names, weak.home, strict=True)))
    mass = ReducedDynamics(weak).inertia(home)[0, 0]
    (demand,) = [each for each in found.demands if each.quantity == "effort"]
    bend = np.abs(np.diff(soft(np.linspace(0.0, 1.0, 100001)), 2)).max() * 1e10
    assert demand.joint == "wheel_right_joint"
    assert abs(demand.value) == pytest.approx(0.5 * mass * 0.15 * 4.0 * bend / 100.0, rel=1e-2)
    assert len(demand.stretches) == 2  # it speeds up, and it brakes
    assert "in 2 stretches" in demand.sentence
    assert f"(line {demand.line})" in demand.sentence


def test_within_the_limits_nothing_is_told(paper: Robot, tmp_path: Path) -> None:
    x = line(TIMES, 1.0, 2.0)
    found = recording_of(paper, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    assert (found.demands, found.jumps, found.changes, found.warnings) == ((), (), (), ())


def test_a_jump_is_told_by_its_row(paper: Robot, tmp_path: Path) -> None:
    x = line(TIMES, 1.0, 2.0)
    x[120:] += 0.4
    found = recording_of(paper, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    (jump,) = found.jumps
    assert (jump.columns, jump.line, jump.unit) == ("x, y move", FIRST + 120, "m/s")
    assert jump.time == pytest.approx(6.0)
    assert jump.speed == pytest.approx((x[120] - x[119]) / 0.05)
    assert jump.pace == pytest.approx(np.diff(x)[130] / 0.05, rel=0.3)
    assert found.warnings[0] == jump.sentence
    assert f"line {FIRST + 120}: x, y move at" in jump.sentence


def test_json_says_all_of_it(paper: Robot, tmp_path: Path) -> None:
    x = line(TIMES, 0.25, 3.0)
    x[20:] += 0.4
    found = recording_of(paper, tmp_path / "a.csv", "t,x,y", TIMES, x, 0.0 * x)
    told = json.loads(json.dumps(found.to_dict()))
    assert told["smooth"] is None
    assert told["retimed"] is None
    assert told["smoothed"] == []
    assert [each["joint"] for each in told["demands"]] == [each.joint for each in found.demands]
    first = told["demands"][0]
    assert first["ratio"] == pytest.approx(found.demands[0].ratio)
    assert first["stretches"][0]["first_line"] == found.demands[0].stretches[0].first_line
    assert told["jumps"][0]["line"] == FIRST + 20
    assert math.isfinite(told["jumps"][0]["speed"])
    assert told["sentence"] == "; ".join(found.warnings)


def test_dry_friction_takes_of_a_limit_and_not_of_a_motion(tmp_path: Path) -> None:
    """A limit of 30 N m of which friction takes 10: what motion alone takes is of 20."""
    robot = rpctl.load("paper")
    first = robot.model.getJointId("wheel_left_joint")
    entry = robot.model.joints[first].idx_v
    assert robot.losses is None
    bare = set_limits(robot, effort={"wheel_left_joint": 20.0})
    friction = np.zeros(robot.nv)
    friction[entry] = 10.0
    losses = Losses(np.zeros(robot.nv), friction, np.full(robot.nv, 1e-6))
    dry = replace(set_limits(robot, effort={"wheel_left_joint": 30.0}), losses=losses)
    shares = []
    for each in (bare, dry):
        dynamics = ReducedDynamics(each)
        reference: Any = load_reference(each, "circle")
        samples = sample(each, reference(np.linspace(1.0, 5.0, 9)))
        usages = effort_usage(dynamics, samples, np.zeros(len(each.actuators)))
        shares.append(next(u.ratio for u in usages if u.joint == "wheel_left_joint"))
    assert shares[0] == pytest.approx(shares[1], rel=1e-6)
    assert shares[0] > 0.01
