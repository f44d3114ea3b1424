"""The verdict's borders, by results written by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from rpctl.study.cells import Figures
from rpctl.study.stress_report import (
    error_text,
    judge,
    rule,
)

GOOD = Figures("tracked", "on its way", late_base=0.004, late_end_effector=0.010)
TOLERANCE = 0.010


@pytest.mark.parametrize(
    ("change", "verdict", "reason"),
    [
        ({}, "pass", "10 mm from its reference"),
        ({"late_end_effector": None}, "pass", "4 mm from its reference"),
        ({"late_end_effector": 0.0101}, "degrade", "10.1 mm from its reference"),
        ({"late_base": 0.0101, "late_end_effector": None}, "degrade", "10.1 mm"),
        ({"outcome": "late"}, "degrade", "late: on its way"),
        ({"would_slip": True}, "degrade", "its wheels would slip"),
        ({"tilt": math.radians(9.9)}, "pass", "10 mm"),
        ({"tilt": 0.5, "late_base": 0.5}, "fail", "tipped over: it leaned 29 degrees"),
        ({"would_tip": True, "would_slip": True}, "fail", "it would tip over"),
        ({"violations": ("a effort", "b upper")}, "fail", "broke a effort, b upper"),
        ({"outcome": "late", "violations": ("a effort",)}, "fail", "broke a effort"),
        ({"late_base": math.nan, "late_end_effector": None}, "fail", "its error is not finite"),
        ({"late_base": 0.001, "late_end_effector": math.nan}, "fail", "not finite"),
        ({"late_base": None, "late_end_effector": None}, "fail", "its error is not finite"),
        ({"violations": (*"abcd",)}, "fail", "broke a, b, c and 1 more"),
        (
            {"outcome": "stuck", "lifted_wheels": ("a", "b"), "hanging_wheels": ("a",)},
            "fail",
            "stuck: on its way; a carried no load from the start",
        ),
        ({"outcome": "late", "lifted_wheels": ("a",)}, "degrade", "late: on its way; a lifted"),
        ({"late_base": 0.02, "lifted_wheels": ("a",)}, "degrade", "20 mm from its reference; a l"),
        ({"lifted_wheels": ("a",)}, "pass", "10 mm from its reference"),
        ({"outcome": "ended"}, "fail", "ended: on its way"),
        ({"outcome": "refused"}, "refused", "on its way"),
    ]
    + [({"outcome": each}, "fail", each) for each in ("stuck", "diverging", "collided")],
)
def test_each_border(change: dict[str, Any], verdict: str, reason: str) -> None:
    found = judge(replace(GOOD, **change), TOLERANCE)
    assert found.name == verdict
    assert found.reason.startswith(reason) or found.reason.endswith(reason)


def test_the_rule_is_told_with_its_bound() -> None:
    assert "within 12.5 mm of their references" in rule(0.0125)
    for word in ("pass: ", "degrade: ", "fail: ", "stuck, diverging, collided, ended early"):
        assert word in rule(0.0125)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (1.2e-5, "0.01"), (9.94e-4, "0.99"), (3.7e-3, "3.70"), (9.994e-3, "9.99"),
        (9.996e-3, "10.0"), (0.0999, "99.9"), (0.09996, "100"), (0.0123456, "12.3"),
        (0.9994, "999"), (0.9996, "1.0 m"), (9.94, "9.9 m"), (9.96, "10 m"), (999.4, "999 m"),
        (1e4, "> km"), (math.inf, ""), (math.nan, ""),
    ],
)  # fmt: skip
def test_an_error_takes_five_characters(error: float, text: str) -> None:
    assert error_text(error) == text
    assert len(text) <= 5
