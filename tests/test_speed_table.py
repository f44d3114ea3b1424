"""The speed table is written as it is measured, and the README's has the form of the writer's."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.readme_table import (
    BEGIN,
    END,
    HEAD,
    README,
    SHOWN,
    in_readme,
    readme_table,
    rewrite,
)
from tests.bench.rows import Row, Section, in_words, markdown

SLOWER = Row("`rpctl verify tiago`", 4.0, "s", "rpctl verify tiago", goal=2.0)
FASTER = Row(
    "the loop with its log, compiled", 300.0, "times real time", "track", "MuJoCo", 60.0, 250.0
)
TIMED = Row("tiago: machine code, 1 lane", 0.4, "µs", "growth", "Python", 10.0, ratio_goal=20.0)
TABLE = [Section("One", (FASTER, TIMED), "A note."), Section("Other", (SLOWER,))]


def numbers(cell: str) -> float:
    """Return the number that a cell begins with."""
    return float(re.match(r"[\d.,e+-]+", cell)[0].replace(",", ""))  # type: ignore[index]


def cells(table: str) -> list[list[str]]:
    """Return the cells of a table in Markdown."""
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in table.splitlines()]


def test_better_is_a_larger_ratio_in_every_unit() -> None:
    assert FASTER.ratio == 5.0
    assert TIMED.ratio == 25.0
    assert math.isnan(SLOWER.ratio)


@pytest.mark.parametrize(
    ("row", "met"),
    [
        (SLOWER, False),
        (replace(SLOWER, figure=2.0), True),
        (FASTER, True),
        (replace(FASTER, figure=249.0), False),
        (TIMED, True),
        (replace(TIMED, figure=0.6), False),
        (replace(TIMED, ratio_goal=None), None),
    ],
)
def test_a_goal_is_met_or_not(row: Row, met: bool | None) -> None:
    assert row.met is met
    assert ("(missed)" in markdown([Section("", (row,))], "")) is (met is False)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.05341, "0.0534"),
        (271.9, "272"),
        (1.0, "1.00"),
        (9.999, "10.0"),
        (104857.0, "105,000"),
        (2e-5, "2.00e-05"),
        (0.0, "0"),
    ],
)
def test_figures_have_three_digits(value: float, words: str) -> None:
    assert in_words(value) == words


def test_what_is_written_is_read() -> None:
    text = json.dumps([section.to_dict() for section in TABLE], allow_nan=False)
    again = [Section.from_dict(each) for each in json.loads(text)]
    assert repr(again) == repr(TABLE)
    assert json.loads(text)[0]["rows"][0]["ratio"] == 5.0


def test_the_readme_has_the_writers_table() -> None:
    head, rule, *lines = cells(in_readme(README.read_text(encoding="utf-8")))
    assert head == [*HEAD]
    assert set(rule) == {"---"}
    assert [line[0] for line in lines] == [shown.text for shown in SHOWN]
    for _, own, its, ratio in lines:
        assert bool(its) == bool(ratio)
        if ratio:
            quotients = numbers(its) / numbers(own), numbers(own) / numbers(its)
            assert numbers(ratio) == pytest.approx(quotients["real time" in own], rel=0.02)


def test_only_the_table_is_rewritten(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}old\n{END}after\n", encoding="utf-8")
    for _ in range(2):
        rewrite(TABLE, readme)
    table = readme_table(TABLE)
    assert readme.read_text(encoding="utf-8") == f"before\n{BEGIN}{table}{END}after\n"
    assert cells(table)[2:] == [
        ["forward step, machine code", "0.400 µs", "10.0 µs (in Python)", "25.0×"],
        [
            "closed loop at 2 ms with its log",
            "300 times real time",
            "60.0 times real time (MuJoCo, controller in Python)",
            "5.00×",
        ],
        ["`rpctl verify tiago`, whole process", "4.00 s", "", ""],
    ]


@pytest.mark.parametrize(
    "text", ["", BEGIN, END + BEGIN, BEGIN + END + BEGIN + END, END + BEGIN + END]
)
def test_a_readme_without_its_markers_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="needs one <!-- speed table -->"):
        in_readme(text)
