"""The speed table is written as it is measured, and the README's has the form of the writer's."""

from __future__ import annotations

import json
import re
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
from tests.bench.rows import Row, Section

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
