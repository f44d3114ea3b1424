"""Efforts that a scenario leaves, and the order in which controllers are listed, by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl.control.registry import KINEMATIC_LAWS
from rpctl.reference.named import reference_by_name
from rpctl.study.compare import LAW_PAIRS, SCENARIOS, LawPair, controllers
from tests.robots import SET_A, platform, write

LIFT = """<link name="load"><inertial><mass value="2"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="load"/>
  <origin xyz="0 0 0.5"/><axis xyz="0 0 {up}"/>
  <limit lower="-0.2" upper="0.4" effort="{effort}" velocity="1"/></joint>"""
WHEEL = '<axis xyz="0 1 0"/>'


@pytest.mark.parametrize("up", [1, -1])
@pytest.mark.parametrize(("effort", "left"), [(50.0, 25.0 + 0.5 * 2 * 9.81), (10.0, 10.0)])
def test_half_of_what_holding_leaves(tmp_path: Path, up: int, effort: float, left: float) -> None:
    """A lift that bears 19.62 N, pushing or pulling; wheels hold nothing. One too weak stays."""
    text = platform(SET_A, extra=LIFT.format(up=up, effort=effort))
    text = text.replace(WHEEL, f'{WHEEL}<limit effort="8" velocity="9"/>')
    robot = rpctl.load(write(tmp_path, text))
    case = SCENARIOS["half-limits"].make(robot, reference_by_name(robot, "line"))
    limits = dict(zip(robot.actuators, case.robot.effort_limits, strict=True))
    assert limits == pytest.approx({"left_joint": 4.0, "right_joint": 4.0, "lift": left})
    assert case.plant == rpctl.Plant()


def test_all_kinematic_laws_are_there_when_none_is_asked_for() -> None:
    """The pairs that are compared come first; a law of none of them has the bounded one."""
    found = controllers()
    assert {pair.kinematic for pair in found} == set(KINEMATIC_LAWS)
    assert found[: len(LAW_PAIRS)] == list(LAW_PAIRS)
    assert {pair.dynamic for pair in found[len(LAW_PAIRS) :]} <= {"bounded"}


def test_who_is_asked_for_twice_is_listed_once() -> None:
    """Unlisted pairs come last, in the order they were asked for."""
    asked = ["kanayama+integral", "paper+bounded", "paper", "paper"]
    assert controllers(asked) == [
        LawPair("paper", "paper"),
        LawPair("kanayama", "integral"),
        LawPair("paper", "bounded"),
    ]
