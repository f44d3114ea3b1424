"""The head of generated code tells what each number is, and in which unit."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import rpctl
from rpctl import Robot
from rpctl.derive.write import c_source, python_source
from tests.golden import TRICYCLE
from tests.robots import write
from tests.vehicles import vehicle

# Positions in the order in which the code takes them: actuated joints, then the others.
HEAD = {
    "q[0]": ("left_wheel_joint", "rad"),
    "q[1]": ("right_wheel_joint", "rad"),
    "q[2]": ("steer_joint", "rad"),
    "q[3]": ("swing_joint", "rad"),
    "q[4]": ("slide_joint", "m"),
    "q[5]": ("front_wheel_joint", "rad"),
    "nu[0]": ("v", "m/s"),
    "nu[1]": ("steer_joint", "rad/s"),
    "nu[2]": ("swing_joint", "rad/s"),
    "nu[3]": ("slide_joint", "m/s"),
    "tau[0]": ("left_wheel_joint", "N m"),
    "tau[1]": ("right_wheel_joint", "N m"),
    "tau[2]": ("steer_joint", "N m"),
    "tau[3]": ("swing_joint", "N m"),
    "tau[4]": ("slide_joint", "N"),
}


def heads(robot: Robot) -> list[dict[str, tuple[str, str]]]:
    """Return what the heads of the C and of the Python code list, by symbol and index."""
    row = re.compile(r"^(?: \*)? +((?:q|nu|tau)\[\d+\])  (\S+)  \[(.+)\]$", re.MULTILINE)
    texts = (c_source(robot).partition("#include")[0], python_source(robot).partition("import")[0])
    return [{symbol: (name, unit) for symbol, name, unit in row.findall(text)} for text in texts]


def test_units_of_a_car_with_an_arm_that_turns_and_slides(tricycle: Robot) -> None:
    assert heads(tricycle) == [HEAD, HEAD]
    for source in (c_source(tricycle), python_source(tricycle)):
        assert "M (4 x 4) and B (4 x 5) row by row." in source
        assert "SI units; gravity is 9.81 m/s2 along -z." in source


def test_units_of_a_base_that_moves_to_any_side(tmp_path: Path) -> None:
    for head in heads(rpctl.load(write(tmp_path, vehicle("omni")))):
        units = {name: unit for symbol, (name, unit) in head.items() if symbol.startswith("nu")}
        assert units == {"vx": "m/s", "vy": "m/s", "omega": "rad/s", "arm_joint": "rad/s"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["v", "omega"])
def test_a_joint_called_as_a_speed_is_a_joint(tmp_path: Path, name: str) -> None:
    text = TRICYCLE.replace("swing_joint", name)
    for head in heads(rpctl.load(write(tmp_path, text))):
        assert (head["q[3]"], head["nu[2]"], head["tau[3]"]) == (
            (name, "rad"), (name, "rad/s"), (name, "N m"),
        )  # fmt: skip
        assert head["nu[0]"] == ("v", "m/s")
        assert head["nu[1]"] == ("steer_joint", "rad/s")
