"""Answers about robots that are kept."""

from __future__ import annotations

from dataclasses import replace

from rpctl import Robot
from rpctl.reference.load import load_reference


def test_a_named_reference_is_sized_once(paper: Robot) -> None:
    known = load_reference(paper, "eight", size=2.0)
    assert load_reference(paper, "eight", size=2.0) is known
    assert load_reference(paper, "eight", size=3.0) is not known
    assert load_reference(replace(paper), "eight", size=2.0) is not known  # alike, yet another one
