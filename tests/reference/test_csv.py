"""Tables as spreadsheets and other programs write them, and such as no robot can follow."""

from __future__ import annotations

import math
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.errors import DescriptionError
from rpctl.reference.load import load_reference
from rpctl.reference.recorded.recording import base_limits
from rpctl.reference.recorded.table_file import MAX_LINE, read_table

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
    assert fault.startswith(f"1: error: separated by {name}; put commas between the columns")
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
        (",".join("c" * 300), "1: error: 300 columns; 200 are the most; if it is meant, set "
         "RPCTL_MAX_COLUMNS"),
        (f"{TABLE}\n{'0,' * MAX_LINE}", f"10: error: a row of {2 * MAX_LINE} characters; {MAX_LINE}"
         " are the most; keep to t"),
        (f"{TABLE}\n{'0,' * 250}", "10: error: 251 columns; 200 are the most"),
        (f"{TABLE}\n900000,1,0,0", "10: error: t is 900000, over 86400 s after the first row; use "
         "seconds; if it is meant, set RPCTL_MAX_REFERENCE_SECONDS"),
        (f"{TABLE}\n0.9;1;0;0", "10: error: 1 entries where the header names 4: separated by semi"),
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
        "m and rad, or mend the row"
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
