"""Answers about robots that are kept."""

from __future__ import annotations

from dataclasses import replace

from rpctl import Robot
from rpctl.reference.load import load_reference
from rpctl.robot.kept import kept


def test_the_last_answers_are_kept(paper: Robot, mixed_chain: Robot) -> None:
    asked: list[tuple[Robot, int]] = []

    @kept(2)
    def found(robot: Robot, number: int = 1) -> int:
        asked.append((robot, number))
        return number

    like = replace(paper)  # equal, but another one
    for robot, number in ((paper, 1), (paper, 1), (paper, 2), (paper, 1), (like, 1), (paper, 2)):
        assert found(robot, number) == number
    assert asked == [(paper, 1), (paper, 2), (like, 1)]
    found(mixed_chain)
    found(paper, number=2)
    assert asked[3:] == [(mixed_chain, 1), (paper, 2)]


def test_a_named_reference_is_sized_once(paper: Robot) -> None:
    known = load_reference(paper, "eight", size=2.0)
    assert load_reference(paper, "eight", size=2.0) is known
    assert load_reference(paper, "eight", size=3.0) is not known
    assert load_reference(replace(paper), "eight", size=2.0) is not known
